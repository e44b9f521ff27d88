"""Reading the arrays of a field without zarr, which takes longer to import than they to read.

Only arrays just as `locplan.field._zarr` writes them are read; the memory that they take is known
from their shape, whatever their chunks say.
"""

from __future__ import annotations

import json
import math
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.reading import MAX_JSON_BYTES, read_bytes


def chunk_of(
    folder: Path, shape: tuple[int, ...], kind: str = "float64", separator: str = "."
) -> tuple[int, ...]:
    """Shape of an array's chunks; one of several errors if it is not as written."""
    about = json.loads(read_bytes(folder / "zarr.json", MAX_JSON_BYTES))
    chunk = tuple(about["chunk_grid"]["configuration"]["chunk_shape"])
    size = math.prod(chunk) * np.dtype(kind).itemsize
    whole = len(chunk) == len(shape) and all(type(each) is int and each > 0 for each in chunk)
    if not whole or size > 2**28 or not _as_written(about, shape, kind, separator):
        raise ValueError(f"its {folder.name} does not fit its own map and config")
    return chunk


def read_array(
    folder: Path, shape: tuple[int, ...], kind: str = "float64", separator: str = "."
) -> tuple[NDArray[Any], int]:
    """Read a whole array, and count its damaged chunks, which are as the absent ones: NaN or 0.

    One of several errors is raised if it is not as written.
    """
    chunk = chunk_of(folder, shape, kind, separator)
    values = np.full(shape, np.nan if kind == "float64" else 0, kind)
    damaged = 0
    counts = [-(-size // each) for size, each in zip(shape, chunk, strict=True)]
    for index in product(*map(range, counts)):
        at = [slice(i * each, (i + 1) * each) for i, each in zip(index, chunk, strict=True)]
        part = values[tuple(at)]
        try:
            decoded = _decoded(folder / separator.join(map(str, ("c", *index))), chunk, kind)
            part[...] = decoded[tuple(slice(size) for size in part.shape)]
        except FileNotFoundError:
            continue
        except Exception:  # whatever it holds, it is computed anew
            damaged += 1
    return values, damaged


def _decoded(file: Path, chunk: tuple[int, ...], kind: str) -> NDArray[Any]:
    """The values of a chunk; one of several errors if it is damaged."""
    from google_crc32c import value as crc32c
    from numcodecs.zstd import Zstd  # type: ignore[import-untyped]

    values = np.empty(chunk, np.dtype(kind).newbyteorder("<"))
    content = read_bytes(file, 2 * values.nbytes + MAX_JSON_BYTES)
    body, checksum = content[:-4], content[-4:]
    if crc32c(body) != int.from_bytes(checksum, "little"):
        raise ValueError("its checksum is another one")
    Zstd().decode(body, out=values)  # no byte beyond them, whatever it declares
    return values


def _as_written(about: Any, shape: tuple[int, ...], kind: str, separator: str) -> bool:
    """True if an array's description is that of `locplan.field._zarr.create`."""
    codecs = about["codecs"]
    return bool(
        about["zarr_format"] == 3
        and about["node_type"] == "array"
        and about["data_type"] == kind
        and about["shape"] == list(shape)
        and about["chunk_grid"]["name"] == "regular"
        and about["chunk_key_encoding"]["name"] == "default"
        and about["chunk_key_encoding"]["configuration"]["separator"] == separator
        and about["fill_value"] == ("NaN" if kind == "float64" else 0)
        and not about["storage_transformers"]
        and [each["name"] for each in codecs] == ["bytes", "zstd", "crc32c"]  # as applied
        and codecs[0].get("configuration", {}).get("endian", "little") == "little"
    )
