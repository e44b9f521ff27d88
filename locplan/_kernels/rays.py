"""Straight lines through a grid, cell by cell (Amanatides and Woo, 1987).

Positions are continuous (row, col) in cells: cell (r, c) covers [r, r + 1) x [c, c + 1).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

TOUCH = 1e-6
"""A cell crossed by no more than this is only touched, at its corner [cells]."""


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


@njit(nogil=True, cache=True, error_model="numpy")
def segment_cost(
    half: NDArray[np.float64],
    columns: int,
    row0: float,
    col0: float,
    row1: float,
    col1: float,
    corner_cutting: bool,
) -> float:
    """Integral of a density along one line [density x cells]; infinite if it is blocked.

    `half` is flat and holds half the density (`locplan._kernels.search`). Unless corners may be
    cut, a line is blocked, too, where it only touches a blocked cell.
    """
    drow, dcol = row1 - row0, col1 - col0
    length = np.hypot(drow, dcol)
    if length == 0:
        return 0.0
    row, col = _first_cell(row0, drow), _first_cell(col0, dcol)
    row_step = columns if drow > 0 else -columns
    col_step = 1 if dcol > 0 else -1
    cell = row * columns + col
    touched = 0  # where the line runs along an edge between two cells: the other one
    if not corner_cutting:
        if drow == 0 and row0 == row:
            touched = -columns
        elif dcol == 0 and col0 == col:
            touched = -1
    row_at, col_at = _crossing(row0, row, drow), _crossing(col0, col, dcol)
    row_share, col_share = abs(1 / drow), abs(1 / dcol)
    rows_crossed = cols_crossed = 0
    first_row_at, first_col_at = row_at, col_at
    touch = TOUCH / length
    at, total = 0.0, 0.0
    while True:
        leave = min(row_at, col_at, 1.0)
        if leave - at > touch:
            total += (leave - at) * half[cell]
            at = leave
        if leave >= 1.0 or total == np.inf or (touched and half[cell + touched] == np.inf):
            break
        at_corner = abs(row_at - col_at) <= touch and not corner_cutting
        if at_corner and half[cell + row_step] + half[cell + col_step] == np.inf:
            return np.inf
        if row_at < col_at:
            cell += row_step
            rows_crossed += 1
            row_at = first_row_at + rows_crossed * row_share
        else:
            cell += col_step
            cols_crossed += 1
            col_at = first_col_at + cols_crossed * col_share
    if touched and half[cell + touched] == np.inf:
        return np.inf
    return 2 * total * length


@njit(nogil=True, cache=True)
def cells_along(
    positions: NDArray[np.float64],
) -> tuple[NDArray, NDArray, NDArray]:
    """The cells that a polyline of (n, 2) positions crosses and its length in each [cells].

    In order of travel, one entry for every visit. What is only touched goes to the next cell.
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
            if (leave - at) * length > TOUCH:
                rows[count], cols[count], lengths[count] = row, col, (leave - at) * length
                count += 1
                at = leave
            if leave >= 1.0:
                break
            if row_at < col_at:
                row += 1 if drow > 0 else -1
            else:
                col += 1 if dcol > 0 else -1
    return rows[:count], cols[:count], lengths[:count]
