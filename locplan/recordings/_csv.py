"""Recordings as CSV: a line that describes the lidar, column names, and a row for each scan.

    # lidar: range=12.0, least_range=0.1, field_of_view_deg=180.0, mount_x=0.1
    time,x,y,heading,odom_x,odom_y,odom_heading,range_0,range_1,range_2
    0.0,1.0,2.0,0.0,0.0,0.0,0.0,2.5,1.25,
    0.1,1.1,2.0,0.0,0.1,0.0,0.0,2.5,1.15,inf

The line of the lidar has any fields of `locplan.Lidar` but the number of beams. Columns of time and
odometry may be missing. An empty range, inf and nan mean no return. Lengths are in metres, times in
seconds and headings in radians; names may end in their unit, such as x_m.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import shown
from locplan._util.poses import Numbers
from locplan._util.reading import numbered_lines
from locplan.errors import LocplanError, RecordingError
from locplan.recordings._options import MAX_ARRAY_BYTES, Contents, Options, Source, with_options
from locplan.recordings._scans import row_bytes
from locplan.robots import MAX_BEAMS, Lidar

POSE = ("x", "y", "heading")
ODOMETRY = ("odom_x", "odom_y", "odom_heading")
LIDAR = "# lidar:"
UNIT = re.compile("_(m|s|rad)$")


def read_csv(path: Path, options: Options) -> Contents:
    """Read a recording from CSV; only every n-th row is kept in memory.

    Raises
    ------
    RecordingError
        If the file cannot be read, or its rows have another shape than its header.
    """
    options.refuse_those_for_logs("a .csv file")
    lines = ((number, line.strip()) for number, line in numbered_lines(path))
    values, names, number = _header(lines)
    with_time, with_odometry = _columns(names, number)
    first = with_time + 3 + 3 * with_odometry
    beams = len(names) - first
    table, ranges = _rows(lines, len(names), first, options.every)
    if not len(table):
        raise RecordingError(f"has no scan below its column names, line {number}")
    notes, times = list[str](), table[:, 0] if with_time else None
    if times is not None and not (np.diff(times) > 0).all():
        times = None
        notes.append("its times do not rise from scan to scan, and are left out")
    poses = table[:, with_time : with_time + 3]
    odometry = table[:, with_time + 3 : first] if with_odometry else None
    return Contents(
        ranges,
        _lidar(values, beams, options),
        poses,
        times,
        odometry,
        Source(
            file=path.name,
            scans="columns range_0 ...",
            poses=f"columns {', '.join(POSE)}",
            odometry=f"columns {', '.join(ODOMETRY)}" if with_odometry else "",
            notes=tuple(notes),
        ),
    )


def write_csv(drive: Contents, target: Path) -> None:
    """Write a recording as CSV: ranges to 0.1 mm, poses to a millionth, and times without loss."""
    settings = {
        each.name: getattr(drive.lidar, each.name)
        for each in dataclasses.fields(Lidar)
        if each.name not in ("beams", "model")
    }
    names = [*([] if drive.times is None else ["time"]), *POSE]
    columns = [*([] if drive.times is None else [drive.times[:, None]]), drive.poses]
    if drive.odometry is not None:
        names += ODOMETRY
        columns.append(drive.odometry)
    names += [f"range_{beam}" for beam in range(drive.lidar.beams)]
    with open(target, "w", encoding="utf-8", newline="\n") as file:
        described = ", ".join(f"{name}={value!r}" for name, value in settings.items())
        file.write(f"{LIDAR} {described}\n{','.join(names)}\n")
        for place, ranges in zip(np.concatenate(columns, axis=1), drive.ranges, strict=True):
            cells = [] if drive.times is None else [repr(float(place[0]))]
            cells += [f"{value:.6f}" for value in place[len(cells) :]]
            cells += [f"{value:.4f}" if math.isfinite(value) else "" for value in ranges]
            file.write(",".join(cells) + "\n")


def _header(lines: Iterator[tuple[int, str]]) -> tuple[dict[str, str], list[str], int]:
    """The lidar's settings, the names of the columns, and the number of the line with these."""
    values: dict[str, str] = {}
    for number, line in lines:
        if line.lower().startswith(LIDAR):
            values |= _settings(line[len(LIDAR) :], number)
        elif line and not line.startswith("#"):
            names = (each.strip().strip('"') for each in line.split(","))
            return values, [UNIT.sub("", each) for each in names], number
    raise RecordingError(
        f"is empty; it needs a line of column names: time,{','.join(POSE)},range_0,..."
    )


def _rows(
    lines: Iterator[tuple[int, str]], columns: int, first: int, every: int
) -> tuple[Numbers, NDArray[np.float32]]:
    """Every n-th row: what comes before the column `first`, and the ranges from there on."""
    beams = columns - first
    most = MAX_ARRAY_BYTES // row_bytes(beams)
    places, rows = list[Numbers](), list[NDArray[np.float32]]()
    filled = ((number, line) for number, line in lines if line and not line.startswith("#"))
    for count, (number, line) in enumerate(filled):
        if count % every == 0:
            if len(rows) == most:
                raise RecordingError(
                    f"line {number}: over {most:,} scans of {beams} beams take too much memory;"
                    " read every n-th (every=), or split it"
                )
            row = _row(line, columns, first, number)
            places.append(row[:first])
            with np.errstate(over="ignore"):
                rows.append(row[first:].astype(np.float32))
        elif line.count(",") + 1 != columns:
            _row(line, columns, first, number)  # which says what is wrong with it
    return np.array(places), np.array(rows)


def _columns(names: list[str], line: int) -> tuple[bool, bool]:
    """Whether there are columns of time and odometry; a RecordingError if the names are others."""
    timed = names[0] == "time"
    rest = names[timed:]
    reported = tuple(rest[3:6]) == ODOMETRY
    ranges = rest[6 if reported else 3 :]
    if tuple(rest[:3]) != POSE or not ranges or len(ranges) > MAX_BEAMS:
        raise RecordingError(
            f"line {line} must name the columns [time,]{','.join(POSE)},[{','.join(ODOMETRY)},]"
            f"range_0,..., not {shown(','.join(names))}"
        )
    for beam, name in enumerate(ranges):
        if name != f"range_{beam}":
            raise RecordingError(f"line {line}: column {shown(name)} must be range_{beam}")
    return timed, reported


def _row(line: str, count: int, first: int, number: int) -> Numbers:
    cells = line.split(",")
    if len(cells) != count:
        raise RecordingError(
            f"line {number} has {len(cells)} columns and must have {count}, as named above"
        )
    try:
        row = np.array([cell.strip() or "inf" for cell in cells], np.float64)
    except ValueError:
        raise RecordingError(f"line {number} has a cell that is no number; mend it") from None
    if not np.isfinite(row[:first]).all():
        column = int(np.argmin(np.isfinite(row[:first])))
        raise RecordingError(
            f"line {number}, column {column + 1}: time, pose and odometry must be finite, not"
            f" {shown(cells[column])}; take the row out"
        )
    return row


def _settings(text: str, line: int) -> dict[str, str]:
    found = {}
    for part in filter(None, (each.strip() for each in text.split(","))):
        name, equals, value = (each.strip() for each in part.partition("="))
        if not equals:
            raise RecordingError(f"line {line}: {shown(part)} must be NAME=VALUE")
        found[name] = value
    return found


def _lidar(values: dict[str, str], beams: int, options: Options) -> Lidar:
    known = {each.name for each in dataclasses.fields(Lidar)} - {"beams", "model"}
    numbers: dict[str, Any] = {}
    for name, value in values.items():
        if name not in known:
            raise RecordingError(
                f"its lidar has no {shown(name)}; known are {', '.join(sorted(known))}"
            )
        try:
            numbers[name] = float(value)
        except ValueError:
            raise RecordingError(
                f"its lidar's {name} must be a number, not {shown(value)}"
            ) from None
    try:
        return with_options(Lidar(**numbers, beams=beams), options)
    except LocplanError as error:
        raise RecordingError(f"its line '{LIDAR} ...' is wrong: {error}") from None
