"""The visible part of the disc around a cell, in squares of 8 x 8 cells."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.bitplanes import SQUARE
from locplan._kernels.templates import Disc, Sight


@njit(nogil=True, cache=True)
def see(sight: Sight, n: int, disc: Disc, masks: NDArray[np.uint64]) -> None:
    """Write the cells of the disc seen from the n-th cell, turned to each heading, as bits."""
    radius, levels = sight.radius, sight.levels
    row, col = sight.rows[n], sight.cols[n]
    reach = np.empty(sight.cos.size, np.int64)
    for b in range(reach.size):
        first = 2 * radius
        for step in range(1, 2 * radius + 1):
            i = row + int(np.floor(sight.sin[b] * (step / 2) + 0.5))
            j = col + int(np.floor(sight.cos[b] * (step / 2) + 0.5))
            inside = 0 <= i < levels.shape[0] and 0 <= j < levels.shape[1]
            if (i != row or j != col) and not (inside and levels[i, j] == 254):
                first = step
                break
        reach[b] = (first + 1 + 2 * sight.behind) ** 2
    for k in range(masks.shape[0]):
        for n in range(disc.words.size):
            word = np.uint64(0)
            if disc.words[n] != 0:
                for bit in range(SQUARE * SQUARE):
                    seen = sight.distance[n, bit] <= reach[sight.beam[k, n, bit]]
                    word |= np.uint64(seen) << np.uint64(bit)
            masks[k, n] = word & disc.words[n]
