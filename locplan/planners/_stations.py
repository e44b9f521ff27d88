"""Stations: named positions where robots have something to do."""

from __future__ import annotations

import os
from dataclasses import dataclass

from locplan._util.checks import file_path, position, shown
from locplan.errors import LocplanError
from locplan.planners._named_rows import finite_number, header_of, named_rows

STATION = ("name", "x", "y")
"""The columns of a file of stations."""


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
