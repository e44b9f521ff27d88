"""Temporary folders that are removed even if the process that made them is killed.

A process holds a lock of each as long as it lives. So the next one that needs a temporary folder in
the same place knows which ones nobody needs any more.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import gettempdir, mkdtemp

ASIDE = "aside"
"""Folder in a temporary one of what is moved aside; it returns to its place unless replaced."""
PREFIX = ".locplan-tmp-"
_NAME = re.compile(re.escape(PREFIX) + r"[a-z0-9_]{8}")
_FIELDS = 2

_listener: int | None = None


def tell(descriptor: int) -> None:
    """Tell of temporary folders through this pipe from now on, see `Leftovers`."""
    global _listener
    _listener = descriptor


@contextmanager
def temporary_folder(folder: Path | None = None) -> Iterator[Path]:
    """Yield a new folder in `folder`, or where the system has such, that is removed at last.

    Those that killed processes have left there are removed first.
    """
    parent = os.path.abspath(folder or gettempdir())
    remove_abandoned(parent)
    made, lock = _made(parent)
    _say("+", made)
    try:
        yield Path(made)
    finally:
        remove(made)
        _say("-", made)
        if lock is not None:
            os.close(lock)


def remove_abandoned(folder: str | os.PathLike[str]) -> None:
    """Remove the temporary folders in a folder that killed processes have left."""
    with suppress(OSError):  # it cannot be listed, or is gone
        for name in filter(_NAME.fullmatch, os.listdir(folder)):
            path = os.path.join(folder, name)
            with suppress(OSError):  # a process holds it, or it is another user's
                lock = _lock(path, wait=False)
                if lock is not None:
                    remove(path)
                    os.close(lock)


def remove(temporary: str) -> None:
    """Remove a temporary folder, after what was moved aside has returned to its place."""
    aside = os.path.join(temporary, ASIDE)
    for name in os.listdir(aside) if os.path.isdir(aside) else ():
        place = os.path.join(os.path.dirname(temporary), name)
        if not os.path.lexists(place):
            os.rename(os.path.join(aside, name), place)
    shutil.rmtree(temporary, ignore_errors=True)


class Leftovers:
    """What a process has said of its temporary folders, for another one that outlives it."""

    def __init__(self) -> None:
        self._known: dict[str, None] = {}
        self._rest = b""

    def hear(self, said: bytes) -> None:
        """Take what came through the pipe."""
        *words, self._rest = (self._rest + said).split(b"\0")
        keep = len(words) - len(words) % _FIELDS
        self._rest = b"\0".join([*words[keep:], self._rest])
        for n in range(0, keep, _FIELDS):
            sign, temporary = map(os.fsdecode, words[n : n + _FIELDS])
            if sign == "+":
                self._known[temporary] = None
            else:
                self._known.pop(temporary, None)

    def remove(self) -> None:
        """Remove what the process has not removed itself."""
        for temporary in self._known:
            with suppress(OSError):
                remove(temporary)


def _made(parent: str) -> tuple[str, int | None]:
    """A new folder, and the descriptor of its lock, None where there are no locks."""
    while True:
        made = mkdtemp(prefix=PREFIX, dir=parent)
        try:
            return made, _lock(made, wait=True)
        except FileNotFoundError:
            continue  # another process took it for abandoned before it was locked
        except OSError:
            return made, None


def _lock(folder: str, *, wait: bool) -> int | None:
    """Descriptor that holds the lock of a folder until it is closed; None on Windows.

    It is an OSError if another process holds it, or has removed the folder meanwhile.
    """
    try:
        import fcntl
    except ModuleNotFoundError:
        return None
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.stat(folder)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def _say(*words: str) -> None:
    if _listener is not None:
        with suppress(OSError):  # nobody listens any more
            os.write(_listener, b"".join(os.fsencode(word) + b"\0" for word in words))
