"""The command that drives paths in simulated worlds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import locplan
from locplan._util.progress import progress_bar
from locplan.cli._drive_options import DriveOptions
from locplan.cli._field_options import FieldOptions
from locplan.cli._groups import (
    XY,
    Csv,
    DriveSeed,
    FilterMap,
    MapFiles,
    Pair,
    command,
    option_group,
)
from locplan.cli._options import Computing, CostOptions
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load_filter_map, read_paths, refuse
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable

    from locplan import Costmap, OccupancyGrid, Robot

app = command(
    "simulate",
    "simulate lab.yaml --start 2,3 --goal 38,3 -o driven",
    "simulate lab.yaml --path planned/shortest.csv --path mine.csv -o driven",
    "simulate lab.yaml --random 20 -o queries",
    "simulate lab.yaml --drive monday.mcap --robot nav2_params.yaml -o replayed",
)


@option_group("Options")
class Driven:
    """The paths that are driven, and how often."""

    path: Csv = ()
    """Path that is driven (x,y), as plan wrote it; repeatable."""
    start: XY = None
    """Start of the shortest and the aware path, x,y in metres."""
    goal: XY = None
    """Goal of both paths, x,y in metres."""
    random: Pair | None = None
    """Number of random queries on each map, in place of a start; 5 or more give intervals."""
    min_distance: float | None = None
    """Minimum distance from start to goal of random queries, in metres; 10 by default."""
    drives: Pair | None = None
    """Number of drives along each path; 100 by default, and 20 of a recorded drive."""
    closed: Pair | None = None
    """Number of further drives along each path that are steered by the filter's pose, to see how
    many arrive; none by default."""
    replan: float | None = None
    """Time after which these plan anew in any case, in seconds; by default where something is in
    the way."""

    @property
    def distance(self) -> float:
        """Minimum distance from start to goal of random queries [m]."""
        return 10.0 if self.min_distance is None else self.min_distance

    def check(self, seed: int, **of_plans: object) -> None:
        """Raise a ConfigError unless one kind of paths was asked for; to be called early.

        With paths of one's own the options of planned ones are refused.
        """
        asked = bool(self.path), bool(self.start or self.goal), self.random is not None
        if asked.count(True) != 1 or bool(self.start) != bool(self.goal):
            raise ConfigError("give one of --path, --start with --goal, --random, and --drive")
        if self.random is not None:
            refuse("with --random", closed=self.closed)
        if self.closed is None:
            refuse("without --closed", replan=self.replan)
        if self.path:
            own = {"config": None, "estimator": None}  # they name the lidar, too
            refuse("with --path: no path is planned", **of_plans | own)
        if self.random is None:
            refuse("without --random", min_distance=self.min_distance)
        else:
            locplan.planners.check_random(self.random, seed, self.distance)

    def maps(self, maps: list[Path]) -> list[Path]:
        """The files of the maps; a ConfigError if there are several, and one path."""
        files = locplan.maps.find_maps(*maps)
        if self.random is None and len(files) > 1:
            raise ConfigError(
                f"one path is of one map: name one of these {len(files)}, or give --random"
            )
        return files


@app.default
def simulate(
    maps: MapFiles,
    /,
    *,
    driven: Driven = Driven(),
    recorded: DriveOptions = DriveOptions(),
    robot_options: RobotOptions = RobotOptions(),
    filter_map: FilterMap = None,
    seed: DriveSeed = 1,
    costs: CostOptions = CostOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    out: Output = Output(),
) -> None:
    """Drive paths with AMCL in simulated worlds: its error, and how often it is lost (> 1 m).

    With --drive, AMCL runs on the odometry and the scans of a recorded drive instead, and its
    errors are those against the recorded poses.
    """
    recorded.check()
    every: dict[str, Any] = {"seed": seed, "threads": computing.threads}
    if recorded.drive:
        unread = {name: value or None for name, value in vars(driven).items() if name != "drives"}
        unread |= {"scheduler": computing.scheduler, "cache_dir": computing.cache_dir}
        refuse("with --drive", **unread, **vars(costs), **vars(options))
        every["runs"] = driven.drives or 20
        return _replay(maps, recorded, robot_options, filter_map, every, out)
    driven.check(seed, **vars(costs), **vars(options))
    robot, config = options.simulated(robot_options)
    costs.check(config)
    grids = [locplan.load_map(file) for file in driven.maps(maps)]
    every |= {"drives": driven.drives or 100, "filter_map": load_filter_map(filter_map, grids)}
    with computing.of(config) as compute:

        def costmap_of(grid: OccupancyGrid) -> Costmap:
            return costs.costmap(grid, compute(grid), robot)

        drive = _along_paths if driven.random is None else _at_random
        drive(grids, driven, robot, costmap_of, every, out)


def _replay(
    maps: list[Path],
    recorded: DriveOptions,
    robot_options: RobotOptions,
    filter_map: Path | None,
    every: dict[str, Any],
    out: Output,
) -> None:
    """Run AMCL on a recorded drive, and show its errors against the recorded poses."""
    out.check(locplan.recordings.Replay.files)
    grid, recording = recorded.on_map(maps)
    every["filter_map"] = load_filter_map(filter_map, [grid])
    robot = robot_options.on_drive(recording)
    robot_options.warn(robot)
    with progress_bar("replaying", "runs") as progress:
        found = locplan.recordings.replay(recording, grid, robot, progress=progress, **every)
    out.finish(found)


def _along_paths(
    grids: list[OccupancyGrid],
    driven: Driven,
    robot: Robot,
    costmap_of: Callable[[OccupancyGrid], Costmap],
    every: dict[str, Any],
    out: Output,
) -> None:
    """Drive the paths that were given, or the shortest and the aware one between two places."""
    out.check(locplan.simulation.Simulation.files, *(["arrivals.csv"] if driven.closed else ()))
    (grid,) = grids
    paths, costmap = read_paths(driven.path), None
    if driven.start and driven.goal:
        ends = driven.start, driven.goal
        locplan.planners.check_ends(locplan.Costmap.blank(grid, robot=robot), *ends)
        costmap = costmap_of(grid)
        plans = locplan.planners.plan_beside_shortest(costmap, *ends)
        paths = {name: plan.path for name, plan in plans.items() if plan.path is not None}
    if not paths:
        out.show({"status": "unreachable"}, "unreachable: no path leads to the goal")
        return
    every |= {"closed": driven.closed or 0, "replan": driven.replan}
    with progress_bar("simulating", "drives") as progress:
        simulate = locplan.simulation.simulate
        result = simulate(grid, paths, robot, costs=costmap, progress=progress, **every)
    out.finish(result)


def _at_random(
    grids: list[OccupancyGrid],
    driven: Driven,
    robot: Robot,
    costmap_of: Callable[[OccupancyGrid], Costmap],
    every: dict[str, Any],
    out: Output,
) -> None:
    """Drive both paths of random queries on each map."""
    results = locplan.simulation.RoutesOnMaps
    out.check(results.files, *results.pictures([grid.name for grid in grids]))
    found = []
    for grid in grids:
        costmap = costmap_of(grid)
        queries = locplan.planners.random_queries(
            costmap, driven.random or 0, every["seed"], min_distance=driven.distance
        )
        with progress_bar(f"simulating in {grid.name}", "drives") as progress:
            simulate = locplan.simulation.simulate_queries
            found.append(simulate(costmap, queries, robot, progress=progress, **every))
    out.finish(results(tuple(found)))
