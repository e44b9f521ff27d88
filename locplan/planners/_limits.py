"""Limits that a path must keep, as planners around another: waypoints, a greatest e, an outline."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import positive
from locplan.costs import Costmap, Footprint
from locplan.costs._path import joined
from locplan.errors import ConfigError
from locplan.planners._budget import rounded_up
from locplan.planners._protocol import Found, Planner, Position, Wrapper


def limited(
    planner: Planner,
    via: Sequence[Position] = (),
    max_e: float | None = None,
    outline: Footprint | None = None,
) -> Planner:
    """A planner whose paths keep these limits; see `locplan.plan`."""
    cutting = bool(getattr(planner, "allow_corner_cutting", False))
    stops = tuple(via)
    if stops:
        planner = Via(planner, stops)
    if outline is not None:
        planner = ClearOfWalls(planner, outline, stops)
    if max_e is not None:
        planner = NeverAbove(planner, max_e, stops, outline, cutting)
    return planner


@dataclass(frozen=True)
class Via(Wrapper):
    """Paths over waypoints, each leg planned for itself."""

    via: tuple[Position, ...]
    """World positions [m], or poses, in their order."""

    def solve(self, costs: Costmap, start: Position, goal: Position) -> Found:
        """Plan from each stop to the next."""
        legs = []
        for number, ends in enumerate(itertools.pairwise((start, *self.via, goal)), 1):
            found = self.planner.solve(costs, *ends)
            if found.path is None:
                if number <= len(self.via):
                    because = f": {found.note}" if found.note else ""
                    note = f"no path leads to waypoint {number}{because}"
                    found = dataclasses.replace(found, note=note)
                return dataclasses.replace(found, solve_time=None)
            legs.append(found.path)
        return Found(joined(legs))


@dataclass(frozen=True)
class NeverAbove(Wrapper):
    """Paths that enter no cell whose e is above a limit."""

    max_e: float
    """The limit [m^2 rad]."""
    via: tuple[Position, ...] = ()
    """The waypoints that the planner visits [m]."""
    outline: Footprint | None = None
    """The robot's outline that it keeps clear of walls."""
    allow_corner_cutting: bool = False
    """Whether its grid paths pass corners of blocked cells."""

    def check(self) -> None:
        """Raise a ConfigError unless the limit is a positive number."""
        super().check()
        positive("max_e", self.max_e, "m^2 rad")

    def solve(self, costs: Costmap, start: Position, goal: Position) -> Found:
        """Plan where e allows it; if nothing joins the stops there, find the least e that does."""
        stops, allowed, found = (start, *self.via, goal), _allowed(costs, self.max_e), None
        if _free(allowed, stops):
            found = self.planner.solve(allowed, start, goal)
            if found.path is not None:
                return dataclasses.replace(found, solve_time=None)
        inner = costs
        if self.outline:
            radius = max(self.outline.inscribed_radius, costs.robot_radius)
            inner = costs.with_robot_radius(radius)
        least = least_max_e(inner, stops, self.allow_corner_cutting)
        if least is None or least <= self.max_e:  # it is not for max_e that there is none
            found = found or self.planner.solve(costs, start, goal)
            return dataclasses.replace(found, solve_time=None)
        verdict = "is needed at least" if self.outline else "would do"
        note = f"every path enters cells with e above {self.max_e:g};"
        note += f" max_e {rounded_up(least)} {verdict}"
        return Found(status="infeasible", feasible_from=least, note=note)


@dataclass(frozen=True)
class ClearOfWalls(Wrapper):
    """Paths that keep the robot's outline clear of walls.

    The cheapest path for the inscribed circle is tried and, where the outline meets a wall on
    that, the one for the circumscribed circle.
    """

    outline: Footprint
    """The robot's outline [m]."""
    via: tuple[Position, ...] = ()
    """The waypoints that the planner visits [m]."""

    def solve(self, costs: Costmap, start: Position, goal: Position) -> Found:
        """Plan for both circles, one after the other."""
        meets, timeout = None, None
        for radius in (self.outline.inscribed_radius, self.outline.circumscribed_radius):
            wide = costs.with_robot_radius(max(radius, costs.robot_radius))
            if not _free(wide, (start, *self.via, goal)):
                continue
            found = dataclasses.replace(self.planner.solve(wide, start, goal), solve_time=None)
            if found.status == "timeout":
                timeout = found
            if found.path is not None:
                collision = self.outline.first_collision(costs.grid, found.path)
                if collision is None:
                    return found
                meets = meets or collision
        without = timeout or self.planner.solve(costs, start, goal)
        if without.path is None:
            return dataclasses.replace(without, solve_time=None)
        note = "no path is wide enough for the footprint"
        if meets:
            where = f"{meets[0]:.2f},{meets[1]:.2f}"
            note = f"where its inner circle passes the footprint meets a wall (near {where})"
        return Found(status="infeasible", note=note)


def least_max_e(
    costs: Costmap, stops: Sequence[Position], allow_corner_cutting: bool = False
) -> float | None:
    """The least `max_e` [m^2 rad] with which a grid path joins the stops, None if none does."""
    from locplan._kernels.search import bordered_half, shortest_costs
    from locplan.planners._grid import bordered_index

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
    return all(np.isfinite(costs.density[costs.grid.world_to_cell(*stop[:2])]) for stop in stops)


def _allowed(costs: Costmap, max_e: float) -> Costmap:
    """With the cells above it blocked; without a field there is no e to limit."""
    free: NDArray[np.bool_] = np.isfinite(costs.density)
    if not np.isfinite(costs.e[free]).all():
        raise ConfigError("a costmap without a field has no e to limit")
    return costs.blocked_where(costs.e > max_e)
