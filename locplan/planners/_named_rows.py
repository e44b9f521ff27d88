"""CSV files of named rows, and the stations of such a file: where robots have something to do."""

from __future__ import annotations

import contextlib
import csv
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from locplan._util.checks import file_path, position, shown
from locplan._util.reading import read_text
from locplan._util.tables import from_csv_cell
from locplan.errors import LocplanError

STATION = ("name", "x", "y")
"""The columns of a file of stations."""


def header_of(path: Path) -> list[str]:
    """The columns that the first line names."""
    try:
        return [each.strip() for each in next(csv.reader(read_text(path).splitlines()[:1]), [])]
    except csv.Error as error:
        raise LocplanError(f"{path}: row 1: is no CSV ({error})") from None


def named_rows(path: Path, what: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Where each row below the header stands, and its values by column; empty ones are left out.

    An apostrophe that keeps a name from being a formula in a spreadsheet is no part of the name.

    Raises
    ------
    LocplanError
        If a row has another number of values than the header, or no name of its own.
    """
    header, names = header_of(path), set()
    rows = csv.reader(read_text(path).splitlines())
    next(rows, None)
    try:
        for row in rows:
            if not any(value.strip() for value in row):
                continue
            where = f"{path}: row {rows.line_num}"
            if len(row) != len(header):
                raise LocplanError(
                    f"{where}: has {len(row)} values, but the header {len(header)} columns"
                )
            values = dict(zip(header, (value.strip() for value in row), strict=True))
            name = values["name"] = from_csv_cell(values["name"])
            if not name:
                raise LocplanError(f"{where}: name is empty; give the {what} one")
            if name in names:
                raise LocplanError(
                    f"{where}: there is another {what} named {shown(name)}; give each its own name"
                )
            names.add(name)
            yield where, values
    except csv.Error as error:
        raise LocplanError(f"{path}: row {rows.line_num}: is no CSV ({error})") from None


def finite_number(where: str, column: str, values: Mapping[str, str]) -> float:
    """The finite number in a column of a row."""
    with contextlib.suppress(ValueError):
        if math.isfinite(value := float(values[column])):
            return value
    raise LocplanError(f"{where}: {column} must be a finite number, not {shown(values[column])}")


@dataclass(frozen=True)
class Station:
    """A named position where robots have something to do."""

    name: str
    """The name, which no other station has."""
    x: float
    """World x [m]."""
    y: float
    """World y [m]."""

    def __post_init__(self) -> None:
        position(self.x, self.y, f"station {self.name}")


def read_stations(file: str | os.PathLike[str]) -> list[Station]:
    """Read stations from a CSV file.

    Parameters
    ----------
    file : path
        File with columns name, x and y [m].

    Returns
    -------
    list of Station
        The stations in the order of the rows.

    Raises
    ------
    LocplanError
        If the file cannot be read, or a row is wrong.
    """
    path = file_path("a file of stations", file)
    header = header_of(path)
    if tuple(header) != STATION:
        raise LocplanError(
            f"{path}: its header must be {','.join(STATION)}, not {shown(','.join(header))}"
        )
    stations = [
        Station(values["name"], *(finite_number(where, axis, values) for axis in "xy"))
        for where, values in named_rows(path, "station")
    ]
    if not stations:
        raise LocplanError(f"{path}: has no stations; add a row for each below the header")
    return stations
