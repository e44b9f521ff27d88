"""The command that plans a path."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from locplan.cli import _groups as groups
from locplan.cli._groups import Force, Json, MapFile, Seed, Text, option_group, results
from locplan.cli._kinds import given_of
from locplan.cli._options import Computing, CostOptions, FieldOptions
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load, position, settings_of, show
from locplan.planners import names

if TYPE_CHECKING:
    from locplan.costs import Costmap
    from locplan.field import CovarianceField, FieldConfig
    from locplan.maps import OccupancyGrid
    from locplan.planners import Plan, Planner

app = groups.command(
    "plan",
    "plan lab.yaml --start 2,3 --goal 38,3 --lidar turtlebot4 --robot nav2.yaml -o planned",
    "plan lab.yaml --start 2,3 --goal 38,3 --planner BITstar --time-limit 2",
)


@option_group(groups.PLANNER)
class PlannerOptions:
    """The planner and its own options, which have the planner's defaults if they are not given."""

    planner: Annotated[str | None, Parameter(choices=names())] = None
    """Planner; any-angle by default, grid with a budget. grid searches with astar or dijkstra,
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

    def given(self) -> dict[str, Any]:
        """The options of the planner that were given."""
        given = given_of(self)
        given.pop("planner", None)
        settings = settings_of(given.pop("setting"), "setting", "range=2.0")
        return {**given, "settings": settings} if settings else given


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
    max_e: float | None = None
    """Greatest e of the cells that the path enters, in m² rad."""
    budget: float | None = None
    """Greatest ∫u ds of the path, in metres; the shortest such path is planned."""


@app.default
def plan(
    map_file: MapFile,
    /,
    *,
    query: Query,
    robot_options: RobotOptions = RobotOptions(),
    planning: PlannerOptions = PlannerOptions(),
    no_verdict: Annotated[
        bool,
        Parameter(
            group=groups.SIMULATION,
            help="Drive and recommend no path; paths are driven where the lidar is known.",
        ),
    ] = False,
    costs: CostOptions = CostOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    output: Annotated[
        Path | None,
        results("Folder for the paths (CSV), plan.json and plan.png."),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Plan a path that the robot can localize on, beside the shortest one.

    Where the lidar is known, both paths are driven in simulation, and one of them is recommended.
    """
    from locplan import planners
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.costs import Costmap
    from locplan.export import PLAN_FILES, write_plans
    from locplan.field import about_field
    from locplan.planners import plans_summary, plans_table, prepared_beside

    start, goal = position("start", query.start), position("goal", query.goal)
    stops = [position("via", xy) for xy in query.via]
    robot, config = options.with_robot(robot_options)
    limits: dict[str, Any] = {"max_e": query.max_e, "budget": query.budget, "via": stops}
    limits["footprint"] = robot.outline if query.budget is None else None
    if robot.outline and query.budget is not None:
        print(AS_CIRCLE.format(robot.outline.inscribed_radius), file=sys.stderr)
    given = planning.given()
    driven = robot.lidar is not None and not no_verdict
    why_not = "not both paths were found"
    if driven:
        robot_options.warn(robot)
        if not planners.takes(planners.planner_for(planning.planner, **limits), "seed"):
            given.pop("seed", None)  # it is that of the drives alone
    else:
        unnamed = "name the lidar (--lidar) to drive them"
        why_not = unnamed if robot.lidar is None else "the paths are not driven"
    planner = planners.planner_for(planning.planner, given, **limits)
    grid = load(map_file)
    blank = Costmap.blank(grid, robot_radius=robot.radius)
    planners.check_ends(blank, start, goal, stops, space=planning.space or "R2")
    del blank  # saves memory on a large map
    costs.check(config)
    history = ["history.png"] if planners.takes(planner, "progress") else []
    folder = PLAN_FILES.into(output, *history, force=force) if output else None
    asked = {"start": start, "goal": goal, "planner": planning.planner, **limits, **given}
    near_paths = options.is_fine_near_paths(config)
    compiling = not computing.begun(grid, config, in_part=near_paths)
    driving: AbstractContextManager[Callable[[], None]] = nullcontext(lambda: None)
    if driven:
        from locplan.simulation import drives_prepared_beside

        driving = drives_prepared_beside(needed=compiling)
    with prepared_beside(planner, needed=compiling) as ready, driving as drivable:
        field, (costmap, plans) = _planned(
            grid,
            config,
            planner,
            asked,
            near_paths=near_paths,
            costmap_of=lambda field: costs.costmap(grid, field, robot),
            computing=computing,
            ready=ready,
        )
        drivable()
    found = None
    if driven:
        from locplan.simulation import verdict

        with progress_bar("simulating", "drives") as progress:
            found = verdict(
                costmap,
                plans,
                robot,
                seed=1 if planning.seed is None else planning.seed,
                threads=computing.threads,
                progress=progress,
            )
    said = found.text if found else f"nothing is recommended: {why_not}"
    if folder:
        with working("writing the paths"):
            write_plans(folder, costmap, field, plans, found, said)
    lines = [plans_table(plans, field), about_field(field)]
    if not costmap.has_weak_spots:
        lines.append("no weak spot for this lidar: u is 0 all over the map")
    about = plans_summary(plans) | {"verdict": found.summary() if found else None}
    show(json, about, "\n".join([*lines, said]), output)


def _planned(
    grid: OccupancyGrid,
    config: FieldConfig,
    planner: Planner,
    asked: dict[str, Any],
    *,
    near_paths: bool,
    costmap_of: Callable[[CovarianceField], Costmap],
    computing: Computing,
    ready: Callable[[], None],
) -> tuple[CovarianceField, tuple[Costmap, dict[str, Plan]]]:
    """The field, which need only be fine near the paths where that is so, and the plans on it."""
    from locplan import planners
    from locplan._util.progress import in_turn, progress_bar
    from locplan._util.working import working

    slow, draft = planners.takes(planner, "progress"), asked
    if slow:  # the default planner finds where the field must be fine
        draft = {name: asked[name] for name in ("max_e", "budget", "footprint")}
        draft |= {"start": asked["start"][:2], "goal": asked["goal"][:2]}
        draft["via"] = [xy[:2] for xy in asked["via"]]

    def planned(field: CovarianceField, request: dict[str, Any]) -> tuple[Costmap, dict[str, Plan]]:
        costmap = costmap_of(field)
        return costmap, planners.plan_beside_shortest(costmap, **request)

    def drafted(field: CovarianceField) -> tuple[Costmap, dict[str, Plan]]:
        ready()
        with working("planning"):
            return planned(field, draft)

    with computing.of(config) as compute:
        if near_paths:
            field, found = planners.planned_near_paths(
                grid,
                config,
                lambda points: compute(grid, points),
                drafted,
                lambda found: [plan.path for plan in found[1].values() if plan.path],
            )
        else:
            field = compute(grid)
    if slow or not near_paths:
        ready()
        untimed = "iterations" in asked and "time_limit" not in asked
        with progress_bar(planner.name, "iterations" if untimed else "") as progress:
            if slow:
                asked["progress"] = in_turn(progress, 2 * (len(asked["via"]) + 1))
            found = planned(field, asked)
    return field, found
