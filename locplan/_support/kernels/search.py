"""Exact shortest paths on an 8-connected grid, with buckets instead of a heap.

Dijkstra's algorithm and A* with circular buckets (Dial, 1969): each bucket is a range of costs. If
buckets are as narrow as the cheapest step, Dijkstra's cells in the lowest one are final and need no
sorting. A*, and wider buckets for costs of a high contrast, expand a cell again if that lowers its
cost. Cells leave a bucket in order of arrival, so repeats are few: 0 to 3 % on maps. On noise over
nine magnitudes as many cells are expanded again, still no slower than with a heap.

The kernels work on a flat grid with a blocked border that holds half of each cell's density: a step
costs its length times the sum of its two cells' halves. Arrays of a map's size come from numpy,
which requests huge pages. The memory of the next cells is prefetched, because far from the start a
front of cells exceeds the caches.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Floats, Ints
from locplan._support.kernels.simd import prefetch

MAX_BUCKETS = 1 << 16
"""Greatest number of buckets; cells that are to come later wait in the last one."""
SQRT2 = np.sqrt(2.0)
MOVES = ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (-1, 1), (1, -1), (1, 1))
"""The steps to the neighbours, as rows and columns."""
ROWS = (-1, -1, -1, 0, 0, 1, 1, 1)
COLUMNS = (-1, 0, 1, -1, 1, -1, 0, 1)
"""The same in the order of rows and columns, in which `locplan._support.kernels.ways.trace_path`
takes
the first of those that cost the same; a byte that holds steps has a bit for each."""
LENGTHS = (SQRT2, 1.0, SQRT2, 1.0, 1.0, SQRT2, 1.0, SQRT2)
_LENGTHS = (1.0,) * 4 + (SQRT2,) * 4
TIE = 1e-10
"""Share by which rounding may set paths of one cost apart."""
ROOM = 4096
"""Number of cells for which there is room at first, in the queue and in its batch."""
STRETCH = 1 << 20
"""Number of expansions between two looks at the clock, and two calls of a check."""
_UNUSED, _USED, _WAITING, _LOWEST, _EXPANDED, _LEFT = range(6)
_FINISHED, _OUT_OF_ROOM, _PAUSED = range(3)
WIDTH_TO_MEAN, WIDTH_TO_MAX = 2.0**-10, 2.0**-26
"""Least width of a bucket, as shares of the mean and the greatest density: of a high contrast
little lies below, and few empty buckets are visited. With 2^-14 of the mean in place of 2^-10, the
search for the least integral of u takes 1.3 times as long at 4000 x 4000 cells."""


class CostScale(NamedTuple):
    """Scale of a map's costs, which sets the width of a search's buckets."""

    cheapest: float  # minimum density
    costliest: float  # maximum density of a free cell
    mean: float  # mean density of the free cells

    @property
    def width(self) -> float:
        """Width of a bucket [density x cells]."""
        min_width = max(WIDTH_TO_MEAN * self.mean, WIDTH_TO_MAX * self.costliest)
        return max(self.cheapest, min_width) or 1.0


def measure_cost_scale(half_density: Floats) -> CostScale:
    """Return the scale of the costs of a bordered grid."""
    cheapest, costliest, total, free = find_cost_range(half_density)
    return (
        CostScale(2 * cheapest, 2 * costliest, 2 * total / free)
        if free
        else CostScale(0.0, 0.0, 0.0)
    )


@njit(nogil=True, cache=True)
def find_cost_range(half_density: Floats) -> tuple[float, float, float, int]:
    """Return minimum, maximum and sum of the values of free cells, and their number."""
    smallest, greatest, total, free = np.inf, 0.0, 0.0, 0
    for value in half_density:
        if value < np.inf:
            smallest, greatest = min(smallest, value), max(greatest, value)
            total += value
            free += 1
    return smallest, greatest, total, free


class BucketQueue(NamedTuple):
    """Queue of the cells to expand, in buckets."""

    state: Ints
    """First entry free again, number of entries ever used, number that wait, lowest bucket,
    number of cells expanded, and number of cells left of that bucket."""
    heads: NDArray[np.int32]  # first entry of each bucket
    cells: NDArray[np.uint32]  # cell of each entry
    following: NDArray[np.int32]  # next entry in the same bucket, or in the chain of free entries
    batch: NDArray[np.uint32]  # cells taken out of the lowest bucket; the last one is the next


class SearchResult(NamedTuple):
    """Costs of a search, the number of its expansions, and whether it has finished."""

    cost: Floats
    """Cost from the start to each cell, flat [density x cells]: infinite where nothing was seen,
    an upper bound for a cell that was not expanded, and the negative of the cost for one that was
    (so that no other array has to tell)."""
    expanded: int
    """Number of expansions."""
    finished: bool
    """False if there was no time left."""


def make_bordered_half_density(density: Floats, border: int) -> Array:
    """Return half the density with a blocked border of `border` cells, flat."""
    rows, columns = density.shape
    half = np.full((rows + 2 * border, columns + 2 * border), np.inf)
    np.multiply(density, 0.5, out=half[border : border + rows, border : border + columns])
    return half.reshape(-1)


def compute_shortest_costs(
    half: Floats, columns: int, start: int, goal: int, corner_cutting: bool
) -> Array:
    """Return the cost from a cell to every cell, flat [density x cells].

    Parameters
    ----------
    half : (n,) array
        Half the density, see `make_bordered_half_density`.
    columns : int
        Number of columns of the bordered grid.
    start, goal : int
        Flat indices. With `goal` >= 0 the search ends when the goal's cost is final. The remaining
        costs are then upper bounds, infinite for unseen cells.
    corner_cutting : bool
        True if a diagonal step may pass a blocked cell's corner.
    """
    cost = search_grid(half, columns, start, goal, corner_cutting, measure_cost_scale(half)).cost
    return np.abs(cost, out=cost)


def search_grid(
    half_density: Floats,
    columns: int,
    start: int,
    goal: int,
    corner_cutting: bool,
    scale: CostScale,
    *,
    guided: bool = False,
    until: float = np.inf,
    check: Callable[[], None] | None = None,
) -> SearchResult:
    """Search from a cell as `compute_shortest_costs` does, and count the expanded cells.

    Parameters
    ----------
    scale : CostScale
        The scale of `half_density`, see `measure_cost_scale`.
    guided : bool
        True for A* with the octile distance to `goal` times the minimum density, which never
        overestimates. It expands all cells on cheapest paths, and finds the same cost and path
        as Dijkstra's algorithm.
    until : float
        Time of `time.perf_counter` after which the search ends unfinished [s].
    check : callable, optional
        Called regularly; an exception that it raises ends the search.
    """
    cost = np.full(half_density.size, np.inf)
    if half_density[start] == np.inf:
        return SearchResult(cost, 0, True)
    cost[start] = 0.0
    per_cost = 1.0 / scale.width
    rate = scale.cheapest if guided else 0.0
    # A step raises A*'s sum of cost and distance to go by at most twice what it costs.
    farthest = (2.0 if guided else 1.0) * SQRT2 * scale.costliest * per_cost
    buckets = 2
    while buckets < min(farthest + 2, MAX_BUCKETS):
        buckets *= 2
    (row, col), (goal_row, goal_col) = divmod(start, columns), divmod(goal, columns)
    lowest = int(compute_octile_cost.py_func(row - goal_row, col - goal_col, rate) * per_cost)
    queue = BucketQueue(
        state=np.array([-1, 1, 1, lowest, 0, 0]),
        heads=np.full(buckets, -1, np.int32),
        cells=np.full(ROOM, start, np.uint32),
        following=np.full(ROOM, -1, np.int32),
        batch=np.empty(ROOM, np.uint32),
    )
    queue.heads[lowest % buckets] = 0
    terms = SearchConstants(columns, goal, corner_cutting, per_cost, rate)
    while True:
        status = expand_cells(queue, half_density, cost, terms, STRETCH)
        if status == _OUT_OF_ROOM:
            cells, following = (np.concatenate([a, a]) for a in (queue.cells, queue.following))
            queue = queue._replace(cells=cells, following=following)
        elif status == _FINISHED or time.perf_counter() > until:
            return SearchResult(cost, int(queue.state[_EXPANDED]), status == _FINISHED)
        elif check is not None:
            check()


class SearchConstants(NamedTuple):
    """Constants of a search."""

    columns: int  # of the bordered grid
    goal: int
    corner_cutting: bool
    per_cost: float  # buckets per cost
    rate: float  # the minimum density for A*, 0 for Dijkstra's algorithm


@njit(nogil=True, cache=True, error_model="numpy")
def expand_cells(
    queue: BucketQueue, half_density: Floats, cost: Floats, terms: SearchConstants, expansions: int
) -> int:
    """Continue a search until it has ended, is out of space, or has expanded so many cells.

    `cost` is the array of `SearchResult`.
    """
    state, heads, batch = queue.state, queue.heads, queue.batch
    cells, following = queue.cells, queue.following
    mask, cost_limit = heads.size - 1, np.inf
    pausing = state[_EXPANDED] + expansions
    if terms.goal >= 0:
        cost_limit = abs(cost[terms.goal]) * (1 + TIE)
    while True:
        if state[_LEFT] == 0:
            lowest = state[_LOWEST]
            if state[_WAITING] == 0 or lowest > cost_limit * terms.per_cost:
                return _FINISHED
            node, left = heads[lowest & mask], 0
            if node < 0:
                state[_LOWEST] += 1
                continue
            if state[_EXPANDED] >= pausing:
                return _PAUSED
            # A bucket's newest cell is its first, and will be the last of the batch: cells leave
            # in the order in which they came, so that few are expanded anew.
            while node >= 0 and left < batch.size:
                batch[left] = cells[node]
                left += 1
                after = following[node]
                following[node], state[_UNUSED] = state[_UNUSED], node
                node = after
            heads[lowest & mask], state[_LEFT] = node, left
            state[_WAITING] -= left
        cost_limit = expand_batch(queue, half_density, cost, terms, cost_limit)
        if state[_LEFT]:
            return _OUT_OF_ROOM


@njit(nogil=True, cache=True, error_model="numpy")
def expand_batch(
    queue: BucketQueue,
    half_density: Floats,
    cost: Floats,
    terms: SearchConstants,
    cost_limit: float,
) -> float:
    """Expand the cells of the batch while there is space; return the cost at which to end.

    The result is `cost_limit`, or less if the goal is reached. The other arguments are the same as
    in `expand_cells`.
    """
    columns, goal, corner_cutting, per_cost, rate = terms
    # All arrays have local names: numba counts references to those that are passed on.
    state, heads, batch = queue.state, queue.heads, queue.batch
    cells, following = queue.cells, queue.following
    unused, used, waiting = state[_UNUSED], state[_USED], state[_WAITING]
    lowest, expanded, left = state[_LOWEST], state[_EXPANDED], state[_LEFT]
    # Unsigned, which numba need not check for counting from the end.
    unit, width, end, mask = np.uint64(1), np.uint64(columns), np.uint64(goal), heads.size - 1
    goal_row, goal_col = goal // columns, goal % columns
    corner = np.nan if corner_cutting else np.inf  # nothing equals NaN
    while left and used + 8 <= cells.size:
        left -= 1
        # Memory is fetched two cells ahead; from 1 to 8 the times are alike.
        cell, coming = np.uint64(batch[left]), np.int64(batch[max(left - 2, 0)])
        for row_shift in (-columns, 0, columns):
            prefetch(cost, coming + row_shift)
            prefetch(half_density, coming + row_shift)
        cell_cost = cost[cell]
        if cell_cost < 0:  # it was expanded since it was put into this bucket
            continue
        row, col, total = 0, 0, cell_cost
        if rate > 0:
            row, col = int(cell // width) - goal_row, int(cell % width) - goal_col
            total += compute_octile_cost(row, col, rate)
        if total >= cost_limit:
            continue
        bucket = np.int64(total * per_cost)
        if bucket > lowest:  # it waited in the last bucket that there was
            slot = min(bucket, lowest + mask) & mask
            unused, used = put_into_bucket(cell, slot, heads, cells, following, unused, used)
            waiting += 1
            continue
        cost[cell], cell_half = -cell_cost, half_density[cell]
        expanded += 1
        south, north, west, east = cell - width, cell + width, cell - unit, cell + unit
        neighbours = (
            south,
            north,
            west,
            east,
            south - unit,
            south + unit,
            north - unit,
            north + unit,
        )
        # The two cells beside a diagonal step, whose corner it may cut.
        first_flanks = cell, cell, cell, cell, south, south, north, north
        second_flanks = cell, cell, cell, cell, west, east, west, east
        for n in range(8):
            neighbour = neighbours[n]
            reached = cell_cost + _LENGTHS[n] * (cell_half + half_density[neighbour])
            if (
                not reached < abs(cost[neighbour])
                or half_density[first_flanks[n]] + half_density[second_flanks[n]] == corner
            ):
                continue
            total = reached
            if rate > 0:
                total += compute_octile_cost(row + MOVES[n][0], col + MOVES[n][1], rate)
            if total >= cost_limit:
                continue
            if neighbour == end:
                cost_limit = reached * (1 + TIE)
            cost[neighbour] = reached
            bucket = min(max(np.int64(total * per_cost), lowest), lowest + mask)
            unused, used = put_into_bucket(
                neighbour, bucket & mask, heads, cells, following, unused, used
            )
            waiting += 1
    state[_UNUSED], state[_USED], state[_WAITING] = unused, used, waiting
    state[_EXPANDED], state[_LEFT] = expanded, left
    return cost_limit


@njit(inline="always")
def compute_octile_cost(rows: int, columns: int, rate: float) -> float:
    """Return the cost to a cell so many rows and columns away if all cells cost `rate`."""
    rows, columns = abs(rows), abs(columns)
    return rate * (max(rows, columns) + (SQRT2 - 1.0) * min(rows, columns))


@njit(inline="always")
def put_into_bucket(
    cell: int, slot: int, heads: Array, cells: Array, following: Array, unused: int, used: int
) -> tuple[int, int]:
    """Put a cell into a bucket; return the first free entry and the number of entries ever used."""
    node = unused
    if node >= 0:
        unused = following[node]
    else:
        node = used
        used += 1
    cells[node], following[node], heads[slot] = cell, heads[slot], node
    return unused, used
