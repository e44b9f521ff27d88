"""A map as two bit planes, *free* and *occupied*, laid out for squares of 8 x 8 cells.

A *strip* holds, for one column, the byte of the eight cells from that column on, row by row, so
that the square at any row and column is one unaligned 64-bit load. Positions (row, col) are
indices of the whole map's lattice, also beyond its edges, where everything is unknown.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.simd import load_word

SQUARE = 8
"""Edge of a word's square of cells."""
PLANES = 2


class Strips(NamedTuple):
    """Strips of the map turned by some headings, cut out where the cells of a tile look."""

    octets: NDArray[np.uint8]  # (heading, plane, col, row)
    first_rows: NDArray[np.int64]  # (heading,)
    first_cols: NDArray[np.int64]


class Window(NamedTuple):
    """The map around a tile, laid out so that the offsets in y of a square are contiguous."""

    words: NDArray[np.uint64]  # (plane, col, row mod step, row div step), flat
    disc_sums: NDArray[np.int64]  # (plane, col, row): cells set within the disc there
    first_row: int  # of words: rows and columns are counted in `unit` cells from here
    first_col: int
    unit: int
    cols: int
    lanes: int  # rows of the same remainder
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
def window_words(
    octets: NDArray[np.uint8], unit: int, step_units: int, cols: int, lanes: int
) -> NDArray:
    """Words at every `unit` cells of the strips, those a step apart side by side."""
    words = np.zeros((PLANES, cols, step_units, lanes), np.uint64)
    for plane in range(PLANES):
        for q in range(cols):
            strip = octets[plane, q * unit]
            for p in range((strip.size - SQUARE) // unit + 1):
                words[plane, q, p % step_units, p // step_units] = load_word(strip, p * unit)
    return words.reshape(-1)


@njit(nogil=True, cache=True)
def disc_sums(
    octets: NDArray[np.uint8], radius: int, start: int, unit: int, rows: int, cols: int
) -> NDArray:
    """Cells set within the disc around every `unit` cells from `start` on, (plane, col, row)."""
    sums = np.zeros((PLANES, cols, rows), np.int64)
    below = np.zeros((octets.shape[1], octets.shape[2] + 1), np.int32)
    for plane in range(PLANES):
        for i in range(octets.shape[1]):
            for j in range(octets.shape[2]):
                below[i, j + 1] = below[i, j] + (octets[plane, i, j] & 1)
        for q in range(cols):
            for du in range(-radius, radius + 1):
                half = int(np.sqrt(radius * radius - du * du))
                line = below[start + q * unit + du]
                for p in range(rows):
                    centre = start + p * unit
                    sums[plane, q, p] += line[centre + half + 1] - line[centre - half]
    return sums
