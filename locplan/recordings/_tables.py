"""Recordings as files of locplan: .npz without loss, and .csv that any program can write."""

from __future__ import annotations

import dataclasses
import json
import os
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import file_path, shown
from locplan._util.files import replacing
from locplan._util.poses import Numbers
from locplan._util.reading import opened, parsed_json
from locplan.errors import LocplanError, RecordingError
from locplan.recordings._csv import read_csv, write_csv
from locplan.recordings._options import MAX_ARRAY_BYTES, Contents, Options, Source, with_options
from locplan.robots import Lidar

NONE_MM = 65535
"""No return among ranges in whole millimetres, uint16."""
NPZ_ARRAYS = ("ranges", "poses", "times", "odometry", "lidar", "source")
Reader = Callable[[Path, Options], Contents]


def save(drive: Contents, target: str | os.PathLike[str]) -> None:
    """Write a recording as .npz or .csv, whole or not at all."""
    path = file_path("a file to write", target)
    if path.suffix not in (".npz", ".csv"):
        raise RecordingError(f"{path}: must end in .npz or .csv")
    with replacing(path) as temporary:
        if path.suffix == ".npz":
            _write_npz(drive, temporary)
        else:
            write_csv(drive, temporary)


def load(source: str | os.PathLike[str]) -> Contents:
    """Read a recording from .npz or .csv."""
    path = file_path("a recording", source)
    readers: dict[str, Reader] = {".npz": read_npz, ".csv": read_csv}
    if path.suffix not in readers:
        raise RecordingError(
            f"{path}: must end in .npz or .csv; logs of robots are read by read_drive"
        )
    try:
        return readers[path.suffix](path, Options())
    except LocplanError as error:
        raise RecordingError(f"{path}: {error}") from None


def read_npz(path: Path, options: Options) -> Contents:
    """Read a recording from .npz.

    Raises
    ------
    RecordingError
        If the file is damaged, or its arrays are no recording.
    """
    options.refuse_those_for_logs("an .npz file")
    try:
        arrays = _arrays(path)
    except (zipfile.BadZipFile, zlib.error, EOFError, KeyError, NotImplementedError):
        raise RecordingError("is damaged, or no .npz file; copy it again") from None
    except (ValueError, MemoryError, RuntimeError, OverflowError, SyntaxError, TypeError) as error:
        raise RecordingError(f"is damaged ({str(error)[:200]}); copy it again") from None
    except OSError as error:
        raise RecordingError(f"cannot be read ({error.strerror or error})") from None
    missing = [name for name in ("ranges", "poses", "lidar") if name not in arrays]
    if missing:
        raise RecordingError(
            f"has no array {' and '.join(missing)}; a recording has {', '.join(NPZ_ARRAYS)}, of"
            " which times, odometry and source may be missing"
        )
    ranges = arrays["ranges"]
    if ranges.dtype == np.uint16:
        metres = (ranges / np.float64(1000)).astype(np.float32)
        ranges = np.where(ranges == NONE_MM, np.float32(np.inf), metres)
    lidar = _lidar(arrays["lidar"], options)
    return Contents(
        ranges, lidar, arrays["poses"], arrays.get("times"), arrays.get("odometry"),
        _source(arrays.get("source"), path),
    )  # fmt: skip


def _lidar(text: NDArray[Any], options: Options) -> Lidar:
    try:
        values = parsed_json(str(text))
        lidar = Lidar(**values)
    except LocplanError as error:
        raise RecordingError(f"its lidar cannot be: {error}") from None
    except (TypeError, ValueError):
        names = ", ".join(each.name for each in dataclasses.fields(Lidar))
        raise RecordingError(
            f"its lidar must be JSON with some of {names}, not {shown(str(text))}"
        ) from None
    return with_options(lidar, options)


def _source(text: NDArray[Any] | None, path: Path) -> Source:
    if text is None:
        return Source(file=path.name)
    try:
        values = parsed_json(str(text))
        notes = tuple(str(each) for each in values.pop("notes", ()))
        return Source(notes=notes, **{str(key): str(value) for key, value in values.items()})
    except (TypeError, ValueError, AttributeError):
        raise RecordingError(
            f"its source is no JSON as Recording.save writes it: {shown(str(text))}"
        ) from None


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of a file, each of a size that its header and the archive agree on."""
    found = {}
    with opened(path) as content, zipfile.ZipFile(content) as archive:
        sizes = {each.filename: each.file_size for each in archive.infolist()}
        if (total := sum(sizes.get(f"{name}.npy", 0) for name in NPZ_ARRAYS)) > MAX_ARRAY_BYTES:
            most = MAX_ARRAY_BYTES / 1e6
            raise ValueError(f"its arrays take {total / 1e6:.0f} MB, of at most {most:.0f} MB")
        for name in NPZ_ARRAYS:
            size = sizes.get(f"{name}.npy")
            if size is None:
                continue
            with archive.open(f"{name}.npy") as member:
                version = np.lib.format.read_magic(member)
                read = (
                    np.lib.format.read_array_header_1_0
                    if version == (1, 0)
                    else np.lib.format.read_array_header_2_0
                )
                shape, _, kind = read(member)
                if int(np.prod([1, *shape], dtype=object)) * kind.itemsize > size:
                    raise ValueError(f"{name} is cut off")
            with archive.open(f"{name}.npy") as member:
                found[name] = np.lib.format.read_array(member, allow_pickle=False)
    return found


def _write_npz(drive: Contents, target: Path) -> None:
    ranges: NDArray[Any] = drive.ranges
    whole = np.where(np.isfinite(ranges), np.rint(ranges * np.float64(1000)), NONE_MM)
    if whole.max() <= NONE_MM and _same(whole, ranges):
        ranges = whole.astype(np.uint16)
    values: dict[str, NDArray[Any] | Numbers] = {
        "ranges": ranges,
        "poses": drive.poses,
        "lidar": np.array(json.dumps(dataclasses.asdict(drive.lidar))),
        "source": np.array(json.dumps(dataclasses.asdict(drive.source))),
    }
    if drive.times is not None:
        values["times"] = drive.times
    if drive.odometry is not None:
        values["odometry"] = drive.odometry
    with open(target, "wb") as file:
        np.savez_compressed(file, **values)  # type: ignore[arg-type]


def _same(millimetres: Numbers, ranges: NDArray[np.float32]) -> bool:
    """Return whether ranges are whole millimetres, so that nothing is lost."""
    returns = np.isfinite(ranges)
    exact = (millimetres[returns] / 1000).astype(np.float32) == ranges[returns]
    return bool(exact.all() and (millimetres[returns] < NONE_MM).all())
