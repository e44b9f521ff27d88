"""Plans: the paths that planners return, with their metrics."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path as PathOf
from typing import ClassVar

from locplan._util.records import Column, Result, Table
from locplan._util.results import Results
from locplan._util.saved import Stored, listed, tree_of
from locplan.costs import DEGENERATE, Costmap, Path, PathMetrics, path_metrics
from locplan.planners._protocol import Found, Position, Status

METRICS = (
    Column("length", "m", "length"),
    Column("cost", "m", "cost J"),
    Column("integrated_u", "m", "degenerate, ∫u ds"),
    Column("integrated_e", "m² rad m", "∫e ds", 4),
    Column("mean_e", "m² rad", "mean e", 5),
    Column("max_e", "m² rad", "max e", 5),
    Column("degenerate_share", "", f"share with u > {DEGENERATE:g}", 0, "%"),
    Column("longest_degenerate", "m", f"longest with u > {DEGENERATE:g}"),
    Column("clearance", "m", "least clearance"),
)
"""Columns of the metrics of a path."""


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Result, Stored):
    """A path that a planner returned with its metrics, or the reason why there is none.

    `save` writes plan.json, which `load` reads, a picture, and path.csv. The costmap is not saved.
    """

    kind: ClassVar[str] = "plan"
    suffix: ClassVar[str] = ".json"
    files: ClassVar[Results] = Results("plan", ("plan.json", "plan.png", "path.csv"))
    _drawn_by: ClassVar[str] = "locplan.plotting:path_figure"

    status: Status
    """The status is "solved", or says that no path leads to the goal ("unreachable"), that none
    keeps the limits ("infeasible"), that none was found in time ("timeout"), or that none was
    found where the planner searched, though there may be one ("not found")."""
    planner: str
    """The planner's name, such as "any-angle"."""
    start: Position
    """Position of the start in the world [m], or its pose [m, rad]."""
    goal: Position
    """Position of the goal in the world [m], or its pose [m, rad]."""
    path: Path | None
    """The path from start to goal; None without one."""
    metrics: PathMetrics | None
    """The metrics of the path on `costs`; None without a path."""
    solve_time: float
    """Time spent planning, without compilation [s]."""
    via: tuple[Position, ...] = ()
    """Positions in the world that the path visits on the way [m], or poses [m, rad]."""
    max_e: float | None = None
    """The greatest e that was allowed [m^2 rad]; None if there was no limit."""
    budget: float | None = None
    """The greatest integral that was allowed, of u [m] or of e [m^2 rad m]; None if there was
    none."""
    footprint: tuple[Position, ...] | None = None
    """The corners (x, y) of the outline that had to stay clear of walls, about the robot's centre
    [m]; None if the robot's radius counted."""
    bound: float | None = None
    """Least length that a path within the budget can have [m]; None without a budget."""
    feasible_from: float | None = None
    """The `budget` or `max_e` below which there is no path, in its unit, if it is infeasible."""
    minimises: bool = True
    """True if the planner seeks the least J; some of OMPL's stop at the first path they find."""
    expanded: int | None = None
    """Number of cells that a grid planner's search expanded, over all legs; None for others."""
    history: tuple[tuple[float, float], ...] = ()
    """Time since a sampling planner began [s] and its best J [m], whenever that fell; there is
    none over waypoints."""
    note: str = ""
    """A text on why there is no path and what would help; empty if that is not known."""
    costs: Costmap | None = field(default=None, compare=False)
    """The costmap that `metrics` were measured on; None if that is not known."""

    def __repr__(self) -> str:
        ends = " to ".join(",".join(f"{v:g}" for v in end) for end in (self.start, self.goal))
        if self.metrics is None:
            return f"Plan({self.status}, {self.planner}, {ends}: {self.note or 'no path'})"
        return (
            f"Plan({self.status}, {self.planner}, {ends}: {self.metrics.length:.2f} m long,"
            f" cost {self.metrics.cost:.2f} m, {self.solve_time:.3g} s)"
        )

    def summary(self) -> dict[str, object]:
        """All of it but the costmap, fit for JSON; null is a number that is not known."""
        return dict(listed(tree_of(self)))

    def table(self) -> Table:
        """The metrics of the path; no row without one."""
        return Table.of(METRICS, [self.metrics] if self.metrics else [])

    def report(self) -> str:
        """The metrics of the path as text, or why there is none."""
        note = f"\n{self.note}" if self.note else ""
        return f"{self.status}{note}\n{self.table()}" if self.metrics else f"{self.status}{note}"

    @property
    def drawable(self) -> bool:
        """Whether the costmap is known, on which the path is drawn."""
        return self.costs is not None

    def _write(self, folder: PathOf, *_: object) -> None:
        if self.path is not None:
            self.path.save(folder / "path.csv")

    def measured_on(self, costs: Costmap) -> Plan:
        """A copy with the metrics on another costmap of the same map, without history.

        Parameters
        ----------
        costs : Costmap
            The costmap to measure the path on, such as one of another weight or estimator.
        """
        if self.path is None:
            return self
        metrics = path_metrics(costs, self.path)
        return dataclasses.replace(self, metrics=metrics, history=(), costs=costs)


def finished(
    planner: str, costs: Costmap, start: Position, goal: Position, found: Found, elapsed: float
) -> Plan:
    """Make a plan of what a planner found, with the metrics of its path on a costmap."""
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
        expanded=found.expanded,
        history=found.history,
        note=note,
        costs=costs,
    )
