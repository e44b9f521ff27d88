"""Covariances at a few lattice points, without the arrays of a whole field."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from locplan._util.machine import check_threads
from locplan.field import _tiles as tiles
from locplan.field._config import FieldConfig
from locplan.field._covariance import mean_information, rotated
from locplan.maps import OccupancyGrid


def covariances_at(
    grid: OccupancyGrid,
    config: FieldConfig,
    points: NDArray[np.int64],
    *,
    threads: int | None = None,
) -> NDArray[np.float64]:
    """Covariances at points of the config's lattice, (n, d, d), as a field has them.

    Several headings give the covariance of their mean information.

    Parameters
    ----------
    grid, config
        The map, and the field's settings.
    points : (n, 2) array
        Rows and columns on the lattice.
    threads : int, optional
        Number of threads; all cores by default.
    """
    lattice = tiles.field_shapes(grid, config)["covariance"][:2]
    number = np.full(lattice, -1)
    number[tuple(points.T)] = np.arange(len(points))
    estimator, yaw = config.estimator, grid.origin[2]
    dimension = estimator.lattice(grid.resolution).dimension
    found = np.full((len(points), dimension, dimension), np.nan)
    prepared = estimator.prepare(grid.cells, grid.resolution)
    with ThreadPoolExecutor(check_threads(threads)) as pool:
        running = []
        for _, some in tiles.tiles_of(number >= 0, tiles.chunk_edge(config, grid.resolution)):
            part = tiles.part_of(grid, config, some, prepared)
            running.append((some, pool.submit(tiles.compute, tiles.ENGINE, estimator, part)))
        for some, tile in running:
            covariance = rotated(tile.result()["covariance"], yaw)
            merged = mean_information(covariance) if covariance.ndim == 4 else covariance
            found[number[some]] = merged
    return np.asarray(found[number[tuple(points.T)]])
