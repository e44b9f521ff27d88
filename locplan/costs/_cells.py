"""Cells of a map: the window that an edit changes, and where a robot is to stand."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import position
from locplan.errors import FieldError, PoseError
from locplan.field import CovarianceField
from locplan.maps import OCCUPIED, UNKNOWN, OccupancyGrid

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


def _around(marked: NDArray[np.bool_], reach: int) -> slice:
    """All marked places and those up to `reach` from the first and the last one."""
    places = np.flatnonzero(marked)
    return slice(max(0, int(places[0]) - reach), min(marked.size, int(places[-1]) + reach + 1))


def standing_cell(
    grid: OccupancyGrid,
    density: NDArray[np.float64],
    robot_radius: float,
    xy: Sequence[float],
    role: str,
) -> tuple[int, int]:
    """Row and column of the cell at a world position, see `Costmap.cell_of`."""
    x, y = position(xy, name=role)
    row, col = grid.world_to_cell(x, y)
    fault = _fault(grid, density, robot_radius, row, col)
    if fault is None:
        return row, col
    remedy = f"no cell of the map is free for a robot of radius {robot_radius:g} m"
    if nearest := _nearest_free(grid, density, x, y):
        decimals = max(2, math.ceil(1 - math.log10(grid.resolution)))
        shown = ",".join(f"{v:.{decimals}f}" for v in nearest)
        remedy = f"the nearest free position is {shown}"
    where = "locplan info MAP -o PICTURE shows coordinates"
    raise PoseError(f"{role} {x:.10g},{y:.10g} {fault}; {remedy}; {where}")


def _fault(
    grid: OccupancyGrid, density: NDArray[np.float64], robot_radius: float, row: int, col: int
) -> str | None:
    """Why a robot cannot stand in a cell; None if it can."""
    if not grid.contains(row, col):
        return "lies outside the map"
    if np.isfinite(density[row, col]):
        return None
    level = grid.cells[row, col]
    if level in (OCCUPIED, UNKNOWN):
        return "lies in a wall" if level == OCCUPIED else "lies in unknown space"
    clearance = grid.clearance[row, col]
    if clearance < robot_radius:
        return (
            f"is {clearance:.2f} m from a wall, closer than the robot's radius of"
            f" {robot_radius:g} m"
        )
    return "lies in a blocked cell"


def _nearest_free(
    grid: OccupancyGrid, density: NDArray[np.float64], x: float, y: float
) -> tuple[float, float] | None:
    """Centre of the passable cell next to a world position [m]."""
    rows, cols = np.nonzero(np.isfinite(density))
    if rows.size == 0:
        return None
    row, col = grid.world_to_grid(x, y)
    nearest = np.argmin((rows + 0.5 - row) ** 2 + (cols + 0.5 - col) ** 2)
    return grid.cell_to_world(int(rows[nearest]), int(cols[nearest]))
