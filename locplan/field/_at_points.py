"""Covariances at a few lattice points or poses, without the arrays of a whole field."""

from __future__ import annotations

from contextlib import closing

import numpy as np
from numpy.typing import NDArray

from locplan.field import _tiles as tiles
from locplan.field._config import FieldConfig
from locplan.field._covariance import mean_information
from locplan.field._reading import interpolated, weights_at
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
    found = _computed_at(grid, config, points, threads)
    return mean_information(found) if found.ndim == 4 else found


def covariances_along(
    grid: OccupancyGrid,
    config: FieldConfig,
    poses: NDArray[np.float64],
    *,
    threads: int | None = None,
) -> NDArray[np.float64]:
    """Covariances at poses in the world, (n, d, d), as `CovarianceField.at` reads them.

    Parameters
    ----------
    grid, config
        The map, and the field's settings.
    poses : (n, 3) array
        Poses x, y, heading [m, m, rad].
    threads : int, optional
        Number of threads; all cores by default.

    Raises
    ------
    ConfigError
        If the computation takes too much memory.
    """
    known, stride = tiles.wanted_points(grid, config), config.stride_cells(grid.resolution)
    lacking = np.zeros_like(known)
    weights = [weights_at(grid, stride, known, lacking, (x, y)) for x, y, _ in poses.tolist()]
    points = np.array([point for each in weights for point in each], np.int64).reshape(-1, 2)
    found = np.split(
        _computed_at(grid, config, points, threads), np.cumsum([len(each) for each in weights])[:-1]
    )
    return np.array(
        [
            interpolated(some, each.values(), heading)
            for some, each, heading in zip(found, weights, poses[:, 2].tolist(), strict=True)
        ]
    )


def _computed_at(
    grid: OccupancyGrid, config: FieldConfig, points: NDArray[np.int64], threads: int | None
) -> NDArray[np.float64]:
    """Covariances at points (n, 2) of the lattice, (n, d, d), or (n, headings, d, d) of several."""
    tiles.check_tiles(grid, config)
    shape = tiles.field_shapes(grid, config)["covariance"]
    number = np.full(shape[:2], -1)
    number[tuple(points.T)] = np.arange(len(points))
    found = np.full((len(points), *shape[2:]), np.nan)
    chunks = tiles.computed_chunks(number >= 0, grid, config, threads, None, None)
    with closing(chunks):
        for _, some, computed in chunks:
            found[number[some]] = computed["covariance"]
    return np.asarray(found[number[tuple(points.T)]])
