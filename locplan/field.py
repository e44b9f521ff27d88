"""The covariance field of a map: evaluated on a lattice, read anywhere on the map."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import zipfile
import zlib
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from locplan.config import FieldConfig
from locplan.covariance import log_euclidean_mean, rotated, scalar
from locplan.errors import FieldError, LocplanError
from locplan.estimators import sad
from locplan.files import replacing
from locplan.grid import OccupancyGrid
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
"""Edge of a tile: lattice cells whose covariances share one layout of the map."""


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
        logs = _spread(np.where(known, logs, 0.0), self.grid.shape, self.stride)
        weight = _spread(known.astype(float), self.grid.shape, self.stride)
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
        row, col = self.grid.world_to_cell(x, y)
        if not (self.grid.contains(row, col) and self.grid.free[row, col]):
            return nowhere
        exact_row, exact_col = (float(v) - 0.5 for v in self.grid.world_to_grid(x, y))
        corners, weights = [], []
        for i, weight_row in _neighbours(exact_row / self.stride, self.covariance.shape[0]):
            for j, weight_col in _neighbours(exact_col / self.stride, self.covariance.shape[1]):
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
            what = " ".join(str(error).split())[:200]
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
        Called with (done, total) cells as tiles are finished.

    Raises
    ------
    ConfigError
        If the config does not fit the map's resolution.

    Examples
    --------
    >>> from locplan.grid import FREE
    >>> grid = OccupancyGrid(np.full((30, 30), FREE), resolution=0.1)
    >>> field = covariance_field(grid, FieldConfig(sensor_range=0.5))
    >>> field.covariance.shape
    (15, 15, 3, 3)
    """
    config = config or FieldConfig()
    window = SearchWindow.from_config(config, grid.resolution)
    stride = stride_cells(config, grid.resolution)
    wanted = evaluated_points(grid.free, stride)
    covariance = np.full((*wanted.shape, window.dimension, window.dimension), np.nan)
    total, done = int(wanted.sum()), 0

    pool = executor or ThreadPoolExecutor(threads or os.cpu_count())
    try:
        tiles = {
            pool.submit(
                sad.covariances,
                _around(grid, i, j, stride, config),
                i * stride,
                j * stride,
                grid.resolution,
                config,
                corner=_corner(i, j, stride, config, grid.resolution),
                map_shape=grid.shape,
            ): (i, j)
            for i, j in _tiles(wanted)
        }
        for tile in as_completed(tiles):
            i, j = tiles[tile]
            covariance[i, j] = tile.result()
            done += len(i)
            if progress:
                progress(done, total)
    finally:
        if executor is None:
            pool.shutdown(cancel_futures=True)

    yaw = grid.origin[2]
    return CovarianceField(rotated(covariance, yaw) if yaw else covariance, grid, config)


def stride_cells(config: FieldConfig, resolution: float) -> int:
    """Spacing of the lattice in whole cells."""
    return max(1, round(config.stride / resolution))


def evaluated_points(free: NDArray[np.bool_], stride: int) -> NDArray[np.bool_]:
    """Lattice points to evaluate, (h, w), so that every free cell can be read from one at least."""
    wanted = free[::stride, ::stride].copy()
    covered = _spread(wanted.astype(float), free.shape, stride) > 0
    rows, cols = np.nonzero(free & ~covered)
    nearest = [
        np.minimum((index + stride // 2) // stride, size - 1)
        for index, size in zip((rows, cols), wanted.shape, strict=True)
    ]
    wanted[nearest[0], nearest[1]] = True
    return wanted


def _tiles(wanted: NDArray[np.bool_]) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    for top in range(0, wanted.shape[0], TILE):
        for left in range(0, wanted.shape[1], TILE):
            i, j = np.nonzero(wanted[top : top + TILE, left : left + TILE])
            if i.size:
                yield i + top, j + left


def _corner(
    i: NDArray[np.intp], j: NDArray[np.intp], stride: int, config: FieldConfig, resolution: float
) -> tuple[int, int]:
    reach = sad.halo(config, resolution)
    return max(0, int(i.min()) * stride - reach), max(0, int(j.min()) * stride - reach)


def _around(
    grid: OccupancyGrid,
    i: NDArray[np.intp],
    j: NDArray[np.intp],
    stride: int,
    config: FieldConfig,
) -> NDArray[np.uint8]:
    """The part of the map that the covariances at these lattice points depend on."""
    reach = sad.halo(config, grid.resolution)
    top, left = _corner(i, j, stride, config, grid.resolution)
    bottom, right = int(i.max()) * stride + reach + 1, int(j.max()) * stride + reach + 1
    return grid.cells[top:bottom, left:right]


def _spread(
    values: NDArray[np.float64], shape: tuple[int, int], stride: int
) -> NDArray[np.float64]:
    """Lattice values (h, w) read bilinearly at every cell (H, W); beyond the last, the last."""
    for axis, size in enumerate(shape):
        last = values.shape[axis] - 1
        position = np.minimum(np.arange(size) / stride, last)
        low = np.floor(position).astype(np.intp)
        part = position - low
        part = part[:, None] if axis == 0 else part[None, :]
        below = np.take(values, low, axis)
        above = np.take(values, np.minimum(low + 1, last), axis)
        values = below * (1 - part) + above * part
    return values


def _neighbours(position: float, size: int) -> list[tuple[int, float]]:
    """Lattice indices on either side of a position, with their bilinear weights."""
    position = min(max(position, 0.0), size - 1.0)
    low = math.floor(position)
    return [(low, 1 - (position - low)), (min(low + 1, size - 1), position - low)]
