"""Plan paths on a costmap, with any planner, by `plan`; or on a field that is fine near them."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from locplan._support.kernels.arrays import Bools
from locplan.field.config import FieldConfig
from locplan.field.field import CovarianceField
from locplan.field.lattice import find_near_points, select_every_second_point
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap, check_costs
from locplan.planning.limits import LimitedPlanner
from locplan.planning.path import Path
from locplan.planning.protocol import LATTICE, Planner, Position, check_pose
from locplan.planning.requests import AnyPlanner, has_option, make_planner, parse_footprint
from locplan.planning.results import Plan, make_plan
from locplan.planning.robot_fit import describe_robot_conflict
from locplan.robots.parts import Footprint

SHORTEST, AWARE = "shortest", "localizability-aware"
"""Labels of the paths that `plan_with_shortest` returns."""


def check_ends(
    costs: Costmap,
    start: Position,
    goal: Position,
    via: Sequence[Position] = (),
    *,
    space: str = "R2",
) -> list[Position]:
    """Return start, waypoints and goal as numbers, if the robot can stand at all of them.

    Parameters
    ----------
    costs : Costmap
        The costmap, whose blocked cells count.
    start, goal : (x, y) or (x, y, heading)
        Positions in the world [m], with a heading [rad] in all spaces but "R2".
    via : sequence of (x, y) or (x, y, heading), default ()
        Waypoints in between [m, rad].
    space : str, default "R2"
        The planner's space: "R2", "SE2", "Dubins", "ReedsShepp" or "lattice".

    Returns
    -------
    list of (x, y) or (x, y, heading)
        Start, waypoints and goal [m, rad], with headings in -pi..pi.

    Raises
    ------
    PoseError
        If it cannot, with the nearest free position, or if a heading is missing or useless.
    """
    stops = [(start, "start"), *((xy, f"waypoint {n}") for n, xy in enumerate(via, 1))]
    headed = None if space == LATTICE else space != "R2"
    return [
        check_pose(costs, pose, role, has_heading=headed) for pose, role in [*stops, (goal, "goal")]
    ]


def plan(
    costs: Costmap,
    start: Position,
    goal: Position,
    *,
    planner: AnyPlanner | None = None,
    via: Sequence[Position] = (),
    max_e: float | None = None,
    budget: float | None = None,
    footprint: Footprint | ArrayLike | None = None,
    **options: Any,
) -> Plan:
    """Plan a path of least cost J.

    Parameters
    ----------
    costs : Costmap
        The costmap to plan on.
    start, goal : (x, y) or (x, y, heading)
        Positions in the world [m], with a heading [rad] if the planner's `space` has one.
    planner : str, function or Planner, optional
        A name that ``locplan info`` lists; a function ``f(costs, start, goal, **options)`` that
        returns a `Path`, `Plan` or `PlannerResult`; or an object,
        ``planning.AnyAngle(accuracy="high")``.
        By default "lattice" if the robot of the costmap has an outline or a turning radius,
        otherwise "any-angle". If a planner ignores the outline or the turning radius, the plan's
        note reports it.
    via : sequence of (x, y) or (x, y, heading), default ()
        Positions in the world to visit on the way, in this order [m, rad].
    max_e : float, optional
        The path enters no cell whose e is above this [m^2 rad], above 0; by default there is no
        limit.
    budget : float, optional
        The path is the shortest one whose integral of u is at most this [m], or of e with
        ``objective="e"`` [m^2 rad m], >= 0. By default `plan` finds the path of least J
        instead. The grid planner finds the path exactly; its options are the fields of
        `BudgetPlanner`, which also documents the tolerance.
    footprint : Footprint or (n, 2) array, optional
        The robot's outline [m], which must stay clear of walls along the path. `plan` returns the
        first clear path of three: the cheapest for the inscribed circle, the cheapest for the
        circumscribed circle, and the path of `Lattice`. If no motions of the lattice lead there,
        the status is "not found". By default the robot is a circle of the costmap's radius; give
        the outline of a robot that is far from round.
    **options
        Options of the planner: see `GridPlanner` (also for "astar" and "dijkstra"),
        `AnyAngle`, `Lattice` and `Ompl`.

    Returns
    -------
    Plan
        The plan, with status "unreachable" if no path joins start and goal, "infeasible" if none
        does within the limits, "timeout" if none was found in time, and "not found" if none was
        found though there may be one.

    Raises
    ------
    PoseError
        If start, goal or a waypoint lies outside the map or in a blocked cell, or lacks a heading.
    ConfigError
        If the planner or an option is unknown, or a limit is out of its range.

    Examples
    --------
    >>> import numpy as np
    >>> from locplan.maps import FREE, OccupancyGrid
    >>> grid = OccupancyGrid(np.full((4, 4), FREE), resolution=1.0)
    >>> result = plan(Costmap.from_density(grid, np.ones((4, 4))), (0.5, 0.5), (3.5, 2.5))
    >>> result.path.xy.tolist()
    [[0.5, 0.5], [3.5, 2.5]]
    >>> round(result.metrics.cost, 3)
    3.606
    """
    check_costs(costs)
    outline = parse_footprint(footprint)
    limited_planner = make_planner(
        planner,
        options,
        via=via,
        max_e=max_e,
        budget=budget,
        footprint=outline,
        robot=costs.robot,
    )
    start, *waypoints, goal = check_ends(costs, start, goal, via, space=limited_planner.space)
    if isinstance(limited_planner, LimitedPlanner):
        limited_planner = dataclasses.replace(limited_planner, via=tuple(waypoints))
    limited_planner.prepare()
    corners = None if outline is None else tuple((x, y) for x, y in outline.vertices.tolist())
    return dataclasses.replace(
        run_planner(limited_planner, costs, start, goal),
        via=tuple(waypoints),
        max_e=max_e,
        budget=None if budget is None else float(budget),
        footprint=corners,
    )


def run_planner(planner: Planner, costs: Costmap, start: Position, goal: Position) -> Plan:
    """Plan between two positions that were checked, with a planner that was prepared.

    Parameters
    ----------
    planner : Planner
        The planner, as `make_planner` makes it; its `prepare` has been called.
    costs : Costmap
        The costmap to plan on.
    start, goal : (x, y) or (x, y, heading)
        Positions in the world [m, rad], as `check_ends` returns them.

    Returns
    -------
    Plan
        The plan with the path's metrics and the time that it took.
    """
    began = time.perf_counter()
    planner_result = planner.solve(costs, start, goal)
    elapsed = (
        time.perf_counter() - began
        if planner_result.solve_time is None
        else planner_result.solve_time
    )
    if planner_result.path is not None and (
        note := describe_robot_conflict(planner, costs, planner_result.path)
    ):
        planner_result = dataclasses.replace(
            planner_result, note="; ".join(filter(None, [planner_result.note, note]))
        )
    timed_plan = make_plan(planner.name, costs, start, goal, planner_result, elapsed)
    return dataclasses.replace(timed_plan, minimises=planner.minimises is not None)


def plan_with_shortest(
    costs: Costmap,
    start: Position,
    goal: Position,
    *,
    planner: AnyPlanner | None = None,
    via: Sequence[Position] = (),
    max_e: float | None = None,
    budget: float | None = None,
    footprint: Footprint | ArrayLike | None = None,
    **options: Any,
) -> dict[str, Plan]:
    """Plan as `plan` does, and plan the shortest path without limits of e for comparison.

    Both are measured on `costs`. Any-angle paths are improved from two beginnings here: unless
    there are limits, the shorter of the two counts as the shortest, and the cheaper one as the
    localizability-aware one. Paths of planners with random numbers are not exchanged.

    Parameters
    ----------
    costs : Costmap
        Costmap of a field, with the weight of the localizability-aware path.
    start, goal : (x, y) or (x, y, heading)
        Positions in the world [m, rad].
    planner, via, footprint
        Planner, waypoints and footprint of both paths; see `plan`. With a budget the planner
        is "grid" by default.
    max_e, budget : float, optional
        Limits of the localizability-aware path alone; see `plan`.
    **options
        Options of the planner of both paths; see `plan`.

    Returns
    -------
    dict of str to Plan
        The plans "shortest" and "localizability-aware".

    Raises
    ------
    LocplanError
        The errors of `plan`.
    """
    if budget is not None:
        planner = planner or "grid"
    request: dict[str, Any] = {"planner": planner, "via": via, "footprint": footprint, **options}
    # Of the many shortest paths on a grid this is the one that sees most: the comparison is fair.
    shortest = plan(costs.for_shortest, start, goal, **request).with_costs(costs)
    aware = plan(costs, start, goal, max_e=max_e, budget=budget, **request)
    solved_plans = [candidate for candidate in (shortest, aware) if candidate.metrics]
    free = max_e is None and budget is None
    aware_planner = make_planner(planner, options, robot=costs.robot)
    if free and len(solved_plans) == 2 and not has_option(aware_planner, "seed"):
        shortest, aware = (
            min(solved_plans, key=lambda candidate: getattr(candidate.metrics, measure))
            for measure in ("length", "cost")
        )
    return {SHORTEST: shortest, AWARE: aware}


T = TypeVar("T")


def plan_with_adaptive_field(
    grid: OccupancyGrid,
    config: FieldConfig,
    make_field: Callable[[Bools], CovarianceField],
    plan_on_field: Callable[[CovarianceField], T],
    get_paths: Callable[[T], Iterable[Path]],
) -> tuple[CovarianceField, T]:
    """Plan on every second lattice point, then on all points near the paths, until they stay there.

    On a real map of 0.05 m about two fifths of the points are evaluated for a path across it.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    config : FieldConfig
        Settings of the field.
    make_field : callable
        Function of a mask (h, w) of lattice points that returns the field with values at those.
    plan_on_field : callable
        Function of a field that plans on it, and returns its plans.
    get_paths : callable
        Function of what `plan_on_field` returned that returns the paths in it.

    Returns
    -------
    field : CovarianceField
        The last field; NaN at points that were not evaluated.
    planned
        The result of the last planning on it.
    """
    required = config.lattice_points(grid)
    resolution, stride = grid.resolution, config.stride_cells(grid.resolution)
    points = select_every_second_point(required)
    for _ in range(3):  # at last there is a fourth field, whose paths may leave what is fine
        field = make_field(points)
        points = points | field.is_evaluated
        plans = plan_on_field(field)
        spacing = max(resolution, stride * resolution / 2)
        along = [path.resample(spacing).xy for path in get_paths(plans)]
        xy = np.concatenate([*along, np.empty((0, 2))])
        cells = np.stack(grid.world_to_grid(*xy.T), axis=1) - 0.5  # from the first cell's centre
        # Within 0.3 m of a path, or one and a half strides, the field must be fine, ...
        close = find_near_points(required, stride, cells, max(0.3 / resolution, 1.5 * stride))
        if not (close & ~points).any():
            return field, plans
        # ... and is made so within 1 m, so that the next paths have room to move.
        points = points | find_near_points(required, stride, cells, 1.0 / resolution)
        del field, plans  # saves memory on a large map
    field = make_field(points)
    return field, plan_on_field(field)
