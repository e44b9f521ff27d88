"""Covariances at a few lattice points, without the arrays of a whole field."""

from __future__ import annotations

from contextlib import closing

import numpy as np
from numpy.typing import NDArray

from locplan.field import _tiles as tiles
from locplan.field._config import FieldConfig
from locplan.field._covariance import mean_information
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

    Raises
    ------
    ConfigError
        If the computation takes too much memory.
    """
    tiles.check_tiles(grid, config)
    lattice = tiles.field_shapes(grid, config)["covariance"][:2]
    number = np.full(lattice, -1)
    number[tuple(points.T)] = np.arange(len(points))
    dimension = config.estimator.lattice(grid.resolution).dimension
    found = np.full((len(points), dimension, dimension), np.nan)
    chunks = tiles.computed_chunks(number >= 0, grid, config, threads, None, None)
    with closing(chunks):
        for _, some, computed in chunks:
            covariance = computed["covariance"]
            merged = mean_information(covariance) if covariance.ndim == 4 else covariance
            found[number[some]] = merged
    return np.asarray(found[number[tuple(points.T)]])
