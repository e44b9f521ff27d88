"""The one door to files that are read: plain ones only, of a size that is known before."""

from __future__ import annotations

import json
import os
import stat
from io import BufferedReader
from pathlib import Path
from typing import Any

from locplan.errors import LocplanError

MAX_BYTES = 2**26
"""Greatest size of a file of text that is read."""
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


def parsed_json(text: str) -> Any:
    """Value of a text in JSON; a ValueError if it is none, or too deep or long to be read."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("its brackets are too deep") from None
