"""The tasks of a comparison and their runs, and the columns of a table of runs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

from locplan._util.records import Column
from locplan.costs import DEGENERATE

Key = TypeVar("Key")
Record = TypeVar("Record")
STATUSES = (
    *("solved", "unreachable", "infeasible", "timeout", "not found"),
    *("error", "crashed", "hung", "out of memory"),
)
"""Outcomes of a run: the first five are the planner's own, the others are failures."""

MEASURES: Mapping[str, Column] = {
    column.name: column
    for column in (
        Column("length", "m", "length"),
        Column("cost", "m", "cost J"),
        Column("integrated_u", "m", "degenerate, ∫u ds"),
        Column("integrated_e", "m² rad m", "∫e ds"),
        Column("max_e", "m² rad", "max e"),
        Column("degenerate_share", "", f"share with u > {DEGENERATE:g}"),
        Column("longest_degenerate", "m", f"longest with u > {DEGENERATE:g}"),
        Column("clearance", "m", "least clearance"),
        Column("turning", "rad", "turning"),
        Column("seconds", "s", "planning time"),
    )
}
"""The measures of a solved run by name, with title and unit."""


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
    """The measures by their names in `MEASURES`, except "seconds"; none without a path."""
    history: tuple[tuple[float, float], ...] = ()
    """Times since an anytime planner began [s], each with its best J until then [m]; none for
    others."""
    xy: tuple[tuple[float, float], ...] = ()
    """The path's positions (x, y) in the world [m]; none without a path."""
    note: str = ""
    """The reason why there is no path; empty with one."""
    expanded: int | None = None
    """Number of cells that a grid planner expanded; None for other planners."""

    @property
    def ended(self) -> bool:
        """Whether it was ended from outside, which may go otherwise the next time."""
        return self.status in ("crashed", "hung", "out of memory")

    def measure(self, name: str) -> float:
        """A measure; NaN where it is not known.

        Parameters
        ----------
        name : str
            One of `MEASURES`.
        """
        return self.seconds if name == "seconds" else self.measures.get(name, math.nan)


def _cell(name: str, run: Run) -> float | str:
    """What stands in a column; signs that UTF-8 does not have are question marks."""
    if name in MEASURES:
        return run.measure(name)
    value: Any = getattr(run.task if hasattr(run.task, name) else run, name)
    if value is None:
        return math.nan
    return value.encode("utf-8", "replace").decode() if isinstance(value, str) else value


RUN_COLUMNS = tuple(
    dataclasses.replace(column, value=partial(_cell, column.name))
    for column in (
        *(Column(each.name) for each in dataclasses.fields(Task)),
        *(Column("status"), Column("seconds"), Column("wall_seconds", "s")),
        *(Column("note"), Column("expanded")),
        *(column for name, column in MEASURES.items() if name != "seconds"),
    )
)
"""The columns of a table with a row for each run."""


def grouped(records: Iterable[Record], key: Callable[[Record], Key]) -> dict[Key, list[Record]]:
    """The records by a key, in the order in which the keys come first."""
    groups: dict[Key, list[Record]] = {}
    for record in records:
        groups.setdefault(key(record), []).append(record)
    return groups
