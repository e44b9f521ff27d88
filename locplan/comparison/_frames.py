"""Runs as tables: CSV, Parquet, and data frames of pandas."""

from __future__ import annotations

import csv
import importlib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locplan._util.extras import needed
from locplan._util.files import check_target, replacing
from locplan._util.tables import csv_cell
from locplan.comparison._runs import Run, Task

if TYPE_CHECKING:
    import pandas


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
