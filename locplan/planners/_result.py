"""What planners return."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import ClassVar

from locplan._util.notebook import Pictured
from locplan.costs import Costmap, Path, PathMetrics, path_metrics
from locplan.planners._protocol import Found, Position, Status


@dataclass(frozen=True, repr=False)
class Plan(Pictured):
    """What a planner returned."""

    _drawn_by: ClassVar[str] = "locplan.plotting:path_figure"

    status: Status
    """Whether there is a path.

    None to the goal ("unreachable"), none within the limits given ("infeasible"), or none found in
    time ("timeout"), is a result, not an error.
    """
    planner: str
    """The planner's name."""
    start: Position
    """World position [m], or pose."""
    goal: Position
    """World position [m], or pose."""
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
    minimises: bool = True
    """Whether the planner seeks the least J; some of OMPL's stop at the first path they find."""
    history: tuple[tuple[float, float], ...] = ()
    """Of a sampling planner: seconds since it began and its best J [m], whenever that fell.

    Of a path over waypoints there is none.
    """
    note: str = ""
    """Why there is no path, and what would help, if that is known."""
    costs: Costmap | None = field(default=None, compare=False)
    """The costmap that `metrics` were measured on."""

    def __repr__(self) -> str:
        ends = " to ".join(",".join(f"{v:g}" for v in end) for end in (self.start, self.goal))
        if self.metrics is None:
            return f"Plan({self.status}, {self.planner}, {ends}: {self.note or 'no path'})"
        return (
            f"Plan({self.status}, {self.planner}, {ends}: {self.metrics.length:.2f} m long,"
            f" cost {self.metrics.cost:.2f} m, {self.solve_time:.3g} s)"
        )

    def measured_on(self, costs: Costmap) -> Plan:
        """The same path with its metrics on another costmap of the same map, without history."""
        if self.path is None:
            return self
        metrics = path_metrics(costs, self.path)
        return dataclasses.replace(self, metrics=metrics, history=(), costs=costs)


def finished(
    planner: str,
    costs: Costmap,
    start: Position,
    goal: Position,
    found: Found,
    elapsed: float,
    *,
    minimises: bool = True,
) -> Plan:
    """What a planner found as a plan, with the metrics of its path on a costmap."""
    note = found.note
    if found.status == "unreachable" and not note:
        note = f"no path joins start and goal for a robot of radius {costs.robot_radius:g} m"
    return Plan(
        status=found.status,
        planner=planner,
        start=tuple(start),
        goal=tuple(goal),
        path=found.path,
        metrics=None if found.path is None else path_metrics(costs, found.path),
        solve_time=elapsed,
        bound=found.bound,
        feasible_from=found.feasible_from,
        minimises=minimises,
        history=found.history,
        note=note,
        costs=costs,
    )
