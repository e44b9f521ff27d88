"""The main part of a map: the largest one in which a robot has something to do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from locplan._kernels.arrays import Array, Bools
from locplan.maps import OCCUPIED, OccupancyGrid

INDOOR_SHARE = 0.05
"""Minimum area of rooms or a building within surroundings, as a share of the surroundings' area."""


def find_main_part(
    grid: OccupancyGrid, room_of_cell: Array, areas: Sequence[float]
) -> tuple[int, Bools | None]:
    """Find the largest part of the building that a robot can reach.

    It is the largest room. A room along most of the image's border is the outside of a drawing, or
    a building that is open to it. Then only its cells between walls count.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    room_of_cell : (H, W) array of int
        Number of the room of each cell, from 1 on; 0 where there is none.
    areas : sequence of float
        Area of each room [m^2], the largest first.

    Returns
    -------
    room : int
        Number of the room; 0 without any.
    cells : (H, W) array of bool, or None
        The cells of its main part; None if it is the whole room.
    """
    if not areas:
        return 0, None
    outside = find_surroundings(room_of_cell, len(areas))
    if not outside:
        return 1, None
    inner = [number for number in range(1, len(areas) + 1) if number != outside]
    largest = areas[inner[0] - 1] if inner else 0.0
    indoor = (room_of_cell == outside) & _is_between_walls(grid)
    indoor_area = float(np.count_nonzero(indoor)) * grid.resolution**2
    if max(largest, indoor_area) < INDOOR_SHARE * areas[outside - 1]:
        return outside, None
    return (outside, indoor) if indoor_area > largest else (inner[0], None)


def find_surroundings(room_of_cell: Array, count: int) -> int:
    """Return the number of the room along most of the image's border, or 0 without one."""
    border = [room_of_cell[0], room_of_cell[-1], room_of_cell[1:-1, 0], room_of_cell[1:-1, -1]]
    cells = np.bincount(np.concatenate(border), minlength=count + 1)
    room = int(cells[1:].argmax()) + 1
    return room if cells[room] > cells.sum() / 2 else 0


def _is_between_walls(grid: OccupancyGrid) -> Bools:
    """Mark the cells with an occupied cell on all four sides, in their row and column."""
    occupied = grid.cells == OCCUPIED
    between = np.ones(grid.shape, np.bool_)
    for turned, marks in ((occupied, between), (occupied.T, between.T)):
        marks &= np.logical_or.accumulate(turned, axis=1)
        marks &= np.logical_or.accumulate(turned[:, ::-1], axis=1)[:, ::-1]
    return between
