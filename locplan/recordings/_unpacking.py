"""Bounds of what rosbags unpacks: a packed megabyte may hold gigabytes."""

from __future__ import annotations

import os
from bz2 import BZ2Decompressor
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from io import BufferedReader
from types import SimpleNamespace
from typing import Any

from locplan.errors import RecordingError

MAX_CHUNK_BYTES = 2**26
"""Greatest size of a chunk, or of a message that is packed by itself, once it is unpacked."""
MAX_RATIO = 100
"""Greatest size of a file that is packed as a whole, once it is unpacked, to its own."""


@cache
def bound_unpacking(ros1: Any, ros2: Any, mcap: Any) -> None:
    """Put bounds on the functions by which these modules of rosbags unpack, which have none."""
    from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

    lz4 = partial(_unpacked, LZ4FrameDecompressor)
    ros1.decompressors.update(bz2=partial(_unpacked, BZ2Decompressor), lz4=lz4)
    mcap.DECOMPRESSORS["lz4"] = lz4
    zstd: Any = getattr(ros2, "zstd", None)
    if zstd is not None:  # older ones unpack no more than a chunk says of itself
        unpacked = partial(_unpacked, zstd.ZstdDecompressor)
        mcap.DECOMPRESSORS["zstd"] = unpacked
        whole_file = partial(_whole_file, zstd.open)
        vars(ros2)["zstd"] = SimpleNamespace(open=whole_file, decompress=unpacked)


def _unpacked(kind: Callable[[], Any], packed: bytes, _: int = 0) -> bytes:
    """Content of a chunk, which may consist of several frames."""
    parts, room = list[bytes](), MAX_CHUNK_BYTES
    while packed:
        frame = kind()
        parts.append(frame.decompress(packed, room + 1))
        room -= len(parts[-1])
        if room < 0:
            raise RecordingError(f"a chunk unpacks to over {MAX_CHUNK_BYTES / 1e6:.0f} MB")
        if not frame.eof:
            raise RecordingError("a chunk is cut off or damaged; record it again")
        packed = frame.unused_data
    return b"".join(parts)


@contextmanager
def _whole_file(unpack: Callable[..., Any], file: BufferedReader, mode: str) -> Iterator[Any]:
    """A packed file that is open for reading, up to its greatest size."""
    left = MAX_RATIO * os.fstat(file.fileno()).st_size

    def read(count: int) -> bytes:
        nonlocal left
        part: bytes = content.read(count)
        left -= len(part)
        if left < 0:
            raise RecordingError(f"it unpacks to over {MAX_RATIO} times its size; unpack it first")
        return part

    with unpack(file, mode) as content:
        yield SimpleNamespace(read=read)
