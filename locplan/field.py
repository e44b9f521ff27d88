"""The covariance field of a map: evaluated on a lattice, read anywhere on the map."""

from __future__ import annotations

import math
import os
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from locplan import field_files, tiles
from locplan.config import FieldConfig
from locplan.covariance import log_euclidean_mean, scalar
from locplan.files import replacing_folder
from locplan.grid import OccupancyGrid
from locplan.lattice import neighbours, spread, stride_cells
from locplan.progress import ProgressCallback
from locplan.search_window import SearchWindow

SATURATION = 1.05


@dataclass(frozen=True, eq=False, repr=False)
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

    def __repr__(self) -> str:
        h, w = self.covariance.shape[:2]
        return (
            f"CovarianceField({self.grid.name or 'map'}: {int(self.evaluated.sum())} covariances"
            f" on a lattice of {h} x {w}, {self.config})"
        )

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

    def update(
        self,
        grid: OccupancyGrid,
        *,
        threads: int | None = None,
        executor: Executor | None = None,
        progress: ProgressCallback | None = None,
    ) -> CovarianceField:
        """The field of an edited map: computed only where the change can be felt.

        Equal, bit for bit, to `covariance_field` of the new map.

        Parameters
        ----------
        grid : OccupancyGrid
            The new map, of the same shape, resolution and origin.
        threads, executor, progress
            As for `covariance_field`.

        Raises
        ------
        FieldError
            If the maps differ in more than their cells.
        """
        same = tiles.untouched_points(self.grid, grid, self.config)
        covariance = np.where(same[:, :, None, None], self.covariance, np.nan)
        tiles.complete(covariance, grid, self.config, threads, executor, progress)
        return CovarianceField(covariance, grid, self.config)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the field with its map and config as a Zarr v3 group, a folder named *.zarr.

        A field that is there already is replaced; anything else is not.

        Raises
        ------
        LocplanError
            If the folder cannot be written, or is something else than a field.
        """
        with replacing_folder(path, field_files.SUFFIX, field_files.is_field) as temporary:
            field_files.write(temporary, self.covariance, self.grid, self.config)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> CovarianceField:
        """Read a field written by `save`.

        Raises
        ------
        FieldError
            If the folder is missing, damaged, or no covariance field.
        """
        return cls(*field_files.read(Path(path)))


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
        Where to run the tiles instead of own threads: a process pool, or a cluster by
        dask.distributed's ``client.get_executor()``. Its workers need locplan.
    progress : callable, optional
        Called with (done, total) cells now and then.

    Raises
    ------
    ConfigError
        If the config does not fit the map's resolution, or `threads` is below 1.
    FieldError
        If the executor fails.

    Examples
    --------
    >>> from locplan.grid import FREE
    >>> grid = OccupancyGrid(np.full((30, 30), FREE), resolution=0.1)
    >>> field = covariance_field(grid, FieldConfig(sensor_range=0.5))
    >>> field.covariance.shape
    (15, 15, 3, 3)
    """
    config = config or FieldConfig()
    covariance = np.full(tiles.field_shape(grid, config), np.nan)
    tiles.complete(covariance, grid, config, threads, executor, progress)
    return CovarianceField(covariance, grid, config)
