"""The covariance field of a map: evaluated on a lattice, read anywhere on the map."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import zipfile
import zlib
from collections.abc import Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.config import FieldConfig
from locplan.covariance import log_euclidean_mean, rotated, scalar
from locplan.errors import ConfigError, FieldError, LocplanError
from locplan.estimators import sad
from locplan.files import replacing
from locplan.grid import OccupancyGrid
from locplan.lattice import evaluated_points, neighbours, spread, stride_cells
from locplan.progress import ProgressCallback
from locplan.search_window import SearchWindow

FORMAT = "locplan-field-1"
SATURATION = 1.05
_UNREADABLE = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    EOFError,
    zipfile.BadZipFile,
    zlib.error,
    LocplanError,
)
TILE = 64
"""Edge of a tile, whose covariances share one layout of the map [lattice points]."""
TILE_CELLS = 512
"""And at most so many cells, which bounds the layout's memory."""


@dataclass(frozen=True, eq=False)
class CovarianceField:
    """Covariances of a pose match over a map.

    Lattice point ``(i, j)`` is the centre of cell ``(i * stride, j * stride)``.

    Parameters
    ----------
    covariance : (h, w, d, d) array of float64
        Of (x, y, theta) [m, m, rad] in the world frame; d = 2 (x, y) without rotation. NaN where
        not evaluated.
    grid : OccupancyGrid
        The map, (H, W) cells.
    config : FieldConfig
        What the covariances were computed with.
    """

    covariance: NDArray[np.float64]
    grid: OccupancyGrid
    config: FieldConfig

    @property
    def stride(self) -> int:
        """Spacing of the lattice [cells]."""
        return stride_cells(self.config, self.grid.resolution)

    @cached_property
    def evaluated(self) -> NDArray[np.bool_]:
        """Which lattice points hold a covariance, (h, w)."""
        return ~np.isnan(self.covariance[:, :, 0, 0])

    @property
    def window(self) -> SearchWindow:
        """The lattice of offsets that was compared at each cell."""
        return SearchWindow.from_config(self.config, self.grid.resolution)

    @cached_property
    def e(self) -> NDArray[np.float64]:
        """sqrt(det Sigma) (Eq. 10) on the lattice, (h, w) [m^2 rad]; NaN where not evaluated."""
        return scalar(self.covariance, "e")

    def scalar(self, name: str) -> NDArray[np.float64]:
        """A scalar on the lattice, (h, w): "e", "position_std", "position_rms", "heading_std".

        See `locplan.covariance.scalar`.
        """
        return scalar(self.covariance, name)

    @property
    def quantised_covariance(self) -> NDArray[np.float64]:
        """Sigma + Q whether or not `config.quantisation` has added it, (h, w, d, d)."""
        if self.config.quantisation:
            return self.covariance
        return self.covariance + self.window.quantisation

    def anchors(self, name: str = "e") -> tuple[float, float]:
        """A scalar's least and greatest value with Q: a perfect match, and a featureless place."""
        q = self.window.quantisation
        featureless = self.config.noise_level * self.window.uniform_covariance + q
        return float(scalar(q, name)), float(scalar(featureless, name))

    @property
    def saturated_share(self) -> float:
        """Share of the evaluated points whose e (with Q) is within 5 % of its least value.

        There the search window's lattice resolves no difference any more; zero for an empty field.
        """
        e = scalar(self.quantised_covariance, "e")[self.evaluated]
        return float(np.mean(e <= SATURATION * self.anchors()[0])) if e.size else 0.0

    @property
    def e_unit(self) -> str:
        """Of e: positions alone have no angle in it."""
        return "m² rad" if self.window.dimension == 3 else "m²"

    def e_map(self) -> NDArray[np.float64]:
        """`e` on the map's free cells, (H, W) [m^2 rad]: bilinear in ln e; NaN elsewhere."""
        return self.on_map(self.e)

    def on_map(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positive values (h, w) on the lattice, read on the free cells: bilinear in the logarithm.

        Where a corner was not evaluated the others take its weight.
        """
        known = self.evaluated
        logs = np.log(np.maximum(np.where(known, values, 1.0), np.finfo(float).tiny))
        logs = spread(np.where(known, logs, 0.0), self.grid.shape, self.stride)
        weight = spread(known.astype(float), self.grid.shape, self.stride)
        readable = self.grid.free & (weight > 0)
        result = np.full(self.grid.shape, np.nan)
        result[readable] = np.exp(logs[readable] / weight[readable])
        return result

    def at(self, x: float, y: float) -> NDArray[np.float64]:
        """Covariance at a world position [m], (d, d).

        Interpolated between the lattice points in the matrices' logarithm, which makes it
        bilinear in ln e; NaN in cells that are not free or lie outside the map.
        """
        nowhere = np.full(self.covariance.shape[2:], np.nan)
        if not (math.isfinite(x) and math.isfinite(y)):
            return nowhere
        row, col = self.grid.world_to_cell(x, y)
        if not (self.grid.contains(row, col) and self.grid.free[row, col]):
            return nowhere
        exact_row, exact_col = (float(v) - 0.5 for v in self.grid.world_to_grid(x, y))
        corners, weights = [], []
        for i, weight_row in neighbours(exact_row / self.stride, self.covariance.shape[0]):
            for j, weight_col in neighbours(exact_col / self.stride, self.covariance.shape[1]):
                if self.evaluated[i, j] and weight_row * weight_col > 0:
                    corners.append(self.covariance[i, j])
                    weights.append(weight_row * weight_col)
        if not corners:
            return nowhere
        return log_euclidean_mean(np.array(corners), np.array(weights))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the field with its config and the map's digest to a NumPy archive (.npz)."""
        about = {
            "format": FORMAT,
            "config": dataclasses.asdict(self.config),
            "resolution": self.grid.resolution,
            "origin": self.grid.origin,
            "name": self.grid.name,
            "digest": self.grid.digest,
        }
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(
                file,
                covariance=self.covariance,
                cells=self.grid.cells,
                about=np.array(json.dumps(about)),
            )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> CovarianceField:
        """Read a field written by `save`.

        Raises
        ------
        FieldError
            If the file is missing, damaged, or no covariance field.
        """
        try:
            with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as archive:
                about = json.loads(str(archive["about"]))
                if about["format"] != FORMAT:
                    raise ValueError(f"its format is {about['format']}, not {FORMAT}")
                origin = tuple(about["origin"])
                grid = OccupancyGrid(archive["cells"], about["resolution"], origin, about["name"])
                if grid.digest != about["digest"]:
                    raise ValueError("the map inside does not match its digest")
                return cls(archive["covariance"], grid, FieldConfig(**about["config"]))
        except FileNotFoundError:
            raise FieldError(f"{path}: no such file") from None
        except _UNREADABLE as error:
            what = " ".join(str(error).split()).split("; ")[0][:120]
            if isinstance(error, ValueError) and "pickle" in what:
                what = "it is no NumPy archive"
            raise FieldError(f"{path}: not a covariance field ({what}); compute it anew") from None


def covariance_field(
    grid: OccupancyGrid,
    config: FieldConfig | None = None,
    *,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: ProgressCallback | None = None,
) -> CovarianceField:
    """Compute the covariance of a pose match over the free cells of a map.

    Evaluated on every lattice point (`config.stride` apart) in a free cell, and on the nearest
    lattice point of free cells that would have none to be read from.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    config : FieldConfig, optional
        `FieldConfig()` by default.
    threads : int, optional
        All cores by default. The result does not depend on it.
    executor : concurrent.futures.Executor, optional
        Where to run the tiles instead of own threads.
    progress : callable, optional
        Called with (done, total) cells now and then.

    Raises
    ------
    ConfigError
        If the config does not fit the map's resolution, or `threads` is below 1.

    Examples
    --------
    >>> from locplan.grid import FREE
    >>> grid = OccupancyGrid(np.full((30, 30), FREE), resolution=0.1)
    >>> field = covariance_field(grid, FieldConfig(sensor_range=0.5))
    >>> field.covariance.shape
    (15, 15, 3, 3)
    """
    config = config or FieldConfig()
    if threads is not None and threads < 1:
        raise ConfigError(f"threads must be at least 1, not {threads}")
    window = SearchWindow.from_config(config, grid.resolution)
    wanted = evaluated_points(grid.free, stride_cells(config, grid.resolution))
    covariance = np.full((*wanted.shape, window.dimension, window.dimension), np.nan)
    tiles = _computed_tiles(grid, config, wanted, threads, executor, progress)
    with closing(tiles):
        for points, values in tiles:
            covariance[points] = values
    yaw = grid.origin[2]
    return CovarianceField(rotated(covariance, yaw) if yaw else covariance, grid, config)


_Points = tuple[NDArray[np.intp], NDArray[np.intp]]


def _computed_tiles(
    grid: OccupancyGrid,
    config: FieldConfig,
    wanted: NDArray[np.bool_],
    threads: int | None,
    executor: Executor | None,
    progress: ProgressCallback | None,
) -> Generator[tuple[_Points, NDArray[np.float64]]]:
    """Lattice points of each tile with their covariances, as the tiles are finished.

    Own threads count their cells as they go and stop at once when the caller does; an executor
    finishes the tiles that it has begun.
    """
    controls: list[NDArray[np.int64]] = []
    tiles: dict[Future[NDArray[np.float64]], _Points] = {}
    total, finished = int(wanted.sum()), 0
    pool = executor or ThreadPoolExecutor(threads or os.cpu_count())
    try:
        stride = stride_cells(config, grid.resolution)
        for points in _tiles(wanted, stride, sad.points_apart(config, grid.resolution, stride)):
            task = _task(grid, config, points)
            if executor is None:
                controls.append(np.zeros(2, np.int64))
                task["control"] = controls[-1]
            tiles[pool.submit(sad.covariances, **task)] = points
        waiting = set(tiles)
        while waiting:
            done, waiting = wait(waiting, timeout=0.2, return_when=FIRST_COMPLETED)
            for tile in done:
                yield tiles[tile], tile.result()
                finished += len(tiles[tile][0])
            if progress:
                progress(sum(int(c[1]) for c in controls) if controls else finished, total)
    finally:
        for tile in tiles:
            tile.cancel()
        for control in controls:
            control[0] = 1
        if executor is None:
            pool.shutdown(cancel_futures=True)


def _tiles(wanted: NDArray[np.bool_], stride: int, apart: int) -> Iterator[_Points]:
    """Lattice points of each tile, every `apart`-th along rows and columns."""
    edge = min(TILE, max(1, TILE_CELLS // (stride * apart)))
    for row in range(apart):
        for col in range(apart):
            part = wanted[row::apart, col::apart]
            for top in range(0, part.shape[0], edge):
                for left in range(0, part.shape[1], edge):
                    i, j = np.nonzero(part[top : top + edge, left : left + edge])
                    if i.size:
                        yield (i + top) * apart + row, (j + left) * apart + col


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
