"""What planners return."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from locplan.costmap import Costmap
from locplan.metrics import PathMetrics, path_metrics
from locplan.path import Path

Position = tuple[float, float]
"""x, y in the world [m]."""


@dataclass(frozen=True)
class Plan:
    """What a planner returned."""

    status: Literal["solved", "unreachable", "infeasible"]
    """Whether there is a path.

    None to the goal ("unreachable"), or none within the limits given ("infeasible"), is a result,
    not an error.
    """
    planner: str
    """The planner's name."""
    start: Position
    """World position [m]."""
    goal: Position
    """World position [m]."""
    path: Path | None
    """The path from start to goal, or None."""
    metrics: PathMetrics | None
    """What the path costs, or None."""
    solve_time: float
    """Time spent planning, without compilation [s]."""
    via: tuple[Position, ...] = ()
    """World positions visited on the way [m]."""
    max_e: float | None = None
    """The limit it was to keep, if any [m^2 rad]."""
    budget: float | None = None
    """The limit of its integral, if any [m, or m^2 rad m]."""
    footprint: tuple[Position, ...] | None = None
    """The outline it was to keep clear of walls, if any [m]."""
    bound: float | None = None
    """With a budget: no path within it is shorter [m]."""
    feasible_from: float | None = None
    """If infeasible: the least `budget` or `max_e` with which there is a path."""
    note: str = ""
    """Why there is no path, and what would help, if that is known."""

    def measured_on(self, costs: Costmap) -> Plan:
        """The same path with its metrics on another costmap of the same map."""
        if self.path is None:
            return self
        return dataclasses.replace(self, metrics=path_metrics(costs, self.path))


Solver = Callable[[Costmap, list[Position]], dict[str, Any]]
"""Finds the path over some stops: what it returns are fields of `Plan`, "path" if there is one."""


def finished(
    planner: str, costs: Costmap, start: Position, goal: Position, path: Path | None, elapsed: float
) -> Plan:
    """A plan with its metrics, "unreachable" without a path."""
    if path is None:
        note = f"no path joins start and goal for a robot of radius {costs.robot_radius:g} m"
        return Plan("unreachable", planner, start, goal, None, None, elapsed, note=note)
    return Plan("solved", planner, start, goal, path, path_metrics(costs, path), elapsed)
