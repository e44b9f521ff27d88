"""Limits that a path must keep: waypoints, a greatest e, and an outline clear of walls."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from locplan._support.checks import check_positive
from locplan._support.tables import format_rounded_up
from locplan.errors import ConfigError
from locplan.planning.cost_to_go import plan_field
from locplan.planning.costmap import Costmap
from locplan.planning.lattice import Lattice
from locplan.planning.path import Path
from locplan.planning.protocol import (
    CURVED,
    LATTICE,
    Planner,
    PlannerResult,
    PlannerWrapper,
    Position,
)
from locplan.robots.parts import Footprint
from locplan.robots.robot import Robot


@dataclass(frozen=True)
class LimitedPlanner(PlannerWrapper):
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
            check_positive("max_e", self.max_e, "m^2 rad")

    def solve(self, costs: Costmap, start: Position, goal: Position) -> PlannerResult:
        """Plan within all limits."""
        stops = start, *self.via, goal
        return (
            self._plan_for_outline(costs, stops)
            if self.max_e is None
            else self._plan_below_max_e(costs, stops)
        )

    def _plan_below_max_e(self, costs: Costmap, stops: Sequence[Position]) -> PlannerResult:
        """Plan where e allows it; if nothing joins the stops there, find the least e that does."""
        assert self.max_e is not None
        allowed, planner_result = _block_high_e(costs, self.max_e), None
        if _are_free(allowed, stops):
            planner_result = self._plan_for_outline(allowed, stops)
            if planner_result.path is not None:
                return planner_result
        lowest_max_e = self._find_least_max_e(self._make_thin_costmap(costs), stops)
        if lowest_max_e is None or lowest_max_e <= self.max_e:  # max_e is not the reason
            return planner_result or self._plan_for_outline(costs, stops)
        any_will_do = self.outline is None and self.space not in CURVED
        verdict = "would do" if any_will_do else "is needed at least"
        note = f"every path enters cells with e above {self.max_e:g};"
        note += f" max_e {format_rounded_up(lowest_max_e)} {verdict}"
        return PlannerResult(status="infeasible", feasible_from=lowest_max_e, note=note)

    def _plan_for_outline(self, costs: Costmap, stops: Sequence[Position]) -> PlannerResult:
        """Plan for the outline's inscribed circle, the circumscribed one, or the outline itself."""
        if self.outline is None:
            return self._plan_legs(costs, stops)
        if self.space == LATTICE:
            return self._plan_by_lattice(costs, stops, self.planner)
        planner_result, gave_up, meets = self._plan_for_circles(costs, stops)
        if planner_result is not None:
            return planner_result
        if not self._can_join(self._make_thin_costmap(costs), stops):
            without = self._plan_legs(costs, stops)
            if without.path is None:
                return without
            inner = f"radius {self.outline.inscribed_radius:.3g} m"
            note = f"not even the footprint's inner circle ({inner}) fits through"
            return PlannerResult(status="infeasible", note=note)
        if self.space == "R2" and gave_up is None:
            limit = getattr(self.planner, "time_limit", None)
            planner_result = self._plan_by_lattice(costs, stops, Lattice(time_limit=limit))
            if planner_result.path is not None:
                note = "planned by the lattice for the footprint itself: no path of its inner or"
                note += " outer circle is clear of walls"
                return dataclasses.replace(
                    planner_result, note="; ".join(filter(None, [note, planner_result.note]))
                )
            if planner_result.status == "timeout":
                return planner_result
        return gave_up or self._describe_failed_search(costs, meets)

    def _plan_for_circles(
        self, costs: Costmap, stops: Sequence[Position]
    ) -> tuple[PlannerResult | None, PlannerResult | None, tuple[float, float] | None]:
        """Return a circle's path that is clear for the outline, or None without one.

        The second value is the last search that gave up. The third is the position of the outline's
        first collision on the inner circle's path.
        """
        assert self.outline is not None
        inner, outer = self.outline.inscribed_radius, self.outline.circumscribed_radius
        meets, gave_up = None, None
        wider = f"planned for the footprint's outer circle (radius {outer:.3g} m), since it meets a"
        wider += " wall on the path of the inner one: there may be a better path between"
        for radius in (inner, outer):
            wide = costs.with_robot(max(radius, costs.robot_radius))
            if not _are_free(wide, stops):
                continue
            planner_result = self._plan_legs(wide, stops)
            if planner_result.status in ("timeout", "not found"):
                gave_up = planner_result
            if planner_result.path is None:
                continue
            collision = self.outline.find_first_collision(costs.grid, planner_result.path)
            if collision is None:
                clear = (
                    dataclasses.replace(planner_result, note=wider)
                    if radius > inner
                    else planner_result
                )
                return clear, None, None
            meets = meets or collision
        return None, gave_up, meets

    def _plan_by_lattice(
        self, costs: Costmap, stops: Sequence[Position], planner: Planner
    ) -> PlannerResult:
        """Plan for the outline itself, by a lattice."""
        assert self.outline is not None
        robot = dataclasses.replace(costs.robot or Robot(), footprint=self.outline)
        outline_costs = dataclasses.replace(costs, robot=robot)
        return dataclasses.replace(self, planner=planner)._plan_legs(outline_costs, stops)

    def _describe_failed_search(
        self, costs: Costmap, meets: tuple[float, float] | None
    ) -> PlannerResult:
        """Return the description of a failed search with an outline, for a plan's note."""
        assert self.outline is not None
        inner, outer = self.outline.inscribed_radius, self.outline.circumscribed_radius
        note = f"only the paths of the footprint's inner and outer circle (radii {inner:.3g} and"
        note += f" {outer:.3g} m) were searched"
        if self.space == "R2":
            edge = f"cells of {costs.grid.resolution:g} m"
            note += f", and the lattice's motions between {Lattice().headings} headings and {edge}"
        note += ": there may be another path"
        if meets:
            place_text = f"{meets[0]:.2f},{meets[1]:.2f}"
            note += f"; the footprint meets a wall on that of the inner circle (near {place_text})"
        return PlannerResult(note=note)

    def _plan_legs(self, costs: Costmap, stops: Sequence[Position]) -> PlannerResult:
        """Plan each leg from one stop to the next separately."""
        legs: list[Path] = []
        notes: list[str] = []
        expanded: int | None = 0
        begin = stops[0]
        for number, end in enumerate(stops[1:], 1):
            planner_result = self.planner.solve(costs, begin, end)
            if not self.via:
                return planner_result
            if expanded is not None:
                expanded = (
                    None if planner_result.expanded is None else expanded + planner_result.expanded
                )
            if planner_result.path is None:
                if number > 1 and planner_result.status == "infeasible":
                    planner_result = dataclasses.replace(
                        planner_result, status="not found"
                    )  # in another heading?
                if number == len(stops) - 1:
                    return planner_result
                because = f": {planner_result.note}" if planner_result.note else ""
                verb = "leads" if planner_result.status == "unreachable" else "was found"
                note = f"no path {verb} to waypoint {number}{because}"
                return dataclasses.replace(planner_result, note=note, expanded=expanded)
            begin = end
            if self.space == LATTICE and planner_result.path.heading is not None:
                x, y, heading = planner_result.path.poses[-1].tolist()
                begin = (x, y, heading)  # goes on as this leg ends
            legs.append(planner_result.path)
            notes += [f"leg {number} {planner_result.note}"] if planner_result.note else []
        return PlannerResult(Path.join(legs), note="; ".join(notes), expanded=expanded)

    def _make_thin_costmap(self, costs: Costmap) -> Costmap:
        """Return the costmap of a robot that fits everywhere that the outline does, for proofs.

        The centre of a cell may be half a cell's diagonal nearer to a wall than the robot's is. A
        costmap of the inscribed radius blocks such cells already: there the map alone proves.
        """
        if self.outline is None or costs.robot_radius > self.outline.inscribed_radius:
            return costs
        radius = self.outline.inscribed_radius - costs.grid.resolution * math.sqrt(0.5)
        if costs.robot_radius <= radius:
            return costs.with_robot(radius)
        thin_costs = Costmap.blank(costs.grid, robot=max(0.0, radius), zones=costs.zones)
        return dataclasses.replace(costs, density=thin_costs.density)

    def _can_join(self, costs: Costmap, stops: Sequence[Position]) -> bool:
        """Return True if a path over the grid joins the stops; otherwise no path does."""
        if not _are_free(costs, stops):
            return False
        cutting = getattr(self.planner, "allow_corner_cutting", False)
        cost = plan_field(costs, stops[0][:2], allow_corner_cutting=cutting).cost
        return all(np.isfinite(cost[costs.grid.cell(stop[:2])]) for stop in stops)

    def _find_least_max_e(self, costs: Costmap, stops: Sequence[Position]) -> float | None:
        """Return the least `max_e` [m^2 rad] with a grid path over the stops, or None."""
        if not self._can_join(costs, stops):
            return None
        levels = np.unique(costs.e[np.isfinite(costs.density)])
        low, high = 0, len(levels) - 1
        while low < high:
            middle = (low + high) // 2
            joins = self._can_join(_block_high_e(costs, float(levels[middle])), stops)
            low, high = (low, middle) if joins else (middle + 1, high)
        return float(levels[low])


def _are_free(costs: Costmap, stops: Sequence[Position]) -> bool:
    """Return whether the robot can stand at all stops."""
    return all(np.isfinite(costs.density[costs.grid.cell(stop[:2])]) for stop in stops)


def _block_high_e(costs: Costmap, max_e: float) -> Costmap:
    """Return a copy of the costmap with the cells blocked whose e is above a limit."""
    if not np.isfinite(costs.e[np.isfinite(costs.density)]).all():
        raise ConfigError("a costmap without a field has no e to limit")
    return costs.with_blocked(costs.e > max_e)
