"""All best trade-offs between two costs on an 8-connected grid (bi-objective A*).

BOA* (Hernandez Ulloa et al., ICAPS 2020): labels leave the queue in the order of their first cost,
so that a label is dominated exactly if its second cost is not less than the least one so far at its
cell, or at the goal. The queue consists of buckets over the first cost; the lowest one is a heap.

Costs are whole numbers, kept as floats: both costs of a diagonal step are rounded up, so that the
bounds from searches with unrounded steps stay valid, and equal costs compare as equal. Cells are
indices of a flat grid with a blocked border (`locplan._kernels.search`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.search import SQRT2

SCALE = 1 << 34
"""Units of cost per cell; floats hold the sums exactly over 370,000 cells at this rate."""
BUCKETS, BUCKETS_A_CELL = 64, 16
"""Number of buckets, and of those per cell; a step raises the first bound by <= 2 sqrt(2) cells."""
FINISHED, OUT_OF_LABELS, PAUSED = 0, 1, 2
STATUS, UNUSED, USED, WAITING, LOWEST, IN_HEAP, SOLUTIONS = range(7)
"""Indices of `Labels.state`."""


class Labels(NamedTuple):
    """The labels of a search: paths from the start to a cell."""

    state: NDArray[np.int64]
    """State of the search, at the indices STATUS to SOLUTIONS."""
    cell: NDArray[np.int32]
    """Cell in which each label's path ends."""
    first: NDArray[np.float64]
    """First cost of each path."""
    second: NDArray[np.float64]
    """Second cost of each path."""
    parent: NDArray[np.int32]
    """Label before each label on its path, or -1."""
    following: NDArray[np.int32]
    """Next label in the same bucket, or in the chain of free labels."""
    heads: NDArray[np.int32]
    """First label of every bucket."""
    heap: NDArray[np.int32]
    """Labels of the lowest bucket."""
    heap_first: NDArray[np.float64]
    heap_second: NDArray[np.float64]
    """Bounds on both costs of the heap's labels, by which it is ordered."""
    least: NDArray[np.float64]
    """Least second cost of the paths that were expanded at each cell."""


@njit(nogil=True, cache=True)
def search(
    labels: Labels,
    half: NDArray[np.float64],
    columns: int,
    goal: int,
    first_to_go: NDArray[np.float64],
    second_to_go: NDArray[np.float64],
    both_to_go: NDArray[np.float64],
    multiplier: float,
    most: float,
    corner_cutting: bool,
    expansions: int,
    solutions: NDArray[np.int32],
) -> float:
    """Continue for `expansions`; return a bound on the first cost of all solutions to come.

    Parameters
    ----------
    labels : Labels
        At the beginning just the start's label in bucket 0; `state[STATUS]` tells how it ended.
    half : (n,) array
        Half the second cost's density in whole units, infinite where blocked.
    columns, goal : int
        Number of columns of the bordered grid; flat index of the goal.
    first_to_go, second_to_go : (n,) arrays
        Lower bounds on either cost to the goal.
    both_to_go, multiplier, most
        Paths with ``first + multiplier * second > most`` are left out; `both_to_go` is a lower
        bound on that sum to the goal.
    solutions : (m,) array of int32
        Receives the labels that reached the goal; the search pauses when it is full.
    """
    state, cells, first, second = labels.state, labels.cell, labels.first, labels.second
    parents, following, heads = labels.parent, labels.following, labels.heads
    heap, heap_first, heap_second = labels.heap, labels.heap_first, labels.heap_second
    least = labels.least
    straight, diagonal = float(SCALE), np.ceil(SQRT2 * SCALE)
    per_cost = BUCKETS_A_CELL / SCALE
    begun = 0
    while True:
        if state[IN_HEAP] == 0:
            if state[WAITING] == 0:
                state[STATUS] = FINISHED
                return np.inf
            while heads[state[LOWEST] % BUCKETS] < 0:
                state[LOWEST] += 1
            slot = state[LOWEST] % BUCKETS
            label = heads[slot]
            heads[slot] = -1
            while label >= 0:
                after = following[label]
                cell = cells[label]
                state[WAITING] -= 1
                bound = second[label] + second_to_go[cell]
                if second[label] >= least[cell] or bound >= least[goal]:
                    following[label], state[UNUSED] = state[UNUSED], label
                else:
                    _push(
                        state,
                        heap,
                        heap_first,
                        heap_second,
                        label,
                        first[label] + first_to_go[cell],
                        bound,
                    )
                label = after
            continue
        if begun == expansions or state[SOLUTIONS] == solutions.size:
            state[STATUS] = PAUSED
            return heap_first[0]
        if state[USED] + 8 > cells.size:
            state[STATUS] = OUT_OF_LABELS
            return heap_first[0]
        label, bound = heap[0], heap_second[0]
        _pop(state, heap, heap_first, heap_second)
        cell = cells[label]
        if second[label] >= least[cell] or bound >= least[goal]:
            following[label], state[UNUSED] = state[UNUSED], label
            continue
        least[cell] = second[label]
        if cell == goal:
            solutions[state[SOLUTIONS]] = label
            state[SOLUTIONS] += 1
            continue
        begun += 1
        for vertical in (-columns, 0, columns):
            for horizontal in (-1, 0, 1):
                other = cell + vertical + horizontal
                if half[other] == np.inf or other == cell:
                    continue
                new_first = first[label] + straight
                new_second = second[label] + half[cell] + half[other]
                if vertical != 0 and horizontal != 0:
                    beside = half[cell + vertical] + half[cell + horizontal]
                    if beside == np.inf and not corner_cutting:
                        continue
                    new_first = first[label] + diagonal
                    new_second = second[label] + np.ceil(SQRT2 * (half[cell] + half[other]))
                if new_second >= least[other]:
                    continue
                bound = new_second + second_to_go[other]
                if bound >= least[goal]:
                    continue
                if new_first + multiplier * new_second + both_to_go[other] > most:
                    continue
                if state[UNUSED] >= 0:
                    new = state[UNUSED]
                    state[UNUSED] = following[new]
                else:
                    new = state[USED]
                    state[USED] += 1
                cells[new], first[new], second[new], parents[new] = (
                    other,
                    new_first,
                    new_second,
                    label,
                )
                bound_first = new_first + first_to_go[other]
                bucket = int(bound_first * per_cost)
                if bucket <= state[LOWEST]:
                    _push(state, heap, heap_first, heap_second, new, bound_first, bound)
                else:
                    slot = bucket % BUCKETS
                    following[new], heads[slot] = heads[slot], new
                    state[WAITING] += 1


@njit(nogil=True, cache=True)
def path_of(labels: Labels, label: int) -> NDArray[Any]:
    """Cells of a label's path, from the start on."""
    count, at = 0, label
    while at >= 0:
        count, at = count + 1, labels.parent[at]
    cells, at = np.empty(count, np.int64), label
    for n in range(count - 1, -1, -1):
        cells[n], at = labels.cell[at], labels.parent[at]
    return cells


@njit(inline="always")
def _push(
    state: NDArray[Any],
    heap: NDArray[Any],
    heap_first: NDArray[Any],
    heap_second: NDArray[Any],
    label: int,
    first: float,
    second: float,
) -> None:
    at = state[IN_HEAP]
    state[IN_HEAP] += 1
    while at > 0:
        above = (at - 1) // 2
        if heap_first[above] < first or (
            heap_first[above] == first and heap_second[above] <= second
        ):
            break
        heap[at], heap_first[at], heap_second[at] = (
            heap[above],
            heap_first[above],
            heap_second[above],
        )
        at = above
    heap[at], heap_first[at], heap_second[at] = label, first, second


@njit(inline="always")
def _pop(
    state: NDArray[Any], heap: NDArray[Any], heap_first: NDArray[Any], heap_second: NDArray[Any]
) -> None:
    state[IN_HEAP] -= 1
    last = state[IN_HEAP]
    label, first, second = heap[last], heap_first[last], heap_second[last]
    at = 0
    while 2 * at + 1 < last:
        below = 2 * at + 1
        if below + 1 < last and (
            heap_first[below + 1] < heap_first[below]
            or (
                heap_first[below + 1] == heap_first[below]
                and heap_second[below + 1] < heap_second[below]
            )
        ):
            below += 1
        if first < heap_first[below] or (
            first == heap_first[below] and second <= heap_second[below]
        ):
            break
        heap[at], heap_first[at], heap_second[at] = (
            heap[below],
            heap_first[below],
            heap_second[below],
        )
        at = below
    heap[at], heap_first[at], heap_second[at] = label, first, second
