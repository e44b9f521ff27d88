"""Straight lines and rays through a grid, cell by cell (Amanatides and Woo, 1987).

A ray crosses empty space in leaps. For each of the four quadrants of directions, every cell stores
the edge of the largest empty square with this cell in its corner. The ray leaves that square by one
of its two far sides, and continues from the cell behind it. About six leaps reach the wall.

Positions are continuous (row, col) in cells: cell (r, c) covers [r, r + 1) x [c, c + 1).
"""

from __future__ import annotations

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Bools, Floats, Octets

TOUCH = 1e-6
"""Length up to which a line's part in a cell counts as only touching its corner [cells]."""


@njit(inline="always")
def _find_first_cell(position: float, delta: float) -> int:
    """Return the first cell of a line along one axis."""
    cell = int(np.floor(position))
    return cell - 1 if delta < 0 and cell == position else cell


@njit(inline="always")
def _compute_crossing(position: float, cell: int, delta: float) -> float:
    """Return the share of the line at which it leaves a cell along one axis."""
    if delta > 0:
        return (cell + 1 - position) / delta
    if delta < 0:
        return (cell - position) / delta
    return np.inf


@njit(inline="always")
def _compute_edge_offset(
    row_in_cell: float, col_in_cell: float, drow: float, dcol: float, columns: int
) -> int:
    """Return the offset of the second cell if a line runs along a cell's edge, otherwise 0."""
    offset = 0
    if drow == 0 and row_in_cell == 0:
        offset = -columns
    elif dcol == 0 and col_in_cell == 0:
        offset = -1
    return offset


@njit(nogil=True, cache=True, error_model="numpy")
def compute_segment_cost(
    half: Floats,
    columns: int,
    row0: float,
    col0: float,
    row1: float,
    col1: float,
    corner_cutting: bool,
) -> float:
    """Return the integral of a density along a line [density x cells]; infinite if it is blocked.

    `half` is flat and holds half the density (`locplan._support.kernels.search`). Unless corners
    may be cut, a line that touches a blocked cell is blocked.
    """
    drow, dcol = row1 - row0, col1 - col0
    length = np.hypot(drow, dcol)
    if length == 0:
        return 0.0
    row, col = _find_first_cell(row0, drow), _find_first_cell(col0, dcol)
    row_step = columns if drow > 0 else -columns
    col_step = 1 if dcol > 0 else -1
    cell = row * columns + col
    touched = (
        0 if corner_cutting else _compute_edge_offset(row0 - row, col0 - col, drow, dcol, columns)
    )
    row_at, col_at = _compute_crossing(row0, row, drow), _compute_crossing(col0, col, dcol)
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
        if touched and half[cell + touched] == np.inf:
            return np.inf
        if leave >= 1.0 or total == np.inf:
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
    return 2 * total * length


@njit(nogil=True, cache=True, error_model="numpy")
def find_line_cells(begin: Floats, end: Floats) -> tuple[Array, Array, Array, Array]:
    """Return rows and columns of the cells that lines cross, lengths in cells, and line numbers.

    Cells are in order of travel, one entry per visit. If a line only touches a cell, its length
    [cells] there is added to the next cell.

    Parameters
    ----------
    begin, end : (n, 2) array
        Both ends of the lines [cells].
    """
    room = 4
    for n in range(len(begin)):
        room += int(abs(end[n, 0] - begin[n, 0]) + abs(end[n, 1] - begin[n, 1])) + 4
    rows, cols, lines = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room, np.int64)
    lengths = np.empty(room)
    count = 0
    for n in range(len(begin)):
        row0, col0 = begin[n, 0], begin[n, 1]
        drow, dcol = end[n, 0] - row0, end[n, 1] - col0
        length = np.hypot(drow, dcol)
        row, col = _find_first_cell(row0, drow), _find_first_cell(col0, dcol)
        at = 0.0
        while at < 1.0 and length > 0:
            row_at, col_at = _compute_crossing(row0, row, drow), _compute_crossing(col0, col, dcol)
            leave = min(row_at, col_at, 1.0)
            if (leave - at) * length > TOUCH:
                rows[count], cols[count], lengths[count] = row, col, (leave - at) * length
                lines[count] = n
                count += 1
                at = leave
            if leave >= 1.0:
                break
            if row_at < col_at:
                row += 1 if drow > 0 else -1
            else:
                col += 1 if dcol > 0 else -1
    return rows[:count], cols[:count], lengths[:count], lines[:count]


@njit(nogil=True, cache=True, error_model="numpy")
def find_crossed_cells(positions: Floats) -> tuple[Array, Array, Array]:
    """Return rows and columns of the cells that a polyline (n, 2) crosses, and its lengths."""
    rows, cols, lengths, _ = find_line_cells(positions[:-1], positions[1:])
    return rows, cols, lengths


@njit(nogil=True, cache=True)
def compute_empty_squares(stops: Bools) -> Octets:
    """Return the edge of the largest empty square that starts at each cell [cells].

    Parameters
    ----------
    stops : (H, W) array of bool
        The cells that end a ray.

    Returns
    -------
    (4, H + 2, W + 2) array of uint8
        Edges by quadrant, ``2 * (up the rows) + (up the columns)``; 0 in cells that stop a ray and
        in a ring around the map, so that no ray has to look for the map's edge.
    """
    rows, cols = stops.shape
    squares = np.zeros((4, rows + 2, cols + 2), np.uint8)
    for quadrant in range(4):
        row_step = 1 if quadrant & 2 else -1
        col_step = 1 if quadrant & 1 else -1
        for i in range(rows):
            row = rows - i if row_step > 0 else 1 + i
            for j in range(cols):
                col = cols - j if col_step > 0 else 1 + j
                if not stops[row - 1, col - 1]:
                    smallest_square = min(
                        squares[quadrant, row + row_step, col],
                        squares[quadrant, row, col + col_step],
                        squares[quadrant, row + row_step, col + col_step],
                    )
                    squares[quadrant, row, col] = min(
                        smallest_square + 1, 255
                    )  # the longest leap, in a byte
    return squares


@njit(inline="always")
def _read_square_edge(squares: Octets, quadrant: int, row: int, col: int) -> int:
    # With unsigned indices numba need not check if they count from the end.
    """Return the edge of a cell's square, which is 0 in the ring around the map."""
    return int(np.int64(squares[np.uintp(quadrant), np.uintp(row + 1), np.uintp(col + 1)]))


@njit(nogil=True, cache=True, error_model="numpy")
def cast_ray(
    squares: Octets, row: float, col: float, drow: float, dcol: float, max_range: float
) -> tuple[float, int, int]:
    """Return the range of a ray [cells] and the cell (row, col) that stops it; inf, -1, -1 if none.

    The direction (drow, dcol) has length 1. A ray along the edge between two cells passes through
    the upper one. Through a corner, a ray passes one of the two adjacent cells, so that no wall
    leaks. If the ray starts in a cell that stops rays, the range is 0; outside the map there is no
    return.
    """
    rows, cols = squares.shape[1] - 2, squares.shape[2] - 2
    row0, col0 = _find_first_cell(row, drow), _find_first_cell(col, dcol)
    if not (0 <= row0 < rows and 0 <= col0 < cols):
        return np.inf, -1, -1
    # Cells are counted from the first one in the ray's own direction: up and down are alike.
    up, right = drow >= 0, dcol >= 0
    row_sign, col_sign = 1 if up else -1, 1 if right else -1
    row_pace, col_pace = abs(drow), abs(dcol)
    row_in_cell = row - row0 if up else row0 + 1 - row
    col_in_cell = col - col0 if right else col0 + 1 - col
    row_time, col_time = 1 / row_pace, 1 / col_pace
    quadrant = 2 * up + right
    i = j = 0
    at = 0.0
    edge = _read_square_edge(squares, quadrant, row0, col0)
    while edge:
        next_i, next_j = i + edge, j + edge
        row_at = (next_i - row_in_cell) * row_time
        col_at = (next_j - col_in_cell) * col_time
        # Rounding must not take the ray out of the square by a side that it does not cross.
        if row_at < col_at:
            at, i = row_at, next_i
            j = min(max(int(col_in_cell + at * col_pace), j), next_j - 1)
        else:
            at, j = col_at, next_j
            i = min(max(int(row_in_cell + at * row_pace), i), next_i - 1)
        if at > max_range:
            return np.inf, -1, -1
        edge = _read_square_edge(squares, quadrant, row0 + row_sign * i, col0 + col_sign * j)
    hit_row, hit_col = row0 + row_sign * i, col0 + col_sign * j
    if 0 <= hit_row < rows and 0 <= hit_col < cols:
        return at, hit_row, hit_col
    return np.inf, -1, -1
