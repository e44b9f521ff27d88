"""The cached fields as a table, and as JSON."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from locplan._util.checks import shown
from locplan._util.tables import age, in_bytes, table
from locplan.field._cache import CacheEntry, cache_folder, cache_limit, entries
from locplan.field._config import FieldConfig
from locplan.field._registry import ESTIMATORS, estimator_class
from locplan.robots import PRESETS, Lidar


@dataclass(frozen=True)
class FieldCache:
    """The cached fields in a folder, the last used first."""

    folder: Path
    """The folder."""
    entries: Sequence[CacheEntry]
    """The fields."""
    limit: int
    """Greatest size of the folder [bytes]."""

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
        """The fields, fit for JSON; times are seconds since the epoch."""
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
        """The fields with sizes and when they were used, and how full the folder is."""
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
        count = f"{len(self.entries)} field{'' if len(self.entries) == 1 else 's'}"
        last = f"{count}, {in_bytes(total)} of at most {in_bytes(self.limit)}, in {self.folder}"
        if not rows:
            return last
        columns = ["map", "config", "size", "finished", "last used"]
        return f"{table(columns, rows)}\n{last}"


def _unusual(config: Mapping[str, Any]) -> str:
    """The estimator, the lidar's name, and the settings that are not their default ones."""
    settings = dict(_leaves(config))
    # Each part of an estimator has a lidar.
    models = [key for key in settings if f".{key}".endswith(".lidar.model")] or ["lidar.model"]
    texts = [settings.pop(key, "") for key in ("name", *models)]
    names = [text if isinstance(text, str) else shown(text) for text in texts]
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
    kind = estimator_class(estimator if estimator in ESTIMATORS else "sad")
    sheet = Lidar.preset(lidar) if lidar in PRESETS else Lidar()
    return dict(_leaves(FieldConfig(kind.of(sheet)).to_json()))


def _leaves(settings: Mapping[str, Any], depth: int = 4) -> Iterator[tuple[str, Any]]:
    """The settings in settings, each by its own name and that of what it is a part of."""
    for name, value in settings.items():
        if not isinstance(value, Mapping) or not depth:
            yield name, value
            continue
        prefix = "" if name == "estimator" else f"{name}."
        yield from ((prefix + inner, leaf) for inner, leaf in _leaves(value, depth - 1))
