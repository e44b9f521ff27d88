"""Objects that are drawn in a map, taken out of it."""

from __future__ import annotations

import dataclasses
import math
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from locplan.errors import ConfigError
from locplan.landmarks._objects import LandmarkObject, Shape, filled_cells, on_grid
from locplan.maps import FREE, OCCUPIED, OccupancyGrid

SHIFTS = (-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75)
"""Shifts of an object along rows and columns that are tried [cells]."""
BEYOND = 2.5
"""Distance from an object at which a wall beside it still must be one [cells]."""
DIRECTIONS = 8
"""Number of directions of walls."""


def without_objects(
    grid: OccupancyGrid, kind: LandmarkObject, poses: NDArray[np.float64]
) -> OccupancyGrid:
    """Copy of a map without objects that stand in it, whose cells become free.

    An object is sought up to a cell from its pose, where the least of it is free. Cells stay that
    a straight wall holds, which goes on at both sides of the object. Of the cells around it, only
    those go that are joined with nothing else: a wall that it touches stays.

    Raises
    ------
    ConfigError
        If nothing is drawn where an object should be, or two are given at one place.
    """
    _check_apart(kind, poses)
    cells, occupied = grid.cells.copy(), grid.cells == OCCUPIED
    for (x, y, _), (row, col, heading) in zip(poses.tolist(), on_grid(grid, poses), strict=True):
        rows, cols = _drawn_cells(grid, kind.shape, row, col, heading)
        if not rows.size:
            raise ConfigError(
                f"no {kind.title} is drawn in the map at {x:g},{y:g}; an existing object must be"
                " there, within a cell"
            )
        reach = kind.shape.reach / grid.resolution + BEYOND
        own = [
            not _in_wall(occupied, i, j, (row, col), reach)
            for i, j in zip(rows.tolist(), cols.tolist(), strict=True)
        ]
        at = rows[own], cols[own]
        cells[at] = FREE
        cells[_rim(cells, at)] = FREE
    return dataclasses.replace(grid, cells=cells)


def _check_apart(kind: LandmarkObject, poses: NDArray[np.float64]) -> None:
    """Raise a ConfigError if two objects are given whose middles lie in each other."""
    for (x, y, _), (other_x, other_y, _) in combinations(poses.tolist(), 2):
        if math.hypot(x - other_x, y - other_y) < kind.shape.half_width:
            raise ConfigError(
                f"two existing objects are given at one place, {x:g},{y:g} and"
                f" {other_x:g},{other_y:g}; leave one out"
            )


def _drawn_cells(
    grid: OccupancyGrid, shape: Shape, row: float, col: float, heading: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The occupied cells that an object fills, shifted only to where less of it is free."""
    size = grid.shape[0], grid.shape[1]
    best, found = (-math.inf, 0.0), (np.empty(0, np.int64), np.empty(0, np.int64))
    for d_row, d_col in product(SHIFTS, repeat=2):
        at = filled_cells(shape, row + d_row, col + d_col, heading, grid.resolution, size)
        taken = grid.cells[at] == OCCUPIED
        rank = float(taken.sum() - len(taken)), -math.hypot(d_row, d_col)
        if rank > best:
            best, found = rank, (at[0][taken], at[1][taken])
    return found


def _in_wall(
    occupied: NDArray[np.bool_], row: int, col: int, centre: tuple[float, float], reach: float
) -> bool:
    """Whether occupied cells lead from a cell straight out of a disc [cells] on both sides."""

    def leaves(d_row: float, d_col: float) -> bool:
        at_row, at_col = row + 0.5, col + 0.5
        while math.hypot(at_row - centre[0], at_col - centre[1]) <= reach:
            at_row, at_col = at_row + d_row, at_col + d_col
            i, j = math.floor(at_row), math.floor(at_col)
            if not (0 <= i < occupied.shape[0] and 0 <= j < occupied.shape[1]):
                return True  # the wall goes on where the map ends
            if not occupied[i, j]:
                return False
        return True

    angles = np.arange(DIRECTIONS) * math.pi / DIRECTIONS
    steps = np.column_stack([np.sin(angles), np.cos(angles)]).tolist()
    return any(leaves(y, x) and leaves(-y, -x) for y, x in steps)


def _rim(
    cells: NDArray[np.uint8], at: tuple[NDArray[np.int64], NDArray[np.int64]]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Occupied cells beside those of an object that lead no farther: no wall has them."""
    import cv2

    if not at[0].size:
        return at
    rows, cols = (slice(max(int(v.min()) - 2, 0), int(v.max()) + 3) for v in at)
    own = np.zeros(cells[rows, cols].shape, np.uint8)
    own[at[0] - rows.start, at[1] - cols.start] = 1
    beside = cv2.dilate(own, np.ones((3, 3), np.uint8)) > 0
    _, parts = cv2.connectedComponents((cells[rows, cols] == OCCUPIED).astype(np.uint8))
    of_walls = np.unique(parts[~beside])
    rim_rows, rim_cols = np.nonzero(beside & (parts > 0) & ~np.isin(parts, of_walls))
    return rim_rows + rows.start, rim_cols + cols.start
