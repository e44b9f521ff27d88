"""The commands that drive paths in simulated worlds, and that tune AMCL by such drives."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._util.progress import progress_bar
from locplan.cli import _options as shared, _types as typed
from locplan.cli._robot_options import FIELD, FieldOptions, FilterMap
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from locplan import Costmap, OccupancyGrid, Robot
    from locplan.simulation import Routes, Simulation, Tuning


@typed.command(
    "simulate lab.yaml --start 2,3 --goal 38,3 -o driven",
    "simulate lab.yaml --path planned/01-shortest.csv --path mine.csv -o driven",
    "simulate lab.yaml --random 20 -o queries",
    "simulate lab.yaml --drive monday.mcap --robot nav2_params.yaml -o replayed",
)
class simulate(
    typed.ManyMaps,
    FieldOptions,
    FilterMap,
    shared.Ends,
    shared.ReferencedOptions,
    shared.Seeded,
    shared.CostOptions,
    shared.Computing,
    shared.Output,
):
    """Drive paths with AMCL in simulated worlds: its error, and how often it is off by over 1 m.

    With --drive, AMCL runs on the odometry and the scans of a recorded drive instead, and its
    errors are those against the recorded poses.
    """

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

    def __call__(self) -> None:
        self.check_drive()
        if self.drive:
            return self._replay()
        self._check()
        robot, config = self.robot_and_field()
        named, robot = robot.lidar, self.simulated(robot, config)
        self.check_costs(config)
        grids = self._grids()
        every = self._every(grids, drives=self.drives or 100)
        self._check_folder(grids)
        costmaps = (self.costmap(grid, self.field_of(grid, config), robot) for grid in grids)
        if self.random is not None:
            routes = [self._at_random(each, robot, every) for each in costmaps]
            self.finish(locplan.simulation.RoutesOnMaps(tuple(routes)))
        elif simulated := self._along_paths(grids[0], costmaps, robot, every):
            if named is None:
                assumed = f"{robot.known_lidar.title}; name yours with --lidar"
                print(f"robot: no lidar named, one assumed: {assumed}", file=sys.stderr)
            self.finish(simulated)
        else:
            self.show({"status": "unreachable"}, "unreachable: no path leads to the goal")

    def _every(self, grids: list[OccupancyGrid], **count: int) -> dict[str, Any]:
        """What is said to each recipe."""
        return {**self.given(shared.Seeded), **count, "filter_map": self.load_filter_map(*grids)}

    def _replay(self) -> None:
        """Run the filter on a recorded drive."""
        of_paths = "path", "start", "goal", "random", "min_distance", "closed", "replan"
        unread = *of_paths, "cache_dir", *FIELD
        self.refuse("with --drive", *unread, shared.CostOptions)
        self.check_output(locplan.recordings.Replay.files)
        grid, recording = self.on_map(self.maps)
        every = self._every([grid], runs=self.drives or 20)
        robot = self.robot_on(recording)
        self.warn(robot)
        with progress_bar("replaying", "runs") as progress:
            found = locplan.recordings.replay(recording, grid, robot, progress=progress, **every)
        self.finish(found)

    @property
    def _distance(self) -> float:
        """Minimum distance from start to goal of random queries [m]."""
        return 10.0 if self.min_distance is None else self.min_distance

    def _check(self) -> None:
        """Raise a ConfigError unless one kind of paths was asked for; to be called early.

        With paths of one's own the options of planned ones are refused.
        """
        asked = bool(self.path), bool(self.start or self.goal), self.random is not None
        if asked.count(True) != 1 or bool(self.start) != bool(self.goal):
            raise ConfigError("give one of --path, --start with --goal, --random, and --drive")
        if self.random is None:
            self.refuse("without --random", "min_distance")
        else:
            self.refuse("with --random", "closed")
            locplan.planners.check_random(self.random, self.seed, self._distance)
        if self.closed is None:
            self.refuse("without --closed", "replan")
        if self.path:
            of_field = [name for name in FIELD if name not in ("config", "estimator")]
            self.refuse("with --path: no path is planned", shared.CostOptions, *of_field)

    def _grids(self) -> list[OccupancyGrid]:
        """The maps; a ConfigError if there are several, and one path."""
        files = locplan.maps.find_maps(*self.maps)
        if self.random is None and len(files) > 1:
            raise ConfigError(
                f"one path is of one map: name one of these {len(files)}, or give --random"
            )
        return [locplan.load_map(file) for file in files]

    def _check_folder(self, grids: list[OccupancyGrid]) -> None:
        """Raise a LocplanError if the folder cannot take the results; before long work."""
        if self.random is None:
            more = ("arrivals.csv",) if self.closed else ()
            return self.check_output(locplan.simulation.Simulation.files, *more)
        results = locplan.simulation.RoutesOnMaps
        return self.check_output(results.files, *results.pictures([grid.name for grid in grids]))

    def _along_paths(
        self,
        grid: OccupancyGrid,
        costmaps: Iterator[Costmap],
        robot: Robot,
        every: dict[str, Any],
    ) -> Simulation | None:
        """Drive the paths that were given, or the shortest and the aware one of two places."""
        paths, costmap = shared.read_paths(self.path), None
        if ends := self.ends():
            if ends[0] == ends[1]:
                raise ConfigError("start and goal are one place; a drive needs a way between two")
            locplan.planners.check_ends(locplan.Costmap.blank(grid, robot=robot), *ends)
            costmap = next(costmaps)
            plans = locplan.planners.plan_beside_shortest(costmap, *ends)
            paths = {name: plan.path for name, plan in plans.items() if plan.path is not None}
        if not paths:
            return None
        if self.closed:
            every["closed"] = locplan.simulation.Closed(drives=self.closed, replan=self.replan)
        with progress_bar("simulating", "drives") as progress:
            return locplan.simulation.simulate(
                grid, paths, robot, costs=costmap, progress=progress, **every
            )

    def _at_random(self, costmap: Costmap, robot: Robot, every: dict[str, Any]) -> Routes:
        """Drive both paths of random queries on a map."""
        queries = locplan.planners.random_queries(
            costmap, self.random or 0, self.seed, min_distance=self._distance
        )
        with progress_bar(f"simulating in {costmap.grid.name}", "drives") as progress:
            return locplan.simulation.simulate_queries(
                costmap, queries, robot, progress=progress, **every
            )


@typed.command(
    "tune lab.yaml --lidar turtlebot4 -o tuned",
    "tune lab.yaml --lidar rplidar-a1 --robot nav2_params.yaml -o tuned",
    "tune lab.yaml --drive monday.mcap --robot nav2_params.yaml -o tuned",
    "tune lab.yaml hall.yaml --robot nav2_params.yaml -o tuned",
)
class tune(typed.ManyMaps, FilterMap, shared.ReferencedOptions, shared.Seeded, shared.Output):
    """Find settings of AMCL that localize your robot better, and write them as Nav2's parameters.

    Your settings (--robot, or Nav2's defaults) and two presets drive along random shortest
    paths of the map in simulation, at several levels of disturbance. A preset that is
    better at the usual level and does no harm at the others is written into a copy of your
    file. Otherwise the copy equals your file. do_beamskip is not simulated, and is off if
    the laser model changes.

    With --drive, the settings are replayed over the whole recorded drive, 12 times, and
    the drive decides: no run may be off at the end, and the error may not be larger than
    with your settings. Recorded poses should be better than AMCL's.

    With several maps or drives, one file is written for all of them.

    Takes half a minute of CPU, or as long with a drive of 400 m.
    """

    drive: shared.DriveFiles = ()  # type: ignore[assignment]  # other commands take one
    """Recorded drive: a bag of ROS 1 or 2, a log of CARMEN, CSV or NPZ; repeatable, with one map
    for all, or one for each in their order."""
    paths: Annotated[int | None, Parameter(validator=Number(gte=5, lte=1000))] = None
    """Number of random paths on each map; 16 by default."""
    drives: typed.Pair | None = None
    """Number of drives along each path; 4 by default, and 12 replays of a recorded drive."""

    def __call__(self) -> None:
        self.check_drive()
        self.check_output(locplan.simulation.Tuning.files)
        params = self.nav2_file("amcl")
        if self.output:
            locplan.simulation.check_tunable(params)
        # The table says what works badly, which other commands warn of.
        others = locplan.robots.read_parameters(params).of("amcl")
        every = self.given("paths", "drives", shared.Seeded) | {"others": others}
        if self.drive:
            self.refuse("with --drive", "paths")
            result = self._on_drives(every)
        else:
            grids = [locplan.load_map(file) for file in locplan.maps.find_maps(*self.maps)]
            every["filter_map"] = self.load_filter_map(*grids)
            robot, where = self.load_robot(), ", ".join(each.name for each in grids)
            with progress_bar(f"tuning in {where}", "") as progress:
                result = locplan.simulation.tune(grids, robot, progress=progress, **every)
        self.finish(result, saved=(params,))

    def _on_drives(self, every: dict[str, Any]) -> Tuning:
        """Tune on recorded drives, with one map for all or one for each."""
        if len(self.maps) not in (1, len(self.drive)):
            raise ConfigError(
                f"give one map for all drives, or one for each in their order: {len(self.drive)}"
                f" drives, {len(self.maps)} maps"
            )
        maps = self.maps * (len(self.drive) // len(self.maps))
        pairs = [self.on_map([map], file) for map, file in zip(maps, self.drive, strict=True)]
        grids, recordings = zip(*pairs, strict=True)
        robot = self.robot_on(recordings[0])
        every["filter_map"] = self.load_filter_map(*dict.fromkeys(grids))
        where = ", ".join(file.name for file in self.drive)
        with progress_bar(f"tuning on {where}", "") as progress:
            return locplan.recordings.tune_on_drive(
                recordings, grids, robot, progress=progress, **every
            )
