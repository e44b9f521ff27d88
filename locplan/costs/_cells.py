"""The window of cells whose costs an edit of the map changes."""

from __future__ import annotations

import math

import numpy as np

from locplan._kernels.arrays import Bools
from locplan.errors import FieldError
from locplan.field import CovarianceField
from locplan.maps import OccupancyGrid

CellWindow = tuple[slice, slice]
"""Rows and columns of a map."""


def changed_window(
    before: OccupancyGrid, field: CovarianceField, robot_radius: float
) -> CellWindow | None:
    """The cells whose costs may differ between a map and the edited map of a field; None if none.

    An edit reaches as far as the estimator sees, and as far as the robot's radius.

    Parameters
    ----------
    before : OccupancyGrid
        The map.
    field : CovarianceField
        The field of the edited map.
    robot_radius : float
        Radius of the robot [m].

    Raises
    ------
    FieldError
        If the maps differ in shape, resolution or origin.
    """
    after = field.grid
    for name in ("shape", "resolution", "origin"):
        if getattr(before, name) != getattr(after, name):
            raise FieldError(f"the field's map has another {name}; make a costmap of its own")
    changed = before.cells != after.cells
    if not changed.any():
        return None
    # A lidar that would stand in a wall is moved by a stride; values are read a stride further.
    halo = field.config.estimator.halo(after.resolution, after.shape) + 2 * field.stride
    reach = max(halo, math.ceil(robot_radius / after.resolution) + 1)
    rows, cols = (_around(changed.any(axis=1 - axis), reach) for axis in (0, 1))
    return rows, cols


def joined_windows(one: CellWindow | None, other: CellWindow | None) -> CellWindow | None:
    """The least window that holds two windows; None stands for no cell.

    Parameters
    ----------
    one, other : (slice, slice) or None
        The windows, rows and columns of a map.
    """
    if one is None or other is None:
        return one or other
    rows, cols = (
        slice(min(a.start, b.start), max(a.stop, b.stop)) for a, b in zip(one, other, strict=True)
    )
    return rows, cols


def part_around(
    field: CovarianceField, window: CellWindow, robot_radius: float
) -> tuple[CovarianceField, CellWindow]:
    """The part of a field that a window of its map is read from, and the window within it."""
    grid, stride = field.grid, field.stride
    margin = 2 * stride + math.ceil(robot_radius / grid.resolution) + 1
    cells, points, inside = [], [], []
    for inner, size in zip(window, grid.shape, strict=True):
        first = max(0, inner.start - margin) // stride
        last = min(size, inner.stop + margin)
        cells.append(slice(first * stride, last))
        points.append(slice(first, -(-last // stride)))
        inside.append(slice(inner.start - first * stride, inner.stop - first * stride))
    crop = OccupancyGrid(grid.cells[tuple(cells)], grid.resolution, name=grid.name)
    values = {name: array[tuple(points)] for name, array in field.values.items()}
    return CovarianceField.of(values, crop, field.config), (inside[0], inside[1])


def _around(marked: Bools, reach: int) -> slice:
    """All marked places and those up to `reach` from the first and the last one."""
    places = np.flatnonzero(marked)
    return slice(max(0, int(places[0]) - reach), min(marked.size, int(places[-1]) + reach + 1))
