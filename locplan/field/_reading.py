"""Reading the covariances of a field: at a position, and for all headings together."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.field._covariance import log_euclidean_mean, mean_information
from locplan.field._lattice import corners_of
from locplan.maps import OccupancyGrid


def weights_at(
    grid: OccupancyGrid,
    stride: int,
    known: NDArray[np.bool_],
    lacking: NDArray[np.bool_],
    xy: tuple[float, float],
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


def interpolated(
    covariances: NDArray[np.float64], weights: Iterable[float], heading: float | None
) -> NDArray[np.float64]:
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
