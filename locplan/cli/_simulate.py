"""The command that drives paths in simulated worlds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from locplan.cli._drive_options import DriveOptions
from locplan.cli._groups import (
    GENERAL,
    INPUT,
    DriveSeed,
    FilterMap,
    MapFiles,
    Pair,
    Text,
    command,
    option_group,
)
from locplan.cli._options import Computing, CostOptions, FieldOptions
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load_filter_map, read_paths, refuse, show, two_numbers
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.costs import Costmap
    from locplan.maps import OccupancyGrid
    from locplan.recordings import Recording
    from locplan.robots import Robot

app = command(
    "simulate",
    "simulate lab.yaml --start 2,3 --goal 38,3 -o driven",
    "simulate lab.yaml --path planned/shortest.csv --path mine.csv -o driven",
    "simulate lab.yaml --random 20 -o queries",
    "simulate lab.yaml --drive monday.mcap --robot nav2_params.yaml -o replayed",
)

DRIVES = 100
"""Number of drives along each path."""
LEAST_DISTANCE = 10.0
"""Least distance from start to goal of random queries [m]."""
OF_PLANS = ("preset", "disc", "template", "headings", "stride")
"""Settings of a field that is only planned on."""


@option_group(GENERAL)
class Driven:
    """The paths that are driven, and how often."""

    path: Annotated[tuple[Path, ...], INPUT, Parameter(metavar="CSV")] = ()
    """Path that is driven (x,y), as plan wrote it; repeatable."""
    start: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """Start of the shortest and the aware path, x,y in metres."""
    goal: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """Goal of both paths, x,y in metres."""
    random: Pair | None = None
    """Number of random queries on each map, in place of a start; 5 or more give intervals."""
    least_distance: float | None = None
    """Least distance from start to goal of random queries, in metres; 10 by default."""
    drives: Pair | None = None
    """Number of drives along each path; 100 by default, and 20 of a recorded drive."""

    @property
    def least(self) -> float:
        """Least distance from start to goal of random queries [m]."""
        return LEAST_DISTANCE if self.least_distance is None else self.least_distance

    def check(self, seed: int) -> None:
        """Raise a ConfigError unless one kind of paths was asked for; to be called early."""
        from locplan.planners import check_random

        asked = bool(self.path), bool(self.start or self.goal), self.random is not None
        if asked.count(True) != 1 or bool(self.start) != bool(self.goal):
            raise ConfigError("give one of --path, --start with --goal, --random, and --drive")
        if self.random is None:
            refuse("without --random", least_distance=self.least_distance)
        else:
            check_random(self.random, seed, self.least)

    def maps(self, maps: list[Path]) -> list[Path]:
        """The files of the maps; a ConfigError if there are several, and one path."""
        from locplan.maps import find_maps

        files = find_maps(*maps)
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
    from locplan.maps import load_map
    from locplan.recordings import Replay

    recorded.check()
    every: dict[str, Any] = {"seed": seed, "threads": computing.threads}
    if recorded.drive:
        _refuse_plans(driven, costs, options, computing)
        out.check(Replay.files)
        grid, recording = recorded.on_map(maps)
        every["filter_map"] = load_filter_map(filter_map, [grid])
        every |= {"runs": driven.drives} if driven.drives else {}
        _replay(grid, recording, robot_options, every, out)
        return
    driven.check(seed)
    if driven.path:
        unread = {name: value for name, value in vars(options).items() if name in OF_PLANS}
        refuse("with --path: no path is planned", **vars(costs), **unread)
    robot, config = options.simulated(robot_options)
    costs.check(config)
    every["drives"] = driven.drives or DRIVES
    grids = [load_map(file) for file in driven.maps(maps)]
    every["filter_map"] = load_filter_map(filter_map, grids)
    with computing.of(config) as compute:

        def costmap_of(grid: OccupancyGrid) -> Costmap:
            return costs.costmap(grid, compute(grid), robot)

        if driven.random is None:
            _along_paths(grids[0], driven, robot, costmap_of, every, out)
        else:
            _at_random(grids, driven, robot, costmap_of, every, out)


def _refuse_plans(
    driven: Driven, costs: CostOptions, options: FieldOptions, computing: Computing
) -> None:
    """Raise a ConfigError if an option of planned paths was given."""
    unread = {name: value or None for name, value in vars(driven).items() if name != "drives"}
    refuse("with --drive", **unread, **vars(costs), **vars(options))
    refuse("with --drive", scheduler=computing.scheduler, cache_dir=computing.cache_dir)


def _along_paths(
    grid: OccupancyGrid,
    driven: Driven,
    robot: Robot,
    costmap_of: Callable[[OccupancyGrid], Costmap],
    every: dict[str, Any],
    out: Output,
) -> None:
    """Drive the paths that were given, or the shortest and the aware one between two places."""
    from locplan import planners
    from locplan._util.progress import progress_bar
    from locplan.costs import Costmap
    from locplan.simulation import Simulation, simulate as drive

    out.check(Simulation.files)
    paths, costmap = read_paths(driven.path), None
    if driven.start and driven.goal:
        ends = two_numbers("start", driven.start), two_numbers("goal", driven.goal)
        planners.check_ends(Costmap.blank(grid, robot_radius=robot.radius), *ends)
        costmap = costmap_of(grid)
        plans = planners.plan_beside_shortest(costmap, *ends)
        paths = {name: plan.path for name, plan in plans.items() if plan.path is not None}
    if not paths:
        show(out.json, {"status": "unreachable"}, "unreachable: no path leads to the goal")
        return
    with progress_bar("simulating", "drives") as progress:
        result = drive(grid, paths, robot, costs=costmap, progress=progress, **every)
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
    from locplan._util.progress import progress_bar
    from locplan.planners import random_queries
    from locplan.simulation import RoutesOnMaps, simulate_queries

    out.check(RoutesOnMaps.files, *RoutesOnMaps.pictures([grid.name for grid in grids]))
    found = []
    for grid in grids:
        costmap = costmap_of(grid)
        queries = random_queries(
            costmap, driven.random or 0, every["seed"], least_distance=driven.least
        )
        with progress_bar(f"simulating in {grid.name}", "drives") as progress:
            found.append(simulate_queries(costmap, queries, robot, progress=progress, **every))
    result = RoutesOnMaps(tuple(found))
    out.finish(result)


def _replay(
    grid: OccupancyGrid,
    recording: Recording,
    robot_options: RobotOptions,
    every: dict[str, Any],
    out: Output,
) -> None:
    """Run AMCL on a recorded drive, and tell its errors against the recorded poses."""
    from locplan._util.progress import progress_bar
    from locplan.recordings import replay

    robot = robot_options.on_drive(recording)
    robot_options.warn(robot)
    with progress_bar("replaying", "runs") as progress:
        result = replay(recording, grid, robot, progress=progress, **every)
    out.finish(result)
