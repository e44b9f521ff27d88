"""The folder of cached results: its entries, its size limit, its locks, and its table.

Most are fields; others, such as trajectories, checks of walls and drives, have a folder `KEY.kept`
(`locplan.field._kept`).
"""

from __future__ import annotations

import os
import re
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locplan._util.checks import file_path, shown
from locplan._util.output import clear_abandoned, temporary_folder
from locplan._util.reading import parsed_json, read_text
from locplan._util.tables import age, in_bytes, table
from locplan.errors import ConfigError, LocplanError
from locplan.field import _zarr as field_files
from locplan.field._config import FieldConfig
from locplan.field.estimators import ESTIMATORS, estimator_class
from locplan.robots import PRESETS, Lidar

if TYPE_CHECKING:
    from filelock import BaseFileLock

_UNITS = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
_UNITS |= {f"{unit}I": 1024**power for power, unit in enumerate("KMGT", 1)}
KEPT = ".kept"
CHECK = "check of walls"
"""What the check of a map's walls is called in the list of the cache."""
KINDS = {"field": "fields", "trajectory": "trajectories", CHECK: "checks of walls"}
KINDS |= {"driven check": "driven checks"}
"""What entries are, one and several."""
_FIELD = re.compile("[0-9a-f]{32}" + re.escape(field_files.FIELD_SUFFIX))
_ENTRY = re.compile(f"{_FIELD.pattern}|[0-9a-f]{{32}}{re.escape(KEPT)}")
"""Patterns of the names of cached fields, and of all entries; nothing else is touched."""


@dataclass(frozen=True)
class CacheEntry:
    """A cached field, or another kept result."""

    folder: Path
    """Folder of the field's Zarr group, or of the result's files."""
    about: dict[str, Any]
    """The group's attributes, or what the result is; empty if they are damaged."""
    size: int
    """Total size of the files [bytes]."""
    chunks: int
    """Number of finished chunks, of `about["chunks"]` in all."""
    computed: float
    """Time at which the computation began [s since the epoch]."""
    used: float
    """Time of the last use [s since the epoch]."""

    @classmethod
    def read(cls, folder: Path) -> CacheEntry:
        """Read the entry of a folder, as far as it can be read.

        Parameters
        ----------
        folder : path
            The folder within the cache.
        """
        about: dict[str, Any] = {}
        chunks = field_files.count_chunks(folder)
        with suppress(LocplanError, ValueError):
            if folder.suffix == KEPT:
                what, map_name, finished = parsed_json(read_text(note_of(folder)))
                about = {"config": {"name": str(what)}, "map_name": str(map_name), "chunks": 1}
                chunks = int(bool(finished))
            else:
                about = field_files.read_attributes(folder)
        files = [Path(at, name) for at, _, names in os.walk(folder) for name in names]
        return cls(
            folder=folder,
            about=about,
            size=sum(_status(file)[0] for file in files),
            chunks=chunks,
            computed=_status(folder / "covariance" / "zarr.json")[1] or _status(folder)[1],
            used=_status(note_of(folder))[1],
        )

    @property
    def share(self) -> float | None:
        """Finished share of the field, 0..1; None where it is to have some points only."""
        if "points" in self.about.get("identity", ()):
            return None
        return self.chunks / self.about["chunks"] if self.about.get("chunks") else 1.0


def cache_folder(cache_dir: str | os.PathLike[str] | None = None) -> Path:
    """The folder of cached fields.

    Parameters
    ----------
    cache_dir : path, optional
        The folder; by default LOCPLAN_CACHE of the environment, or else the user's cache folder.

    Raises
    ------
    ConfigError
        If it is no path, or begins with a user that there is not.
    """
    from platformdirs import user_cache_path

    chosen = cache_dir if cache_dir is not None else os.environ.get("LOCPLAN_CACHE")
    if cache_dir is None and not chosen:
        return user_cache_path("locplan") / "fields"
    folder = os.path.expanduser(file_path("the cache folder", chosen))
    if folder.startswith("~"):
        raise ConfigError(f"the cache folder {chosen}: there is no such user")
    return Path(folder)


def cache_limit() -> int:
    """Maximum size of the folder [bytes]: LOCPLAN_CACHE_SIZE, such as 500 MB, or else 5 GB."""
    text = os.environ.get("LOCPLAN_CACHE_SIZE") or "5 GB"
    match = re.fullmatch(r"\s*(\d{1,15}(?:\.\d*)?)\s*([KMGT]?|[KMGT]I)B?\s*", text.upper())
    if not match:
        raise ConfigError(f"LOCPLAN_CACHE_SIZE must be a size such as 500 MB, not {shown(text)}")
    return int(float(match[1]) * _UNITS[match[2]])


def entries(folder: Path) -> list[CacheEntry]:
    """All entries in the folder, the last used first."""
    return [CacheEntry.read(path) for path in _named(folder, _ENTRY)]


def fields(folder: Path) -> list[Path]:
    """Paths of the cached fields in the folder, the last used first."""
    return _named(folder, _FIELD)


def _named(folder: Path, pattern: re.Pattern[str]) -> list[Path]:
    with suppress(OSError):  # the folder does not exist
        found = [folder / name for name in os.listdir(folder) if pattern.fullmatch(name)]
        return sorted(found, key=lambda path: _status(note_of(path))[1], reverse=True)
    return []


def note_of(entry: Path) -> Path:
    """The file that says what an entry is, and whose time is that of its last use."""
    return entry / ("about.json" if entry.suffix == KEPT else "zarr.json")


def lock_of(field: Path) -> BaseFileLock:
    """Lock that a process holds while it computes an entry; the system frees it when that ends.

    Lock files are empty and are kept: if one were removed while another process opens it, two
    processes could hold the lock.
    """
    from filelock import FileLock

    locks = field.parent / "locks"
    locks.mkdir(parents=True, exist_ok=True)
    return FileLock(locks / f"{field.stem}.lock")


def remove(field: Path) -> bool:
    """Remove an entry unless a process holds its lock; return whether it is gone."""
    from filelock import Timeout

    try:
        with lock_of(field).acquire(blocking=False), temporary_folder(field.parent) as aside:
            field.rename(aside / field.name)
    except Timeout:
        return False
    except FileNotFoundError:
        return True  # another process has removed it
    except OSError as error:
        raise LocplanError(f"{field}: cannot be removed ({error.strerror or error})") from None
    return True


def clear_cache(folder: Path, days: float = 0.0) -> tuple[list[CacheEntry], list[CacheEntry]]:
    """Remove cached fields and other results, but for those being computed.

    Parameters
    ----------
    folder : path
        The folder of cached fields, see `cache_folder`.
    days : float, default 0.0
        Time for which fields were not used that are removed [days].

    Returns
    -------
    removed, busy : list of CacheEntry
        The fields that were removed, and those that are being computed.
    """
    removed: list[CacheEntry] = []
    busy: list[CacheEntry] = []
    for entry in entries(folder):
        if time.time() - entry.used >= days * 86400.0:
            (removed if remove(entry.folder) else busy).append(entry)
    clear_abandoned(folder)
    return removed, busy


def evict(folder: Path, limit: int, keep: Path) -> None:
    """Remove the least recently used fields, but not `keep`, down to the limit [bytes]."""
    found = entries(folder)
    total = sum(entry.size for entry in found)
    for entry in reversed(found):
        if total > limit and entry.folder != keep:
            with suppress(LocplanError):  # one that cannot be removed is skipped
                total -= entry.size if remove(entry.folder) else 0


def mark_used(field: Path) -> None:
    """Note that a field was used just now, if the folder can be written."""
    with suppress(OSError):  # a read-only cache works without this note
        os.utime(field / "zarr.json")


def _status(path: Path) -> tuple[int, float]:
    """Size [bytes] and time of the last change [s] of a file; zeros if it has been removed."""
    try:
        status = path.stat()
    except OSError:
        return 0, 0.0
    return status.st_size, status.st_mtime


@dataclass(frozen=True)
class FieldCache:
    """The cached results in a folder, the last used first."""

    folder: Path
    """The folder."""
    entries: Sequence[CacheEntry]
    """The results."""
    limit: int
    """Maximum size of the folder [bytes]."""

    @classmethod
    def of(cls, cache_dir: str | os.PathLike[str] | None = None) -> FieldCache:
        """Read what a folder holds.

        Parameters
        ----------
        cache_dir : path, optional
            See `cache_folder`.
        """
        folder = cache_folder(cache_dir)
        return cls(folder, entries(folder), cache_limit())

    def summary(self) -> list[dict[str, Any]]:
        """The results, fit for JSON; times are seconds since the epoch."""
        return [
            {
                "folder": str(entry.folder),
                "map": entry.about.get("map_name"),
                "config": entry.about.get("config"),
                "bytes": entry.size,
                "finished_share": entry.share,
                "computed": entry.computed,
                "used": entry.used,
            }
            for entry in self.entries
        ]

    def table(self) -> str:
        """The results with sizes and when they were used, and how full the folder is."""
        rows = [
            [
                entry.about.get("map_name", "(not of this version)"),
                _unusual(entry.about["config"]) if entry.about else "–",
                in_bytes(entry.size),
                "near paths" if entry.share is None else f"{entry.share:.0%}",
                age(entry.used),
            ]
            for entry in self.entries
        ]
        total = sum(entry.size for entry in self.entries)
        counts = Counter(map(_kind, self.entries))
        count = " and ".join(
            f"{counts[one]} {one if counts[one] == 1 else several}"
            for one, several in KINDS.items()
            if counts[one] or one == "field"
        )
        last = f"{count}, {in_bytes(total)} of at most {in_bytes(self.limit)}, in {self.folder}"
        columns = ["map", "config", "size", "finished", "last used"]
        return f"{table(columns, rows)}\n{last}" if rows else last


def _kind(entry: CacheEntry) -> str:
    """What an entry is, of `KINDS`."""
    if entry.folder.suffix != KEPT:
        return "field"
    name = entry.about.get("config", {}).get("name", "")
    return name if name in KINDS else "trajectory"


def _unusual(config: Mapping[str, Any]) -> str:
    """The estimator, the lidar's name, and the settings that are not their default ones."""
    settings = dict(_leaves(config))
    # Each part of an estimator has a lidar.
    models = [key for key in settings if f".{key}".endswith(".lidar.model")] or ["lidar.model"]
    names = [_short(settings.pop(key, "")) for key in ("name", *models)]
    usual = _usual(*names[:2])
    changed = [
        f"{key.removesuffix('.name').rpartition('.')[2]} {_short(v)}"
        for key, v in settings.items()
        if usual.get(key, v) != v
    ]
    said = [name for name in names if name] + changed
    return ", ".join(dict.fromkeys(said))  # both parts of fused have the same lidar


def _short(value: object) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return value if isinstance(value, str) else shown(value)


def _usual(estimator: str, lidar: str) -> dict[str, object]:
    """The settings of an estimator with a lidar by default; few where either is not known."""
    kind: Any = estimator_class(estimator if estimator in ESTIMATORS else "sad")
    sheet = Lidar.preset(lidar) if lidar in PRESETS else Lidar()
    return dict(
        _leaves(FieldConfig(kind(sheet) if kind.casts_rays else kind().with_lidar(sheet)).to_json())
    )


def _leaves(settings: Mapping[str, Any], depth: int = 4) -> Iterator[tuple[str, Any]]:
    """The settings in settings, each by its own name and that of what it is a part of."""
    for name, value in settings.items():
        if not isinstance(value, Mapping) or not depth:
            yield name, value
            continue
        prefix = "" if name == "estimator" else f"{name}."
        yield from ((prefix + inner, leaf) for inner, leaf in _leaves(value, depth - 1))
