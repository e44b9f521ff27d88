"""Writing the results of simulations as JSON and CSV."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from locplan._util.files import replacing
from locplan._util.tables import csv_cell, write_json as write_json


def write_rows(target: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write rows of names and numbers, as a whole or not at all; unknown numbers are empty."""
    with replacing(target) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([csv_cell(_text(value)) for value in row] for row in rows)


def _text(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return f"{value:.9g}" if math.isfinite(value) else ""


def file_name(name: str) -> str:
    """A map's name with a dash for each character that some file systems refuse."""
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in name)
