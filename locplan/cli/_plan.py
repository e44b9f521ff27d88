"""The command that chooses the path to take."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from locplan.cli import _groups as groups
from locplan.cli._groups import FilterMap, MapFile, Seed, Text, option_group
from locplan.cli._kinds import given_of
from locplan.cli._options import Computing, CostOptions, FieldOptions
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load, load_filter_map, position, read_paths, refuse, settings_of
from locplan.errors import ConfigError
from locplan.planners import names

if TYPE_CHECKING:
    from locplan.planners import Planner

app = groups.command(
    "plan",
    "plan lab.yaml --start 2,3 --goal 38,3 --lidar turtlebot4 --robot nav2.yaml -o planned",
    "plan lab.yaml --start 2,3 --goal 38,3 --planner BITstar --time-limit 2",
)


@option_group(groups.PLANNER)
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
    seed: Seed | None = None
    """Seed of OMPL's random numbers, and of the simulated drives; 1 by default."""
    from_grid: bool | None = None
    """Begin OMPL's planner with the grid planner's path."""
    improve: bool | None = None
    """Straighten the path found by an OMPL planner."""
    setting: Annotated[tuple[str, ...], Parameter(metavar="NAME=VALUE")] = ()
    """Setting of OMPL's own, such as range=2.0; repeatable."""

    def made(self, **limits: Any) -> dict[str, Planner]:
        """The planners by name, with the options that were given."""
        from locplan.planners import DEFAULT, planner_for, takes

        given = given_of(self)
        given.pop("planner", None)
        settings = settings_of(given.pop("setting"), "setting", "range=2.0")
        given |= {"settings": settings} if settings else {}
        seed = given.pop("seed", None)  # that of the drives, too
        made = {}
        for name in dict.fromkeys(self.planner or ((DEFAULT,) if given else ())):
            own = {"seed": seed} if seed is not None and takes(planner_for(name), "seed") else {}
            planner_for(name, given | own, **limits)  # refuses limits that it does not keep
            made[name] = planner_for(name, given | own)
        return made


AS_CIRCLE = "with a budget the robot counts as the circle of {:.3g} m within its outline"


@option_group(groups.GENERAL)
class Query:
    """The places and limits of the path."""

    start: Annotated[Text, Parameter(metavar="X,Y[,DEG]")]
    """Start of the path, x,y in metres, and the heading in degrees where the space has one."""
    goal: Annotated[Text, Parameter(metavar="X,Y[,DEG]")]
    """Goal of the path, x,y in metres, and the heading in degrees where the space has one."""
    via: Annotated[tuple[Text, ...], Parameter(metavar="X,Y[,DEG]", allow_leading_hyphen=True)] = ()
    """Place to visit on the way, x,y in metres; repeatable."""
    path: Annotated[tuple[Path, ...], groups.INPUT, Parameter(metavar="CSV")] = ()
    """Further candidate (CSV of positions); repeatable."""
    front: Annotated[bool, Parameter(name="--front")] = False
    """Take up to 5 paths of the Pareto front of length against degeneracy as candidates, too."""
    max_e: float | None = None
    """Greatest e of the cells that a path enters, in m² rad."""
    budget: float | None = None
    """Greatest ∫u ds of a path, in metres."""
    longest: float | None = None
    """Greatest length of a candidate, in lengths of the shortest path; 1.5 by default."""

    def limits(self) -> dict[str, Any]:
        """What binds the paths of planners."""
        via = [position("via", xy) for xy in self.via]
        return {"via": via, "max_e": self.max_e, "budget": self.budget}

    def settings(self) -> dict[str, Any]:
        """The settings of the choice that were given."""
        longest = {} if self.longest is None else {"longest": self.longest}
        return {**self.limits(), **longest, "front": self.front}

    def candidates(self, made: dict[str, Planner]) -> dict[str, Any]:
        """The paths in files, and the planners that were made."""
        paths = read_paths(self.path)
        for name in made.keys() & paths.keys():
            raise ConfigError(f"a --path file has the name of a --planner, {name}; rename it")
        return {**paths, **made}


@option_group(groups.SIMULATION)
class Driving:
    """What decides among candidates, which are driven where the lidar is known."""

    drives: int | None = None
    """Greatest number of confirming drives of a path; 64 by default, 0 drives and recommends
    none."""
    bold: Annotated[bool, Parameter(name="--bold")] = False
    """Take a path that is only probably better, too."""
    minimise: Literal["rmse", "lost", "goal-error", "heading"] | None = None
    """Error that decides: RMSE of the position (by default), that of the last metre, that of the
    heading, or first of all the number of lost drives."""
    price: float | None = None
    """Price of the length in the race: so much of its logarithm counts as error; 0.3 by default."""
    driving_time: float | None = None
    """Time after which no further round of confirming drives begins, in seconds."""
    no_field: Annotated[bool, Parameter(name="--no-field")] = False
    """Decide without the aware paths, which need a field of the map."""

    def settings(self) -> dict[str, Any]:
        """The settings of the choice that were given."""
        given = given_of(self)
        del given["no_field"]
        if "driving_time" in given:
            given["time_limit"] = given.pop("driving_time")
        return given


@app.default
def plan(
    map_file: MapFile,
    /,
    *,
    query: Query,
    robot_options: RobotOptions = RobotOptions(),
    filter_map: FilterMap = None,
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
    from locplan._util.progress import later_progress_bar
    from locplan.costs import Costmap
    from locplan.simulation import Choice, choose, drives_prepared_beside

    robot, config = options.with_robot(robot_options)
    driven = robot.lidar is not None and driving.drives != 0
    if driven:
        robot_options.warn(robot)
    if robot.outline and query.budget is not None:
        print(AS_CIRCLE.format(robot.outline.inscribed_radius), file=sys.stderr)
    if driving.no_field:
        unread = {"max_e": query.max_e, "budget": query.budget, "front": query.front or None}
        refuse("with --no-field", **vars(options), **vars(costs), **unread)
    costs.check(config)
    candidates = query.candidates(planning.made(**query.limits()))
    out.check(Choice.files, "history.png")
    grid = load(map_file)
    with (
        drives_prepared_beside(needed=driven) as drivable,
        computing.of(config, whole=options.stride is not None, then=drivable) as compute,
        later_progress_bar("driving the candidates", "drives") as progress,
    ):
        choice = choose(
            grid,
            position("start", query.start),
            position("goal", query.goal),
            robot,
            costs=Costmap.blank(grid, robot_radius=robot.radius) if driving.no_field else config,
            candidates=candidates,
            compute=compute,
            seed=given_of(planning).get("seed", 1),
            threads=computing.threads,
            progress=progress,
            filter_map=load_filter_map(filter_map, [grid]),
            **query.settings(),
            **driving.settings(),
            **given_of(costs),
        )
    out.finish(choice)
