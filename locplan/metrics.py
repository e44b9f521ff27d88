"""What a path costs, by the exact line integral over the cells of a costmap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan.costmap import Costmap
from locplan.grid import OccupancyGrid
from locplan.path import Path

DEGRADED = 0.5
"""The u above which a place counts as degraded."""


@dataclass(frozen=True)
class PathMetrics:
    """What a path costs, by the exact line integral over the map's cells.

    All that depends on a field is NaN for a costmap without one.
    """

    length: float
    """[m]"""
    cost: float
    """J, the integral of the costmap's density [m]; infinite if a blocked cell is crossed."""
    integrated_e: float
    """Integral of e [m^2 rad m]."""
    integrated_u: float
    """Integral of u [m]: metres of blind travel."""
    mean_e: float
    """[m^2 rad]"""
    max_e: float
    """[m^2 rad]"""
    degraded_share: float
    """Share of the length with u above 0.5."""
    longest_degraded: float
    """Longest stretch with u above 0.5 [m]."""
    clearance: float
    """Least distance from the centre of a crossed cell to an occupied one [m]."""


def path_metrics(costs: Costmap, path: Path) -> PathMetrics:
    """Measure a path on a costmap.

    Where the path leaves the map or touches cells that are not free, the cost is infinite and the
    integrals of e and u are NaN.
    """
    row, col, lengths = _crossed(costs.grid, path)
    e, u = _along(costs.e, row, col, np.nan), _along(costs.u, row, col, np.nan)
    density = _along(costs.density, row, col, np.inf)
    integrated_e = float(e @ lengths)
    return PathMetrics(
        length=path.length,
        cost=float(density @ lengths) if np.isfinite(density).all() else np.inf,
        integrated_e=integrated_e,
        integrated_u=float(u @ lengths),
        mean_e=integrated_e / path.length if path.length else float(e[0]),
        max_e=float(e.max()),
        degraded_share=float(_share(u > DEGRADED, lengths)) if np.isfinite(u).all() else np.nan,
        longest_degraded=_longest(u > DEGRADED, lengths) if np.isfinite(u).all() else np.nan,
        clearance=float(_along(costs.grid.clearance, row, col, 0.0).min()),
    )


def profile(
    costs: Costmap, path: Path, layer: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A layer (H, W) along a path, as steps.

    Returns
    -------
    distance : (n + 1,) array
        Where each crossed cell begins, and the path's length [m].
    values : (n,) array
        The layer there; NaN outside the map.
    """
    row, col, lengths = _crossed(costs.grid, path)
    return np.concatenate([[0.0], np.cumsum(lengths)]), _along(layer, row, col, np.nan)


def _crossed(grid: OccupancyGrid, path: Path) -> tuple[NDArray, NDArray, NDArray]:
    """Rows and columns of the cells that a path crosses, and its length in each [m]."""
    from locplan._kernels.rays import cells_along

    positions = np.column_stack(grid.world_to_grid(*path.xy.T))
    row, col, lengths = cells_along(positions)
    if lengths.size == 0:  # it stays where it is
        row, col = np.floor(positions[:1]).astype(np.int64).T
        lengths = np.zeros(1)
    return row, col, lengths * grid.resolution


def _along(layer: NDArray, row: NDArray, col: NDArray, outside: float) -> NDArray[np.float64]:
    inside = (row >= 0) & (row < layer.shape[0]) & (col >= 0) & (col < layer.shape[1])
    return np.where(inside, layer[np.where(inside, row, 0), np.where(inside, col, 0)], outside)


def _share(where: NDArray[np.bool_], lengths: NDArray) -> float:
    total = lengths.sum()
    return float(lengths[where].sum() / total) if total > 0 else 0.0


def _longest(where: NDArray[np.bool_], lengths: NDArray) -> float:
    longest = stretch = 0.0
    for inside, length in zip(where, lengths, strict=True):
        stretch = stretch + length if inside else 0.0
        longest = max(longest, stretch)
    return float(longest)
