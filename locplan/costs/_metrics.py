"""Metrics of paths, by the exact line integral over the cells of a costmap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.saved import Valued
from locplan.costs._costmap import Costmap
from locplan.costs._path import Path
from locplan.errors import LocplanError
from locplan.maps import OccupancyGrid

DEGENERATE = 0.5
"""The u above which a place counts as degenerate."""
MAX_CROSSED = 10**7
"""Greatest length of a path that is measured [cells]."""


@dataclass(frozen=True, eq=False, repr=False)
class PathMetrics(Valued):
    """Metrics of a path, by the exact line integral over the map's cells.

    Metrics that depend on a field are NaN for a costmap without one.
    """

    length: float
    """Length of the path [m]."""
    cost: float
    """J, the integral of the costmap's density [m]; infinite if a blocked cell is crossed."""
    integrated_e: float
    """Integral of e [m^2 rad m]."""
    integrated_u: float
    """Integral of u, the degenerate metres [m]."""
    mean_e: float
    """Mean e over the length [m^2 rad]."""
    max_e: float
    """Greatest e on the path [m^2 rad]."""
    degenerate_share: float
    """Share of the length with u above 0.5, 0..1."""
    longest_degenerate: float
    """Length of the longest stretch with u above 0.5 [m]."""
    clearance: float
    """Least distance from the centre of a crossed cell to an occupied one [m]."""

    def __repr__(self) -> str:
        return (
            f"PathMetrics({self.length:.2f} m long, cost {self.cost:.2f} m, degenerate"
            f" {self.integrated_u:.2f} m, integrated e {self.integrated_e:.3g} m² rad m,"
            f" clearance {self.clearance:.2f} m)"
        )


def path_metrics(costs: Costmap, path: Path) -> PathMetrics:
    """Measure a path on a costmap, in the path's headings if it and the costmap have headings.

    Where the path leaves the map or touches cells that are not free, the cost is infinite and the
    integrals of e and u are NaN.

    Parameters
    ----------
    costs : Costmap
        The costmap; its e and u count whatever the path was planned on.
    path : Path
        The path in the world [m].

    Raises
    ------
    LocplanError
        If the path crosses over 1e7 cells.
    """
    layers: list[Any] = [costs.e[None], costs.u[None], costs.density[None]]
    if path.heading is not None and costs.u_of_heading is not None:
        layers = [costs.e_of_heading, costs.u_of_heading, costs.density_of_heading]
    *at, lengths = _crossed(costs.grid, path, len(layers[0]))
    e, u = (_along(layer, at, np.nan) for layer in layers[:2])
    density, clearance = _along(layers[2], at, np.inf), costs.grid.clearance[None]
    integrated_e, known = float(e @ lengths), bool(np.isfinite(u).all())
    return PathMetrics(
        length=path.length,
        cost=float(density @ lengths) if np.isfinite(density).all() else np.inf,
        integrated_e=integrated_e,
        integrated_u=float(u @ lengths),
        mean_e=integrated_e / path.length if path.length else float(e[0]),
        max_e=float(e.max()),
        degenerate_share=_share(u > DEGENERATE, lengths) if known else np.nan,
        longest_degenerate=_longest(u > DEGENERATE, lengths) if known else np.nan,
        clearance=float(_along(clearance, [0 * at[0], *at[1:]], 0.0).min()),
    )


def path_cost(costs: Costmap, path: Path) -> float:
    """J of a path [m], as `path_metrics` has it, without the other metrics.

    Parameters
    ----------
    costs : Costmap
        The costmap whose density is integrated.
    path : Path
        The path in the world [m].

    Raises
    ------
    LocplanError
        If the path crosses over 1e7 cells.
    """
    density: Any = costs.density[None]
    if path.heading is not None and costs.u_of_heading is not None:
        density = costs.density_of_heading
    *at, lengths = _crossed(costs.grid, path, len(density))
    along = _along(density, at, np.inf)
    return float(along @ lengths) if np.isfinite(along).all() else np.inf


def profile(
    costs: Costmap, path: Path, layer: NDArray[np.floating]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Steps of a layer along a path.

    Parameters
    ----------
    costs : Costmap
        The costmap, whose map has the layer's cells.
    path : Path
        The path in the world [m]; with headings if the layer has several.
    layer : (H, W) or (n, H, W) array
        Values of the cells, such as `costs.u`, or those for n headings evenly spaced from 0 on,
        such as `costs.u_of_heading`.

    Returns
    -------
    distance : (k + 1,) array
        Distance along the path at which each crossed cell begins, and the path's length [m].
    values : (k,) array
        Value of the layer in each cell; NaN outside the map.

    Raises
    ------
    LocplanError
        If the path crosses over 1e7 cells.
    """
    layers = layer.reshape(-1, *layer.shape[-2:])
    *at, lengths = _crossed(costs.grid, path, len(layers))
    return np.concatenate([[0.0], np.cumsum(lengths)]), _along(layers, at, np.nan)


def _crossed(grid: OccupancyGrid, path: Path, headings: int) -> list[NDArray[Any]]:
    """Headings, rows and columns of the cells that a path crosses, and lengths in them [m]."""
    parts = []
    for heading, xy in path.by_heading(headings) if headings > 1 else [(0, path.xy)]:
        row, col, lengths = _crossed_cells(grid, xy)
        parts.append((np.full_like(row, heading), row, col, lengths))
    return [np.concatenate(part) for part in zip(*parts, strict=True)]


def _crossed_cells(
    grid: OccupancyGrid, xy: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    from locplan._kernels.rays import cells_along

    positions = np.column_stack(grid.world_to_grid(*xy.T))
    if np.abs(np.diff(positions, axis=0)).sum() > MAX_CROSSED:
        raise LocplanError(
            f"the path crosses over {MAX_CROSSED} cells of {grid.resolution:g} m; give a path in"
            " metres on this map"
        )
    row, col, lengths = cells_along(positions)
    if lengths.size == 0:  # the path has no length
        row, col = np.floor(positions[:1]).astype(np.int64).T
        lengths = np.zeros(1)
    return row, col, lengths * grid.resolution


def _along(layers: NDArray[Any], at: Sequence[NDArray[Any]], outside: float) -> NDArray[np.float64]:
    """Values of layers at headings, rows and columns; `outside` outside the map."""
    heading, row, col = at
    rows, cols = layers.shape[1:]
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    row, col = np.where(inside, row, 0), np.where(inside, col, 0)
    return np.where(inside, layers[heading, row, col], outside)


def _share(where: NDArray[np.bool_], lengths: NDArray[Any]) -> float:
    total = lengths.sum()
    return float(lengths[where].sum() / total) if total > 0 else 0.0


def _longest(where: NDArray[np.bool_], lengths: NDArray[Any]) -> float:
    longest = stretch = 0.0
    for inside, length in zip(where, lengths, strict=True):
        stretch = stretch + length if inside else 0.0
        longest = max(longest, stretch)
    return float(longest)
