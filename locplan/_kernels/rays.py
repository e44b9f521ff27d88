"""Straight lines through a grid, cell by cell (Amanatides and Woo, 1987).

Positions are continuous (row, col) in cells: cell (r, c) covers [r, r + 1) x [c, c + 1).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

CORNER = 1e-9
"""Crossings of a row and a column closer than this share of the line pass through a corner."""


@njit(inline="always")
def _first_cell(position: float, delta: float) -> int:
    cell = int(np.floor(position))
    return cell - 1 if delta < 0 and cell == position else cell


@njit(inline="always")
def _crossing(position: float, cell: int, delta: float) -> float:
    """The share of the line at which it leaves a cell along one axis."""
    if delta > 0:
        return (cell + 1 - position) / delta
    if delta < 0:
        return (cell - position) / delta
    return np.inf


@njit(nogil=True, cache=True)
def line_integral(
    density: NDArray[np.float64], row0: float, col0: float, row1: float, col1: float
) -> float:
    """Integral of a density, constant in each cell, along a line [density x cells].

    Infinite if the line leaves the grid, crosses a cell of infinite density, or passes exactly
    through a corner of one.
    """
    drow, dcol = row1 - row0, col1 - col0
    length = np.hypot(drow, dcol)
    row, col = _first_cell(row0, drow), _first_cell(col0, dcol)
    row_step, col_step = (1 if drow > 0 else -1), (1 if dcol > 0 else -1)
    total = at = 0.0
    while True:
        if not (0 <= row < density.shape[0] and 0 <= col < density.shape[1]):
            return np.inf
        if density[row, col] == np.inf:
            return np.inf
        row_at, col_at = _crossing(row0, row, drow), _crossing(col0, col, dcol)
        leave = min(row_at, col_at, 1.0)
        total += max(leave - at, 0.0) * length * density[row, col]
        if leave >= 1.0 - 1e-12:
            return total
        at = leave
        if abs(row_at - col_at) <= CORNER:
            if not _is_open(density, row + row_step, col):
                return np.inf
            if not _is_open(density, row, col + col_step):
                return np.inf
            row += row_step
            col += col_step
        elif row_at < col_at:
            row += row_step
        else:
            col += col_step


@njit(inline="always")
def _is_open(density: NDArray[np.float64], row: int, col: int) -> bool:
    inside = 0 <= row < density.shape[0] and 0 <= col < density.shape[1]
    return inside and density[row, col] < np.inf


@njit(nogil=True, cache=True)
def cells_along(
    positions: NDArray[np.float64],
) -> tuple[NDArray, NDArray, NDArray]:
    """The cells that a polyline of (n, 2) positions crosses and its length in each [cells].

    In order of travel, one entry for every visit, without cells that are only touched.
    """
    room = 4
    for n in range(len(positions) - 1):
        room += int(np.abs(positions[n + 1] - positions[n]).sum()) + 4
    rows, cols = np.empty(room, np.int64), np.empty(room, np.int64)
    lengths = np.empty(room)
    count = 0
    for n in range(len(positions) - 1):
        row0, col0 = positions[n]
        drow, dcol = positions[n + 1] - positions[n]
        length = np.hypot(drow, dcol)
        row, col = _first_cell(row0, drow), _first_cell(col0, dcol)
        at = 0.0
        while at < 1.0 and length > 0:
            row_at, col_at = _crossing(row0, row, drow), _crossing(col0, col, dcol)
            leave = min(row_at, col_at, 1.0)
            if leave > at:
                rows[count], cols[count], lengths[count] = row, col, (leave - at) * length
                count += 1
            at = max(at, leave)
            if leave >= 1.0 - 1e-12:
                break
            corner = abs(row_at - col_at) <= CORNER
            if corner or row_at < col_at:
                row += 1 if drow > 0 else -1
            if corner or row_at >= col_at:
                col += 1 if dcol > 0 else -1
    return rows[:count], cols[:count], lengths[:count]
