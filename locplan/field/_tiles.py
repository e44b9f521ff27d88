"""Computing a field tile by tile: in threads, in processes, or on a cluster."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from itertools import islice
from queue import Empty, SimpleQueue
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Bools
from locplan._util.checks import check_memory, check_threads, usable_memory
from locplan._util.progress import ProgressCallback
from locplan.errors import ConfigError, FieldError, LocplanError
from locplan.field._config import FieldConfig
from locplan.field._covariance import check_halo, check_values, halo_of, rotated
from locplan.field._estimator import TILE_CELLS, Estimator, MapPart, Values
from locplan.field._lattice import evaluated_points, standing_cells
from locplan.field._settings import is_ours
from locplan.maps import OccupancyGrid

ENGINE = 4
"""Version of the computation; it grows when the same map and config give other values."""
TILE = 64
"""Maximum edge length of a tile, which is computed and stored as a whole [lattice points]."""


class Chunk(NamedTuple):
    """A rectangle of the lattice."""

    top: int
    left: int
    bottom: int
    right: int

    @property
    def at(self) -> tuple[slice, slice]:
        """Slices of the chunk in an array over the lattice."""
        return slice(self.top, self.bottom), slice(self.left, self.right)


_Points = tuple[NDArray[np.intp], NDArray[np.intp]]
_Tile = Future[Values]


def field_shapes(grid: OccupancyGrid, config: FieldConfig) -> dict[str, tuple[int, ...]]:
    """Shapes of a field's arrays: lattice rows and columns, headings if several, pose axes."""
    stride = config.stride_cells(grid.resolution)
    points = tuple(-(-size // stride) for size in grid.shape)
    places = points if config.headings == 1 else (*points, config.headings)
    dimension = config.estimator.lattice(grid.resolution).dimension
    layers = {layer.name: places for layer in config.estimator.layers}
    return {"covariance": (*places, dimension, dimension), **layers}


def nothing_known(grid: OccupancyGrid, config: FieldConfig) -> Values:
    """Arrays of a field, filled with NaN; a ConfigError if it takes too much memory."""
    check_tiles(grid, config)
    shapes = field_shapes(grid, config)
    total = 8.0 * sum(math.prod(shape) for shape in shapes.values())
    check_memory("the values of the field", total, "set a larger stride or fewer headings")
    return {name: np.full(shape, np.nan) for name, shape in shapes.items()}


def check_tiles(grid: OccupancyGrid, config: FieldConfig) -> None:
    """Raise a ConfigError if a tile takes over 2 GB, which grow with range and window."""
    taken = config.estimator.memory(grid.resolution, grid.shape)
    if taken > 2e9:
        lattice = config.estimator.lattice(grid.resolution)
        raise ConfigError(
            f"cells of {grid.resolution:g} m are too fine for a range of"
            f" {config.estimator.reach:g} m and a search window of"
            f" +-{lattice.reach * lattice.resolution:g} m ({taken / 1e9:.3g} GB of memory); set"
            " smaller ones, or scale the map down"
        )


def known_points(values: Values) -> Bools:
    """Mask of the lattice points that hold values, (h, w)."""
    covariance = values["covariance"]
    return ~np.isnan(covariance.reshape(*covariance.shape[:2], -1)[:, :, 0])


def needed_points(grid: OccupancyGrid, config: FieldConfig, points: Bools | None = None) -> Bools:
    """Mask of the lattice points that a field needs, of `points` where only these are asked for.

    Raises
    ------
    ConfigError
        If `points` is not a mask of the lattice.
    """
    needed = config.lattice_points(grid)
    if points is None:
        return needed
    points = np.asarray(points)
    if points.shape != needed.shape or points.dtype != bool:
        raise ConfigError(
            f"points must be an array of bool of the lattice's shape {needed.shape}, not"
            f" {points.dtype} {points.shape}"
        )
    return points & needed


def finished_chunks(
    values: Values,
    grid: OccupancyGrid,
    config: FieldConfig,
    threads: int | None,
    executor: Executor | None,
    progress: ProgressCallback | None,
    needed: Bools,
) -> Generator[Chunk]:
    """Compute the missing values, and yield each chunk of the lattice when it is finished.

    For the other parameters see `covariance_field`.

    Parameters
    ----------
    values : mapping of str to array
        Values by name on the lattice, (h, w, ...), filled in place where they are NaN.
    needed : (h, w) bool array
        Lattice points that are computed.
    """
    missing = needed & ~known_points(values)
    with closing(computed_chunks(missing, grid, config, threads, executor, progress)) as chunks:
        for chunk, points, computed in chunks:
            for name, array in computed.items():
                values[name][points] = array
            yield chunk


def computed_chunks(
    missing: Bools,
    grid: OccupancyGrid,
    config: FieldConfig,
    threads: int | None,
    executor: Executor | None,
    progress: ProgressCallback | None,
) -> Generator[tuple[Chunk, _Points, Values]]:
    """Yield the chunks of the missing lattice points (h, w), with the points and their values.

    The values depend neither on the chunks nor on where they are computed. Threads of this process
    count their cells as they go and stop at once when the caller does; an executor finishes the
    tiles that it has begun. Covariances are in the world frame.
    """
    threads = check_threads(threads)
    total, finished, yaw = int(missing.sum()), 0, grid.origin[2]
    estimator = config.estimator
    if not total:
        return
    running: dict[_Tile, tuple[Chunk, _Points, MapPart]] = {}
    done: SimpleQueue[_Tile] = SimpleQueue()
    waiting = chunks_of(missing, chunk_edge(config, grid.resolution))
    # Threads of this process share what the estimator prepares from the whole map.
    prepared = None if executor else estimator.prepare(grid.cells, grid.resolution)
    taken = estimator.memory(grid.resolution, grid.shape) if prepared is None else 0.0
    workers = max(1, int(min(threads, usable_memory() / 2 // max(1.0, taken))))
    pool = executor or ThreadPoolExecutor(workers)
    try:
        while True:
            # So many at once bound the memory of their maps.
            for chunk in islice(waiting, 256 - len(running)):
                i, j = np.nonzero(missing[chunk.at])
                points = i + chunk.top, j + chunk.left
                part = part_of(grid, config, points, prepared)
                with _one_line_errors(executor):
                    tile = pool.submit(compute, ENGINE, estimator, part)
                running[tile] = chunk, points, part
                tile.add_done_callback(done.put)
            if not running:
                break
            if ready := _next(done):
                chunk, points, part = running.pop(ready)
                with _one_line_errors(executor):
                    computed = ready.result()
                check_values(computed, estimator, part)
                # The first tile alone shows whether the halo of a user's estimator suffices.
                if not (finished or is_ours(estimator)):
                    check_halo(estimator, part, computed, grid.cells)
                computed["covariance"] = rotated(computed["covariance"], yaw)
                finished += len(points[0])
                yield chunk, points, computed
            if progress:
                begun = sum(int(part.control[1]) for *_, part in running.values())
                progress(finished + begun, total)
    finally:
        for tile, (*_, part) in running.items():
            tile.cancel()
            part.control[0] = 1
        if executor is None:
            pool.shutdown(cancel_futures=True)


def compute(engine: int, estimator: Estimator, part: MapPart) -> Values:
    """Compute the values of a tile, on a worker that must have the same engine."""
    if engine != ENGINE:
        raise FieldError(
            f"a worker has another locplan (engine {ENGINE}, not {engine}); install the same one"
        )
    return estimator.covariances(part)


def chunk_edge(config: FieldConfig, resolution: float) -> int:
    """Edge length of the square tiles that are finished and stored as a whole [lattice points].

    A tile takes one thread two seconds at most, roughly. It follows from what the estimator says
    that a point costs, and not from the machine or the map, so that a computation can be continued
    elsewhere.
    """
    points = 2.0 / (config.headings * config.estimator.seconds(resolution))
    on_map = TILE_CELLS // config.stride_cells(resolution)
    return max(1, min(TILE, on_map, math.isqrt(int(min(points, TILE**2)))))


def chunks_of(points: Bools, edge: int) -> Iterator[Chunk]:
    """Chunks that hold at least one of the points, row by row."""
    height, width = points.shape
    for top in range(0, height, edge):
        for left in range(0, width, edge):
            chunk = Chunk(top, left, min(top + edge, height), min(left + edge, width))
            if points[chunk.at].any():
                yield chunk


def untouched_points(before: OccupancyGrid, after: OccupancyGrid, config: FieldConfig) -> Bools:
    """Mark the second map's lattice points whose covariances are those of the first.

    Parameters
    ----------
    before, after : OccupancyGrid
        The maps.
    config : FieldConfig
        The field's settings.

    Returns
    -------
    (h, w) array of bool
        True where the covariance is the same.

    Raises
    ------
    FieldError
        If the maps differ in shape, resolution or origin.
    """
    import cv2

    for name in ("shape", "resolution", "origin"):
        if getattr(before, name) != getattr(after, name):
            raise FieldError(
                f"the field's map has {name} {getattr(before, name)}, but the new one"
                f" {getattr(after, name)}; compute a field of its own for it"
            )
    stride = config.stride_cells(after.resolution)
    changed = (before.cells != after.cells).astype(np.uint8)
    # A lidar that would stand in a wall is moved by up to one stride.
    reach = stride + halo_of(config.estimator, after.resolution, after.shape)
    box = [2 * min(reach, max(after.shape)) + 1] * 2
    near = cv2.boxFilter(changed, cv2.CV_32S, box, normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.asarray((near[::stride, ::stride] == 0) & evaluated_points(after.free, stride))


def part_of(grid: OccupancyGrid, config: FieldConfig, points: _Points, prepared: object) -> MapPart:
    """Cells of some lattice points, with all that is prepared or the piece of the map they need."""
    stride = config.stride_cells(grid.resolution)
    rows, cols = (index * stride for index in points)
    if config.estimator.casts_rays:
        rows, cols = standing_cells(grid.free, rows, cols, stride)
    levels, top, left = grid.cells, 0, 0
    if prepared is None:
        reach = halo_of(config.estimator, grid.resolution, grid.shape)
        top, left = max(0, int(rows.min()) - reach), max(0, int(cols.min()) - reach)
        levels = levels[top : int(rows.max()) + reach + 1, left : int(cols.max()) + reach + 1]
    headings, at = config.heading_angles - grid.origin[2], (top, left)
    return MapPart(levels, rows, cols, grid.resolution, grid.shape, at, headings, prepared)


def _next(done: SimpleQueue[_Tile]) -> _Tile | None:
    """A finished tile, or None if none is finished within 0.2 s."""
    with suppress(Empty):
        return done.get(timeout=0.2)
    return None


@contextmanager
def _one_line_errors(executor: Executor | None) -> Iterator[None]:
    """Turn any failure of a foreign executor into an error of one line."""
    try:
        yield
    except LocplanError:
        raise
    except Exception as error:  # each executor has its own error for dead workers
        if executor is None:
            raise
        what = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(": ")[:200]
        raise FieldError(f"the executor failed at a tile of the field ({what})") from error
