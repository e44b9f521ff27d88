"""Flips of a map's cells, which make a simulated world of it."""

from __future__ import annotations

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Bools, Ints

GAMMA = np.uint64(0x9E3779B97F4A7C15)
MIX = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
SHIFTS = np.uint64(30), np.uint64(27), np.uint64(31)
"""Constants of splitmix64 (Steele, Lea and Flood, 2014)."""
LOW, HALF = np.uint64(11), np.uint64(32)
"""Bits of a hash that a float has no room for, and bits of a row or a column."""


@njit(nogil=True, cache=True)
def flip_cells(
    is_occupied: Bools,
    cells: Ints,
    first_row: int,
    first_col: int,
    flip_share: float,
    seed: np.uint64,
) -> None:
    """Flip a share of some cells in place, selected by a hash of the seed and of each cell.

    Parts of a map therefore have the flips of the whole map, and maps that differ in some cells
    have the same flips elsewhere.

    Parameters
    ----------
    is_occupied : (H, W) array
        The part of the map.
    cells : (n, 2) array
        Row and column in the part of the cells that may flip.
    first_row, first_col : int
        Row and column of the part's first cell in the map.
    flip_share : float
        Probability with which each flips.
    seed : uint64
        Seed of the hash.
    """
    for n in range(len(cells)):
        i, j = cells[n, 0], cells[n, 1]
        # The counter of splitmix64 is the cell's number, so that cells need no order.
        key = (np.uint64(first_row + i) << HALF) | np.uint64(first_col + j)
        bits = seed + (key + np.uint64(1)) * GAMMA
        bits = (bits ^ (bits >> SHIFTS[0])) * MIX[0]
        bits = (bits ^ (bits >> SHIFTS[1])) * MIX[1]
        bits ^= bits >> SHIFTS[2]
        if (bits >> LOW) * 2.0**-53 < flip_share:
            is_occupied[i, j] = not is_occupied[i, j]
