"""Recordings as files of locplan: .npz without loss, and .csv that any program can write.

    # lidar: range=12.0, min_range=0.1, field_of_view_deg=180.0, mount_x=0.1
    time,x,y,heading,odom_x,odom_y,odom_heading,range_0,range_1,range_2
    0.0,1.0,2.0,0.0,0.0,0.0,0.0,2.5,1.25,
    0.1,1.1,2.0,0.0,0.1,0.0,0.0,2.5,1.15,inf

The line of the lidar has any fields of `locplan.Lidar` but the number of beams. Columns of time and
odometry may be missing. An empty range, inf and nan mean no return. Lengths are in metres, times in
seconds and headings in radians; names may end in their unit, such as x_m.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan._util.arrays import read_arrays, write_arrays
from locplan._util.checks import file_path, shown
from locplan._util.output import replacing
from locplan._util.reading import numbered_lines, parsed_json
from locplan._util.saved import made
from locplan.errors import RecordingError
from locplan.recordings._logs import Options, Source, check_room
from locplan.recordings._recording import Recording
from locplan.robots import Lidar

MAX_ARRAY_BYTES = 2**28
"""Maximum size of a file's arrays together, unpacked; reading takes some six times as much."""
NONE_MM = 65535
"""No return among ranges in whole millimetres, uint16."""
POSE = ["x", "y", "heading"]
ODOMETRY = ["odom_x", "odom_y", "odom_heading"]
LIDAR = "# lidar:"


def save(drive: Recording, target: str | os.PathLike[str]) -> None:
    """Write a recording as .npz or .csv, whole or not at all."""
    path = file_path("a file to write", target)
    writers = {".npz": _write_npz, ".csv": _write_csv}
    if path.suffix not in writers:
        raise RecordingError(f"{path}: must end in .npz or .csv")
    with replacing(path) as temporary:
        writers[path.suffix](drive, temporary)


def read_npz(path: Path, options: Options) -> Recording:
    """Read a recording from .npz.

    Raises
    ------
    RecordingError
        If the file is damaged, or its arrays are no recording.
    """
    options.refuse_others("an .npz file", of_robot=False)
    names = ("ranges", "poses", "times", "odometry", "speeds", "lidar", "source")
    try:
        arrays = read_arrays(path, MAX_ARRAY_BYTES, names)
    except OSError as error:
        raise RecordingError(f"cannot be read ({error.strerror or error})") from None
    except ValueError as error:
        raise RecordingError(f"is damaged, or no .npz file ({error}); copy it again") from None
    missing = [name for name in ("ranges", "poses", "lidar") if name not in arrays]
    if missing:
        raise RecordingError(
            f"has no array {' and '.join(missing)}; a recording has {', '.join(names)}, of which"
            " times, odometry, speeds and source may be missing"
        )
    ranges = arrays["ranges"]
    if ranges.dtype == np.uint16:
        metres = (ranges / np.float64(1000)).astype(np.float32)
        ranges = np.where(ranges == NONE_MM, np.float32(np.inf), metres)
    lidar = options.lidar(_entries("lidar", arrays["lidar"]))
    source = Source(file=path.name)
    if "source" in arrays:
        about = _entries("source", arrays["source"])
        try:
            source = made(Source, about)
        except (LookupError, TypeError, ValueError) as error:
            raise RecordingError(
                f"its source is not as Recording.save writes it: {error}"
            ) from None
    times, odometry = arrays.get("times"), arrays.get("odometry")
    speeds = arrays.get("speeds")
    return Recording(ranges, lidar, arrays["poses"], times, odometry, source, speeds)


def _entries(name: str, text: NDArray[Any]) -> dict[str, Any]:
    """The entries of a text of JSON in an array."""
    try:
        values = parsed_json(str(text))
    except ValueError:
        values = None
    if not isinstance(values, dict):
        raise RecordingError(
            f"its {name} must be JSON with entries by name, not {shown(str(text))}"
        )
    return values


def _write_npz(drive: Recording, target: Path) -> None:
    ranges: NDArray[Any] = drive.ranges
    whole = np.where(np.isfinite(ranges), np.rint(ranges * np.float64(1000)), NONE_MM)
    returns = np.isfinite(ranges)
    exact = (whole[returns] / 1000).astype(np.float32) == ranges[returns]
    if exact.all() and (whole[returns] < NONE_MM).all():  # nothing is lost
        ranges = whole.astype(np.uint16)
    values = {
        "ranges": ranges,
        "poses": drive.poses,
        "lidar": np.array(json.dumps(dataclasses.asdict(drive.lidar))),
        "source": np.array(json.dumps(dataclasses.asdict(drive.source))),
        "times": drive.times,
        "odometry": drive.odometry,
        "speeds": drive.speeds,
    }
    known: Any = {name: value for name, value in values.items() if value is not None}
    write_arrays(target, known)


def read_csv(path: Path, options: Options) -> Recording:
    """Read a recording from CSV; only every n-th row is kept in memory.

    Raises
    ------
    RecordingError
        If the file cannot be read, or its rows have another shape than its header.
    """
    options.refuse_others("a .csv file", of_robot=False)
    lines = ((number, line.strip()) for number, line in numbered_lines(path))
    values, names, number = _header(lines)
    timed, reported = names[0] == "time", ODOMETRY[0] in names
    before = [*["time"][:timed], *POSE, *ODOMETRY[: 3 * reported]]
    beams = max(1, len(names) - len(before))
    for name, needed in zip_longest(names, [*before, *(f"range_{n}" for n in range(beams))]):
        if name != needed:
            fault = f"column {shown(name)} must be" if name else "there is no column"
            raise RecordingError(
                f"line {number}: {fault} {needed}; the columns are"
                f" [time,]{','.join(POSE)},[{','.join(ODOMETRY)},]range_0,..."
            )
    table, ranges = _rows(lines, len(before), beams, options.every)
    if not len(table):
        raise RecordingError(f"has no scan below its column names, line {number}")
    times = table[:, 0] if timed else None
    steps = np.zeros(0) if times is None else np.diff(times)
    rises = bool((steps > 0).all())
    poses = table[:, timed : timed + 3]
    return Recording(
        ranges,
        options.lidar({**values, "beams": beams}),
        poses,
        times if rises else None,
        table[:, timed + 3 :] if reported else None,
        Source(
            file=path.name,
            scans="columns range_0 ...",
            poses=f"columns {', '.join(POSE)}",
            odometry=f"columns {', '.join(ODOMETRY)}" if reported else "",
            stamps_back=int((steps < 0).sum()),
            notes=() if rises else ("its times do not rise from scan to scan, and are left out",),
        ),
    )


def _header(lines: Iterator[tuple[int, str]]) -> tuple[dict[str, Any], list[str], int]:
    """The lidar's settings, the names of the columns, and the number of the line with these."""
    values: dict[str, Any] = {}
    for number, line in lines:
        if line.lower().startswith(LIDAR):
            for part in filter(None, map(str.strip, line[len(LIDAR) :].split(","))):
                name, equals, value = map(str.strip, part.partition("="))
                if not equals:
                    raise RecordingError(f"line {number}: {shown(part)} must be NAME=VALUE")
                try:
                    values[name] = float(value)
                except ValueError:
                    values[name] = value  # which `Lidar` refuses with the name
        elif line and not line.startswith("#"):
            names = (each.strip().strip('"') for each in line.split(","))
            return values, [re.sub("_(m|s|rad)$", "", each) for each in names], number
    raise RecordingError(
        f"is empty; it needs a line of column names: time,{','.join(POSE)},range_0,..."
    )


def _rows(
    lines: Iterator[tuple[int, str]], before: int, beams: int, every: int
) -> tuple[Floats, NDArray[np.float32]]:
    """Every n-th row: the columns before the ranges, and the ranges."""
    places, rows = list[Floats](), list[NDArray[np.float32]]()
    filled = ((number, line) for number, line in lines if line and not line.startswith("#"))
    for count, (number, line) in enumerate(filled):
        if (columns := line.count(",") + 1) != before + beams:
            raise RecordingError(
                f"line {number} has {columns} columns and must have {before + beams}, as named"
                " above"
            )
        if count % every:
            continue
        check_room(len(rows), beams, MAX_ARRAY_BYTES)
        try:
            row = np.array([cell.strip() or "inf" for cell in line.split(",")], np.float64)
        except ValueError:
            raise RecordingError(f"line {number} has a cell that is no number; mend it") from None
        if not np.isfinite(row[:before]).all():
            column = int(np.argmin(np.isfinite(row[:before])))
            raise RecordingError(
                f"line {number}, column {column + 1}: time, pose and odometry must be finite, not"
                f" {shown(line.split(',')[column])}; take the row out"
            )
        places.append(row[:before])
        with np.errstate(over="ignore"):
            rows.append(row[before:].astype(np.float32))
    return np.array(places), np.array(rows)


def _write_csv(drive: Recording, target: Path) -> None:
    """Write a recording as CSV: ranges to 0.1 mm, poses to a millionth, and times without loss."""
    names = [each.name for each in dataclasses.fields(Lidar)]
    described = [
        f"{name}={getattr(drive.lidar, name)!r}" for name in names if name not in ("beams", "model")
    ]
    parts = {"time": drive.times, ",".join(POSE): drive.poses, ",".join(ODOMETRY): drive.odometry}
    known = {name: np.c_[part] for name, part in parts.items() if part is not None}
    columns = [*known, *(f"range_{beam}" for beam in range(drive.lidar.beams))]
    with open(target, "w", encoding="utf-8", newline="\n") as file:
        file.write(f"{LIDAR} {', '.join(described)}\n{','.join(columns)}\n")
        for place, ranges in zip(np.hstack([*known.values()]), drive.ranges, strict=True):
            cells = [] if drive.times is None else [repr(float(place[0]))]
            cells += [f"{value:.6f}" for value in place[len(cells) :]]
            cells += [f"{value:.4f}" if math.isfinite(value) else "" for value in ranges]
            file.write(",".join(cells) + "\n")
