"""The folder of cached fields: what it holds, how large it may grow, who may write."""

from __future__ import annotations

import os
import re
import shutil
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locplan.errors import ConfigError, FieldError, LocplanError
from locplan.field import _zarr as field_files

if TYPE_CHECKING:
    from filelock import BaseFileLock

LIMIT = "5 GB"
"""Of the folder's size, unless LOCPLAN_CACHE_SIZE says otherwise."""
_UNITS = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
_UNITS |= {f"{unit}I": 1024**power for power, unit in enumerate("KMGT", 1)}
_DAY = 86400.0
_KEY = "[0-9a-f]{32}"
"""What our fields are named by: nothing else in the folder is touched."""


@dataclass(frozen=True)
class CacheEntry:
    """A cached field."""

    folder: Path
    """Its Zarr group."""
    about: dict[str, Any]
    """The group's attributes; empty if they are damaged."""
    size: int
    """Of all its files [bytes]."""
    chunks: int
    """Finished, of `about["chunks"]`."""
    computed: float
    """When its computation began [s since the epoch]."""
    used: float
    """When it was used last [s since the epoch]."""

    @classmethod
    def read(cls, folder: Path) -> CacheEntry:
        """The entry in a folder, as far as it can be read."""
        try:
            about = field_files.read_attributes(folder)
        except FieldError:
            about = {}
        files = [Path(at, name) for at, _, names in os.walk(folder) for name in names]
        return cls(
            folder=folder,
            about=about,
            size=sum(_status(file)[0] for file in files),
            chunks=field_files.count_chunks(folder),
            computed=_status(folder / "covariance" / "zarr.json")[1],
            used=_status(folder / "zarr.json")[1],
        )

    @property
    def share(self) -> float:
        """How much of the field is finished, 0..1."""
        return self.chunks / self.about["chunks"] if self.about.get("chunks") else 1.0


def cache_folder(cache_dir: str | os.PathLike[str] | None = None) -> Path:
    """The folder of cached fields: the argument, LOCPLAN_CACHE, or the user's cache folder.

    Raises
    ------
    ConfigError
        If it begins with ~ and a user that there is not.
    """
    from platformdirs import user_cache_path

    chosen = cache_dir or os.environ.get("LOCPLAN_CACHE")
    if not chosen:
        return user_cache_path("locplan") / "fields"
    folder = os.path.expanduser(chosen)
    if folder.startswith("~"):
        raise ConfigError(f"the cache folder {chosen}: there is no such user")
    return Path(folder)


def cache_limit() -> int:
    """How large the folder may grow [bytes]: LOCPLAN_CACHE_SIZE, such as 500 MB, or 5 GB.

    Raises
    ------
    ConfigError
        If LOCPLAN_CACHE_SIZE is no size.
    """
    text = os.environ.get("LOCPLAN_CACHE_SIZE") or LIMIT
    match = re.fullmatch(r"\s*(\d{1,15}(?:\.\d*)?)\s*([KMGT]?|[KMGT]I)B?\s*", text.upper())
    if not match:
        raise ConfigError(f"LOCPLAN_CACHE_SIZE must be a size such as 500 MB, not {text!r}")
    return int(float(match[1]) * _UNITS[match[2]])


def entries(folder: Path) -> list[CacheEntry]:
    """What the folder holds, the last used first."""
    return [CacheEntry.read(path) for path in fields(folder)]


def fields(folder: Path) -> list[Path]:
    """The cached fields in the folder, the last used first."""
    found = _named(folder, _KEY + re.escape(field_files.SUFFIX))
    return sorted(found, key=lambda path: _status(path / "zarr.json")[1], reverse=True)


def lock_of(field: Path) -> BaseFileLock:
    """The lock of whoever computes a field; the system frees it when its process ends.

    Lock files are empty and stay: to remove one while another process opens it would let two in.
    """
    from filelock import FileLock

    locks = field.parent / "locks"
    locks.mkdir(parents=True, exist_ok=True)
    return FileLock(locks / f"{field.stem}.lock")


def remove(field: Path) -> bool:
    """Remove a cached field unless a process is at it; whether it is gone.

    Raises
    ------
    LocplanError
        If the folder cannot be written.
    """
    from filelock import Timeout

    try:
        with lock_of(field).acquire(blocking=False):
            aside = field.with_name(f".{field.stem}.old")
            shutil.rmtree(aside, ignore_errors=True)
            field.rename(aside)
            shutil.rmtree(aside)
    except Timeout:
        return False
    except FileNotFoundError:
        return True  # another process was faster
    except OSError as error:
        raise LocplanError(f"{field}: cannot be removed ({error.strerror or error})") from None
    return True


def remove_older(folder: Path, days: float) -> tuple[list[CacheEntry], list[CacheEntry]]:
    """Remove the fields not used for so many days; those removed, and those in use."""
    removed: list[CacheEntry] = []
    busy: list[CacheEntry] = []
    for entry in entries(folder):
        if time.time() - entry.used >= days * _DAY:
            (removed if remove(entry.folder) else busy).append(entry)
    _sweep(folder)
    return removed, busy


def evict(folder: Path, limit: int, keep: Path) -> None:
    """Remove the fields used least recently until the rest, with `keep`, is within the limit."""
    found = entries(folder)
    total = sum(entry.size for entry in found)
    for entry in reversed(found):
        if total > limit and entry.folder != keep:
            with suppress(LocplanError):  # what cannot be removed must not keep the rest
                total -= entry.size if remove(entry.folder) else 0
    _sweep(folder)


def mark_used(field: Path) -> None:
    """Note that a field was used just now, if the folder can be written."""
    with suppress(OSError):  # a read-only cache serves as well, only without this note
        os.utime(field / "zarr.json")


def _sweep(folder: Path) -> None:
    """Remove what killed processes have left half made."""
    for path in _named(folder, rf"\.{_KEY}.*"):
        if time.time() - _status(path)[1] > _DAY:
            shutil.rmtree(path, ignore_errors=True)


def _named(folder: Path, pattern: str) -> list[Path]:
    try:
        return [folder / name for name in os.listdir(folder) if re.fullmatch(pattern, name)]
    except OSError:
        return []  # there is no such folder


def _status(path: Path) -> tuple[int, float]:
    """Size [bytes] and time of the last change [s]; zeros for what has just been removed."""
    try:
        status = path.stat()
    except OSError:
        return 0, 0.0
    return status.st_size, status.st_mtime
