"""The cache of results: one .npz file each, named by the digest of all inputs.

`load_or_compute_result` is the rule that fields and trajectories share. `KEY.npz` is a result.
`KEY.parts` is the folder of the finished parts of an unfinished one. Files with further names are
not touched.
"""

from __future__ import annotations

import logging
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from locplan._support.arrays import read_arrays
from locplan._support.checks import check_file_path, short_repr
from locplan._support.output import clear_abandoned_folders, temporary_folder
from locplan._support.reading import MAX_JSON_BYTES, parse_json
from locplan._support.saved import TREE_NAME
from locplan._support.tables import format_age, format_bytes, format_table
from locplan._support.user_cache import find_user_cache
from locplan.errors import ConfigError, LocplanError

if TYPE_CHECKING:
    from filelock import BaseFileLock

T = TypeVar("T")
LOG = logging.getLogger(__name__)

_UNITS = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
_UNITS |= {f"{unit}I": 1024**power for power, unit in enumerate("KMGT", 1)}
RESULT, PARTS = ".npz", ".parts"
_ENTRY = re.compile(r"[0-9a-f]{32}\.(npz|parts|zarr|kept)")
"""Pattern of the names of entries; the last two are those of earlier versions."""
_PATIENCE = 0.3
"""Interval of reports while another process computes [s]."""


class CacheWarning(UserWarning):
    """Warning that a field is not cached, since its estimator cannot be told from others."""


def cache_folder(cache_dir: str | os.PathLike[str] | None = None) -> Path:
    """Return the folder of cached results.

    Parameters
    ----------
    cache_dir : path, optional
        The folder; by default the environment's LOCPLAN_CACHE, or without it the user's cache
        folder. If that cannot be written, a temporary folder.

    Raises
    ------
    ConfigError
        If it is no path, or begins with a user that there is not.
    """
    configured_folder = cache_dir if cache_dir is not None else os.environ.get("LOCPLAN_CACHE")
    if cache_dir is None and not configured_folder:
        return find_user_cache() / "fields"
    folder = os.path.expanduser(check_file_path("the cache folder", configured_folder))
    if folder.startswith("~"):
        raise ConfigError(f"the cache folder {configured_folder}: there is no such user")
    return Path(folder)


def cache_limit() -> int:
    """Return the maximum size of the folder [bytes]: LOCPLAN_CACHE_SIZE (as 500 MB), or 5 GB."""
    text = os.environ.get("LOCPLAN_CACHE_SIZE") or "5 GB"
    match = re.fullmatch(r"\s*(\d{1,15}(?:\.\d*)?)\s*([KMGT]?|[KMGT]I)B?\s*", text.upper())
    if not match:
        raise ConfigError(
            f"LOCPLAN_CACHE_SIZE must be a size such as 500 MB, not {short_repr(text)}"
        )
    return int(float(match[1]) * _UNITS[match[2]])


def load_or_compute_result(
    key: str,
    load: Callable[[Path], T | None],
    compute: Callable[[Path | None], T],
    save: Callable[[Path, T], None],
    *,
    cache_dir: str | os.PathLike[str] | None = None,
    on_waiting: Callable[[Path], None] | None = None,
) -> T:
    """Load a result from the cache, or compute it and save it there.

    One process computes it, while all further processes wait and then load it. The log has a
    warning if the cache cannot be written, and if a file is damaged; its result is computed again.

    Parameters
    ----------
    key : str
        Digest of all that decides the result, 32 hexadecimal digits.
    load : callable
        Loads the result from a file; None if the file lacks values. A LocplanError if it is
        damaged.
    compute : callable
        Computes the result. It takes the folder for finished parts, which need not exist, or None
        if the cache cannot be written. Parts from an interrupted computation are there.
    save : callable
        Writes the result to a file.
    cache_dir : path, optional
        See `cache_folder`.
    on_waiting : callable, optional
        Function that is called with the folder of parts while another process computes.
    """
    limit, path = cache_limit(), cache_folder(cache_dir) / f"{key}{RESULT}"
    parts = path.with_suffix(PARTS)
    result = None
    if os.path.lexists(path):
        with suppress(LocplanError):
            result = load(path)
    if result is None:
        with _hold_lock(path, lambda: on_waiting(parts) if on_waiting else None) as writable:
            if os.path.lexists(path):
                try:
                    result = load(path)  # another process may have computed it meanwhile
                except LocplanError as error:
                    LOG.warning("%s; computed again", error)
            if result is None:
                result = compute(parts if writable else None)
                if writable and _is_saved(path, result, save):
                    shutil.rmtree(parts, ignore_errors=True)
                    evict_results(path.parent, limit, path)
    with suppress(OSError):  # a read-only cache works without a note of the last use
        os.utime(path)
    return result


def _is_saved(path: Path, result: T, save: Callable[[Path, T], None]) -> bool:
    """True if the result could be written; otherwise log the reason."""
    try:
        save(path, result)
    except LocplanError as error:
        LOG.warning("the result is not cached: %s", error)
        return False
    return True


@contextmanager
def _hold_lock(path: Path, on_waiting: Callable[[], None]) -> Iterator[bool]:
    """Wait until no process computes this result; yield True if the cache can be written."""
    from filelock import Timeout

    lock = None
    try:
        lock = make_lock(path)
        while not lock.is_locked:
            try:
                lock.acquire(timeout=_PATIENCE)
            except Timeout:
                on_waiting()
    except (OSError, NotImplementedError) as error:  # the latter where a file system has no locks
        lock = None
        reason = getattr(error, "strerror", None) or error
        _log_unwritable(path.parent, str(reason))
    try:
        yield lock is not None
    finally:
        if lock:
            lock.release()


@cache
def _log_unwritable(folder: Path, reason: str) -> None:
    """Log that results are not cached, once for all of them."""
    LOG.warning("results are not cached: %s cannot be written (%s)", folder, reason)


def make_lock(path: Path) -> BaseFileLock:
    """Return the lock of an entry; the system frees it when the process that holds it ends.

    Lock files are empty and are kept: if one were removed while another process opens it, two
    processes could hold the lock.
    """
    from filelock import FileLock

    locks = path.parent / "locks"
    locks.mkdir(parents=True, exist_ok=True)
    return FileLock(locks / f"{path.stem}.lock")


@dataclass(frozen=True)
class CacheEntry:
    """A file or folder in the cache: a result, parts of one, or an earlier version's leftover."""

    path: Path
    """The result's file, or the folder of the parts or the leftover."""
    size: int
    """Size of the file, or of the folder's files [bytes]."""
    used: float
    """Time of the last use [s since the epoch]."""

    @classmethod
    def from_path(cls, path: Path) -> CacheEntry:
        """Read the entry at a path.

        Parameters
        ----------
        path : path
            The file or folder within the cache.
        """
        files = [_read_size_and_time(file) for file in (path, *_list_files(path))]
        return cls(path, sum(size for size, _ in files[1:] or files), max(t for _, t in files))

    @cached_property
    def metadata(self) -> dict[str, Any]:
        """Description of the result or of its parts; empty if none can be read."""
        if self.path.suffix not in (RESULT, PARTS):
            return {}
        file = max(_list_files(self.path), default=self.path)
        try:
            metadata = parse_json(str(read_arrays(file, MAX_JSON_BYTES, (TREE_NAME,))[TREE_NAME]))
            return metadata if isinstance(metadata, dict) else {}
        except (OSError, ValueError, KeyError):
            return {}

    @property
    def kind(self) -> str:
        """Kind of the result; "damaged", "unfinished" or "outdated" otherwise."""
        otherwise = {RESULT: "damaged", PARTS: "unfinished"}
        kind = self._metadata_text("kind") or otherwise.get(self.path.suffix, "outdated")
        return f"parts of a {kind}" if self.metadata and self.path.suffix == PARTS else kind

    @property
    def finished_share(self) -> float | None:
        """Finished share, 0..1; None if unknown."""
        share = self.metadata.get("finished_share")
        if isinstance(share, float) and 0 <= share <= 1:
            return share
        return 1.0 if self.metadata and self.path.suffix == RESULT else None

    def to_json(self) -> dict[str, Any]:
        """Return the entry, fit for JSON."""
        return {
            "file": str(self.path),
            "kind": self.kind,
            "map": self._metadata_text("map"),
            "details": self._metadata_text("title") or self._metadata_text("drive"),
            "bytes": self.size,
            "finished_share": self.finished_share,
            "used": self.used,
        }

    def _metadata_text(self, name: str) -> str:
        value = self.metadata.get(name)
        return value[:200] if isinstance(value, str) else ""


def list_cache_entries(folder: Path) -> list[CacheEntry]:
    """List all entries of a cache, the last used first.

    Parameters
    ----------
    folder : path
        The folder, see `cache_folder`.
    """
    paths: list[Path] = []
    with suppress(OSError):  # the folder does not exist
        paths = [folder / name for name in os.listdir(folder) if _ENTRY.fullmatch(name)]
    return sorted(
        map(CacheEntry.from_path, paths), key=lambda cached_result: cached_result.used, reverse=True
    )


def format_cache_table(cached_results: Sequence[CacheEntry], folder: Path) -> str:
    """Return a table of entries with sizes and times of use, and the size of the cache.

    Parameters
    ----------
    cached_results : sequence of CacheEntry
        The entries, see `list_cache_entries`.
    folder : path
        The folder, see `cache_folder`.
    """
    rows = []
    for cached_result in cached_results:
        description = cached_result.to_json()
        share = (
            "–" if description["finished_share"] is None else f"{description['finished_share']:.0%}"
        )
        names = [description[name] for name in ("kind", "map", "details")]
        rows.append(
            [*names, format_bytes(cached_result.size), share, format_age(cached_result.used)]
        )
    total = format_bytes(sum(cached_result.size for cached_result in cached_results))
    count = f"{len(rows)} {'result' if len(rows) == 1 else 'results'}"
    last = f"{count}, {total} of at most {format_bytes(cache_limit())}, in {folder}"
    columns = ["kind", "map", "details", "size", "finished", "last used"]
    return f"{format_table(columns, rows)}\n{last}" if rows else last


def clear_cache(folder: Path, days: float = 0.0) -> tuple[list[CacheEntry], list[CacheEntry]]:
    """Remove cached results, except for results that are being computed.

    Parameters
    ----------
    folder : path
        The folder, see `cache_folder`.
    days : float, default 0.0
        Time for which results that are removed were not used [days].

    Returns
    -------
    removed, busy : list of CacheEntry
        The removed results, and the results that are being computed.
    """
    removed: list[CacheEntry] = []
    busy: list[CacheEntry] = []
    for cached_result in list_cache_entries(folder):
        if time.time() - cached_result.used >= days * 86400.0:
            (removed if remove_entry(cached_result.path) else busy).append(cached_result)
    clear_abandoned_folders(folder)
    return removed, busy


def evict_results(folder: Path, limit: int, kept_path: Path) -> None:
    """Remove the least recently used results, but not `kept_path`, down to the limit [bytes]."""
    cached_results = list_cache_entries(folder)
    total = sum(cached_result.size for cached_result in cached_results)
    for cached_result in reversed(cached_results):
        if total > limit and cached_result.path != kept_path:
            with suppress(LocplanError):  # one that cannot be removed is skipped
                total -= cached_result.size if remove_entry(cached_result.path) else 0


def remove_entry(path: Path) -> bool:
    """Remove an entry unless a process holds its lock; return True if it is gone."""
    from filelock import Timeout

    try:
        with make_lock(path).acquire(blocking=False), temporary_folder(path.parent) as trash:
            path.rename(trash / path.name)
    except Timeout:
        return False
    except FileNotFoundError:
        return True  # another process has removed it
    except OSError as error:
        raise LocplanError(f"{path}: cannot be removed ({error.strerror or error})") from None
    return True


def _list_files(folder: Path) -> list[Path]:
    """List the files in a folder."""
    return [Path(at, name) for at, _, names in os.walk(folder) for name in names]


def _read_size_and_time(path: Path) -> tuple[int, float]:
    """Return size [bytes] and time of the last change [s] of a file; zeros if it is gone."""
    try:
        status = path.stat()
    except OSError:
        return 0, 0.0
    return status.st_size, status.st_mtime
