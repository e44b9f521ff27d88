"""What is compared, and what came of it: one record for every run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

STATUSES = (
    "solved",
    "unreachable",
    "infeasible",
    "timeout",
    "error",
    "crashed",
    "hung",
    "out of memory",
)
"""The first four are a planner's own; the others tell how a run failed."""

MEASURES: Mapping[str, tuple[str, str]] = {
    "length": ("length", "m"),
    "cost": ("cost J", "m"),
    "integrated_u": ("degenerate, ∫u ds", "m"),
    "integrated_e": ("∫e ds", "m² rad m"),
    "max_e": ("greatest e", "m² rad"),
    "degenerate_share": ("share with u > 0.5", ""),
    "longest_degenerate": ("longest with u > 0.5", "m"),
    "clearance": ("least clearance", "m"),
    "turning": ("turning", "rad"),
    "seconds": ("planning time", "s"),
}
"""What is told of a solved run: label and unit by the field of `Run`."""


@dataclass(frozen=True, order=True)
class Task:
    """One run to be made. Sorted and hashable: its fields are the key of its result."""

    map: str
    """The map's name."""
    config: str
    """The label of the field's settings, such as "6 m" and "8 m"."""
    query: str
    """The query's name."""
    weight: float
    """Metres of detour accepted per degenerate metre."""
    planner: str
    """The label, such as "BITstar:time_limit=2"."""
    seed: int
    """Of the planner's random numbers; 0 for planners without any."""


@dataclass(frozen=True)
class Run:
    """What came of a task; measures are NaN without a path."""

    task: Task
    status: str
    """One of `STATUSES`."""
    seconds: float
    """Planning time, the planner's own where it tells it [s]."""
    wall_seconds: float
    """From handing the task to a worker to having its result [s]."""
    measures: Mapping[str, float] = field(default_factory=dict)
    """By the names of `MEASURES` but "seconds"."""
    history: tuple[tuple[float, float], ...] = ()
    """Of an anytime planner: seconds since it began, and its best J [m]."""
    xy: tuple[tuple[float, float], ...] = ()
    """The path's positions [m]."""
    note: str = ""
    """Why there is no path."""

    def row(self) -> dict[str, Any]:
        """One flat record, for tables."""
        about = asdict(self.task) | {"status": self.status, "seconds": self.seconds}
        about |= {"wall_seconds": self.wall_seconds, "note": self.note}
        measures = (name for name in MEASURES if name != "seconds")
        return about | {name: self.measures.get(name, float("nan")) for name in measures}
