"""Reading the covariances of a field: at positions, for all headings together, and as a Dataset."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan._util.public import needed
from locplan.field import _tiles as tiles
from locplan.field._config import FieldConfig
from locplan.field._covariance import log_euclidean_mean, mean_information
from locplan.field._estimator import Values
from locplan.field._lattice import corners_of
from locplan.field._zarr import coordinates
from locplan.maps import OccupancyGrid

if TYPE_CHECKING:
    from xarray import Dataset


def weights_at(
    grid: OccupancyGrid, stride: int, known: Bools, lacking: Bools, xy: tuple[float, float]
) -> dict[tuple[int, int], float]:
    """Lattice points that a world position [m] is read from, with their weights.

    There are none in cells that are not free, and outside the map.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    stride : int
        Spacing of the lattice [cells].
    known, lacking : (h, w) arrays of bool
        Lattice points that hold a covariance, and those that are read from their neighbours.
    xy : (x, y)
        The position [m].
    """
    cell = grid.world_to_cell(xy)
    if not (grid.contains(*cell) and grid.free[cell]):
        return {}
    row, col = ((float(v) - 0.5) / stride for v in grid.world_to_grid(*xy))
    return corners_of(row, col, known, lacking)


def interpolated(covariances: Floats, weights: Iterable[float], heading: float | None) -> Floats:
    """Weighted mean of the covariances of some lattice points, (d, d); NaN without any.

    Parameters
    ----------
    covariances : (k, d, d) or (k, n, d, d) array
        Covariances of k points, for n headings.
    weights : iterable of k floats
        Their weights.
    heading : float or None
        Heading of the robot [rad]; None takes all headings together.
    """
    if not len(covariances):
        return np.full(covariances.shape[-2:], np.nan)
    own = [_towards(each, heading) for each in covariances]
    return log_euclidean_mean(np.array(own), np.array([*weights]))


def _towards(covariance: NDArray[Any], heading: float | None) -> Floats:
    """Covariance of a lattice point for one heading [rad], or for all headings together."""
    if covariance.ndim == 2:
        return covariance
    if heading is None:
        return mean_information(covariance)
    position = heading / (2 * math.pi) * len(covariance)
    low, share = math.floor(position), position % 1
    both = covariance[[low % len(covariance), (low + 1) % len(covariance)]]
    return log_euclidean_mean(both, np.array([1 - share, share]))


def merged(covariance: Floats, known: Bools) -> Floats:
    """Covariances (h, w, d, d) of the mean information over the headings of (h, w, n, d, d)."""
    if covariance.ndim == 4:
        return covariance
    result = np.full((*covariance.shape[:2], *covariance.shape[3:]), np.nan)
    result[known] = mean_information(covariance[known])
    return result


def covariances_at(
    grid: OccupancyGrid, config: FieldConfig, points: Ints, *, threads: int | None = None
) -> Floats:
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
    grid: OccupancyGrid, config: FieldConfig, poses: Floats, *, threads: int | None = None
) -> Floats:
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
    known, stride = tiles.needed_points(grid, config), config.stride_cells(grid.resolution)
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
    grid: OccupancyGrid, config: FieldConfig, points: Ints, threads: int | None
) -> Floats:
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


def dataset_of(
    values: Values, e: Floats, e_unit: str, grid: OccupancyGrid, config: FieldConfig
) -> Dataset:
    """A field's arrays and e with their coordinates; see `CovarianceField.to_xarray`."""
    needed("xarray", "tables", "to_xarray")
    from xarray import Dataset

    along = coordinates(grid, config)
    places = tuple(along)
    arrays: dict[str, Any] = {name: (places, array) for name, array in values.items()}
    arrays["covariance"] = (*places, "pose_row", "pose_col"), values["covariance"]
    arrays["e"] = places, e, {"units": e_unit}
    at = {name: (name, *described) for name, described in along.items()}
    about = {"map": grid.name, "yaw": grid.origin[2], "estimator": config.estimator.summary}
    return Dataset(arrays, at, about)
