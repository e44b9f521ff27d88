"""What a search from a cell leaves behind in a byte a cell: the steps on cheapest ways to it.

Rounding sets paths of one cost apart, and which of them a planner takes depends on the end that it
searches from. The bytes hold all steps that may be on the cheapest path by either search; among
these few cells the costs from the start are summed up anew, as the planner's search does.

Grids are flat with a blocked border and hold half of each cell's density, see
`locplan._kernels.search`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.search import SQRT2, TIE

EPSILON = 2.0**-53
"""Greatest relative error of a sum of two numbers."""
ROOM = 256
"""Number of cells, and of pages, for which there is room at first."""
PAGE = 6
IN_PAGE = (1 << PAGE) - 1
"""A cell's place stands in a page of 2^6 cells of a row; a path needs few pages of a map."""
_ROWS = (-1, -1, -1, 0, 0, 1, 1, 1)
_COLUMNS = (-1, 0, 1, -1, 1, -1, 0, 1)
"""The steps to the neighbours by bit, in the order in which `locplan._kernels.search.trace` takes
the first one of those that cost the same."""


def tolerance_of(cost: NDArray[np.float64], cheapest: float) -> float:
    """Cost by which rounding may set the steps of cheapest paths apart, for `steps_back`.

    Sums of so many steps of at least the cost `cheapest` are rounded by so much from either end.
    It stays below half a step: then the steps that are kept always lead towards the start.
    """
    greatest = greatest_cost(cost)
    rounding = 4 * EPSILON * greatest / cheapest
    return min(greatest * min(rounding, TIE), cheapest / 2)


@njit(nogil=True, cache=True)
def greatest_cost(cost: NDArray[np.float64]) -> float:
    """Greatest finite cost of a search, whose costs may be negative."""
    bits, none = cost.view(np.int64), np.int64(0x7FF0000000000000)  # that of infinity
    greatest = np.zeros(1, np.int64)
    for k in range(bits.size):  # whole numbers are compared in vectors; they sort as the costs do
        value = bits[k] & np.int64(0x7FFFFFFFFFFFFFFF)
        greatest[0] = max(greatest[0], value if value < none else 0)
    return float(greatest.view(np.float64)[0])


@njit(nogil=True, cache=True, error_model="numpy")
def steps_back(
    half: NDArray[np.float64], columns: int, cost: NDArray[np.float64], tolerance: float
) -> NDArray[Any]:
    """Steps from each cell that cost at most `tolerance` more than a cheapest way to the start.

    `cost` is that of a finished search without a goal, in which no corner was cut. The result has
    a bit for each of the eight steps, in the order of rows and columns.
    """
    steps = np.zeros(half.size, np.uint8)
    count = columns - 2
    for first in range(columns + 1, half.size - columns, columns):
        here, own = cost[first : first + count], half[first : first + count]
        found = steps[first : first + count]
        for n in range(8):  # one plain loop over a row for each step: it runs in vectors
            beside, aside = first + _ROWS[n] * columns, first + _COLUMNS[n]
            at, bit = beside + _COLUMNS[n], np.uint8(1 << n)
            there, theirs = cost[at : at + count], half[at : at + count]
            if _ROWS[n] == 0 or _COLUMNS[n] == 0:
                for k in range(count):
                    through = abs(there[k]) + (own[k] + theirs[k])
                    most = abs(here[k]) + tolerance
                    found[k] |= bit * np.uint8((through <= most) & (through < np.inf))
                continue
            one, other = half[beside : beside + count], half[aside : aside + count]
            for k in range(count):
                through = abs(there[k]) + SQRT2 * (own[k] + theirs[k])
                most, free = abs(here[k]) + tolerance, one[k] + other[k] < np.inf
                found[k] |= bit * np.uint8((through <= most) & (through < np.inf) & free)
    return steps


@njit(nogil=True, cache=True, error_model="numpy")
def cheapest_cells(
    half: NDArray[np.float64],
    columns: int,
    steps: NDArray[np.uint8],
    root: int,
    tip: int,
    from_root: bool,
) -> NDArray[Any]:
    """Cells of the cheapest path between the cell that was searched from, `root`, and `tip`.

    It is bit by bit what a search from its first cell to its last one finds, and `trace` then
    takes. It leads from `root` to `tip` if `from_root`, else from `tip` to `root`. `steps` are
    those of `steps_back`, and lead from `tip` to `root`.
    """
    table, pages = np.zeros((half.size >> PAGE) + 1, np.int32), np.zeros(ROOM << PAGE, np.int32)
    cells, waits = np.empty(ROOM, np.int64), np.zeros(ROOM, np.int8)
    table[tip >> PAGE], opened = 1, 2
    pages[(1 << PAGE) + (tip & IN_PAGE)] = 1
    cells[0], used, at = tip, 1, 0
    while at < used:
        if used + 8 > cells.size:
            cells = np.concatenate((cells, np.empty_like(cells)))
            waits = np.concatenate((waits, np.zeros_like(waits)))
        if (opened + 8) << PAGE > pages.size:
            pages = np.concatenate((pages, np.zeros_like(pages)))
        cell = cells[at]
        bits = steps[cell]
        for n in range(8):
            if bits >> n & 1:
                other = cell + _ROWS[n] * columns + _COLUMNS[n]
                place = place_of(table, pages, other)
                if place < 0:
                    if table[other >> PAGE] == 0:
                        table[other >> PAGE] = opened
                        opened += 1
                    cells[used], place = other, used
                    used += 1
                    pages[(table[other >> PAGE] << PAGE) + (other & IN_PAGE)] = used
                waits[place] += 1
        at += 1
    # Each cell after all those from which a step leads to it; the last one is the root.
    order = np.empty(used, np.int64)
    order[0], done, at = 0, 1, 0
    while at < done:
        cell = cells[order[at]]
        bits = steps[cell]
        for n in range(8):
            if bits >> n & 1:
                place = place_of(table, pages, cell + _ROWS[n] * columns + _COLUMNS[n])
                waits[place] -= 1
                if waits[place] == 0:
                    order[done] = place
                    done += 1
        at += 1
    cost = np.empty(used)
    for k in range(used):
        cost[k] = np.inf
    start, goal = (root, tip) if from_root else (tip, root)
    cost[place_of(table, pages, start)] = 0.0
    for at in range(used):
        k = order[used - 1 - at] if from_root else order[at]
        cell = cells[k]
        bits = steps[cell]
        for n in range(8):
            if bits >> n & 1:
                other = cell + _ROWS[n] * columns + _COLUMNS[n]
                length = SQRT2 if _ROWS[n] and _COLUMNS[n] else 1.0
                step, m = length * (half[cell] + half[other]), place_of(table, pages, other)
                if from_root:
                    cost[k] = min(cost[k], cost[m] + step)
                else:
                    cost[m] = min(cost[m], cost[k] + step)
    path = [goal]
    while path[-1] != start and len(path) < used:
        cell, least, before = path[-1], np.inf, -1
        for n in range(8):
            beside, aside = cell + _ROWS[n] * columns, cell + _COLUMNS[n]
            other = beside + _COLUMNS[n]
            place = place_of(table, pages, other)
            if place < 0:
                continue
            length = 1.0
            if _ROWS[n] and _COLUMNS[n]:
                length = SQRT2
                if half[beside] + half[aside] == np.inf:
                    continue
            through = cost[place] + length * (half[cell] + half[other])
            if through < least:
                least, before = through, other
        path.append(before)
    return np.array(path[::-1])


@njit(inline="always")
def place_of(table: NDArray[np.int32], pages: NDArray[np.int32], cell: int) -> int:
    """Place of a cell among those that were found, -1 if it is not: page 0 is empty."""
    return int(pages[(table[cell >> PAGE] << PAGE) + (cell & IN_PAGE)]) - 1
