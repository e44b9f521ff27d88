"""The tasks of a comparison and their runs: one record each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from locplan.costs import DEGENERATE

STATUSES = (
    "solved",
    "unreachable",
    "infeasible",
    "timeout",
    "not found",
    "error",
    "crashed",
    "hung",
    "out of memory",
)
"""Outcomes of a run: the first five are the planner's own, the others are failures."""

MEASURES: Mapping[str, tuple[str, str]] = {
    "length": ("length", "m"),
    "cost": ("cost J", "m"),
    "integrated_u": ("degenerate, ∫u ds", "m"),
    "integrated_e": ("∫e ds", "m² rad m"),
    "max_e": ("max e", "m² rad"),
    "degenerate_share": (f"share with u > {DEGENERATE:g}", ""),
    "longest_degenerate": (f"longest with u > {DEGENERATE:g}", "m"),
    "clearance": ("least clearance", "m"),
    "turning": ("turning", "rad"),
    "seconds": ("planning time", "s"),
}
"""The measures of a solved run: label and unit by name."""


@dataclass(frozen=True, order=True)
class Task:
    """One run to be made. Sorted and hashable: its fields are the key of its result."""

    map: str
    """The map's name."""
    config: str
    """The label of the field's settings, such as "sad, 6 m"."""
    query: str
    """The query's name."""
    weight: float
    """Metres of detour accepted per degenerate metre, >= 0."""
    planner: str
    """The planner's label, such as "BITstar:time_limit=2"."""
    seed: int
    """Seed of the planner's random numbers; 0 for planners without any."""


@dataclass(frozen=True)
class Run:
    """The outcome of a task; a run without a path has no measures."""

    task: Task
    """The map, query, weight, planner and seed of the run."""
    status: str
    """One of `STATUSES`."""
    seconds: float
    """Planning time, as the planner itself measures it where it does [s]."""
    wall_seconds: float
    """Time from the start of the order to its result [s]."""
    measures: Mapping[str, float] = field(default_factory=dict)
    """The measures by their names in `MEASURES`, which tells their units, except "seconds"; none
    without a path."""
    history: tuple[tuple[float, float], ...] = ()
    """Times since an anytime planner began [s], each with its best J until then [m]; none for
    others."""
    xy: tuple[tuple[float, float], ...] = ()
    """The path's positions (x, y) in the world [m]; none without a path."""
    note: str = ""
    """The reason why there is no path; empty with one."""
    expanded: int | None = None
    """Number of cells that a grid planner expanded; None for other planners."""

    def row(self) -> dict[str, Any]:
        """The run as one flat record, for tables; unknown measures are NaN."""
        about = asdict(self.task) | {"status": self.status, "seconds": self.seconds}
        about |= {"wall_seconds": self.wall_seconds, "note": self.note}
        about["expanded"] = float("nan") if self.expanded is None else self.expanded
        measures = (name for name in MEASURES if name != "seconds")
        return about | {name: self.measures.get(name, float("nan")) for name in measures}
