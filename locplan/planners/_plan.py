"""Planners on a costmap, all through `plan`."""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from locplan.costs import Costmap, Footprint
from locplan.costs._path import joined
from locplan.errors import ConfigError
from locplan.planners import _limits as limits
from locplan.planners._result import Plan, Position, Solver, finished
from locplan.planners._spaces import check_pose
from locplan.planners.ompl._kinds import KINDS

_MODULES = {
    "grid": "locplan.planners._grid",
    "any-angle": "locplan.planners._any_angle",
    **dict.fromkeys(KINDS, "locplan.planners.ompl"),
}
"""Where each planner's `solve` is; imported when first used."""


def names() -> tuple[str, ...]:
    """The planners that `plan` knows."""
    return tuple(_MODULES)


def check_request(
    planner: str,
    *,
    via: Sequence[Position] = (),
    max_e: float | None = None,
    budget: float | None = None,
    footprint: Footprint | None = None,
    **options: Any,
) -> None:
    """Raise a ConfigError unless `plan` knows the planner and takes these arguments together."""
    if planner not in _MODULES:
        raise ConfigError(f"planner must be one of {', '.join(names())}, not {planner!r}")
    limits.check_limits(planner, via, max_e, budget, footprint, options)
    if budget is None:
        module = import_module(_MODULES[planner])
        known = module.solve.__kwdefaults__ or {}
        for name in options:
            if name not in known:
                names_known = ", ".join(known) or "none"
                raise ConfigError(
                    f"planner {planner!r} has no option {name!r}; it has: {names_known}"
                )
        module.check_options(**_named(planner), **options)


def check_ends(
    costs: Costmap,
    start: Position,
    goal: Position,
    via: Sequence[Position] = (),
    *,
    space: str = "R2",
) -> list[Position]:
    """Start, waypoints and goal as numbers, if the robot can stand at all of them.

    Raises
    ------
    PoseError
        If it cannot, with the nearest free position, or a heading is missing or of no use.
    """
    named = [(start, "start"), *((xy, f"waypoint {n}") for n, xy in enumerate(via, 1))]
    headed = space != "R2"
    return [check_pose(costs, pose, role, headed=headed) for pose, role in [*named, (goal, "goal")]]


def plan(
    costs: Costmap,
    start: Position,
    goal: Position,
    *,
    planner: str = "grid",
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
        What travel costs.
    start, goal : (x, y) or (x, y, heading)
        World positions [m]; with a heading [rad] where the planner's `space` has one.
    planner : str
        One of `names`.
    via : sequence of (x, y) or (x, y, heading)
        World positions to visit on the way, in this order [m].
    max_e : float, optional
        Never enter a cell whose e is above this [m^2 rad].
    budget : float, optional
        Instead of the least J, the shortest path whose integral of u is at most this [m]; with
        ``objective="e"``, whose integral of e is [m^2 rad m]. Exact, by the grid planner only;
        options: see `locplan.planners._budget.shortest_within`.
    footprint : Footprint or (n, 2) array, optional
        The robot's outline [m], checked exactly along the path that is returned: the cheapest
        for its inscribed circle or, where the outline meets a wall on that, for its circumscribed
        one. Between the two a way may be missed.
    **options
        Of the planner: see the `solve` function of its module.

    Returns
    -------
    Plan
        With status "unreachable" if no path joins start and goal, "infeasible" if none does
        within the limits, "timeout" if none was found in time.

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
    [[0.5, 0.5], [1.5, 0.5], [3.5, 2.5]]
    >>> round(result.metrics.cost, 3)
    3.828
    """
    outline = None
    if footprint is not None:
        outline = (
            footprint if isinstance(footprint, Footprint) else Footprint(np.asarray(footprint))
        )
    check_request(planner, via=via, max_e=max_e, budget=budget, footprint=outline, **options)
    stops = check_ends(costs, start, goal, via, space=options.get("space", "R2"))
    start, *via, goal = stops
    if budget is not None:
        result = limits.within_budget(costs, start, goal, budget, options)
        return dataclasses.replace(result, budget=float(budget))
    solver = _solver(planner, options)
    if outline is not None:
        solver = limits.clear_of_walls(solver, outline)
    if max_e is not None:
        cutting = bool(options.get("allow_corner_cutting", False))
        solver = limits.never_above(solver, max_e, outline, cutting)
    started = time.perf_counter()
    found = solver(costs, stops)
    elapsed = time.perf_counter() - started
    result = finished(planner, costs, start, goal, found.pop("path", None), elapsed)
    corners = None if outline is None else tuple((x, y) for x, y in outline.vertices.tolist())
    minimises = planner not in KINDS or KINDS[planner].minimises
    asked = dataclasses.replace(
        result, via=tuple(via), max_e=max_e, footprint=corners, minimises=minimises
    )
    return dataclasses.replace(asked, **found)


def plan_beside_shortest(
    costs: Costmap,
    start: Position,
    goal: Position,
    *,
    max_e: float | None = None,
    budget: float | None = None,
    **request: Any,
) -> dict[str, Plan]:
    """The plan that is asked for, and the shortest one without its limits of e, by their names.

    Both are measured on `costs`. Any-angle paths are improved from two beginnings here: unless
    there are limits, the shorter of the two is the shortest, and the cheaper the other. What a
    sampling planner found is not exchanged.
    """
    # Of the many shortest paths on a grid, the one that sees most: the comparison is fair.
    shortest = plan(costs.with_weight(1e-6), start, goal, **request).measured_on(costs)
    aware = plan(costs, start, goal, max_e=max_e, budget=budget, **request)
    both = [one for one in (shortest, aware) if one.metrics]
    exchanged = max_e is None and budget is None and request.get("planner") not in KINDS
    if exchanged and len(both) == 2:
        shortest, aware = (
            min(both, key=lambda one: getattr(one.metrics, measure))
            for measure in ("length", "cost")
        )
    return {"shortest": shortest, "localizability-aware": aware}


def _solver(planner: str, options: dict[str, Any]) -> Solver:
    """The planner as a function of what it is to plan on, from stop to stop."""
    module = import_module(_MODULES[planner])
    options = _named(planner) | options
    module.prepare(**options)

    def over_all(costs: Costmap, stops: list[Position]) -> dict[str, Any]:
        legs = []
        for number, (start, goal) in enumerate(itertools.pairwise(stops), 1):
            found = module.solve(costs, start, goal, **options)
            if not isinstance(found, dict):
                found = {} if found is None else {"path": found}
            if "path" not in found:
                if number < len(stops) - 1:
                    because = f": {found['note']}" if "note" in found else ""
                    found["note"] = f"no path leads to waypoint {number}{because}"
                return found
            legs.append(found["path"])
        if len(legs) == 1:
            return found
        return {"path": joined(legs)}

    return over_all


def _named(planner: str) -> dict[str, Any]:
    """What the module of several planners has to be told."""
    return {"planner": planner} if planner in KINDS else {}
