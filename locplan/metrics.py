"""What a path costs, by the exact line integral over the cells of a costmap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan.costmap import Costmap
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
    from locplan._kernels.rays import cells_along

    grid = costs.grid
    rows, cols = grid.world_to_grid(*path.xy.T)
    row, col, lengths = cells_along(np.column_stack([rows, cols]))
    lengths = lengths * grid.resolution
    if lengths.size == 0:
        row, col = np.floor(rows[:1]).astype(int), np.floor(cols[:1]).astype(int)
        lengths = np.zeros(1)
    inside = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])

    def along(layer: NDArray, outside: float) -> NDArray:
        values = layer[np.where(inside, row, 0), np.where(inside, col, 0)]
        return np.where(inside, values, outside)

    e, u = along(costs.e, np.nan), along(costs.u, np.nan)
    integrated_e = float(e @ lengths)
    return PathMetrics(
        length=path.length,
        cost=float(along(costs.density, np.inf) @ lengths),
        integrated_e=integrated_e,
        integrated_u=float(u @ lengths),
        mean_e=integrated_e / path.length if path.length else float(e[0]),
        max_e=float(e.max()),
        degraded_share=float(_share(u > DEGRADED, lengths)) if np.isfinite(u).all() else np.nan,
        longest_degraded=_longest(u > DEGRADED, lengths) if np.isfinite(u).all() else np.nan,
        clearance=float(along(grid.clearance, 0.0).min()),
    )


def profile(
    costs: Costmap, path: Path, layer: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A layer (H, W) along a path: where each crossed cell begins [m], and its value, (n,)."""
    from locplan._kernels.rays import cells_along

    row, col, lengths = cells_along(
        np.column_stack(costs.grid.world_to_grid(*path.xy.T)),
    )
    distance = np.concatenate([[0.0], np.cumsum(lengths * costs.grid.resolution)])
    return distance[:-1], layer[row, col]


def _share(where: NDArray[np.bool_], lengths: NDArray) -> float:
    total = lengths.sum()
    return float(lengths[where].sum() / total) if total > 0 else 0.0


def _longest(where: NDArray[np.bool_], lengths: NDArray) -> float:
    longest = stretch = 0.0
    for inside, length in zip(where, lengths, strict=True):
        stretch = stretch + length if inside else 0.0
        longest = max(longest, stretch)
    return float(longest)
