"""The command that chooses the path to take, or finds all best trade-offs."""

from __future__ import annotations

import shlex
import sys
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

import locplan
from locplan._util.checks import positive
from locplan._util.progress import later_progress_bar, working
from locplan._util.runs import as_argument, typed as typed_words
from locplan.cli import _types as typed
from locplan.cli._options import Computing, CostOptions, Output, read_paths
from locplan.cli._robot_options import FIELD, FieldOptions, FilterMap
from locplan.errors import ConfigError
from locplan.planners import names

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from locplan import CovarianceField, OccupancyGrid
    from locplan.planners import Planner
    from locplan.robots import Robot


@typed.option_group("Planner")
class PlannerOptions(typed.Options):
    """The planner and its own options, which have the planner's defaults if they are not given."""

    planner: Annotated[tuple[str, ...], Parameter(choices=names())] = ()
    """Planner whose path is a candidate, too; repeatable. grid searches with astar or dijkstra,
    whichever is quicker on the map; lattice plans for the robot's outline and turning radius; those
    with capitals are OMPL's."""
    accuracy: Literal["normal", "high"] | None = None
    """Accuracy of any-angle's paths; normal by default."""
    space: Literal["R2", "SE2", "Dubins", "ReedsShepp"] | None = None
    """Space that OMPL's planners plan in; R2 by default, the others have headings."""
    turning_radius: float | None = None
    """Radius of the curves of Dubins and ReedsShepp, in metres."""
    time_limit: float | None = None
    """Time of OMPL's planners (5 by default) and of lattice for each path, or of --front (30 by
    default), in seconds."""
    iterations: int | None = None
    """Number of iterations of OMPL's planners; one seed then always gives one path."""
    convergence: float | None = None
    """Share, such as 0.001, by which J must still fall lest OMPL's planners stop."""
    seed: typed.Seed | None = None
    """Seed of OMPL's random numbers, and of the simulated drives; 1 by default."""
    from_grid: bool | None = None
    """Begin OMPL's planner with the grid planner's path, or the lattice's of curves."""
    improve: bool | None = None
    """Straighten the path found by an OMPL planner."""
    setting: Annotated[tuple[str, ...], Parameter(metavar="NAME=VALUE")] = ()
    """Setting of OMPL's own, such as range=2.0; repeatable."""

    def planners(self, robot: Robot, **limits: Any) -> dict[str, Planner]:
        """The planners by name, with the options that were given, or the one for the robot."""
        planner_for, takes = locplan.planners.planner_for, locplan.planners.takes
        given = self.given(PlannerOptions)
        asked, seed = given.pop("planner", ()), given.pop("seed", None)  # that of the drives, too
        if settings := typed.settings_of(given.pop("setting", ()), "setting", "range=2.0"):
            given["settings"] = settings
        made, usual = {}, locplan.planners.default_planner(robot)
        for name in dict.fromkeys(asked or ((usual,) if given else ())):
            own = {"seed": seed} if seed is not None and takes(planner_for(name), "seed") else {}
            planner_for(name, given | own, **limits)  # refuses limits that it does not keep
            made[name] = planner_for(name, given | own)
        return made


@typed.option_group("Simulation")
class Driving(typed.Options):
    """What decides among candidates, which are driven where the lidar is known."""

    drives: int | None = None
    """Maximum number of confirming drives of a path; 64 by default; with 0 none is driven or
    recommended."""
    bold: bool = False
    """Take an undecided path, too, if its ratio of errors is at most 0.9."""
    minimise: Literal["rmse", "lost", "goal-error", "heading"] | None = None
    """Error that decides: RMSE of the position (by default), that of the last metre, that of the
    heading, or first of all the number of drives off by over 1 m."""
    price: float | None = None
    """Price of the length in the race: so much of its logarithm counts as error; 0.3 by default."""
    thorough: bool = False
    """Steer 40 drives, not 16, of the path to take and of the shortest by the filter's pose, to see
    how many arrive."""
    driving_time: Annotated[
        float | None, typed.checked(lambda time: positive("--driving-time", time, "seconds"))
    ] = None
    """Time after which no further round of confirming drives begins, in seconds."""
    no_field: bool = False
    """Decide without the aware paths, which need a field of the map."""


@typed.command(
    "plan lab.yaml --start 2,3 --goal 38,3 --lidar turtlebot4 --robot nav2.yaml -o planned",
    "plan lab.yaml --start 2,3 --goal 38,3 --planner BITstar --time-limit 2",
    "plan lab.yaml --start 2,3 --goal 38,3 --front -o front",
)
class plan(
    typed.OneMap, FieldOptions, FilterMap, PlannerOptions, Driving, CostOptions, Computing, Output
):
    """Choose the path to take, along which the robot can localize.

    Where the lidar is known, candidates are driven in simulation until one is shown to be better
    than the shortest path. Elsewhere the localizability-aware path is planned beside it.
    """

    start: typed.Pose
    """Start of the path, x,y in metres, and the heading in degrees where the space has one."""
    goal: typed.Pose
    """Goal of the path, x,y in metres, and the heading in degrees where the space has one."""
    via: typed.Poses = ()
    """Place to visit on the way, x,y in metres; repeatable."""
    path: typed.Csv = ()
    """Further candidate (CSV of positions); repeatable."""
    front: bool = False
    """Compute and draw the Pareto front of length and degeneracy; no drive is simulated."""
    max_e: float | None = None
    """Maximum e of the cells that a path enters, in m² rad."""
    budget: float | None = None
    """Maximum ∫u ds of a path, in metres."""
    longest: float | None = None
    """Maximum length of other candidates, in lengths of the shortest path; 1.5 by default."""

    def __call__(self) -> None:
        if self.front:
            return self._find_front()
        config: Any
        robot, config = self.robot_and_field()
        if robot.lidar is not None and self.drives != 0:
            self.warn(robot)
        if robot.outline and self.budget is not None:
            within = f"the circle of {robot.outline.inscribed_radius:.3g} m within its outline"
            print(f"with a budget the robot counts as {within}", file=sys.stderr)
        self.check_costs(config)
        candidates = self._candidates(robot)
        self.check_output(locplan.Choice.files, "history.png")
        grid, basis = locplan.load_map(self.map_file), config
        if self.no_field:
            self.refuse("with --no-field", *FIELD, CostOptions, "max_e", "budget")
            basis = locplan.Costmap.blank(grid, robot=robot)
        settings = self.given("seed", "threads", locplan.simulation.ChoiceSettings)
        settings["time_limit"] = self.driving_time  # --time-limit is that of OMPL's planners
        settings["filter_map"] = self.load_filter_map(grid)

        def compute(
            grid: OccupancyGrid, points: NDArray[np.bool_] | None = None
        ) -> CovarianceField:
            return self.field_of(grid, config, None if self.stride else points)

        with later_progress_bar("driving the candidates", "drives") as progress:
            choice = locplan.choose(
                grid,
                self.start,
                self.goal,
                robot,
                costs=basis,
                candidates=candidates,
                compute=compute,
                progress=progress,
                **settings,
            )
        self.finish(choice)
        if not self.json and (step := self._next_step(choice)):
            print(f"\nNext: {step[0]}", *step[1:], sep="\n  ")

    def _next_step(self, choice: locplan.Choice) -> tuple[str, ...]:
        """What to do next, and the commands for it; empty if there is nothing to do."""
        again, map_file, path = typed_words(), as_argument(str(self.map_file)), choice.chosen
        robot = [word for word in again if word.partition("=")[0] in ROBOT]
        if path is None:
            see = "see the rooms of the map, and what misleads in it:"
            return see, shlex.join(["locplan", "info", map_file])
        if choice.judgement is None:
            simulate = shlex.join([*again, "--lidar=turtlebot4"])
            known = choice.robot.lidar is not None
            return () if known else ("simulate the paths with your lidar, such as:", simulate)
        if choice.is_tuning_first:
            tune = shlex.join(["locplan", "tune", map_file, *robot, "-o", "tuned"])
            plan = shlex.join([*again, "--robot=tuned/nav2_params.yaml"])
            return "tune the filter, then plan with its settings:", tune, plan
        is_lost = path.driven is not None and path.driven.lost_rate.value >= HALF
        if is_lost or (path.arrivals is not None and path.arrivals.arrived.value <= HALF):
            check = shlex.join(["locplan", "check", map_file, *robot])
            return "find why the robot fails, and what helps most:", check
        if choice.is_undecided:
            own = "--drives", "--driving-time"
            words = [word for word in again if word.partition("=")[0] not in own]
            drives = min(2 * choice.settings.drives, MAX_DRIVES)
            return "simulate more drives:", shlex.join([*words, f"--drives={drives}"])
        if self.output is None:
            save = "save the path, its picture and all candidates:"
            return save, shlex.join([*again, "-o", "planned"])
        if choice.best:
            words = ["--to", "nav2-keepout", f"--choice={self.output}", "-o", "mask"]
            export = shlex.join(["locplan", "export", map_file, *words])
            return "write a mask that makes Nav2 follow the path:", export
        return ()

    def _candidates(self, robot: Robot) -> dict[str, Any]:
        """The paths in files, and the planners."""
        made = self.planners(robot, via=[*self.via], max_e=self.max_e, budget=self.budget)
        paths = read_paths(self.path)
        for name in made.keys() & paths.keys():
            raise ConfigError(f"a --path file has the name of a --planner, {name}; rename it")
        return {**paths, **made}

    def _find_front(self) -> None:
        """Find all best trade-offs of length and degeneracy, and where they bend."""
        self.refuse("with --front", *NOT_OF_FRONT, Driving)
        limits = self.given("time_limit")
        locplan.planners.check_front_limits("u", **{"time_limit": 30.0, **limits})
        ends: Any = (self.start, self.goal)
        if any(len(end) > 2 for end in ends):
            raise ConfigError("--front has no headings; give --start and --goal as X,Y")
        robot, config = self.robot_and_field()
        self.check_costs(config)
        grid = locplan.load_map(self.map_file)
        locplan.planners.check_ends(locplan.Costmap.blank(grid, robot=robot), *ends)
        self.check_output(locplan.ParetoFront.files)
        field = self.field_of(grid, config)
        costs = self.costmap(grid, field, robot)
        with working("searching the front"):
            front = locplan.pareto_front(costs, *ends, **limits)
        self.finish(front)
        if not self.json:
            print(locplan.field.about_field(field))


HALF = 0.5
"""Share of failing drives from which the cause matters more than the path."""
MAX_DRIVES = 1024
"""Maximum number of confirming drives that `plan` takes."""
ROBOT = "--robot", "--lidar", "--set", "--filter-map"
"""The options of the robot, which other commands read as well."""
NOT_OF_FRONT = (
    *(name for name in typed.field_names(PlannerOptions) if name != "time_limit"),
    *("weight", "via", "path", "max_e", "budget", "longest", "filter_map"),
)
"""The options that --front does not read."""
