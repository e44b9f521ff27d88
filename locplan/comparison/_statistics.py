"""The runs of a comparison and their statistics."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import Interval, wilson
from locplan._util.records import Column
from locplan.costs import DEGENERATE

Key = TypeVar("Key")
Record = TypeVar("Record")
STATUSES = (
    *("solved", "unreachable", "infeasible", "timeout", "not found"),
    *("error", "crashed", "hung", "out of memory"),
)
"""Outcomes of a run: the first five are the planner's own, the others are failures."""

HIGH_U = f"with u > {DEGENERATE:g}"
MEASURES: Mapping[str, Column] = {
    column.name: column
    for column in (
        Column("length", "m", "length"),
        Column("cost", "m", "cost J"),
        Column("integrated_u", "m", "degenerate metres (∫u ds)"),
        Column("integrated_e", "m² rad m", "∫e ds"),
        Column("max_e", "m² rad", "max e"),
        Column("degenerate_share", "", f"share {HIGH_U}"),
        Column("longest_degenerate", "m", f"longest {HIGH_U}"),
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

    undriven: ClassVar[str] = "the robot cannot drive it"
    """How the note of a path begins that the robot's outline or turning radius does not allow."""
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
    """The reason why there is no path, or why the robot cannot drive it; empty where it can."""
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
    """Return what stands in a column."""
    if name in MEASURES:
        return run.measure(name)
    value: Any = getattr(run.task if hasattr(run.task, name) else run, name)
    return math.nan if value is None else value


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


Array = NDArray[np.float64]


class Setting(NamedTuple):
    """Map, settings of the field and weight: runs are compared only where they share these."""

    map: str | None
    """The map's name; None for all maps together."""
    config: str
    """The label of the field's settings."""
    weight: float
    """Metres of detour accepted per degenerate metre."""


class Quartiles(NamedTuple):
    """Median and quartiles of some values, in the measure's unit; NaN if there are none."""

    median: float = math.nan
    """The median."""
    lower: float = math.nan
    """The lower quartile."""
    upper: float = math.nan
    """The upper quartile."""
    known: int = 0
    """Number of finite values."""


@dataclass(frozen=True)
class Summary:
    """Statistics of one planner by itself; do not compare them: planners solve different runs."""

    setting: Setting
    """The map, the field's settings and the weight of the runs."""
    planner: str
    """The planner's label."""
    runs: int
    """Number of runs."""
    solved: int
    """Number of runs that found a path."""
    success: Interval
    """The mean over the queries of the share of seeds that solved them, 0..1."""
    measures: Mapping[str, Quartiles]
    """Median and quartiles over the solved runs, by the names of `MEASURES`."""


def summaries(runs: Iterable[Run], pooled: bool = False) -> list[Summary]:
    """Success, medians and quartiles for every map, configuration, weight and planner.

    The interval of the success rate is Wilson's (J. Am. Stat. Assoc. 22, 1927) for as many trials
    as there are queries: the seeds of a query mostly succeed or fail together. With runs as trials
    it held the truth in 77-87 % of simulated cases, with queries in 97-99 %.
    """
    found = []
    for (setting, planner), group in by_planner(runs, pooled).items():
        solved = [run for run in group if run.status == "solved"]
        shares = [np.mean([run.status == "solved" for run in own]) for _, own in by_query(group)]
        success = wilson(float(np.mean(shares)), len(shares))
        columns = zip(MEASURES, values_of(solved).T, strict=True)
        measures = {name: quartiles(column) for name, column in columns}
        found.append(Summary(setting, planner, len(group), len(solved), success, measures))
    return found


def by_planner(runs: Iterable[Run], pooled: bool) -> dict[tuple[Setting, str], list[Run]]:
    """The runs by setting and planner."""
    return grouped(runs, lambda run: (setting_of(run, pooled), run.task.planner))


def setting_of(run: Run, pooled: bool = False) -> Setting:
    """The setting of a run; with `pooled` it is that of all maps together."""
    return Setting(None if pooled else run.task.map, run.task.config, run.task.weight)


Query = tuple[Setting, str]


def query_of(run: Run) -> Query:
    """The setting and the query of a run."""
    return setting_of(run), run.task.query


def values_of(runs: Sequence[Run]) -> Array:
    """The measures of some runs, a row each, in the order of `MEASURES`; NaN if not finite."""
    rows = [[run.measure(name) for name in MEASURES] for run in runs]
    values = np.array(rows, float).reshape(-1, len(MEASURES))
    return np.where(np.isfinite(values), values, np.nan)


def by_query(runs: Iterable[Run]) -> Iterable[tuple[tuple[str, str], list[Run]]]:
    """The runs of each query, with its map and name."""
    return grouped(runs, lambda run: (run.task.map, run.task.query)).items()


def quartiles(values: Array) -> Quartiles:
    """Median and quartiles of the known values."""
    known = values[~np.isnan(values)]
    if not known.size:
        return Quartiles()
    lower, median, upper = np.quantile(known, (0.25, 0.5, 0.75)).tolist()
    return Quartiles(median, lower, upper, known.size)


def median_costs(runs: Iterable[Run]) -> dict[tuple[Query, str], float]:
    """The median J over seeds by query and planner [m]; none of a query without a path."""
    solved = (run for run in runs if math.isfinite(run.measure("cost")))
    groups = grouped(solved, lambda run: (query_of(run), run.task.planner))
    return {
        key: float(np.median([run.measures["cost"] for run in own])) for key, own in groups.items()
    }


def best_so_far(run: Run) -> list[tuple[float, float]]:
    """Every moment [s] with the best J until then [m]; the path returned is the last."""
    points = [(time, cost) for time, cost in run.history if np.isfinite((time, cost)).all()]
    end = run.seconds, run.measures.get("cost", np.nan)
    if run.status == "solved" and np.isfinite(end).all():
        points.append(end)
    best = np.inf
    return [(time, best := min(best, cost)) for time, cost in sorted(points)]
