"""Reading files of text and JSON, of which none takes all memory or raises another error."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from locplan.errors import LocplanError

MAX_BYTES = 2**26
"""Greatest size of a file of text that is read."""
MAX_JSON_BYTES = 2**20
"""Greatest size of a file of settings, or of a description in JSON."""


def read_text(file: Path, limit: int = MAX_BYTES) -> str:
    """Read a text in UTF-8, without a byte order mark.

    Raises
    ------
    LocplanError
        If it cannot be read, or is no text of up to `limit` bytes.
    """
    try:
        with file.open("rb") as opened:
            content = opened.read(limit + 1)
        if len(content) > limit:
            raise LocplanError(f"{file}: is over {limit / 1e6:.0f} MB, too much for such a file")
        return content.decode("utf-8-sig")
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
