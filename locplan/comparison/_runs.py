"""The tasks of a comparison and their runs: one record each, and tables of them.

Tables are CSV, Parquet, and data frames of pandas.
"""

from __future__ import annotations

import csv
import importlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locplan._util.extras import needed
from locplan._util.files import check_target, replacing
from locplan._util.tables import csv_cell
from locplan.costs import DEGENERATE

if TYPE_CHECKING:
    import pandas

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


def write_table(runs: Iterable[Run], target: str | os.PathLike[str]) -> Path:
    """Write one row for every run to a .csv file, or to a .parquet file if pyarrow is installed.

    In CSV, numbers are written so that they read back the same, and unknown ones are empty; a text
    that a spreadsheet would take for a formula gets an apostrophe.
    """
    path = Path(target)
    check_target(path, ".csv", ".parquet")
    write = _write_parquet if path.suffix.lower() == ".parquet" else _write_csv
    write([run.row() for run in runs], path)
    return path


def to_frame(runs: Iterable[Run]) -> pandas.DataFrame:
    """A data frame with one row for every run; a LocplanError if pandas is not installed."""
    needed("pandas", "tables", "a data frame")
    import pandas

    return pandas.DataFrame([run.row() for run in runs], columns=_columns())


def _columns() -> list[str]:
    """The heads of the columns, which a table without rows has, too."""
    return list(Run(Task("", "", "", 0.0, "", 0), "", 0.0, 0.0).row())


def _write_csv(records: list[dict[str, Any]], path: Path) -> None:
    with (
        replacing(path) as temporary,
        temporary.open("w", encoding="utf-8", errors="replace", newline="") as file,
    ):
        table = csv.DictWriter(file, _columns(), lineterminator="\n")
        table.writeheader()
        table.writerows({key: csv_cell(value) for key, value in row.items()} for row in records)


def _write_parquet(records: list[dict[str, Any]], path: Path) -> None:
    needed("pyarrow", "tables", path.name)
    arrow = importlib.import_module("pyarrow")
    parquet = importlib.import_module("pyarrow.parquet")
    texts = ("map", "config", "query", "planner", "status", "note")
    types = dict.fromkeys(texts, arrow.string()) | {"seed": arrow.int64()}
    schema = arrow.schema([(name, types.get(name, arrow.float64())) for name in _columns()])
    with replacing(path) as temporary, temporary.open("wb") as file:  # of any name, also no UTF-8
        parquet.write_table(arrow.Table.from_pylist(records, schema), file)
