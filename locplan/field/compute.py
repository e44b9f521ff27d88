"""Computation of a field tile by tile: in threads, or by any executor of concurrent.futures."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import check_threads, get_usable_memory
from locplan._support.kernels.arrays import Bools
from locplan._support.progress import ProgressCallback
from locplan.errors import FieldError, LocplanError
from locplan.field import tiles
from locplan.field.config import FieldConfig
from locplan.field.covariance import check_halo, check_values, read_halo, rotate_covariance
from locplan.field.estimator import Estimator, MapPart, Values, is_from_locplan
from locplan.field.tiles import Chunk, compute_chunk_edge, find_computed_points, iterate_chunks
from locplan.maps.grid import OccupancyGrid

_Points = tuple[NDArray[np.intp], NDArray[np.intp]]


def find_lidar_cells(
    free: Bools, rows: NDArray[np.intp], cols: NDArray[np.intp], reach: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return cells to put a lidar on: each cell, or the nearest free one within `reach` cells.

    A lattice point in a wall serves free cells next to it; a lidar inside the wall sees nothing.
    """
    rows, cols = rows.copy(), cols.copy()
    for n in np.flatnonzero(~free[rows, cols]):
        row, col = int(rows[n]), int(cols[n])
        top, left = max(row - reach, 0), max(col - reach, 0)
        around = np.argwhere(free[top : row + reach + 1, left : col + reach + 1])
        if len(around):
            # Of those that are as near, the first has the lowest row, and then column.
            nearest = ((around + np.array((top - row, left - col))) ** 2).sum(axis=1).argmin()
            rows[n], cols[n] = around[nearest] + (top, left)
    return rows, cols


def compute_missing_chunks(
    values: Values,
    grid: OccupancyGrid,
    config: FieldConfig,
    threads: int | None,
    executor: Executor | None,
    progress: ProgressCallback | None,
    required: Bools,
) -> Generator[Chunk]:
    """Compute the missing values, and yield each chunk of the lattice when it is finished.

    For all further parameters see `covariance_field`.

    Parameters
    ----------
    values : mapping of str to array
        Values by name on the lattice, (h, w, ...); NaN is replaced in place.
    required : (h, w) bool array
        Lattice points that are computed.
    """
    missing = required & ~find_computed_points(values)
    with closing(compute_chunks(missing, grid, config, threads, executor, progress)) as chunks:
        for chunk, points, computed in chunks:
            for name, array in computed.items():
                values[name][points] = array
            yield chunk


def compute_chunks(
    missing: Bools,
    grid: OccupancyGrid,
    config: FieldConfig,
    threads: int | None,
    executor: Executor | None = None,
    progress: ProgressCallback | None = None,
) -> Generator[tuple[Chunk, _Points, Values]]:
    """Yield the chunks of the missing lattice points (h, w), with the points and their values.

    The values depend neither on the chunks nor on the executor. Threads of this process count their
    cells as they go and stop at once when the caller does; an executor finishes the tiles that it
    has begun. Covariances are in the world frame.
    """
    threads = check_threads(threads)
    total, finished, yaw = int(missing.sum()), 0, grid.origin[2]
    estimator = config.estimator
    if not total:
        return
    tiles.check_tile_memory(grid, config)
    running: dict[Future[Values], tuple[Chunk, _Points, MapPart]] = {}
    waiting = iterate_chunks(missing, compute_chunk_edge(config, grid.resolution))
    # Threads of this process share what the estimator prepares from the whole map.
    prepared = None if executor else estimator.prepare(grid.cells, grid.resolution)
    tile_memory = estimator.memory(grid.resolution, grid.shape) if prepared is None else 0.0
    workers = max(1, int(min(threads, get_usable_memory() / 2 // max(1.0, tile_memory))))
    pool = executor or ThreadPoolExecutor(workers)
    try:
        while True:
            # So many at once bound the memory of their maps.
            for chunk in islice(waiting, 256 - len(running)):
                i, j = np.nonzero(missing[chunk])
                points = i + chunk[0].start, j + chunk[1].start
                part = make_map_part(grid, config, points, prepared)
                with _translate_executor_errors(executor):
                    tile = pool.submit(compute_tile, tiles.ENGINE, estimator, part)
                running[tile] = chunk, points, part
            if not running:
                break
            wait(running, 0.2, FIRST_COMPLETED)
            for ready in [*filter(Future.done, running)]:  # in the map's order
                chunk, points, part = running.pop(ready)
                with _translate_executor_errors(executor):
                    computed = ready.result()
                check_values(computed, estimator, part)
                # The first tile alone shows whether the halo of a user's estimator suffices.
                if not (finished or is_from_locplan(estimator)):
                    check_halo(estimator, part, computed, grid.cells)
                computed["covariance"] = rotate_covariance(computed["covariance"], yaw)
                finished += len(points[0])
                yield chunk, points, computed
            if progress:
                n_started = sum(int(part.control[1]) for *_, part in running.values())
                progress(finished + n_started, total)
    finally:
        for tile, (*_, part) in running.items():
            tile.cancel()
            part.control[0] = 1
        if executor is None:
            pool.shutdown(cancel_futures=True)


def compute_tile(engine: int, estimator: Estimator, part: MapPart) -> Values:
    """Compute the values of a tile, on a worker that must have the same engine."""
    if engine != tiles.ENGINE:
        engine_text = f"engine {tiles.ENGINE}, not {engine}"
        raise FieldError(
            f"a worker has another version of locplan ({engine_text}); install the same one"
        )
    return estimator.covariances(part)


def make_map_part(
    grid: OccupancyGrid, config: FieldConfig, points: _Points, prepared: object
) -> MapPart:
    """Return some lattice points with the prepared data, or with the part of the map that they
    need.
    """
    stride = config.stride_cells(grid.resolution)
    rows, cols = (index * stride for index in points)
    if config.estimator.casts_rays:
        rows, cols = find_lidar_cells(grid.free, rows, cols, stride)
    levels, top, left = grid.cells, 0, 0
    if prepared is None:
        reach = read_halo(config.estimator, grid.resolution, grid.shape)
        top, left = max(0, int(rows.min()) - reach), max(0, int(cols.min()) - reach)
        levels = levels[top : int(rows.max()) + reach + 1, left : int(cols.max()) + reach + 1]
    headings, at = config.heading_angles - grid.origin[2], (top, left)
    return MapPart(levels, rows, cols, grid.resolution, grid.shape, at, headings, prepared)


@contextmanager
def _translate_executor_errors(executor: Executor | None) -> Iterator[None]:
    """Turn any failure of a user's executor into an error of one line."""
    try:
        yield
    except LocplanError:
        raise
    except Exception as error:  # each executor has its own error for dead workers
        if executor is None:
            raise
        reason = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(": ")[:200]
        raise FieldError(f"the executor failed at a tile of the field ({reason})") from error
