"""The cached fields as a table, and as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from locplan._util.checks import shown
from locplan._util.tables import age, in_bytes, table
from locplan.field._cache import CacheEntry
from locplan.field._config import FieldConfig
from locplan.field._lidar import Lidar
from locplan.field._settings import settings_of


def cache_summary(entries: Sequence[CacheEntry]) -> list[dict[str, Any]]:
    """Cached fields, fit for JSON; times are seconds since the epoch."""
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
        for entry in entries
    ]


def cache_table(entries: Sequence[CacheEntry], folder: Path, limit: int) -> str:
    """Cached fields with sizes and ages, and how full the folder is."""
    rows = [
        [
            entry.about.get("map_name", "(not of this version)"),
            _unusual(entry.about["config"]) if entry.about else "–",
            in_bytes(entry.size),
            "near paths" if entry.share is None else f"{entry.share:.0%}",
            age(entry.computed),
            age(entry.used),
        ]
        for entry in entries
    ]
    total = sum(entry.size for entry in entries)
    count = f"{len(entries)} field{'' if len(entries) == 1 else 's'}"
    last = f"{count}, {in_bytes(total)} of at most {in_bytes(limit)}, in {folder}"
    if not rows:
        return last
    columns = ["map", "config", "size", "finished", "computed", "last used"]
    return f"{table(columns, rows)}\n{last}"


def cleared(removed: Sequence[CacheEntry], busy: Sequence[CacheEntry]) -> str:
    """What became of the fields in the cache, in one line."""
    line = f"removed {len(removed)}, {in_bytes(sum(entry.size for entry in removed))}"
    return line + (f"; being computed, and kept: {len(busy)}" if busy else "")


def _unusual(config: Mapping[str, Any]) -> str:
    """The settings that are not the default ones."""
    usual = dict(_leaves(FieldConfig().to_json() | {"lidar": settings_of(Lidar())}))
    changed = [
        f"{key}={v if isinstance(v, str) else shown(v)}"
        for key, v in _leaves(config)
        if usual.get(key, v) != v
    ]
    return ", ".join(changed) or "default"


def _leaves(settings: Mapping[str, Any], depth: int = 4) -> Iterator[tuple[str, Any]]:
    """The settings in settings, each by its own name and that of what it is a part of."""
    for name, value in settings.items():
        if not isinstance(value, Mapping) or not depth:
            yield name, value
            continue
        prefix = "" if name == "estimator" else f"{name}."
        yield from ((prefix + inner, leaf) for inner, leaf in _leaves(value, depth - 1))
