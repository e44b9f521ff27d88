"""Covariance fields computed anew, or read from the store, which completes unfinished ones.

Each field in the store is a Zarr group (`locplan.field._zarr`) in the cache folder, named by a
digest of all that decides its values. Chunks are written as they are finished, so that a killed run
loses only those under way. A lock lets only one process at a time compute a field.
"""

from __future__ import annotations

import logging
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
from locplan._util.output import replacing_folder
from locplan._util.progress import ProgressCallback
from locplan.errors import FieldError
from locplan.field import _cache as cache, _tiles as tiles, _zarr as field_files
from locplan.field._compute import finished_chunks
from locplan.field._config import FieldConfig, config_of
from locplan.field._estimator import Estimator, Values, is_ours
from locplan.field._field import CovarianceField
from locplan.maps import OccupancyGrid, check_grid

LOG = logging.getLogger(__name__)
_PATIENCE = 0.3
"""Interval of checks whether another process has finished [s]."""


class CacheWarning(UserWarning):
    """Warning that the cache cannot be used as intended; the result is right all the same."""


def covariance_field(
    grid: OccupancyGrid,
    config: FieldConfig | Estimator | None = None,
    *,
    points: Bools | None = None,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: ProgressCallback | None = None,
) -> CovarianceField:
    """Compute the covariance of a pose match over the free cells of a map.

    It is evaluated on every lattice point (`config.stride` apart) in a free cell. A free cell
    without such a point around it adds its nearest lattice point.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    config : FieldConfig or Estimator, optional
        Estimator and lattice; `Sad()` by default.
    points : (h, w) array of bool, optional
        Lattice points to evaluate, by default all: point (i, j) is cell (i, j) times the stride.
        The others are read from those around them. A few points take a fraction of the time.
    threads : int, optional
        Number of threads, >= 1; all cores by default. The result does not depend on it.
    executor : concurrent.futures.Executor, optional
        Executor that runs the tiles instead of threads: a process pool, or a cluster by
        dask.distributed's ``client.get_executor()``. Its workers need locplan.
    progress : callable, optional
        Function that is called with (done, total) cells from time to time.

    Raises
    ------
    ConfigError
        If the config does not fit the map's resolution, `points` is no mask of the lattice, or
        `threads` is below 1.
    FieldError
        If the executor fails, or the estimator's values are no covariances or change with the map
        beyond its halo, see `locplan.field.Estimator.covariances`.

    Examples
    --------
    >>> import numpy as np
    >>> from locplan.field import Sad
    >>> from locplan.maps import FREE
    >>> grid = OccupancyGrid(np.full((30, 30), FREE), resolution=0.1)
    >>> field = covariance_field(grid, Sad(range=0.5))
    >>> field.covariance.shape
    (15, 15, 3, 3)
    """
    check_grid(grid)
    config = config_of(config)
    values = tiles.nothing_known(grid, config)
    needed = tiles.needed_points(grid, config, points)
    for _ in finished_chunks(values, grid, config, threads, executor, progress, needed):
        pass
    return CovarianceField.of(values, grid, config)


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
        If the cache cannot be written, holds damaged chunks (which are computed anew), or the
        caller's estimator declares no version.
    """
    check_grid(grid)
    config = config_of(config)
    limit = cache.cache_limit()
    needed, in_part = tiles.needed_points(grid, config, points), points is not None
    about = None
    try:
        about = field_files.cached_attributes(grid, config, in_part)
    except FieldError as error:
        _warn(f"the field is not cached: {error}")
    if about is None:
        return covariance_field(
            grid, config, points=points, threads=threads, executor=executor, progress=progress
        )
    path = cache.cache_folder(cache_dir) / field_files.name_of(about)
    found = _Found.at(path, about, grid, config, needed)
    if not is_ours(config.estimator) and not found.lacking.any():
        version = about["identity"]["version"]
        LOG.warning("field of %s: cached, version %s", grid.name, version)
    if lacking := int(found.lacking.sum()):
        del found  # saves memory on a large map
        with _alone(path, lacking, progress) as writable:
            found = _Found.at(path, about, grid, config, needed)
            if found.complaint:
                _warn(f"{found.complaint}; computed anew")
            found.carry_over()
            chunks = finished_chunks(
                found.values, grid, config, threads, executor, progress, needed
            )
            with closing(chunks):
                cached = writable and _attempt(path, found.open)
                for chunk in chunks:
                    cached = cached and _attempt(
                        path, field_files.write_chunks, path, found.values, [chunk]
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
    about = field_files.cached_attributes(grid, config, in_part)
    return cache.cache_folder(cache_dir) / field_files.name_of(about)


@dataclass(frozen=True)
class _Found:
    """The part of a field that the cache holds."""

    path: Path
    """Path of the field."""
    about: dict[str, Any]
    """Attributes of the field."""
    grid: OccupancyGrid
    """The map."""
    config: FieldConfig
    """The settings."""
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
        about: dict[str, Any],
        grid: OccupancyGrid,
        config: FieldConfig,
        needed: Bools,
    ) -> _Found:
        """Read what a path holds, if it is the field of these attributes."""
        values, complaint, sound = None, "", False
        if os.path.exists(path):  # False, too, where the folder cannot be searched
            try:
                held = field_files.read_attributes(path)
                if any(held.get(name) != about[name] for name in field_files.DECISIVE):
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
        return cls(path, about, grid, config, values, lacking, sound, complaint)

    def carry_over(self) -> None:
        """Fill in the values that other fields of this map, or another state of it, share."""
        expected, looked_at = field_files.kind_of(self.about), 0
        for folder in cache.fields(self.path.parent):
            lacking = self.lacking & ~tiles.known_points(self.values)
            if looked_at == 3 or not lacking.any():
                break
            with suppress(FieldError):  # damaged ones are skipped: this is only a shortcut
                other = field_files.read_attributes(folder)
                if folder == self.path or field_files.kind_of(other) != expected:
                    continue
                looked_at += 1
                before = field_files.read_grid(folder, other)
                useful = lacking & tiles.untouched_points(before, self.grid, self.config)
                if useful.any():
                    known, _ = field_files.read_values(folder, self.grid, self.config)
                    for name, array in known.items():
                        self.values[name][useful] = array[useful]

    def open(self) -> None:
        """Write the chunks carried over, to a new group if there is no sound one."""
        if self.sound:
            for partial in self.path.rglob("*.partial"):  # of a process killed while it wrote
                partial.unlink()
            known, cell = tiles.known_points(self.values), self.grid.resolution
            lacking, edge = self.lacking & ~known, tiles.chunk_edge(self.config, cell)
            carried = tiles.chunks_of(self.lacking & known, edge)
            whole = [chunk for chunk in carried if not lacking[chunk].any()]
            try:
                return field_files.write_chunks(self.path, self.values, whole)
            except Exception as error:  # damaged descriptions of arrays fail in many ways
                if isinstance(error, OSError):
                    raise
        with replacing_folder(self.path, field_files.FIELD_SUFFIX, lambda _: True) as temporary:
            # All that is known goes along, since the group that held it may be replaced.
            field_files.write(temporary, self.values, self.grid, self.config, self.about)


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


def _attempt(path: Path, action: Callable[..., None], *arguments: Any) -> bool:
    """Run an action on a cached field; return whether it worked, and warn the user if not."""
    try:
        action(*arguments)
    except Exception as error:  # a description damaged meanwhile fails in many ways, too
        _warn(f"the field is not cached in {path.parent}: {_reason(error)}")
        return False
    return True


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def _warn(message: str) -> None:
    warnings.warn(CacheWarning(message), stacklevel=4)
