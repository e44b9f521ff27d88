"""The one door to files that are read: plain ones only, of a size that is known before."""

from __future__ import annotations

import gzip
import json
import os
import stat
import zlib
from collections.abc import Iterator
from io import BufferedReader, TextIOWrapper
from pathlib import Path
from typing import Any

from locplan.errors import LocplanError

MAX_BYTES = 2**24
"""Greatest size of a text that is read at once: its numbers may take fifty times as much."""
MAX_LOG_BYTES = 2**32
"""Greatest size, unpacked, of a log that is read line by line."""
MAX_LINE, MAX_LINES = 2**22, 2**22
"""Greatest length of a log's line [characters], and greatest number of lines."""
MAX_JSON_BYTES = 2**20
"""Greatest size of a file of settings, or of a description in JSON."""


def opened(file: str | os.PathLike[str], limit: float = float("inf")) -> BufferedReader:
    """Open a plain file of up to `limit` bytes; an OSError if it is none: a pipe would block."""

    def without_waiting(path: str, flags: int) -> int:
        return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))

    content = open(file, "rb", opener=without_waiting)  # noqa: SIM115
    status = os.fstat(content.fileno())
    if stat.S_ISREG(status.st_mode) and status.st_size <= limit:
        return content
    content.close()
    if stat.S_ISREG(status.st_mode):
        raise OSError(f"it is over {limit / 1e6:.3g} MB, too much for such a file")
    raise OSError("it is no plain file, but a pipe or a device")


def read_bytes(file: str | os.PathLike[str], limit: int) -> bytes:
    """Content of a plain file of up to `limit` bytes; an OSError or a ValueError if it is none."""
    with opened(file, limit) as content:
        return content.read(os.fstat(content.fileno()).st_size)  # room is made for all of it


def read_text(file: Path, limit: int = MAX_BYTES) -> str:
    """Read a text in UTF-8, without a byte order mark.

    Raises
    ------
    LocplanError
        If it cannot be read, or is no text of up to `limit` bytes.
    """
    try:
        return read_bytes(file, limit).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise LocplanError(f"{file}: is no text; save it as UTF-8") from None
    except (OSError, ValueError) as error:  # the latter for names that no file can have
        reason = getattr(error, "strerror", None) or error
        raise LocplanError(f"{file}: cannot be read ({reason})") from None


def numbered_lines(file: Path, errors: str = "strict") -> Iterator[tuple[int, str]]:
    """Lines of a log with their numbers, one at a time; one that ends in .gz is unpacked meanwhile.

    Raises
    ------
    LocplanError
        If it cannot be read, is damaged, is no text in UTF-8 (unless `errors` are replaced), or is
        too long.
    """
    number = size = 0
    try:
        with opened(file, MAX_LOG_BYTES) as content:
            unpacked = gzip.GzipFile(fileobj=content) if file.suffix == ".gz" else content
            text = TextIOWrapper(unpacked, "utf-8-sig", errors)
            while line := text.readline(MAX_LINE):
                number, size = number + 1, size + len(line)
                if len(line) == MAX_LINE:
                    raise LocplanError(f"line {number} is too long for a log of scans")
                if number > MAX_LINES or size > MAX_LOG_BYTES:
                    raise LocplanError(
                        f"goes on beyond {MAX_LINES:,} lines, or {MAX_LOG_BYTES / 1e6:.0f} MB;"
                        " split it"
                    )
                yield number, line
    except UnicodeDecodeError:
        raise LocplanError("is no text; save it as UTF-8") from None
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise LocplanError("is cut off or damaged (gzip); copy it again") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise LocplanError(f"cannot be read ({reason})") from None


def parsed_json(text: str) -> Any:
    """Value of a text in JSON; a ValueError if it is none, or too deep or long to be read."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("its brackets are too deep") from None
