"""Cells on and under the surface of walls."""

from __future__ import annotations

import numpy as np


def surface_depths(cells, free, occupied, deep):
    """Faces between free and occupied cells, and those with much black behind them."""
    faces = deep_faces = 0
    for down, right in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        for row, col in np.argwhere(cells == occupied).tolist():
            before = (row - down, col - right)
            if min(before) >= 0 and np.all(np.less(before, cells.shape)) and cells[before] == free:
                faces += 1
                behind = [(row + n * down, col + n * right) for n in range(deep)]
                inside = [n for n in behind if min(n) >= 0 and np.all(np.less(n, cells.shape))]
                deep_faces += len(inside) == deep and all(cells[n] == occupied for n in inside)
    return faces, deep_faces


def hollowed(cells):
    """The cells with what is black on all sides unknown."""
    result = cells.copy()
    for row in range(1, cells.shape[0] - 1):
        for col in range(1, cells.shape[1] - 1):
            if (cells[row - 1 : row + 2, col - 1 : col + 2] == 0).all():
                result[row, col] = 127
    return result
