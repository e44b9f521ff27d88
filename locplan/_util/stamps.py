"""What a file says of itself first: the locplan that wrote it, its kind, and its version."""

from __future__ import annotations

from typing import Any

from locplan import __version__
from locplan._util.checks import shown
from locplan.errors import LocplanError

STAMP = ("locplan", "kind", "version")
"""Names of the entries."""
MAX_VERSION = 10**6


def stamp(kind: str, version: int) -> dict[str, Any]:
    """First entries of a file: who wrote it, and what it holds."""
    return dict(zip(STAMP, (__version__, kind, version), strict=True))


def check_stamp(file: object, content: object, kind: str, version: int) -> None:
    """Raise a LocplanError unless a file holds this kind of thing, in a version that is known."""
    entries = content if isinstance(content, dict) else {}
    holds, found = entries.get("kind"), entries.get("version")
    if not isinstance(holds, str) or not isinstance(found, int) or not 1 <= found < MAX_VERSION:
        raise LocplanError(f"{file}: is damaged, or no {kind} that locplan has saved; save it anew")
    if holds != kind:
        raise LocplanError(f"{file}: holds a {shown(holds)[1:-1]}, not a {kind}; name another file")
    if found > version:
        raise LocplanError(
            f"{file}: is of a newer locplan (version {found} of a {kind}, this one reads"
            f" {version}); update locplan"
        )
