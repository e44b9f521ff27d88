"""Temporary files and folders that are removed even if the process that made them is killed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp

ASIDE = ".old"
"""What the name of a target that is moved aside ends with, after that of the temporary folder."""
_FIELDS = 3

_listener: int | None = None


def tell(descriptor: int) -> None:
    """Tell of temporary files through this pipe from now on, see `Leftovers`."""
    global _listener
    _listener = descriptor


@contextmanager
def removed_at_last(
    temporary: str | os.PathLike[str], target: Path | None = None
) -> Iterator[None]:
    """Remove a temporary file or folder at the end of the block, also if the process is killed.

    A target folder that was moved aside, and not replaced, returns.
    """
    path = os.path.abspath(temporary)
    aim = os.path.abspath(target) if target else ""
    _say("+", path, aim)
    try:
        yield
    finally:
        remove(path, aim)
        _say("-", path, aim)


@contextmanager
def temporary_folder(folder: Path | None = None, *, prefix: str = "locplan-") -> Iterator[Path]:
    """Yield a new folder in `folder`, or where the system has such, that is removed at last."""
    made = mkdtemp(prefix=prefix, dir=folder)
    with removed_at_last(made):
        yield Path(made)


def remove(temporary: str, target: str) -> None:
    """Remove what is left of a temporary file or folder, and bring back what was moved aside."""
    if os.path.isdir(temporary):
        shutil.rmtree(temporary, ignore_errors=True)
    with suppress(OSError):  # it is in its place, or its folder is gone
        os.unlink(temporary)
    aside = temporary + ASIDE
    if target and os.path.exists(aside):
        if not os.path.exists(target):
            os.rename(aside, target)
        shutil.rmtree(aside, ignore_errors=True)


class Leftovers:
    """What a process has told of its temporary files, for another one that outlives it."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, str], None] = {}
        self._rest = b""

    def hear(self, told: bytes) -> None:
        """Take what came through the pipe."""
        *words, self._rest = (self._rest + told).split(b"\0")
        keep = len(words) - len(words) % _FIELDS
        self._rest = b"\0".join([*words[keep:], self._rest])
        for n in range(0, keep, _FIELDS):
            sign, temporary, target = map(os.fsdecode, words[n : n + _FIELDS])
            if sign == "+":
                self._known[temporary, target] = None
            else:
                self._known.pop((temporary, target), None)

    def remove(self) -> None:
        """Remove what the process has not removed itself."""
        for temporary, target in self._known:
            with suppress(OSError):
                remove(temporary, target)


def _say(*words: str) -> None:
    if _listener is not None:
        with suppress(OSError):  # nobody listens any more
            os.write(_listener, b"".join(os.fsencode(word) + b"\0" for word in words))
