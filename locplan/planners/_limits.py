"""Limits that a path must keep: a greatest e, a budget, the robot's outline."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap, Footprint
from locplan.errors import ConfigError
from locplan.planners._budget import check_budget, shortest_within
from locplan.planners._result import Plan, Position, Solver, finished


def never_above(
    solver: Solver, max_e: float, outline: Footprint | None, allow_corner_cutting: bool
) -> Solver:
    """A solver that enters no cell whose e is above `max_e` [m^2 rad]."""

    def limited(costs: Costmap, stops: list[Position]) -> dict[str, Any]:
        allowed = _allowed(costs, max_e)
        found: dict[str, Any] = {}
        if _free(allowed, stops):
            found = solver(allowed, stops)
        if "path" in found:
            return found
        inner = costs
        if outline:
            inner = costs.with_robot_radius(max(outline.inscribed_radius, costs.robot_radius))
        least = least_max_e(inner, stops, allow_corner_cutting)
        if least is None or least <= max_e:
            return found or solver(costs, stops)  # it is not for max_e that there is none
        verdict = "is needed at least" if outline else "would do"
        note = f"every path enters cells with e above {max_e:g};"
        note += f" max_e {_rounded_up(least)} {verdict}"
        return {"status": "infeasible", "feasible_from": least, "note": note}

    return limited


def least_max_e(
    costs: Costmap, stops: list[Position], allow_corner_cutting: bool = False
) -> float | None:
    """The least `max_e` [m^2 rad] with which a grid path joins the stops, None if none does."""
    from locplan._kernels.search import bordered_half, shortest_costs
    from locplan.planners._grid import bordered_index

    if not _free(costs, stops):
        return None
    columns = costs.grid.shape[1] + 2
    cells = [bordered_index(costs, stop[:2], "position") for stop in stops]

    def joined(max_e: float) -> bool:
        half = bordered_half(_allowed(costs, max_e).density, 1)
        cost = shortest_costs(half, columns, cells[0], -1, allow_corner_cutting)
        return bool(np.isfinite(cost[cells]).all())

    levels = np.unique(costs.e[np.isfinite(costs.density)])
    low, high = 0, len(levels) - 1
    if not joined(float(levels[high])):
        return None
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if joined(float(levels[middle])) else (middle + 1, high)
    return float(levels[low])


def clear_of_walls(solver: Solver, outline: Footprint) -> Solver:
    """A solver whose paths keep the robot's outline clear of walls.

    It tries the cheapest path for the inscribed circle and, where the outline meets a wall on
    that, the one for the circumscribed circle.
    """

    def clear(costs: Costmap, stops: list[Position]) -> dict[str, Any]:
        meets, timeout = None, None
        for radius in (outline.inscribed_radius, outline.circumscribed_radius):
            wide = costs.with_robot_radius(max(radius, costs.robot_radius))
            if not _free(wide, stops):
                continue
            found = solver(wide, stops)
            if found.get("status") == "timeout":
                timeout = found
            if "path" in found:
                collision = outline.first_collision(costs.grid, found["path"])
                if collision is None:
                    return found
                meets = meets or collision
        without = timeout or solver(costs, stops)
        if "path" not in without:
            return without
        note = "no path is wide enough for the footprint"
        if meets:
            where = f"{meets[0]:.2f},{meets[1]:.2f}"
            note = f"where its inner circle passes the footprint meets a wall (near {where})"
        return {"status": "infeasible", "note": note}

    return clear


def within_budget(
    costs: Costmap,
    start: Position,
    goal: Position,
    budget: float,
    options: dict[str, Any],
) -> Plan:
    """The shortest path within a budget; see `locplan.planners.plan`."""
    started = time.perf_counter()
    found = shortest_within(costs, start, goal, budget, **options)
    elapsed = time.perf_counter() - started
    result = finished("grid", costs, start, goal, found.path, elapsed)
    if found.path is not None:
        return dataclasses.replace(result, bound=found.bound)
    if math.isinf(found.least):
        return result
    objective = options.get("objective", "u")
    least = _rounded_up(found.least)
    note = f"no path has an integral of {objective} within {budget:g}; the least is {least}"
    return dataclasses.replace(result, status="infeasible", feasible_from=found.least, note=note)


def check_limits(
    planner: str,
    via: Sequence[Position],
    max_e: float | None,
    budget: float | None,
    footprint: Footprint | None,
    options: Mapping[str, Any],
) -> None:
    """Raise a ConfigError unless these arguments of `locplan.plan` go together."""
    if max_e is not None and not (isinstance(max_e, Real) and 0 < max_e < math.inf):
        raise ConfigError(f"max_e must be a positive number of m^2 rad, not {max_e!r}")
    if budget is None:
        return
    if planner != "grid" or len(via) or footprint is not None or max_e is not None:
        raise ConfigError("a budget is for planner 'grid', without via, footprint and max_e")
    known = shortest_within.__kwdefaults__ or {}
    for name in options:
        if name not in known:
            raise ConfigError(f"a budget has no option {name!r}; it has: {', '.join(known)}")
    check_budget(budget, **options)


def _free(costs: Costmap, stops: list[Position]) -> bool:
    return all(np.isfinite(costs.density[costs.grid.world_to_cell(*stop[:2])]) for stop in stops)


def _rounded_up(value: float) -> str:
    """In six digits, and not below the value: fit to be typed in again."""
    return f"{value * (1 + 1e-5):.6g}"


def _allowed(costs: Costmap, max_e: float) -> Costmap:
    """With the cells above it blocked; without a field there is no e to limit."""
    free: NDArray[np.bool_] = np.isfinite(costs.density)
    if not np.isfinite(costs.e[free]).all():
        raise ConfigError("a costmap without a field has no e to limit")
    return costs.blocked_where(costs.e > max_e)
