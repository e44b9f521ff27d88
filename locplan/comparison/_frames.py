"""Runs as tidy tables: CSV, Parquet, and data frames of pandas."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from locplan._util.files import check_target, replacing
from locplan.comparison._runs import Run, Task
from locplan.errors import LocplanError

if TYPE_CHECKING:
    import pandas


def rows(runs: Iterable[Run]) -> list[dict[str, Any]]:
    """One flat record for every run; measures are in the units of `MEASURES`, times in seconds."""
    return [run.row() for run in runs]


def write_table(runs: Iterable[Run], target: str | os.PathLike[str]) -> Path:
    """Write one row for every run.

    Parameters
    ----------
    runs
        What came of the comparison.
    target
        Ends in .csv, or in .parquet if pyarrow is installed. In CSV, numbers are written so that
        they read back the same, and unknown ones are empty.

    Raises
    ------
    LocplanError
        If the suffix is another, pyarrow is missing, or the file cannot be written.
    """
    path = Path(target)
    check_target(path, ".csv", ".parquet")
    write = _write_parquet if path.suffix.lower() == ".parquet" else _write_csv
    write(rows(runs), path)
    return path


def to_frame(runs: Iterable[Run]) -> pandas.DataFrame:
    """A data frame with one row for every run.

    Raises
    ------
    LocplanError
        If pandas is not installed.
    """
    pandas = _optional("pandas", "a data frame")
    return pandas.DataFrame(rows(runs), columns=_columns())


def _columns() -> list[str]:
    """Those of a run that is not there: a table without rows has them too."""
    return list(Run(Task("", "", "", 0.0, "", 0), "", 0.0, 0.0).row())


def _write_csv(records: list[dict[str, Any]], path: Path) -> None:
    with (
        replacing(path) as temporary,
        temporary.open("w", encoding="utf-8", errors="replace", newline="") as file,
    ):
        table = csv.DictWriter(file, _columns(), lineterminator="\n")
        table.writeheader()
        table.writerows({key: _cell(value) for key, value in row.items()} for row in records)


def _cell(value: Any) -> Any:
    """NaN is the one value that differs from itself."""
    return "" if value != value else value


def _write_parquet(records: list[dict[str, Any]], path: Path) -> None:
    arrow = _optional("pyarrow", f"{path.name}")
    parquet = _optional("pyarrow.parquet", f"{path.name}")
    texts = ("map", "config", "query", "planner", "status", "note")
    types = dict.fromkeys(texts, arrow.string()) | {"seed": arrow.int64()}
    schema = arrow.schema([(name, types.get(name, arrow.float64())) for name in _columns()])
    with replacing(path) as temporary:
        parquet.write_table(arrow.Table.from_pylist(records, schema), temporary)


def has_parquet() -> bool:
    """Whether pyarrow is installed."""
    from importlib.util import find_spec

    return find_spec("pyarrow") is not None


def _optional(module: str, wanted_for: str) -> ModuleType:
    from importlib import import_module

    try:
        return import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise LocplanError(
            f"{wanted_for} needs {package}, which is not installed: pip install {package}"
        ) from None
