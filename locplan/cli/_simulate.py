"""The commands that drive paths in simulated worlds, and that tune AMCL by such drives."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._util.progress import progress_bar
from locplan.cli import _types as typed
from locplan.cli._options import (
    Computing,
    CostOptions,
    Output,
    ReferencedOptions,
    load_filter_map,
    read_paths,
)
from locplan.cli._robot_options import FieldOptions, RobotOptions
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from locplan import Costmap, OccupancyGrid, Robot
    from locplan.simulation import Routes, Simulation


@typed.option_group("Options")
class Driven:
    """The paths that are driven, and how often."""

    path: typed.Csv = ()
    """Path that is driven (x,y), as plan wrote it; repeatable."""
    start: typed.XY = None
    """Start of the shortest and the aware path, x,y in metres."""
    goal: typed.XY = None
    """Goal of both paths, x,y in metres."""
    random: typed.Pair | None = None
    """Number of random queries on each map, in place of a start; 5 or more give intervals."""
    min_distance: float | None = None
    """Minimum distance from start to goal of random queries, in metres; 10 by default."""
    drives: typed.Pair | None = None
    """Number of drives along each path; 100 by default, and 20 of a recorded drive."""
    closed: typed.Pair | None = None
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
            typed.refuse("with --random", closed=self.closed)
        if self.closed is None:
            typed.refuse("without --closed", replan=self.replan)
        if self.path:
            of_lidar = {"config": None, "estimator": None}  # they name the lidar, too
            typed.refuse("with --path: no path is planned", **of_plans | of_lidar)
        if self.random is None:
            typed.refuse("without --random", min_distance=self.min_distance)
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

    def check_folder(self, out: Output, grids: list[OccupancyGrid]) -> None:
        """Raise a LocplanError if the folder cannot take the results; before long work."""
        if self.random is None:
            more = ("arrivals.csv",) if self.closed else ()
            return out.check(locplan.simulation.Simulation.files, *more)
        results = locplan.simulation.RoutesOnMaps
        return out.check(results.files, *results.pictures([grid.name for grid in grids]))


@typed.command(
    "simulate lab.yaml --start 2,3 --goal 38,3 -o driven",
    "simulate lab.yaml --path planned/shortest.csv --path mine.csv -o driven",
    "simulate lab.yaml --random 20 -o queries",
    "simulate lab.yaml --drive monday.mcap --robot nav2_params.yaml -o replayed",
)
def simulate(
    maps: typed.MapFiles,
    /,
    *,
    driven: Driven = Driven(),
    recorded: ReferencedOptions = ReferencedOptions(),
    robot_options: RobotOptions = RobotOptions(),
    filter_map: typed.FilterMap = None,
    seed: typed.DriveSeed = 1,
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
        typed.refuse("with --drive", **unread, **vars(costs), **vars(options))
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
    driven.check_folder(out, grids)
    with computing.of(config) as compute:
        costmaps = (costs.costmap(grid, compute(grid), robot) for grid in grids)
        if driven.random is not None:
            routes = [_at_random(each, driven, robot, every) for each in costmaps]
            out.finish(locplan.simulation.RoutesOnMaps(tuple(routes)))
        elif simulated := _along_paths(grids[0], costmaps, driven, robot, every):
            out.finish(simulated)
        else:
            out.show({"status": "unreachable"}, "unreachable: no path leads to the goal")


def _along_paths(
    grid: OccupancyGrid,
    costmaps: Iterator[Costmap],
    driven: Driven,
    robot: Robot,
    every: dict[str, Any],
) -> Simulation | None:
    """Drive the paths that were given, or the shortest and the aware one between two places."""
    paths, costmap = read_paths(driven.path), None
    if driven.start and driven.goal:
        ends = driven.start, driven.goal
        locplan.planners.check_ends(locplan.Costmap.blank(grid, robot=robot), *ends)
        costmap = next(costmaps)
        plans = locplan.planners.plan_beside_shortest(costmap, *ends)
        paths = {name: plan.path for name, plan in plans.items() if plan.path is not None}
    if not paths:
        return None
    if driven.closed:
        every["closed"] = locplan.simulation.Closed(drives=driven.closed, replan=driven.replan)
    with progress_bar("simulating", "drives") as progress:
        simulate = locplan.simulation.simulate
        return simulate(grid, paths, robot, costs=costmap, progress=progress, **every)


def _at_random(costmap: Costmap, driven: Driven, robot: Robot, every: dict[str, Any]) -> Routes:
    """Drive both paths of random queries on a map."""
    queries = locplan.planners.random_queries(
        costmap, driven.random or 0, every["seed"], min_distance=driven.distance
    )
    with progress_bar(f"simulating in {costmap.grid.name}", "drives") as progress:
        simulate = locplan.simulation.simulate_queries
        return simulate(costmap, queries, robot, progress=progress, **every)


@typed.option_group("Options")
class Amount:
    """The number of drives."""

    paths: Annotated[int | None, Parameter(validator=Number(gte=5, lte=1000))] = None
    """Number of random paths of the search, and of the others on which its result is judged; 20 by
    default. The time grows with it."""
    drives: typed.Pair = 8
    """Number of drives along each path, at each level of disturbance; 8 by default."""


@typed.command(
    "tune lab.yaml --lidar turtlebot4 -o tuned",
    "tune lab.yaml --lidar rplidar-a1 --robot nav2_params.yaml -o tuned",
    "tune lab.yaml --drive monday.mcap --robot nav2_params.yaml -o tuned",
)
def tune(
    map_file: typed.MapFile,
    /,
    *,
    amount: Amount = Amount(),
    recorded: ReferencedOptions = ReferencedOptions(),
    robot_options: RobotOptions = RobotOptions(),
    filter_map: typed.FilterMap = None,
    seeded: typed.Seeded = typed.Seeded(),
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
    every = typed.given_of(amount) | vars(seeded) | {"others": others}
    if recorded.drive:
        typed.refuse("with --drive", paths=amount.paths)
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
