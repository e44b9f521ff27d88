"""A map as two bit planes, *free* and *occupied*, laid out for squares of 8 x 8 cells.

A *strip* holds, for one column, the byte of the eight cells from that column on, row by row, so
that the square at any row and column is one unaligned 64-bit load. Positions (row, col) are
indices of the whole map's lattice, also beyond its edges, where everything is unknown.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.simd import load_word, popcount

SQUARE = 8
"""Edge of a word's square of cells."""
PLANES = 2
ALL = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
"""Word of a square in which all cells are set."""


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
    octets: NDArray[np.uint8],
) -> None:
    """Turn the map by each heading about (centre_row, centre_col) and cut it into strips.

    `levels` is a part of the map whose cell (0, 0) is (row0, col0) of the whole. The strips,
    `octets` (heading, plane, col, row), are filled in from `first_rows` and `first_cols` on.
    """
    cols, rows = octets.shape[2], octets.shape[3]
    for k in range(cos.size):
        for i in range(cols - 1, -1, -1):
            free, occupied = octets[k, 0, i], octets[k, 1, i]
            dx = first_cols[k] + i - centre_col
            for j in range(rows):
                dy = first_rows[k] + j - centre_row
                row = int(np.floor(cos[k] * dy - sin[k] * dx + centre_row + 0.5)) - row0
                col = int(np.floor(sin[k] * dy + cos[k] * dx + centre_col + 0.5)) - col0
                level = 127
                if 0 <= row < levels.shape[0] and 0 <= col < levels.shape[1]:
                    level = levels[row, col]
                free[j] = level == 254
                occupied[j] = level == 0
            if i + 1 < cols:
                more_free, more_occupied = octets[k, 0, i + 1], octets[k, 1, i + 1]
                for j in range(rows):
                    free[j] |= more_free[j] << 1
                    occupied[j] |= more_occupied[j] << 1


@njit(nogil=True, cache=True)
def lay_out_words(
    octets: NDArray[np.uint8],
    top: int,
    left: int,
    rows: int,
    unit: int,
    words: NDArray[np.uint64],
    below: NDArray[np.int64],
) -> None:
    """Lay the map out so that the squares at neighbouring offsets in y are contiguous.

    `octets` are the map's strips, (plane, col, row), of which every `unit`-th column and `rows`
    such rows are taken from (left, top) on. `words` and `below`, (plane, col, row mod step, row
    div step), are filled in: the word of the square there, and the cells set in its strip's rows
    below.
    """
    step = words.shape[2]
    for plane in range(PLANES):
        for q in range(words.shape[1]):
            strip = octets[plane, left + q * unit]
            ones = 0
            for p in range(rows):
                at = top + p * unit
                words[plane, q, p % step, p // step] = load_word(strip, at)
                below[plane, q, p % step, p // step] = ones
                for row in range(at, at + unit):
                    ones += popcount(np.uint64(strip[row]))


@njit(nogil=True, cache=True)
def disc_sums(
    octets: NDArray[np.uint8],
    top: int,
    left: int,
    radius: int,
    unit: int,
    rows: int,
    below: NDArray[np.int32],
    sums: NDArray[np.int64],
) -> None:
    """Fill in the cells set in discs, (plane, col, row), of the first rows.

    The discs' centres are every `unit`-th cell, and begin `radius` further on than (left, top).
    `below` (col, row + 1) is scratch space for all columns and rows that they reach.
    """
    diameter = 2 * radius + 1
    for plane in range(PLANES):
        for i in range(below.shape[0]):
            ones = 0
            below[i, 0] = 0
            for j in range(below.shape[1] - 1):
                ones += octets[plane, left + i, top + j] & 1
                below[i, j + 1] = ones
        for q in range(sums.shape[1]):
            for p in range(rows):
                sums[plane, q, p] = 0
            for u in range(diameter):
                half = int(np.sqrt(float(radius * radius - (u - radius) * (u - radius))))
                line = below[q * unit + u]
                for p in range(rows):
                    centre = radius + p * unit
                    sums[plane, q, p] += line[centre + half + 1] - line[centre - half]
