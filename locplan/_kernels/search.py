"""Exact shortest paths on an 8-connected grid, with buckets instead of a heap.

Dijkstra's algorithm with circular buckets (Dial, 1969): with buckets as narrow as the cheapest
step, every cell in the lowest bucket is final and nothing has to be sorted. Where costs differ so
much that this would take too many buckets, a heap is used instead.

The kernels work on a flat grid with a blocked border that holds half of each cell's density: a
step costs its length times the sum of its two cells' halves.
"""

from __future__ import annotations

from heapq import heappop, heappush
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

MAX_BUCKETS = 1 << 14
SQRT2 = np.sqrt(2.0)
_UNUSED, _USED, _WAITING = 0, 1, 2
"""Indices of the pool of entries: first one free again, number ever used, number that wait."""


@njit(nogil=True, cache=True)
def bordered_half(density: NDArray[np.float64], border: int) -> NDArray[Any]:
    """Half the density with a blocked border of `border` cells, flat."""
    rows, cols = density.shape
    half = np.full((rows + 2 * border, cols + 2 * border), np.inf)
    for row in range(rows):
        for col in range(cols):
            half[row + border, col + border] = density[row, col] / 2
    return half.reshape(-1)


def shortest_costs(
    half: NDArray[np.float64], columns: int, start: int, goal: int, corner_cutting: bool
) -> NDArray[Any]:
    """Cost from a cell to all others, flat [density x cells].

    Parameters
    ----------
    half : (n,) array
        Half the density, see `bordered_half`.
    columns : int
        Number of columns of the bordered grid.
    start, goal : int
        Flat indices. With `goal` >= 0 the search ends once the goal's cost is final; other costs
        are then upper bounds, infinite where nothing was seen.
    corner_cutting : bool
        Whether a diagonal step may pass a blocked cell's corner.
    """
    per_cost, buckets = bucket_scale(half, SQRT2)
    if not buckets:
        return costs_by_heap(half, columns, start, goal, corner_cutting)
    return costs_by_buckets(half, columns, start, goal, corner_cutting, per_cost, buckets)


@njit(nogil=True, cache=True, error_model="numpy")
def costs_by_buckets(
    half: NDArray[np.float64],
    columns: int,
    start: int,
    goal: int,
    corner_cutting: bool,
    per_cost: float,
    buckets: int,
) -> NDArray[Any]:
    """`shortest_costs` with buckets; `per_cost` and `buckets` are those of `bucket_scale`."""
    cost = np.full(half.size, np.inf)
    if half[start] == np.inf:
        return cost
    cost[start] = 0.0
    mask = np.uint64(buckets - 1)
    heads = np.full(buckets, -1, np.int32)
    cells, following = np.empty(4096, np.uint32), np.empty(4096, np.int32)
    pool = np.array([-1, 1, 1])
    cells[0], following[0], heads[0] = start, -1, 0
    done = np.zeros(half.size, np.uint8)
    one, width, lowest = np.uint64(1), np.uint64(columns), 0
    while pool[_WAITING]:
        if goal >= 0 and lowest > cost[goal] * per_cost:
            break
        slot = np.uint64(lowest) & mask
        while heads[slot] >= 0:
            entry = heads[slot]
            heads[slot], following[entry] = following[entry], pool[_UNUSED]
            pool[_UNUSED] = entry
            pool[_WAITING] -= 1
            cell = np.uint64(cells[entry])
            if done[cell]:
                continue
            done[cell] = 1
            if pool[_USED] + 8 > cells.size:
                cells = np.concatenate((cells, np.empty_like(cells)))
                following = np.concatenate((following, np.empty_like(following)))
            here, own = cost[cell], half[cell]
            south, north = cell - width, cell + width
            for other in (south, north, cell - one, cell + one):
                reached = here + (own + half[other])
                if reached < cost[other]:
                    cost[other], done[other] = reached, 0
                    bucket = np.uint64(reached * per_cost) & mask
                    enqueue(other, bucket, heads, cells, following, pool)
            for beside in (south, north):
                for straight in (cell - one, cell + one):
                    other = beside + straight - cell
                    reached = here + SQRT2 * (own + half[other])
                    if reached < cost[other] and (
                        corner_cutting or (half[beside] < np.inf and half[straight] < np.inf)
                    ):
                        cost[other], done[other] = reached, 0
                        bucket = np.uint64(reached * per_cost) & mask
                        enqueue(other, bucket, heads, cells, following, pool)
        lowest += 1
    return cost


@njit(nogil=True, cache=True)
def trace(
    half: NDArray[np.float64],
    columns: int,
    cost: NDArray[np.float64],
    goal: int,
    corner_cutting: bool,
) -> NDArray[Any]:
    """Cells from the search's start to `goal`; each is on the cheapest way to the next."""
    cells = [goal]
    while cost[cells[-1]] > 0:
        cell, least, before = cells[-1], np.inf, -1
        for vertical in (-columns, 0, columns):
            for horizontal in (-1, 0, 1):
                other = cell + vertical + horizontal
                if half[other] == np.inf or other == cell:
                    continue
                length = 1.0
                if vertical != 0 and horizontal != 0:
                    length = SQRT2
                    beside = half[cell + vertical] + half[cell + horizontal]
                    if beside == np.inf and not corner_cutting:
                        continue
                through = cost[other] + length * (half[cell] + half[other])
                if through < least:
                    least, before = through, other
        cells.append(before)
    return np.array(cells[::-1])


@njit(nogil=True, cache=True)
def bucket_scale(half: NDArray[np.float64], longest: float) -> tuple[float, int]:
    """Buckets per cost, and their number, a power of two (0: too many), for steps to `longest`."""
    cheapest, costliest = np.inf, 0.0
    for value in half:
        if value < np.inf:
            cheapest, costliest = min(cheapest, 2 * value), max(costliest, 2 * value)
    if cheapest * MAX_BUCKETS <= longest * costliest:
        return 0.0, 0
    buckets = 2
    while buckets < longest * costliest / cheapest + 2:
        buckets *= 2
    return 1.0 / cheapest, buckets


@njit(nogil=True, cache=True)
def costs_by_heap(
    half: NDArray[np.float64], columns: int, start: int, goal: int, corner_cutting: bool
) -> NDArray[Any]:
    """`shortest_costs` with a binary heap: three times as slow, but for any ratio of costs."""
    cost = np.full(half.size, np.inf)
    if half[start] == np.inf:
        return cost
    cost[start] = 0.0
    queue = [(0.0, start)]
    while queue:
        reached, cell = heappop(queue)
        if cell == goal:
            break
        if reached > cost[cell]:
            continue
        for vertical in (-columns, 0, columns):
            for horizontal in (-1, 0, 1):
                other = cell + vertical + horizontal
                step = half[cell] + half[other]
                if vertical != 0 and horizontal != 0:
                    beside = half[cell + vertical] + half[cell + horizontal]
                    if beside == np.inf and not corner_cutting:
                        continue
                    step *= SQRT2
                if reached + step < cost[other]:
                    cost[other] = reached + step
                    heappush(queue, (cost[other], other))
    return cost


@njit(inline="always")
def enqueue(
    cell: int,
    bucket: int,
    heads: NDArray[Any],
    cells: NDArray[Any],
    following: NDArray[Any],
    pool: NDArray[Any],
) -> None:
    """Put a cell into a bucket."""
    entry = pool[_UNUSED]
    if entry >= 0:
        pool[_UNUSED] = following[entry]
    else:
        entry = pool[_USED]
        pool[_USED] += 1
    cells[entry], following[entry], heads[bucket] = cell, heads[bucket], entry
    pool[_WAITING] += 1
