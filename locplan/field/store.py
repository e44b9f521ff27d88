"""Covariance fields, computed or read from the cache, with resumption of unfinished ones.

A field in the cache is one file (`locplan.field.files`). A long computation writes finished parts
next to it every few seconds, so that a killed run loses only the last seconds.
"""

from __future__ import annotations

import logging
import os
import time
import warnings
from collections.abc import Iterable
from concurrent.futures import Executor
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from locplan._support.files import make_folder
from locplan._support.kernels.arrays import Bools
from locplan._support.progress import ProgressCallback
from locplan.errors import FieldError, LocplanError
from locplan.field import files, tiles
from locplan.field.cache import (
    RESULT,
    CacheWarning,
    cache_folder,
    list_cache_entries,
    load_or_compute_result,
)
from locplan.field.compute import compute_missing_chunks
from locplan.field.config import FieldConfig, config_from_settings
from locplan.field.estimator import Estimator, Values
from locplan.field.field import CovarianceField
from locplan.maps.grid import OccupancyGrid, check_grid

LOG = logging.getLogger(__name__)
PART_SECONDS = 2.0
"""Interval after which finished values are written as a part [s]."""


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
        All further points are interpolated from their neighbours. A few points take a fraction of
        the time.
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
    config = config_from_settings(config)
    values = tiles.make_empty_values(grid, config)
    required = tiles.find_required_points(grid, config, points)
    for _ in compute_missing_chunks(values, grid, config, threads, executor, progress, required):
        pass
    return CovarianceField.from_values(values, grid, config)


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

    Values in the cache are used again: the parts that an interrupted run has finished and, if
    another state of the same map was cached, all values that the edit cannot have changed. While
    another process computes the same field, this one waits.

    The field of a user's estimator is cached if the class declares a `version`.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    config : FieldConfig or Estimator, optional
        Estimator and lattice; `Sad()` by default.
    points : (h, w) array of bool, optional
        See `covariance_field`. The field has values only at these points, even if more are cached.
    cache_dir : path, optional
        Cache folder; by default the environment's LOCPLAN_CACHE, or without it the user's. It may
        grow to LOCPLAN_CACHE_SIZE (5 GB); the least recently used fields are removed first.
    threads, executor, progress
        See `covariance_field`.

    Raises
    ------
    ConfigError, FieldError
        As for `covariance_field`.

    Warns
    -----
    CacheWarning
        If the caller's estimator declares no version.
    """
    check_grid(grid)
    config = config_from_settings(config)
    required = None if points is None else tiles.find_required_points(grid, config, points)
    try:
        metadata = files.make_metadata(grid, config, cached=True)
    except FieldError as error:
        warnings.warn(CacheWarning(f"the field is not cached: {error}"), stacklevel=2)
        return covariance_field(
            grid, config, points=points, threads=threads, executor=executor, progress=progress
        )
    field = _CachedField(grid, config, metadata, required)

    def compute(parts: Path | None) -> Values:
        values, due = field.load_cached_values(path, parts)
        chunks = compute_missing_chunks(values, grid, config, threads, executor, progress, due)
        with closing(chunks):
            field.write_parts(chunks, values, parts)
        return values

    key = files.compute_cache_key(metadata)
    path = cache_folder(cache_dir) / f"{key}{RESULT}"
    values = load_or_compute_result(
        key,
        field.load,
        compute,
        field.save,
        cache_dir=cache_dir,
        on_waiting=(lambda parts: field.report(parts, progress)) if progress else None,
    )
    if required is not None:
        for array in values.values():
            array[~required] = np.nan
    return CovarianceField.from_values(values, grid, config)


def field_path(
    grid: OccupancyGrid,
    config: FieldConfig,
    cache_dir: str | os.PathLike[str] | None = None,
) -> Path:
    """Return the path of a field in the cache, whether or not it exists.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    config : FieldConfig
        The field's settings.
    cache_dir : path, optional
        See `load_or_compute`.

    Raises
    ------
    FieldError
        If the field cannot be cached; see `load_or_compute`.
    """
    key = files.compute_cache_key(files.make_metadata(grid, config, cached=True))
    return cache_folder(cache_dir) / f"{key}{RESULT}"


@dataclass(frozen=True)
class _CachedField:
    """A field in the cache, with all or some of its points."""

    grid: OccupancyGrid
    """The map."""
    config: FieldConfig
    """The settings."""
    metadata: dict[str, Any]
    """Description of the field."""
    required: Bools | None
    """Lattice points that are needed, (h, w); None for all."""

    @cached_property
    def all_points(self) -> Bools:
        """Lattice points of the whole field, (h, w)."""
        return self.config.lattice_points(self.grid)

    def load(self, path: Path) -> Values | None:
        """Read the field from its file; None if points are lacking."""
        metadata = self._read_matching_metadata(path)
        if self.required is None and metadata.get("finished_share") != 1.0:
            return None  # some points only
        values = files.read_values(path, self.grid, self.config)
        if (
            self.required is not None
            and (self.required & ~tiles.find_computed_points(values)).any()
        ):
            return None
        if versions := self.metadata["identity"]["versions"]:
            LOG.info("field of %s: cached, version %s", self.grid.name, ", ".join(versions))
        return values

    def save(self, path: Path, values: Values) -> None:
        """Write all known values to the field's file."""
        is_computed = tiles.find_computed_points(values)
        files.write_points(
            path, values, is_computed, self._metadata_with_share(is_computed), self.grid.cells
        )

    def load_cached_values(self, path: Path, parts: Path | None) -> tuple[Values, Bools]:
        """Return the cached values of the field, NaN at missing points, and the points to compute.

        They come from the field's file and parts, and from the fields of earlier states of the map
        as far as the edits cannot have changed them.
        """
        values = tiles.make_empty_values(self.grid, self.config)
        due = self.all_points if self.required is None else self.required
        for file in (path, *sorted(parts.glob(f"*{RESULT}") if parts else ())):
            with suppress(LocplanError):
                self._read_matching_metadata(file)
                files.fill_values_from_file(values, file, self.grid, self.config, self.all_points)
        same = 0
        for cached_result in list_cache_entries(path.parent):
            lacking = due & ~tiles.find_computed_points(values)
            if same == 3 or not lacking.any():
                break
            if cached_result.path == path or not all(
                cached_result.metadata.get(name) == self.metadata[name]
                for name in ("kind", *files.MATCHING_KEYS)
            ):
                continue
            with suppress(LocplanError):  # damaged ones are skipped: this is only a shortcut
                same += 1
                before = files.read_grid(cached_result.path, cached_result.metadata)
                useful = lacking & tiles.find_unchanged_points(before, self.grid, self.config)
                if useful.any():
                    files.fill_values_from_file(
                        values, cached_result.path, self.grid, self.config, useful
                    )
        return values, due

    def write_parts(self, chunks: Iterable[object], values: Values, parts: Path | None) -> None:
        """Finish all chunks of the values; every few seconds write the new values as a part."""
        written, last = tiles.find_computed_points(values), time.monotonic()
        for _ in chunks:
            if parts and time.monotonic() - last >= PART_SECONDS:
                is_computed = tiles.find_computed_points(values)
                # A full disk shows again when the whole field is written.
                with suppress(LocplanError):
                    make_folder(parts)
                    file = parts / f"{is_computed.sum():012}{RESULT}"
                    files.write_points(
                        file, values, is_computed & ~written, self._metadata_with_share(is_computed)
                    )
                    written = is_computed
                last = time.monotonic()

    def report(self, parts: Path, progress: ProgressCallback) -> None:
        """Report the progress of another process, from the names of the parts that it wrote."""
        due = int((self.all_points if self.required is None else self.required).sum())
        n_done = 0
        with suppress(OSError, ValueError):  # there are none yet
            n_done = max(int(Path(name).stem) for name in os.listdir(parts))
        progress(min(n_done, due), due)

    def _read_matching_metadata(self, file: Path) -> dict[str, Any]:
        """Read the description in a file; a FieldError if it is not of this field."""
        metadata = files.read_metadata(file)
        if any(metadata.get(name) != self.metadata[name] for name in files.IDENTIFYING_KEYS):
            raise FieldError(f"{file}: holds another field")
        return metadata

    def _metadata_with_share(self, is_computed: Bools) -> dict[str, Any]:
        """Return the description with the share of finished points."""
        total = int(self.all_points.sum())
        return self.metadata | {
            "finished_share": float(is_computed.sum() / total) if total else 1.0
        }
