"""Cells that an outline sweeps along poses, and collisions with occupied cells.

Between two poses the position moves along a line, and the heading turns evenly. Each move is split
into parts of at most 2 degrees. The hull of the outlines at both ends contains the part, because
the outlines are grown by the sagitta of their corners' arcs. Poses are (col, row, heading) [cells,
rad].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Bools, Floats, Ints

PART = math.radians(2)
"""Maximum turn of a part [rad]."""
TOUCH = 1e-9
"""Depth up to which an outline only touches a cell [cells]."""


class CollisionMap(NamedTuple):
    """Outline of the robot, and the occupied cells that it must not meet."""

    sums: Ints  # see `sum_occupied_along_rows`
    outline: Floats  # (k, 2) corners [cells]; none for a circle, which the density keeps clear


@njit(nogil=True, cache=True, error_model="numpy")
def find_first_hit(row_sums: Ints, outline: Floats, poses: Floats) -> int:
    """Return the index of the first move in which the outline meets an occupied cell, or -1.

    Parameters
    ----------
    row_sums : (H, W + 1) array
        Number of the occupied cells before each column of a row, see `sum_occupied_along_rows`.
    outline : (k, 2) array
        Corners ahead and left of the centre [cells].
    poses : (n, 3) array
        The poses.
    """
    rows, columns = row_sums.shape[0], row_sums.shape[1] - 1
    corners, hull = allocate_hull(outline)
    for move_index in range(len(poses) - 1):
        n_parts = count_move_parts(poses, move_index)
        for part in range(n_parts):
            size, top, bottom = write_part_hull(
                corners, hull, outline, poses, move_index, part, n_parts
            )
            for row in range(max(0, top), min(rows, bottom + 1)):
                left, right = find_hull_columns(hull, size, row)
                left, right = max(0, left), min(columns, right + 1)
                if left < right and row_sums[row, right] > row_sums[row, left]:
                    return move_index
    return -1


@njit(nogil=True, cache=True)
def sum_occupied_along_rows(occupied: Bools) -> Array:
    """Return the number of occupied cells before each column of a row, (H, W + 1)."""
    rows, columns = occupied.shape
    sums = np.zeros((rows, columns + 1), np.int32)
    for row in range(rows):
        for col in range(columns):
            sums[row, col + 1] = sums[row, col] + occupied[row, col]
    return sums


@njit(nogil=True, cache=True, error_model="numpy")
def find_swept_cells(outline: Floats, poses: Floats, reach: int) -> Array:
    """Return the cells (2 reach + 1, 2 reach + 1) that the outline meets, around cell (0, 0)."""
    met = np.zeros((2 * reach + 1, 2 * reach + 1), np.bool_)
    corners, hull = allocate_hull(outline)
    for move_index in range(len(poses) - 1):
        n_parts = count_move_parts(poses, move_index)
        for part in range(n_parts):
            size, top, bottom = write_part_hull(
                corners, hull, outline, poses, move_index, part, n_parts
            )
            for row in range(top, bottom + 1):
                left, right = find_hull_columns(hull, size, row)
                for col in range(left, right + 1):
                    met[row + reach, col + reach] = True
    return met


@njit(inline="always")
def allocate_hull(outline: Floats) -> tuple[Array, Array]:
    """Return space for the corners of two outlines, and for their hull."""
    return np.empty((2 * len(outline), 2)), np.empty((4 * len(outline) + 2, 2))


@njit(nogil=True, cache=True, error_model="numpy")
def write_part_hull(
    corners: Array,
    hull: Array,
    outline: Floats,
    poses: Floats,
    move_index: int,
    part: int,
    n_parts: int,
) -> tuple[int, int, int]:
    """Write the hull of the outlines at both ends of a part; return its size and row limits."""
    write_end_outlines(corners, outline, poses, move_index, part, n_parts)
    size = write_convex_hull(corners, hull)
    top, bottom = find_hull_rows(hull, size)
    return size, top, bottom


@njit(inline="always")
def compute_turn(poses: Floats, move_index: int) -> float:
    """Return the turn from one pose to the next, the shorter way [rad]."""
    turn = poses[move_index + 1, 2] - poses[move_index, 2] if move_index + 1 < len(poses) else 0.0
    return turn - 2 * math.pi * round(turn / (2 * math.pi))


@njit(inline="always")
def count_move_parts(poses: Floats, move_index: int) -> int:
    """Return the number of parts of a move."""
    return max(1, math.ceil(abs(compute_turn(poses, move_index)) / PART - 1e-9))


@njit(nogil=True, cache=True, error_model="numpy")
def write_end_outlines(
    corners: Array, outline: Floats, poses: Floats, move_index: int, part: int, n_parts: int
) -> None:
    """Write the corners of the outlines at both ends of a part of a move."""
    turn, after = compute_turn(poses, move_index), min(move_index + 1, len(poses) - 1)
    grown = 1 / math.cos(turn / n_parts / 2)
    for end in range(2):
        share = (part + end) / n_parts
        heading = poses[move_index, 2] + turn * share
        cos, sin = grown * math.cos(heading), grown * math.sin(heading)
        x = poses[move_index, 0] + share * (poses[after, 0] - poses[move_index, 0])
        y = poses[move_index, 1] + share * (poses[after, 1] - poses[move_index, 1])
        for k in range(len(outline)):
            at = end * len(outline) + k
            corners[at, 0] = x + cos * outline[k, 0] - sin * outline[k, 1]
            corners[at, 1] = y + sin * outline[k, 0] + cos * outline[k, 1]


@njit(nogil=True, cache=True)
def write_convex_hull(points: Array, hull: Array) -> int:
    """Write the convex hull's corners, counter-clockwise and closed; return their number.

    The algorithm is Andrew's monotone chain; the points are sorted in place.
    """
    count = len(points)
    for n in range(1, count):
        x, y, k = points[n, 0], points[n, 1], n
        while k > 0 and (points[k - 1, 0] > x or (points[k - 1, 0] == x and points[k - 1, 1] > y)):
            points[k, 0], points[k, 1] = points[k - 1, 0], points[k - 1, 1]
            k -= 1
        points[k, 0], points[k, 1] = x, y
    size = 0
    for side in range(2):
        begin = size
        for n in range(count):
            k = n if side == 0 else count - 1 - n
            x, y = points[k, 0], points[k, 1]
            while size >= begin + 2:
                to_x, to_y = (
                    hull[size - 1, 0] - hull[size - 2, 0],
                    hull[size - 1, 1] - hull[size - 2, 1],
                )
                if to_x * (y - hull[size - 2, 1]) - to_y * (x - hull[size - 2, 0]) > 0:
                    break
                size -= 1
            hull[size, 0], hull[size, 1] = x, y
            size += 1
        if side == 0:
            size -= 1  # the last point of the lower chain is the first of the upper one
    return size


@njit(nogil=True, cache=True)
def find_hull_rows(hull: Array, size: int) -> tuple[int, int]:
    """Return the first and last row of cells that a hull meets."""
    low, high = hull[0, 1], hull[0, 1]
    for n in range(size):
        low, high = min(low, hull[n, 1]), max(high, hull[n, 1])
    return math.floor(low + TOUCH), math.ceil(high - TOUCH) - 1


@njit(nogil=True, cache=True, error_model="numpy")
def find_hull_columns(hull: Array, size: int, row: int) -> tuple[int, int]:
    """Return the first and last column of the cells in a row that a hull meets."""
    low, high = np.inf, -np.inf
    for n in range(size - 1):
        x0, y0, x1, y1 = hull[n, 0], hull[n, 1], hull[n + 1, 0], hull[n + 1, 1]
        if max(y0, y1) < row or min(y0, y1) > row + 1:
            continue
        begin, end = x0, x1
        if y0 != y1:
            shares = (row - y0) / (y1 - y0), (row + 1 - y0) / (y1 - y0)
            begin = x0 + min(max(min(shares), 0.0), 1.0) * (x1 - x0)
            end = x0 + min(max(max(shares), 0.0), 1.0) * (x1 - x0)
        low, high = min(low, begin, end), max(high, begin, end)
    if high < low:
        return 0, -1
    return math.floor(low + TOUCH), math.ceil(high - TOUCH) - 1
