"""The commands that drive paths in simulated worlds, and that tune AMCL by such drives."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._util.progress import progress_bar
from locplan.cli._options import (
    Computing,
    CostOptions,
    DriveOptions,
    Output,
    load_filter_map,
    read_paths,
)
from locplan.cli._robot_options import FieldOptions, RobotOptions
from locplan.cli._types import (
    XY,
    Csv,
    DriveSeed,
    FilterMap,
    MapFile,
    MapFiles,
    Pair,
    Seeded,
    command,
    given_of,
    option_group,
    refuse,
)
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable

    from locplan import Costmap, OccupancyGrid, Robot


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
        if self.path:
            of_lidar = {"config": None, "estimator": None}  # they name the lidar, too
            refuse("with --path: no path is planned", **of_plans | of_lidar)
        if self.random is None:
            refuse("without --random", min_distance=self.min_distance)
        else:
            locplan.planners.check_random(self.random, seed, self.distance)

    def grids(self, maps: list[Path]) -> list[OccupancyGrid]:
        """The maps; a ConfigError if there are several, and one path."""
        files = locplan.maps.find_maps(*maps)
        if self.random is None and len(files) > 1:
            raise ConfigError(
                f"one path is of one map: name one of these {len(files)}, or give --random"
            )
        return [locplan.load_map(file) for file in files]


@command(
    "simulate lab.yaml --start 2,3 --goal 38,3 -o driven",
    "simulate lab.yaml --path planned/shortest.csv --path mine.csv -o driven",
    "simulate lab.yaml --random 20 -o queries",
    "simulate lab.yaml --drive monday.mcap --robot nav2_params.yaml -o replayed",
)
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
        of_fields = {"scheduler": computing.scheduler, "cache_dir": computing.cache_dir}
        unread = vars(driven) | of_fields | {"drives": None}
        refuse("with --drive", **unread, **vars(costs), **vars(options))
        out.check(locplan.recordings.Replay.files)
        grid, recording = recorded.on_map(maps)
        every |= {"runs": driven.drives or 20, "filter_map": load_filter_map(filter_map, [grid])}
        robot = robot_options.on_drive(recording)
        robot_options.warn(robot)
        with progress_bar("replaying", "runs") as progress:
            found = locplan.recordings.replay(recording, grid, robot, progress=progress, **every)
        return out.finish(found)
    driven.check(seed, **vars(costs), **vars(options))
    robot, config = options.simulated(robot_options)
    costs.check(config)
    grids = driven.grids(maps)
    every |= {"drives": driven.drives or 100, "filter_map": load_filter_map(filter_map, grids)}
    with computing.of(config) as compute:

        def costmap_of(grid: OccupancyGrid) -> Costmap:
            return costs.costmap(grid, compute(grid), robot)

        drive = _along_paths if driven.random is None else _at_random
        drive(grids, driven, robot, costmap_of, every, out)


def _along_paths(
    grids: list[OccupancyGrid],
    driven: Driven,
    robot: Robot,
    costmap_of: Callable[[OccupancyGrid], Costmap],
    every: dict[str, Any],
    out: Output,
) -> None:
    """Drive the paths that were given, or the shortest and the aware one between two places."""
    out.check(locplan.simulation.Simulation.files)
    (grid,) = grids
    paths, costmap = read_paths(driven.path), None
    if driven.start and driven.goal:
        ends = driven.start, driven.goal
        locplan.planners.check_ends(locplan.Costmap.blank(grid, robot_radius=robot.radius), *ends)
        costmap = costmap_of(grid)
        plans = locplan.planners.plan_beside_shortest(costmap, *ends)
        paths = {name: plan.path for name, plan in plans.items() if plan.path is not None}
    if not paths:
        out.show({"status": "unreachable"}, "unreachable: no path leads to the goal")
        return
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


@option_group("Options")
class Amount:
    """The number of drives."""

    paths: Annotated[int | None, Parameter(validator=Number(gte=5, lte=1000))] = None
    """Number of random paths of the search, and of the others on which its result is judged; 20 by
    default. The time grows with it."""
    drives: Pair = 8
    """Number of drives along each path, at each level of disturbance; 8 by default."""


@command(
    "tune lab.yaml --lidar turtlebot4 -o tuned",
    "tune lab.yaml --lidar rplidar-a1 --robot nav2_params.yaml -o tuned",
    "tune lab.yaml --drive monday.mcap --robot nav2_params.yaml -o tuned",
)
def tune(
    map_file: MapFile,
    /,
    *,
    amount: Amount = Amount(),
    recorded: DriveOptions = DriveOptions(),
    robot_options: RobotOptions = RobotOptions(),
    filter_map: FilterMap = None,
    seeded: Seeded = Seeded(),
    out: Output = Output(),
) -> None:
    """Find settings of AMCL that localize your robot better, and write them as Nav2's parameters.

    Your own settings (--robot, or Nav2's defaults) and others drive along random
    shortest paths of the map in simulation, with a third of, once and three times
    the errors of odometry. The best at its worst level is judged against yours on
    other paths in other worlds. A copy of your file is written in which only those
    values differ that gain, or none if nothing is clearly better; those of --set;
    and do_beamskip, which is not simulated and is off where the laser model changes.

    With --drive, they are replayed on stretches of a recorded drive instead. Half
    of these are kept for the judgement; recorded poses should be better than AMCL's.

    This takes some three minutes on two cores, and more with more particles.
    """
    recorded.check()
    out.check(locplan.simulation.Tuning.files)
    params = robot_options.nav2_file("amcl")
    if out.output:
        locplan.simulation.check_tunable(params)
    # The table says what works badly, which other commands warn of.
    others = locplan.robots.read_parameters(params).of("amcl")
    every = given_of(amount) | vars(seeded) | {"others": others}
    if recorded.drive:
        refuse("with --drive", paths=amount.paths)
        grid, recording = recorded.on_map([map_file])
        robot = robot_options.on_drive(recording)
    else:
        robot, grid = robot_options.load(), locplan.load_map(map_file)
    every["filter_map"] = load_filter_map(filter_map, [grid])
    where = f"on {recorded.drive.name}" if recorded.drive else f"in {grid.name}"
    with progress_bar(f"tuning {where}", "") as progress:
        if recorded.drive:
            tune_on_drive = locplan.recordings.tune_on_drive
            result = tune_on_drive(recording, grid, robot, progress=progress, **every)
        else:
            result = locplan.simulation.tune(grid, robot, progress=progress, **every)
    out.finish(result, saved=(params,))
