"""Reading the arrays of a field without zarr, whose import takes longer than the reading.

Only arrays just as `locplan.field._zarr` writes them, without damage, are read so.
"""

from __future__ import annotations

import json
import os
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.reading import MAX_JSON_BYTES

CHECKSUM_BYTES = 4
CODECS = ("bytes", "zstd", "crc32c")
"""Codecs of an array's chunks, in the order in which they were applied."""


def edge_of(folder: Path) -> int | None:
    """Edge length of an array's square chunks [lattice points]; None if it is not as written."""
    try:
        (rows, cols, *_) = _description(folder)["chunk_grid"]["configuration"]["chunk_shape"]
        return rows if rows == cols and type(rows) is int and rows > 0 else None
    except Exception:  # zarr then says what is wrong
        return None


def read_array(folder: Path, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    """Read a whole array of float64, NaN where a chunk is absent; None if it is not as written."""
    try:
        from google_crc32c import value as crc32c
        from numcodecs.zstd import Zstd  # type: ignore[import-untyped]

        if (edge := edge_of(folder)) is None:
            return None
        chunk = (edge, edge, *shape[2:])
        if not _as_written(_description(folder), shape, chunk):
            return None
        values, codec = np.full(shape, np.nan), Zstd()
        counts = [-(-size // each) for size, each in zip(shape, chunk, strict=True)]
        there = set(os.listdir(folder))
        for index in product(*map(range, counts)):
            name = "c." + ".".join(map(str, index))
            if name not in there:
                continue
            content = (folder / name).read_bytes()
            body, checksum = content[:-CHECKSUM_BYTES], content[-CHECKSUM_BYTES:]
            if crc32c(body) != int.from_bytes(checksum, "little"):
                return None
            decoded = np.frombuffer(codec.decode(body), "<f8").reshape(chunk)
            at = [slice(i * each, (i + 1) * each) for i, each in zip(index, chunk, strict=True)]
            part = values[tuple(at)]
            part[...] = decoded[tuple(slice(size) for size in part.shape)]
        return values
    except Exception:  # zarr then says what is wrong
        return None


def _description(folder: Path) -> Any:
    with (folder / "zarr.json").open("rb") as opened:
        return json.loads(opened.read(MAX_JSON_BYTES))


def _as_written(about: Any, shape: tuple[int, ...], chunk: tuple[int, ...]) -> bool:
    """True if an array's description is that of `locplan.field._zarr.create`."""
    codecs = about["codecs"]
    return bool(
        about["zarr_format"] == 3
        and about["node_type"] == "array"
        and about["data_type"] == "float64"
        and about["shape"] == list(shape)
        and about["chunk_grid"]["name"] == "regular"
        and about["chunk_grid"]["configuration"]["chunk_shape"] == list(chunk)
        and about["chunk_key_encoding"]["name"] == "default"
        and about["chunk_key_encoding"]["configuration"]["separator"] == "."
        and about["fill_value"] == "NaN"
        and not about["storage_transformers"]
        and tuple(each["name"] for each in codecs) == CODECS
        and codecs[0]["configuration"]["endian"] == "little"
    )
