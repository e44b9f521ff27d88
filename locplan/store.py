"""The field cache: a field that was computed once is read, not computed again."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import warnings
from pathlib import Path

from locplan.config import FieldConfig
from locplan.errors import FieldError, LocplanError
from locplan.field import FORMAT, CovarianceField, covariance_field
from locplan.grid import OccupancyGrid
from locplan.progress import ProgressCallback

ENGINE = 1
"""Raised whenever the same map and config would give other values than before."""


class CacheWarning(UserWarning):
    """The cache cannot be used; the result is right all the same."""


def load_or_compute(
    grid: OccupancyGrid,
    config: FieldConfig | None = None,
    *,
    cache_dir: str | os.PathLike[str] | None = None,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> CovarianceField:
    """The field of a map from the cache, or computed and put there.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    config : FieldConfig, optional
        `FieldConfig()` by default.
    cache_dir : path, optional
        By default the environment variable LOCPLAN_CACHE, or else the user's cache folder.
    threads, progress
        As for `covariance_field`.

    Warns
    -----
    CacheWarning
        If the cache cannot be written, or holds a damaged field (which is computed anew).
    """
    config = config or FieldConfig()
    path = field_path(grid, config, cache_dir)
    if os.path.exists(path):  # False, too, where the folder cannot be searched
        try:
            field = CovarianceField.load(path)
            return dataclasses.replace(field, grid=grid)
        except FieldError as error:
            message = str(error).replace("compute it anew", "computed anew")
            warnings.warn(CacheWarning(message), stacklevel=2)
    field = covariance_field(grid, config, threads=threads, progress=progress)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        field.save(path)
    except (OSError, LocplanError) as error:
        warnings.warn(CacheWarning(f"the field is not cached: {error}"), stacklevel=2)
    return field


def field_path(
    grid: OccupancyGrid, config: FieldConfig, cache_dir: str | os.PathLike[str] | None = None
) -> Path:
    """Where the cache holds this field, whether or not it is there."""
    key = json.dumps([FORMAT, ENGINE, grid.digest, dataclasses.asdict(config)], sort_keys=True)
    return cache_folder(cache_dir) / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.npz"


def cache_folder(cache_dir: str | os.PathLike[str] | None = None) -> Path:
    """The folder of cached fields: the argument, LOCPLAN_CACHE, or the user's cache folder."""
    from platformdirs import user_cache_path

    chosen = cache_dir or os.environ.get("LOCPLAN_CACHE")
    return Path(os.path.expanduser(chosen)) if chosen else user_cache_path("locplan") / "fields"
