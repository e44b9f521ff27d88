"""Exact shortest paths on an 8-connected grid with buckets instead of a heap.

Dijkstra's algorithm with circular buckets (Dial, 1969): with buckets as narrow as the cheapest
step, every cell in the lowest bucket is final and nothing has to be sorted. Where costs differ so
much that this would take too many buckets they are wider, and a cell that improves within its
bucket is visited again, so that the result is exact all the same.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

MOST_BUCKETS = 1 << 16
_DROW = np.array([-1, 1, 0, 0, -1, -1, 1, 1])
_DCOL = np.array([0, 0, -1, 1, -1, 1, -1, 1])


@njit(nogil=True, cache=True)
def shortest_costs(
    density: NDArray[np.float64], start: int, goal: int, corner_cutting: bool
) -> NDArray:
    """Cost from a cell to all others, (H + 2, W + 2) flat with a blocked border [density x cells].

    A step costs its length times the mean density of its two cells; infinite density blocks.
    Cells are indices of the flat, bordered grid. With `goal` >= 0 the search ends once the goal's
    cost is final; other costs are then upper bounds, infinite where nothing was seen.
    """
    half, width = _bordered_half(density)
    around, lengths = _neighbours(width)
    cheapest, dearest = np.inf, 0.0
    for value in half:
        if value < np.inf:
            cheapest, dearest = min(cheapest, 2 * value), max(dearest, 2 * value)
    cost = np.full(half.size, np.inf)
    cost[start] = 0.0
    if half[start] == np.inf:
        return cost
    longest = np.sqrt(2.0) * dearest
    bucket_width = max(cheapest, longest / MOST_BUCKETS)
    buckets = int(longest / bucket_width) + 2
    heads = np.full(buckets, -1, np.int64)
    cells, following = np.empty(1024, np.int64), np.empty(1024, np.int64)
    done = np.zeros(half.size, np.bool_)
    cells[0], following[0], heads[0] = start, -1, 0
    used, unused, waiting, lowest = 1, -1, 1, 0
    while waiting:
        if goal >= 0 and lowest * bucket_width > cost[goal]:
            break
        slot = lowest % buckets
        while heads[slot] >= 0:
            entry = heads[slot]
            heads[slot], cell = following[entry], cells[entry]
            following[entry], unused = unused, entry
            waiting -= 1
            if done[cell]:
                continue
            done[cell] = True
            for n in range(8):
                other = cell + around[n]
                reached = cost[cell] + lengths[n] * (half[cell] + half[other])
                if reached >= cost[other]:
                    continue
                if n >= 4 and not corner_cutting and _cuts_corner(half, cell, around[n], width):
                    continue
                cost[other], done[other] = reached, False
                if unused >= 0:
                    entry, unused = unused, following[unused]
                else:
                    if used == cells.size:
                        cells = np.concatenate((cells, np.empty_like(cells)))
                        following = np.concatenate((following, np.empty_like(following)))
                    entry, used = used, used + 1
                to = int(reached / bucket_width) % buckets
                cells[entry], following[entry], heads[to] = other, heads[to], entry
                waiting += 1
        lowest += 1
    return cost


@njit(nogil=True, cache=True)
def trace(
    density: NDArray[np.float64], cost: NDArray[np.float64], goal: int, corner_cutting: bool
) -> NDArray:
    """Cells from the search's start to `goal`, each the cheapest way into the next."""
    half, width = _bordered_half(density)
    around, lengths = _neighbours(width)
    cells = [goal]
    while cost[cells[-1]] > 0:
        cell, least, before = cells[-1], np.inf, -1
        for n in range(8):
            other = cell + around[n]
            through = cost[other] + lengths[n] * (half[cell] + half[other])
            if through < least and not (
                n >= 4 and not corner_cutting and _cuts_corner(half, cell, around[n], width)
            ):
                least, before = through, other
        cells.append(before)
    return np.array(cells[::-1])


@njit(nogil=True, cache=True)
def _bordered_half(density: NDArray[np.float64]) -> tuple[NDArray, int]:
    """Half the density with a blocked border, flat, and the bordered width."""
    rows, cols = density.shape
    half = np.full((rows + 2, cols + 2), np.inf)
    half[1:-1, 1:-1] = density / 2
    return half.reshape(-1), cols + 2


@njit(nogil=True, cache=True)
def _neighbours(width: int) -> tuple[NDArray, NDArray]:
    return _DROW * width + _DCOL, np.sqrt((_DROW**2 + _DCOL**2).astype(np.float64))


@njit(inline="always")
def _cuts_corner(half: NDArray[np.float64], cell: int, diagonal: int, width: int) -> bool:
    """Whether one of the two cells beside a diagonal step is blocked."""
    vertical = width if diagonal > 0 else -width
    return half[cell + vertical] == np.inf or half[cell + diagonal - vertical] == np.inf
