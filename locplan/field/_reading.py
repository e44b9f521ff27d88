"""Reading the covariances of a field: at a position, and for all headings together."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.field._covariance import log_euclidean_mean, mean_information
from locplan.field._lattice import corners_of
from locplan.maps import OccupancyGrid


def covariance_at(
    covariance: NDArray[np.float64],
    grid: OccupancyGrid,
    stride: int,
    known: NDArray[np.bool_],
    lacking: NDArray[np.bool_],
    xy: tuple[float, float],
    heading: float | None,
) -> NDArray[np.float64]:
    """Covariance at a world position [m], (d, d), see `CovarianceField.at`.

    Parameters
    ----------
    covariance : (h, w, d, d) or (h, w, n, d, d) array
        Covariances on the lattice.
    grid : OccupancyGrid
        The map.
    stride : int
        Spacing of the lattice [cells].
    known, lacking : (h, w) arrays of bool
        Lattice points that hold a covariance, and those that are read from their neighbours.
    xy : (x, y)
        The position [m].
    heading : float or None
        Heading of the robot [rad]; None takes all headings together.
    """
    nowhere = np.full(covariance.shape[-2:], np.nan)
    cell = grid.world_to_cell(xy)
    if not (grid.contains(*cell) and grid.free[cell]):
        return nowhere
    row, col = ((float(v) - 0.5) / stride for v in grid.world_to_grid(*xy))
    corners = corners_of(row, col, known, lacking)
    if not corners:
        return nowhere
    covariances = [_towards(covariance[point], heading) for point in corners]
    return log_euclidean_mean(np.array(covariances), np.array(list(corners.values())))


def _towards(covariance: NDArray[Any], heading: float | None) -> NDArray[np.float64]:
    """Covariance of a lattice point for one heading [rad], or for all headings together."""
    if covariance.ndim == 2:
        return covariance
    if heading is None:
        return mean_information(covariance)
    position = heading / (2 * math.pi) * len(covariance)
    low, share = math.floor(position), position % 1
    both = covariance[[low % len(covariance), (low + 1) % len(covariance)]]
    return log_euclidean_mean(both, np.array([1 - share, share]))


def merged(covariance: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Covariances (h, w, d, d) of the mean information over the headings of (h, w, n, d, d)."""
    if covariance.ndim == 4:
        return covariance
    result = np.full((*covariance.shape[:2], *covariance.shape[3:]), np.nan)
    result[known] = mean_information(covariance[known])
    return result
