"""A map as two bit planes, *free* and *occupied*, laid out for squares of 8 x 8 cells.

A *strip* holds, for one column, the byte of the eight cells from that column on, row by row, so
that the square at any row and column is one unaligned 64-bit load. Positions (row, col) are
indices of the whole map's lattice, also beyond its edges, where everything is unknown.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.simd import load_word, popcount

SQUARE = 8
"""Edge of a word's square of cells."""
PLANES = 2
ALL = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
"""Word of a square in which all cells are set."""


class Strips(NamedTuple):
    """Strips of the map turned by some headings, cut out where the cells of a tile look."""

    octets: NDArray[np.uint8]  # (heading, plane, col, row)
    first_rows: NDArray[np.int64]  # (heading,)
    first_cols: NDArray[np.int64]


class Window(NamedTuple):
    """The map around a tile, laid out so that the offsets in y of a square are contiguous."""

    words: NDArray[np.uint64]  # (plane, col, row mod step, row div step), flat
    below: NDArray[np.int64]  # laid out like words: cells set in the strip's rows below the square
    disc_sums: NDArray[np.int64]  # (plane, col, row): cells set within the disc there
    first_row: int  # rows and columns of words are counted in `unit` cells from here
    first_col: int
    unit: int
    lanes: int  # number of rows with the same remainder
    plane_stride: int  # number of words in a plane
    sum_unit: int  # disc_sums start `radius` cells further in and are this many cells apart


@njit(nogil=True, cache=True)
def cut_strips(
    levels: NDArray[np.uint8],
    row0: int,
    col0: int,
    centre_row: float,
    centre_col: float,
    cos: NDArray[np.float64],
    sin: NDArray[np.float64],
    first_rows: NDArray[np.int64],
    first_cols: NDArray[np.int64],
    rows: int,
    cols: int,
) -> Strips:
    """Turn the map by each heading about (centre_row, centre_col) and cut it into strips.

    `levels` is a part of the map whose cell (0, 0) is (row0, col0) of the whole.
    """
    octets = np.empty((cos.size, PLANES, cols, rows), np.uint8)
    for k in range(cos.size):
        free, occupied = octets[k]
        for i in range(cols - 1, -1, -1):
            dx = first_cols[k] + i - centre_col
            for j in range(rows):
                dy = first_rows[k] + j - centre_row
                row = int(np.floor(cos[k] * dy - sin[k] * dx + centre_row + 0.5)) - row0
                col = int(np.floor(sin[k] * dy + cos[k] * dx + centre_col + 0.5)) - col0
                level = 127
                if 0 <= row < levels.shape[0] and 0 <= col < levels.shape[1]:
                    level = levels[row, col]
                free[i, j] = level == 254
                occupied[i, j] = level == 0
            if i + 1 < cols:
                for j in range(rows):
                    free[i, j] |= free[i + 1, j] << 1
                    occupied[i, j] |= occupied[i + 1, j] << 1
    return Strips(octets, first_rows, first_cols)


@njit(nogil=True, cache=True)
def lay_out_window(
    octets: NDArray[np.uint8],
    top: int,
    left: int,
    first_row: int,
    first_col: int,
    row_span: int,
    col_span: int,
    radius: int,
    diameter: int,
    step: int,
    sum_unit: int,
    unit: int,
    lanes: int,
) -> Window:
    """Window around a tile whose discs start up to `row_span` and `col_span` cells further on.

    `octets` are the map's strips, (plane, col, row); those at (left, top) are of `first_row` and
    `first_col`. `sum_unit` divides the step and the distances of the tile's cells, and `unit` is
    what it has in common with a square's edge. `diameter` is the disc's, rounded up to whole
    squares, and `lanes` the number of offsets in y read from any position.
    """
    rows, cols = (row_span + diameter) // unit + 1, (col_span + diameter) // unit + 1
    step_units = step // unit
    lanes += -(-rows // step_units)
    words = np.zeros((PLANES, cols, step_units, lanes), np.uint64)
    below = np.zeros((PLANES, cols, step_units, lanes), np.int64)
    for plane in range(PLANES):
        for q in range(cols):
            strip = octets[plane, left + q * unit]
            ones = 0
            for p in range(rows):
                rest, lane, at = p % step_units, p // step_units, top + p * unit
                words[plane, q, rest, lane] = load_word(strip, at)
                below[plane, q, rest, lane] = ones
                for row in range(at, at + unit):
                    ones += popcount(np.uint64(strip[row]))
    sums = disc_sums(
        octets, top, left, radius, sum_unit, row_span // sum_unit + 1, col_span // sum_unit + 1
    )
    return Window(
        words.reshape(-1),
        below.reshape(-1),
        sums,
        first_row,
        first_col,
        unit,
        lanes,
        cols * step_units * lanes,
        sum_unit,
    )


@njit(nogil=True, cache=True)
def disc_sums(
    octets: NDArray[np.uint8], top: int, left: int, radius: int, unit: int, rows: int, cols: int
) -> NDArray[Any]:
    """Cells set in the disc around every `unit`-th cell from (left, top) + `radius` on.

    The result is (plane, col, row).
    """
    sums = np.zeros((PLANES, cols, rows), np.int64)
    width, height = 2 * radius + 1 + (cols - 1) * unit, 2 * radius + 1 + (rows - 1) * unit
    below = np.empty((width, height + 1), np.int32)
    halves = np.empty(2 * radius + 1, np.int64)
    for u in range(2 * radius + 1):
        halves[u] = int(np.sqrt(float(radius * radius - (u - radius) * (u - radius))))
    for plane in range(PLANES):
        for i in range(width):
            ones = 0
            below[i, 0] = 0
            for j in range(height):
                ones += octets[plane, left + i, top + j] & 1
                below[i, j + 1] = ones
        for q in range(cols):
            for u in range(2 * radius + 1):
                half = halves[u]
                line = below[q * unit + u]
                for p in range(rows):
                    centre = radius + p * unit
                    sums[plane, q, p] += line[centre + half + 1] - line[centre - half]
    return sums
