"""The commands that choose the path to take, and that find all best trade-offs."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

import locplan
from locplan._util.progress import later_progress_bar, working
from locplan.cli import _types as typed
from locplan.cli._options import Computing, CostOptions, Output, load_filter_map, read_paths
from locplan.cli._robot_options import FieldOptions, RobotOptions
from locplan.errors import ConfigError
from locplan.planners import names

if TYPE_CHECKING:
    from locplan.planners import Planner


@typed.option_group("Planner")
class PlannerOptions:
    """The planner and its own options, which have the planner's defaults if they are not given."""

    planner: Annotated[tuple[str, ...], Parameter(choices=names())] = ()
    """Planner whose path is a candidate, too; repeatable. grid searches with astar or dijkstra,
    whichever is quicker on the map; those with capitals are OMPL's."""
    accuracy: Literal["normal", "high"] | None = None
    """Accuracy of any-angle's paths; normal by default."""
    space: Literal["R2", "SE2", "Dubins", "ReedsShepp"] | None = None
    """Space that OMPL's planners plan in; R2 by default, the others have headings."""
    turning_radius: float | None = None
    """Radius of the curves of Dubins and ReedsShepp, in metres."""
    time_limit: float | None = None
    """Time of OMPL's planners for each path, in seconds; 5 by default."""
    iterations: int | None = None
    """Number of iterations of OMPL's planners; one seed then always gives one path."""
    convergence: float | None = None
    """Share, such as 0.001, by which J must still fall lest OMPL's planners stop."""
    seed: typed.Seed | None = None
    """Seed of OMPL's random numbers, and of the simulated drives; 1 by default."""
    from_grid: bool | None = None
    """Begin OMPL's planner with the grid planner's path."""
    improve: bool | None = None
    """Straighten the path found by an OMPL planner."""
    setting: Annotated[tuple[str, ...], Parameter(metavar="NAME=VALUE")] = ()
    """Setting of OMPL's own, such as range=2.0; repeatable."""

    def made(self, **limits: Any) -> dict[str, Planner]:
        """The planners by name, with the options that were given."""
        planner_for, takes = locplan.planners.planner_for, locplan.planners.takes
        given = typed.given_of(self)
        asked, seed = given.pop("planner"), given.pop("seed", None)  # that of the drives, too
        if settings := typed.settings_of(given.pop("setting"), "setting", "range=2.0"):
            given["settings"] = settings
        made = {}
        for name in dict.fromkeys(asked or ((locplan.planners.DEFAULT,) if given else ())):
            own = {"seed": seed} if seed is not None and takes(planner_for(name), "seed") else {}
            planner_for(name, given | own, **limits)  # refuses limits that it does not keep
            made[name] = planner_for(name, given | own)
        return made


@typed.option_group("Options")
class Query:
    """The places and limits of the path."""

    start: typed.Pose
    """Start of the path, x,y in metres, and the heading in degrees where the space has one."""
    goal: typed.Pose
    """Goal of the path, x,y in metres, and the heading in degrees where the space has one."""
    via: typed.Poses = ()
    """Place to visit on the way, x,y in metres; repeatable."""
    path: typed.Csv = ()
    """Further candidate (CSV of positions); repeatable."""
    front: bool = False
    """Take up to 5 paths of the Pareto front of length against degeneracy as candidates, too."""
    max_e: float | None = None
    """Maximum e of the cells that a path enters, in m² rad."""
    budget: float | None = None
    """Maximum ∫u ds of a path, in metres."""
    longest: float | None = None
    """Maximum length of a candidate, in lengths of the shortest path; 1.5 by default."""

    @property
    def limits(self) -> dict[str, Any]:
        """What binds the paths of planners."""
        return {"via": [*self.via], "max_e": self.max_e, "budget": self.budget}

    def warn(self, robot: locplan.Robot) -> None:
        """Say which outline is planned with where it is not the robot's."""
        if robot.outline and self.budget is not None:
            within = f"the circle of {robot.outline.inscribed_radius:.3g} m within its outline"
            print(f"with a budget the robot counts as {within}", file=sys.stderr)

    def candidates(self, made: dict[str, Planner]) -> dict[str, Any]:
        """The paths in files, and the planners that were made."""
        paths = read_paths(self.path)
        for name in made.keys() & paths.keys():
            raise ConfigError(f"a --path file has the name of a --planner, {name}; rename it")
        return {**paths, **made}


@typed.option_group("Simulation")
class Driving:
    """What decides among candidates, which are driven where the lidar is known."""

    drives: int | None = None
    """Maximum number of confirming drives of a path; 64 by default; with 0 none is driven or
    recommended."""
    bold: bool = False
    """Take a path that is only probably better, too."""
    minimise: Literal["rmse", "lost", "goal-error", "heading"] | None = None
    """Error that decides: RMSE of the position (by default), that of the last metre, that of the
    heading, or first of all the number of drives off by over 1 m."""
    price: float | None = None
    """Price of the length in the race: so much of its logarithm counts as error; 0.3 by default."""
    thorough: bool = False
    """Steer 40 drives, not 16, of the path to take and of the shortest by the filter's pose, to see
    how many arrive."""
    driving_time: float | None = None
    """Time after which no further round of confirming drives begins, in seconds."""
    no_field: bool = False
    """Decide without the aware paths, which need a field of the map."""


def choice_settings(query: Query, driving: Driving) -> dict[str, Any]:
    """The settings of the choice that were given, by their names in Python."""
    given = typed.given_of(query) | query.limits | typed.given_of(driving)
    if "driving_time" in given:
        given["time_limit"] = given.pop("driving_time")
    others = ("start", "goal", "path", "no_field")
    return {name: value for name, value in given.items() if name not in others}


@typed.command(
    "plan lab.yaml --start 2,3 --goal 38,3 --lidar turtlebot4 --robot nav2.yaml -o planned",
    "plan lab.yaml --start 2,3 --goal 38,3 --planner BITstar --time-limit 2",
)
def plan(
    map_file: typed.MapFile,
    /,
    *,
    query: Query,
    robot_options: RobotOptions = RobotOptions(),
    filter_map: typed.FilterMap = None,
    planning: PlannerOptions = PlannerOptions(),
    driving: Driving = Driving(),
    costs: CostOptions = CostOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    out: Output = Output(),
) -> None:
    """Choose the path to take, along which the robot can localize.

    Where the lidar is known, candidates are driven in simulation until one is shown to be better
    than the shortest path. Elsewhere the localizability-aware path is planned beside it.
    """
    config: Any
    robot, config = options.with_robot(robot_options)
    driven = robot.lidar is not None and driving.drives != 0
    if driven:
        robot_options.warn(robot)
    query.warn(robot)
    costs.check(config)
    candidates = query.candidates(planning.made(**query.limits))
    out.check(locplan.Choice.files, "history.png")
    grid, basis = locplan.load_map(map_file), config
    if driving.no_field:
        unread = {"max_e": query.max_e, "budget": query.budget, "front": query.front or None}
        typed.refuse("with --no-field", **vars(options), **vars(costs), **unread)
        basis = locplan.Costmap.blank(grid, robot=robot)
    with (
        locplan.simulation.drives_prepared_beside(needed=driven) as drivable,
        computing.of(config, whole=options.stride is not None, then=drivable) as compute,
        later_progress_bar("driving the candidates", "drives") as progress,
    ):
        choice = locplan.choose(
            grid,
            query.start,
            query.goal,
            robot,
            costs=basis,
            candidates=candidates,
            compute=compute,
            seed=typed.given_of(planning).get("seed", 1),
            threads=computing.threads,
            progress=progress,
            filter_map=load_filter_map(filter_map, [grid]),
            **choice_settings(query, driving),
            **typed.given_of(costs),
        )
    out.finish(choice)


@typed.option_group("Options")
class Search:
    """The query, and the limits of the search."""

    start: Annotated[Any, typed.parsed(typed.position, "X,Y")]
    """Start, x,y in metres."""
    goal: Annotated[Any, typed.parsed(typed.position, "X,Y")]
    """Goal, x,y in metres."""
    objective: Literal["u", "e"] = "u"
    """Second objective: the degenerate metres (u, by default), or the integral of e."""
    time_limit: float = 30.0
    """Time of the search, in seconds, exact or not; 30 by default."""


@typed.command("pareto lab.yaml --start 2,3 --goal 38,3 -o front")
def pareto(
    map_file: typed.MapFile,
    /,
    *,
    search: Search,
    robot_options: RobotOptions = RobotOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    out: Output = Output(),
) -> None:
    """Find all best trade-offs between length and localizability, and where they bend.

    The knee is the path farthest below the chord between the front's ends, or else the shortest.
    """
    limits = typed.given_of(search)
    ends = limits.pop("start"), limits.pop("goal")
    locplan.planners.check_front_limits(**limits)
    grid = locplan.load_map(map_file)
    robot, config = options.with_robot(robot_options)
    locplan.planners.check_ends(locplan.Costmap.blank(grid, robot=robot), *ends)
    out.check(locplan.ParetoFront.files)
    field = computing.field(grid, config)
    costs = locplan.Costmap.from_field(grid, field, robot=robot)
    with working("searching the front"):
        front = locplan.pareto_front(costs, *ends, **limits)
    out.finish(front)
    if not out.json:
        print(locplan.field.about_field(field))
