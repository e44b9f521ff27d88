"""Computing a field tile by tile: in threads, in processes, or on a cluster."""

from __future__ import annotations

import os
from collections.abc import Generator, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan.config import FieldConfig
from locplan.covariance import rotated
from locplan.errors import ConfigError, FieldError, LocplanError
from locplan.estimators import sad
from locplan.grid import OccupancyGrid
from locplan.lattice import evaluated_points, stride_cells
from locplan.progress import ProgressCallback
from locplan.search_window import SearchWindow

ENGINE = 1
"""Raised whenever the same map and config would give other values than before."""
TILE = 64
"""Edge of a tile, whose covariances share one layout of the map [lattice points]."""
TILE_CELLS = 512
"""And at most so many cells, which bounds the layout's memory."""
IN_FLIGHT = 256
"""Tiles that are given to an executor at once at most, which bounds the memory of their maps."""


class Chunk(NamedTuple):
    """A rectangle of the lattice."""

    top: int
    left: int
    bottom: int
    right: int

    @property
    def at(self) -> tuple[slice, slice]:
        """Its place in an array over the lattice."""
        return slice(self.top, self.bottom), slice(self.left, self.right)


_Points = tuple[NDArray[np.intp], NDArray[np.intp]]
_Tile = Future[NDArray[np.float64]]


def field_shape(grid: OccupancyGrid, config: FieldConfig) -> tuple[int, int, int, int]:
    """Of the array of covariances: lattice rows and columns, and the poses' dimension twice."""
    stride = stride_cells(config, grid.resolution)
    rows, cols = (-(-size // stride) for size in grid.shape)
    dimension = SearchWindow.from_config(config, grid.resolution).dimension
    return rows, cols, dimension, dimension


def missing_points(
    covariance: NDArray[np.float64], grid: OccupancyGrid, config: FieldConfig
) -> NDArray[np.bool_]:
    """Lattice points that a field needs and an array of covariances does not hold, (h, w)."""
    wanted = evaluated_points(grid.free, stride_cells(config, grid.resolution))
    return wanted & np.isnan(covariance[:, :, 0, 0])


def complete(
    covariance: NDArray[np.float64],
    grid: OccupancyGrid,
    config: FieldConfig,
    threads: int | None,
    executor: Executor | None,
    progress: ProgressCallback | None,
) -> None:
    """`finished_chunks` to the end, for whoever does not mind the chunks."""
    for _ in finished_chunks(covariance, grid, config, threads, executor, progress):
        pass


def finished_chunks(
    covariance: NDArray[np.float64],
    grid: OccupancyGrid,
    config: FieldConfig,
    threads: int | None,
    executor: Executor | None,
    progress: ProgressCallback | None,
) -> Generator[Chunk]:
    """Compute the covariances that are missing, and name each chunk as it is finished.

    The values depend neither on the tiles nor on where they are computed. Own threads count their
    cells as they go and stop at once when the caller does; an executor finishes the tiles that it
    has begun.

    Parameters
    ----------
    covariance : (h, w, d, d) array of float64
        In the world frame, NaN where unknown; filled in place.
    grid, config, threads, executor, progress
        As for `locplan.covariance_field`.

    Yields
    ------
    Chunk
        `chunk_edge` lattice points along each axis, less at the edges.

    Raises
    ------
    FieldError
        If the executor fails.
    """
    if threads is not None and threads < 1:
        raise ConfigError(f"threads must be at least 1, not {threads}")
    missing = missing_points(covariance, grid, config)
    total, finished, yaw = int(missing.sum()), 0, grid.origin[2]
    if not total:
        return
    running: dict[_Tile, tuple[Chunk, _Points, NDArray[np.int64]]] = {}
    done: SimpleQueue[_Tile] = SimpleQueue()
    pending: dict[Chunk, int] = {}
    waiting = _tiles(missing, pending, config, grid.resolution)
    pool = executor or ThreadPoolExecutor(threads or os.cpu_count())
    try:
        while True:
            for chunk, points in islice(waiting, IN_FLIGHT - len(running)):
                task, control = _task(grid, config, points), np.zeros(2, np.int64)
                if executor is None:
                    task["control"] = control
                with _told_in_short(executor):
                    tile = pool.submit(compute, ENGINE, **task)
                running[tile] = chunk, points, control
                tile.add_done_callback(done.put)
            if not running:
                break
            ready = _next(done)
            if ready:
                chunk, points, _ = running.pop(ready)
                with _told_in_short(executor):
                    values = ready.result()
                covariance[points] = rotated(values, yaw) if yaw else values
                finished += len(points[0])
                pending[chunk] -= 1
                if not pending[chunk]:
                    yield chunk
            if progress:
                progress(finished + sum(int(c[1]) for *_, c in running.values()), total)
    finally:
        for tile, (*_, control) in running.items():
            tile.cancel()
            control[0] = 1
        if executor is None:
            pool.shutdown(cancel_futures=True)


def compute(engine: int, **task: Any) -> NDArray[np.float64]:
    """Covariances of a tile, wherever that is run, if it is the same engine there.

    Raises
    ------
    FieldError
        If it is another one.
    """
    if engine != ENGINE:
        raise FieldError(
            f"a worker has another locplan (engine {ENGINE}, not {engine}); install the same one"
        )
    return sad.covariances(**task)


def chunk_edge(config: FieldConfig, resolution: float) -> int:
    """Edge of the square chunks that are finished as a whole [lattice points]."""
    edge, apart = _tile_edge(config, resolution)
    return edge * apart


def chunks_of(points: NDArray[np.bool_], edge: int) -> Iterator[Chunk]:
    """Chunks with any of the points, row by row."""
    height, width = points.shape
    for top in range(0, height, edge):
        for left in range(0, width, edge):
            chunk = Chunk(top, left, min(top + edge, height), min(left + edge, width))
            if points[chunk.at].any():
                yield chunk


def untouched_points(
    before: OccupancyGrid, after: OccupancyGrid, config: FieldConfig
) -> NDArray[np.bool_]:
    """Lattice points that two maps have in common, and whose covariances are the same, (h, w).

    Raises
    ------
    FieldError
        If the maps differ in more than their cells.
    """
    import cv2

    for name in ("shape", "resolution", "origin"):
        if getattr(before, name) != getattr(after, name):
            raise FieldError(
                f"the field's map has {name} {getattr(before, name)}, but the new one"
                f" {getattr(after, name)}; compute a field of its own for it"
            )
    stride = stride_cells(config, after.resolution)
    changed = (before.cells != after.cells).astype(np.uint8)
    box = [2 * sad.halo(config, after.resolution, after.shape) + 1] * 2
    near = cv2.boxFilter(changed, cv2.CV_32S, box, normalize=False, borderType=cv2.BORDER_CONSTANT)
    return (near[::stride, ::stride] == 0) & evaluated_points(after.free, stride)


def _tile_edge(config: FieldConfig, resolution: float) -> tuple[int, int]:
    """Edge of a tile [lattice points], and how many lattice points apart its own are."""
    stride = stride_cells(config, resolution)
    apart = sad.points_apart(config, resolution, stride)
    return min(TILE, max(1, TILE_CELLS // (stride * apart))), apart


def _tiles(
    points: NDArray[np.bool_], pending: dict[Chunk, int], config: FieldConfig, resolution: float
) -> Iterator[tuple[Chunk, _Points]]:
    """Each tile's chunk and its lattice points; counts every chunk's tiles in `pending`."""
    edge, apart = _tile_edge(config, resolution)
    for chunk in chunks_of(points, edge * apart):
        tiles = []
        for row in range(apart):
            for col in range(apart):
                i, j = np.nonzero(points[chunk.at][row::apart, col::apart])
                if i.size:
                    tiles.append((i * apart + row + chunk.top, j * apart + col + chunk.left))
        pending[chunk] = len(tiles)
        for tile in tiles:
            yield chunk, tile


def _task(grid: OccupancyGrid, config: FieldConfig, points: _Points) -> dict[str, Any]:
    """Arguments of the estimator, with the part of the map that these points depend on."""
    rows, cols = (index * stride_cells(config, grid.resolution) for index in points)
    reach = sad.halo(config, grid.resolution, grid.shape)
    top, left = max(0, int(rows.min()) - reach), max(0, int(cols.min()) - reach)
    bottom, right = int(rows.max()) + reach + 1, int(cols.max()) + reach + 1
    return {
        "levels": grid.cells[top:bottom, left:right],
        "rows": rows,
        "cols": cols,
        "resolution": grid.resolution,
        "config": config,
        "corner": (top, left),
        "map_shape": grid.shape,
    }


def _next(done: SimpleQueue[_Tile]) -> _Tile | None:
    """A finished tile, or None if there is none for a while."""
    try:
        return done.get(timeout=0.2)
    except Empty:
        return None


@contextmanager
def _told_in_short(executor: Executor | None) -> Iterator[None]:
    """What befalls a foreign executor is an error of one line."""
    try:
        yield
    except LocplanError:
        raise
    except Exception as error:  # each executor has its own for workers that died
        if executor is None:
            raise
        what = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(": ")[:200]
        raise FieldError(f"the executor failed at a tile of the field ({what})") from error
