"""A field that is fine near the paths that are planned on it, and coarse elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Path
from locplan.field import CovarianceField, FieldConfig, every_second_point, points_near
from locplan.maps import OccupancyGrid

NEAR = 1.0
"""Distance from a path within which the field is made fine [m]."""
CLOSE = 0.3
"""Distance from a path within which it must be fine, or the field is computed once more [m].

It is one and a half strides where these are longer."""
ROUNDS = 4
"""Greatest number of fields; paths of the last one may leave what is fine."""

T = TypeVar("T")


def planned_near_paths(
    grid: OccupancyGrid,
    config: FieldConfig,
    field_of: Callable[[NDArray[np.bool_]], CovarianceField],
    planned: Callable[[CovarianceField], T],
    paths_of: Callable[[T], Iterable[Path]],
) -> tuple[CovarianceField, T]:
    """Plan on every second lattice point, then on all points near the paths, until they stay there.

    On a real map of 0.05 m about two fifths of the points are evaluated for a path across it.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    config : FieldConfig
        Settings of the field.
    field_of : callable
        Function of a mask (h, w) of lattice points that returns the field with values at those.
    planned : callable
        Function of a field that plans on it, and returns what it planned.
    paths_of : callable
        Function of what `planned` returned that returns the paths in it.

    Returns
    -------
    field : CovarianceField
        The last field; NaN where it was not evaluated.
    planned
        What was planned on it.
    """
    needed = config.lattice_points(grid)
    resolution, stride = grid.resolution, config.stride_cells(grid.resolution)
    points = every_second_point(needed)
    for _ in range(ROUNDS - 1):
        field = field_of(points)
        points = points | field.evaluated
        found = planned(field)
        cells = _cells_along(paths_of(found), grid, max(resolution, stride * resolution / 2))
        close = points_near(needed, stride, cells, max(CLOSE / resolution, 1.5 * stride))
        if not (close & ~points).any():
            return field, found
        points = points | points_near(needed, stride, cells, NEAR / resolution)
        del field, found  # saves memory on a large map
    field = field_of(points)
    return field, planned(field)


def _cells_along(paths: Iterable[Path], grid: OccupancyGrid, spacing: float) -> NDArray[np.float64]:
    """Positions every `spacing` metres along paths [cells from the first cell's centre], (n, 2)."""
    along = [path.resampled(spacing).xy for path in paths]
    xy = np.concatenate([*along, np.empty((0, 2))])
    return np.stack(grid.world_to_grid(*xy.T), axis=1) - 0.5
