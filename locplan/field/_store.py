"""The field store: it reads fields that were computed before, and completes unfinished ones.

Each field is a Zarr group (`locplan.field._zarr`) in the cache folder, named by a digest of all
that decides its values. Chunks are written as they are finished, so that a killed run loses only
those under way. A lock lets only one process at a time compute a field.
"""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from locplan._kernels.arrays import Bools
from locplan._util.checks import shown
from locplan._util.code_digest import code_digest
from locplan._util.files import replacing_folder
from locplan._util.progress import ProgressCallback
from locplan.errors import FieldError, LocplanError
from locplan.field import _cache as cache, _tiles as tiles, _zarr as field_files
from locplan.field._compute import covariance_field
from locplan.field._config import FieldConfig, config_of
from locplan.field._estimator import Estimator, Values
from locplan.field._field import CovarianceField
from locplan.field._settings import is_ours, kinds_of
from locplan.maps import OccupancyGrid, check_grid

DECISIVE = ("format", "engine", "map_digest", "identity")
"""Attributes that decide the values of a field."""
_PATIENCE = 0.3
"""Interval of checks whether another process has finished [s]."""


class CacheWarning(UserWarning):
    """Warning that the cache cannot be used as intended; the result is right all the same."""


def load_or_compute(
    grid: OccupancyGrid,
    config: FieldConfig | Estimator | None = None,
    *,
    points: Bools | None = None,
    cache_dir: str | os.PathLike[str] | None = None,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: ProgressCallback | None = None,
) -> CovarianceField:
    """Read the field of a map from the cache, or compute it and put it there.

    Values in the cache are used again: the chunks that an interrupted run has finished and, where
    another state of the same map was cached, all values that the edit cannot have changed. While
    another process computes the same field, this one waits.

    An estimator of your own is cached, too, whether or not it is registered. Its field is found by
    the settings and a digest of the code: its classes, and the functions and values that they name,
    but not the files that they read, nor what they take from installed libraries. Where there is no
    such digest, as of a lock or an open file, the field is computed and not cached.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    config : FieldConfig or Estimator, optional
        Estimator and lattice; `Sad()` by default.
    points : (h, w) array of bool, optional
        See `covariance_field`. The field has values at these alone, whatever else is cached.
    cache_dir : path, optional
        Cache folder; by default LOCPLAN_CACHE of the environment, or else the user's. It may grow
        to LOCPLAN_CACHE_SIZE (5 GB); the least recently used fields are removed first.
    threads, executor, progress
        See `covariance_field`.

    Raises
    ------
    ConfigError, FieldError
        As for `covariance_field`.

    Warns
    -----
    CacheWarning
        If the cache cannot be written, holds damaged chunks (which are computed anew), or cannot
        know an estimator of your own again.
    """
    check_grid(grid)
    config = config_of(config)
    limit = cache.cache_limit()
    needed, in_part = tiles.needed_points(grid, config, points), points is not None
    about = None
    try:
        about = _about(grid, config, in_part)
    except FieldError as error:
        _warn(f"the field is not cached: {error}")
    if about is None:
        return covariance_field(
            grid, config, points=points, threads=threads, executor=executor, progress=progress
        )
    path = _path(about, cache_dir)
    found = _Found.at(path, about, grid, config, needed)
    if lacking := int(found.lacking.sum()):
        del found  # saves memory on a large map
        with _alone(path, lacking, progress) as writable:
            found = _Found.at(path, about, grid, config, needed)
            if found.complaint:
                _warn(f"{found.complaint}; computed anew")
            _carry_over(found, path, about, grid, config)
            chunks = tiles.finished_chunks(
                found.values, grid, config, threads, executor, progress, needed
            )
            with closing(chunks):
                cached = writable and _attempt(_open, path, about, found, grid, config)
                for chunk in chunks:
                    cached = cached and _attempt(
                        field_files.write_chunks, path, found.values, [chunk]
                    )
        if cached:
            cache.evict(path.parent, limit, path)
    cache.mark_used(path)
    if in_part:
        for array in found.values.values():
            array[~needed] = np.nan
    return CovarianceField.of(found.values, grid, config)


def field_path(
    grid: OccupancyGrid,
    config: FieldConfig,
    cache_dir: str | os.PathLike[str] | None = None,
    *,
    in_part: bool = False,
) -> Path:
    """Path of a field, or of some of its points, in the cache, whether or not it is there.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    config : FieldConfig
        The field's settings.
    cache_dir : path, optional
        See `load_or_compute`.
    in_part : bool, default False
        Whether it is the field of some points alone.

    Raises
    ------
    FieldError
        If the field cannot be cached; see `load_or_compute`.
    """
    return _path(_about(grid, config, in_part), cache_dir)


def _about(grid: OccupancyGrid, config: FieldConfig, in_part: bool) -> dict[str, Any]:
    """Attributes of a cached field; a FieldError if nothing can say what decides its values."""
    identity, estimator = {"points": "some"} if in_part else {}, config.estimator
    try:
        if not is_ours(estimator):
            identity["code"] = code_digest(estimator, kinds_of(estimator))
        about = field_files.attributes(grid, config, **identity)
        json.dumps(about)
    except (LocplanError, TypeError, ValueError) as error:  # the others are of JSON
        raise FieldError(f"estimator {shown(estimator.name)}: {error}") from None
    return about


def _path(about: dict[str, Any], cache_dir: str | os.PathLike[str] | None) -> Path:
    decisive = [about[name] for name in DECISIVE]
    key = hashlib.sha256(json.dumps(decisive, sort_keys=True).encode()).hexdigest()[:32]
    return cache.cache_folder(cache_dir) / (key + field_files.FIELD_SUFFIX)


@dataclass(frozen=True)
class _Found:
    """The part of a field that the cache holds."""

    values: Values
    """Arrays of the field, NaN where they are not known."""
    lacking: Bools
    """Lattice points that are needed and still to be computed, (h, w)."""
    sound: bool
    """True if there is a group that chunks can be written to."""
    complaint: str
    """Damage that was found, or an empty text."""

    @classmethod
    def at(
        cls,
        path: Path,
        expected: dict[str, Any],
        grid: OccupancyGrid,
        config: FieldConfig,
        needed: Bools,
    ) -> _Found:
        """Read what a path holds, if it is the field of the attributes expected."""
        values, complaint, sound = None, "", False
        if os.path.exists(path):  # False, too, where the folder cannot be searched
            try:
                about = field_files.read_attributes(path)
                if any(about.get(name) != expected[name] for name in DECISIVE):
                    raise FieldError(f"{path}: holds another field")
                values, damaged = field_files.read_values(path, grid, config)
                # Whatever stands in place of a damaged chunk goes with the group.
                sound = not damaged and field_files.has_todays_chunks(path, grid, config)
                if damaged:
                    complaint = f"{path}: damaged chunks: {damaged}"
            except FieldError as error:
                complaint = str(error)
        if values is None:
            values = tiles.nothing_known(grid, config)
        lacking = needed & ~tiles.known_points(values)
        return cls(values, lacking, sound, complaint)


@contextmanager
def _alone(path: Path, lacking: int, progress: ProgressCallback | None) -> Iterator[bool]:
    """Keep other processes from computing this field; yield whether it can be cached at all."""
    from filelock import Timeout

    lock = None
    try:
        lock = cache.lock_of(path)
        while not lock.is_locked:
            try:
                lock.acquire(timeout=_PATIENCE)
            except Timeout:
                if progress:
                    progress(int(lacking * (cache.CacheEntry.read(path).share or 0.0)), lacking)
    except (OSError, NotImplementedError) as error:  # the latter where a file system has no locks
        lock = None
        _warn(f"the field is not cached: {path.parent} cannot be written ({_reason(error)})")
    try:
        yield lock is not None
    finally:
        if lock:
            lock.release()


def _carry_over(
    found: _Found, path: Path, about: dict[str, Any], grid: OccupancyGrid, config: FieldConfig
) -> None:
    """Fill in the values that other cached fields of this map, or of another state of it, share."""
    expected = _kind(about)
    looked_at = 0
    for folder in cache.fields(path.parent):
        lacking = found.lacking & ~tiles.known_points(found.values)
        if looked_at == 3 or not lacking.any():
            break
        with suppress(FieldError):  # damaged ones are skipped: this is only a shortcut
            other = field_files.read_attributes(folder)
            if folder == path or _kind(other) != expected:
                continue
            looked_at += 1
            before = field_files.read_grid(folder, other)
            useful = lacking & tiles.untouched_points(before, grid, config)
            if useful.any():
                known, _ = field_files.read_values(folder, grid, config)
                for name, array in known.items():
                    found.values[name][useful] = array[useful]


def _kind(about: dict[str, Any]) -> dict[str, Any]:
    """The attributes that fields must share for values of one to be values of the other."""
    names = ("format", "engine", "map_shape", "resolution", "origin")
    identity = {name: value for name, value in about["identity"].items() if name != "points"}
    return {**{name: about.get(name) for name in names}, "identity": identity}


def _open(
    path: Path, about: dict[str, Any], found: _Found, grid: OccupancyGrid, config: FieldConfig
) -> None:
    """Make the field's group if there is no sound one, and write the chunks carried over."""
    known, edge = tiles.known_points(found.values), tiles.chunk_edge(config, grid.resolution)
    if not (found.sound and field_files.takes_chunks(path, found.values)):
        with replacing_folder(path, field_files.FIELD_SUFFIX, lambda _: True) as temporary:
            field_files.create(temporary, grid, config, about)
            # All that is known goes along, since the group that held it may be replaced.
            field_files.write_chunks(temporary, found.values, [*tiles.chunks_of(known, edge)])
        return
    for partial in path.rglob("*.partial"):  # left by a process that was killed while it wrote
        partial.unlink()
    lacking = found.lacking & ~known
    carried = tiles.chunks_of(found.lacking & known, edge)
    whole = [chunk for chunk in carried if not lacking[chunk.at].any()]
    field_files.write_chunks(path, found.values, whole)


def _attempt(action: Callable[..., None], path: Path, *arguments: Any) -> bool:
    """Run an action on the cache; return whether it worked, and warn the user if not."""
    try:
        action(path, *arguments)
    except Exception as error:  # a description damaged meanwhile fails in many ways, too
        _warn(f"the field is not cached in {path.parent}: {_reason(error)}")
        return False
    return True


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def _warn(message: str) -> None:
    warnings.warn(CacheWarning(message), stacklevel=4)
