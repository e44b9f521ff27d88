"""Limits that a path must keep: waypoints, a greatest e, and an outline clear of walls."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import positive
from locplan.costs import Costmap, Footprint, Path
from locplan.costs._path import joined
from locplan.errors import ConfigError
from locplan.planners._budget import rounded_up
from locplan.planners._grid import bordered_index
from locplan.planners._protocol import Found, Position, Wrapper


@dataclass(frozen=True)
class Limited(Wrapper):
    """A planner whose paths keep limits; see `locplan.plan`."""

    via: tuple[Position, ...] = ()
    """The waypoints to visit in their order, as positions [m] or poses."""
    outline: Footprint | None = None
    """The robot's outline to keep clear of walls [m]."""
    max_e: float | None = None
    """The greatest e of a cell that may be entered [m^2 rad]."""

    def check(self) -> None:
        """Raise a ConfigError unless the limit of e is a positive number."""
        super().check()
        if self.max_e is not None:
            positive("max_e", self.max_e, "m^2 rad")

    def solve(self, costs: Costmap, start: Position, goal: Position) -> Found:
        """Plan within all limits."""
        stops = start, *self.via, goal
        found = self._clear(costs, stops) if self.max_e is None else self._below(costs, stops)
        return found

    def _below(self, costs: Costmap, stops: Sequence[Position]) -> Found:
        """Plan where e allows it; if nothing joins the stops there, find the least e that does."""
        assert self.max_e is not None
        allowed, found = _allowed(costs, self.max_e), None
        if _free(allowed, stops):
            found = self._clear(allowed, stops)
            if found.path is not None:
                return found
        inner = costs
        if self.outline:
            inner = costs.with_robot_radius(max(self.outline.inscribed_radius, costs.robot_radius))
        least = _least_max_e(inner, stops, getattr(self.planner, "allow_corner_cutting", False))
        if least is None or least <= self.max_e:  # max_e is not the reason
            return found or self._clear(costs, stops)
        verdict = "is needed at least" if self.outline else "would do"
        note = f"every path enters cells with e above {self.max_e:g};"
        note += f" max_e {rounded_up(least)} {verdict}"
        return Found(status="infeasible", feasible_from=least, note=note)

    def _clear(self, costs: Costmap, stops: Sequence[Position]) -> Found:
        """Plan for the outline's inscribed circle and, if it meets a wall, the circumscribed."""
        if self.outline is None:
            return self._over(costs, stops)
        meets, timeout = None, None
        for radius in (self.outline.inscribed_radius, self.outline.circumscribed_radius):
            wide = costs.with_robot_radius(max(radius, costs.robot_radius))
            if not _free(wide, stops):
                continue
            found = self._over(wide, stops)
            if found.status == "timeout":
                timeout = found
            if found.path is not None:
                collision = self.outline.first_collision(costs.grid, found.path)
                if collision is None:
                    return found
                meets = meets or collision
        without = timeout or self._over(costs, stops)
        if without.path is None:
            return without
        note = "no path is wide enough for the footprint"
        if meets:
            where = f"{meets[0]:.2f},{meets[1]:.2f}"
            note = f"the footprint meets a wall where its inner circle passes (near {where})"
        return Found(status="infeasible", note=note)

    def _over(self, costs: Costmap, stops: Sequence[Position]) -> Found:
        """Plan each leg from one stop to the next separately."""
        legs: list[Path] = []
        expanded: int | None = 0
        for number, ends in enumerate(itertools.pairwise(stops), 1):
            found = self.planner.solve(costs, *ends)
            if not self.via:
                return found
            if expanded is not None:
                expanded = None if found.expanded is None else expanded + found.expanded
            if found.path is None:
                if number == len(stops) - 1:
                    return found
                because = f": {found.note}" if found.note else ""
                note = f"no path leads to waypoint {number}{because}"
                return dataclasses.replace(found, note=note, expanded=expanded)
            legs.append(found.path)
        return Found(joined(legs), expanded=expanded)


def _least_max_e(
    costs: Costmap, stops: Sequence[Position], allow_corner_cutting: bool
) -> float | None:
    """The least `max_e` [m^2 rad] with which a grid path joins the stops, None if none does."""
    from locplan._kernels.search import bordered_half, shortest_costs

    if not _free(costs, stops):
        return None
    columns = costs.grid.shape[1] + 2
    cells = [bordered_index(costs, stop[:2], "position") for stop in stops]

    def joins(max_e: float) -> bool:
        half = bordered_half(_allowed(costs, max_e).density, 1)
        cost = shortest_costs(half, columns, cells[0], -1, allow_corner_cutting)
        return bool(np.isfinite(cost[cells]).all())

    levels = np.unique(costs.e[np.isfinite(costs.density)])
    low, high = 0, len(levels) - 1
    if not joins(float(levels[high])):
        return None
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if joins(float(levels[middle])) else (middle + 1, high)
    return float(levels[low])


def _free(costs: Costmap, stops: Sequence[Position]) -> bool:
    """Return whether the robot can stand at all stops."""
    return all(np.isfinite(costs.density[costs.grid.world_to_cell(*stop[:2])]) for stop in stops)


def _allowed(costs: Costmap, max_e: float) -> Costmap:
    """A copy of the costmap in which the cells with e above a limit are blocked."""
    free: NDArray[np.bool_] = np.isfinite(costs.density)
    if not np.isfinite(costs.e[free]).all():
        raise ConfigError("a costmap without a field has no e to limit")
    return costs.blocked_where(costs.e > max_e)
