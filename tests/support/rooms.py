"""Rooms side by side, which one scan cannot tell apart if they are equal."""

from __future__ import annotations

import numpy as np

from locplan import Lidar
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

LIDAR = Lidar(range=8.0)


ROOM_CELLS = 44
"""Edge of a room [cells of 0.1 m]."""


GAP_CELLS = 10
"""Cells between rooms."""


def room_cells(*boxes: tuple[int, int, int, int]) -> np.ndarray:
    """A room with walls all round and boxes (rows, columns) in it, alike under no turn."""
    cells = np.full((ROOM_CELLS, ROOM_CELLS), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    for top, bottom, left, right in boxes or ((1, 9, 1, 5), (20, 26, 34, 43), (36, 43, 8, 14)):
        cells[top:bottom, left:right] = OCCUPIED
    return cells


def join_rooms(*parts: np.ndarray, origin=(0.0, 0.0, 0.0)) -> OccupancyGrid:
    """Rooms with a metre of unknown space between them, so that walls have nothing behind them."""
    between = np.full((ROOM_CELLS, GAP_CELLS), UNKNOWN, np.uint8)
    every = [each for part in parts for each in (between, part)][1:]
    return OccupancyGrid(np.concatenate(every, axis=1), 0.1, origin, "rooms")


def two_rooms(origin=(0.0, 0.0, 0.0)) -> OccupancyGrid:
    return join_rooms(room_cells(), room_cells(), origin=origin)
