"""All best trade-offs between two costs on an 8-connected grid (bi-objective A*).

BOA* (Hernandez Ulloa et al., ICAPS 2020): labels leave the queue in the order of their first cost,
so that a label is dominated exactly if its second cost is not less than the least one so far at its
cell, or at the goal. The queue consists of buckets over the first cost; the lowest one is a heap.

Costs are whole numbers, kept as floats: both costs of a diagonal step are rounded up, so that the
bounds from searches with unrounded steps stay valid, and equal costs compare as equal. Cells are
indices of a flat grid with a blocked border (`locplan._support.kernels.search`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Floats, Ints, Numbers
from locplan._support.kernels.search import COLUMNS, LENGTHS, ROWS

SCALE = 1 << 34
"""Units of cost per cell; floats hold the sums exactly over 370,000 cells at this rate."""
BUCKETS, BUCKETS_A_CELL = 64, 16
"""Number of buckets, and of those per cell; a step raises the first bound by <= 2 sqrt(2) cells."""
FINISHED, OUT_OF_LABELS, PAUSED = 0, 1, 2
STATUS, UNUSED, USED, WAITING, LOWEST, IN_HEAP, SOLUTIONS = range(7)
"""Indices of `ParetoLabels.state`."""


class ParetoLabels(NamedTuple):
    """The labels of a search: paths from the start to a cell."""

    state: Ints
    """State of the search, at the indices STATUS to SOLUTIONS."""
    cell: NDArray[np.int32]
    """Cell in which each label's path ends."""
    first: Floats
    """First cost of each path."""
    second: Floats
    """Second cost of each path."""
    parent: NDArray[np.int32]
    """Label before each label on its path, or -1."""
    following: NDArray[np.int32]
    """Next label in the same bucket, or in the chain of free labels."""
    heads: NDArray[np.int32]
    """First label of every bucket."""
    heap: NDArray[np.int32]
    """Labels of the lowest bucket."""
    heap_first: Floats
    heap_second: Floats
    """Bounds on both costs of the heap's labels, by which it is ordered."""
    least: Floats
    """Least second cost of the paths that were expanded at each cell."""


class ParetoConstants(NamedTuple):
    """Constants of a search: the grid, the goal, and bounds on the remaining costs to the goal."""

    half: Floats  # (n,) half the second cost's density in whole units, infinite where blocked
    columns: int  # of the bordered grid
    goal: int  # flat index
    corner_cutting: bool
    first_to_go: Floats  # (n,) lower bound on the first cost to the goal
    second_to_go: Floats  # (n,) lower bound on the second
    joint_to_go: Floats  # (n,) lower bound on first + multiplier * second
    multiplier: float
    max_joint: float  # paths with a greater first + multiplier * second are left out


@njit(nogil=True, cache=True)
def search_labels(
    labels: ParetoLabels, terms: ParetoConstants, expansions: int, solutions: NDArray[np.int32]
) -> float:
    """Continue for `expansions`; return a bound on the first cost of all solutions to come.

    Parameters
    ----------
    labels : Labels
        At the beginning just the start's label in bucket 0; at the end `state[STATUS]` is set.
    terms : Terms
        The terms of the search.
    expansions : int
        Number of labels that are expanded at most.
    solutions : (m,) array of int32
        Receives the labels that reached the goal; the search pauses when it is full.
    """
    state, n_expanded = labels.state, 0
    state[STATUS] = FINISHED
    while True:
        if state[IN_HEAP] == 0:
            if state[WAITING] == 0:
                return np.inf
            _move_bucket_to_heap(labels, terms)
            continue
        n_expanded = _expand_heap(labels, terms, n_expanded, expansions, solutions)
        if state[STATUS] != FINISHED:
            return labels.heap_first[0]


@njit(nogil=True, cache=True)
def _move_bucket_to_heap(labels: ParetoLabels, terms: ParetoConstants) -> None:
    """Move the labels of the lowest filled bucket into the heap, and free dominated ones."""
    state, heads, following = labels.state, labels.heads, labels.following
    heap = labels.heap, labels.heap_first, labels.heap_second
    first_to_go, second_to_go, goal = terms.first_to_go, terms.second_to_go, terms.goal
    while heads[state[LOWEST] % BUCKETS] < 0:
        state[LOWEST] += 1
    slot = state[LOWEST] % BUCKETS
    label = heads[slot]
    heads[slot] = -1
    while label >= 0:
        after, cell = following[label], labels.cell[label]
        state[WAITING] -= 1
        bound = labels.second[label] + second_to_go[cell]
        if not _is_undominated(labels.second[label], bound, labels.least[cell], labels.least[goal]):
            following[label], state[UNUSED] = state[UNUSED], label
        else:
            bound_first = labels.first[label] + first_to_go[cell]
            _push_label(state, heap, label, bound_first, bound)
        label = after


@njit(nogil=True, cache=True)
def _expand_heap(
    labels: ParetoLabels,
    terms: ParetoConstants,
    n_expanded: int,
    expansions: int,
    solutions: NDArray[np.int32],
) -> int:
    """Expand the heap's labels until `expansions` have begun; return the number expanded.

    See `search_labels` for the arguments.
    """
    # All arrays have local names: numba counts references to those that are passed on.
    state, cells, first, second = labels.state, labels.cell, labels.first, labels.second
    parents, following, heads = labels.parent, labels.following, labels.heads
    heap, lowest_second = (labels.heap, labels.heap_first, labels.heap_second), labels.least
    half, columns, goal, corner_cutting, first_to_go, second_to_go, joint_to_go, _, _ = terms
    multiplier, max_joint = terms.multiplier, terms.max_joint
    corner = np.nan if corner_cutting else np.inf  # nothing equals NaN
    while state[IN_HEAP]:
        if n_expanded == expansions or state[SOLUTIONS] == solutions.size:
            state[STATUS] = PAUSED
            break
        if state[USED] + 8 > cells.size:
            state[STATUS] = OUT_OF_LABELS
            break
        label, bound = heap[0][0], heap[2][0]
        _pop_label(state, heap)
        cell = cells[label]
        if not _is_undominated(second[label], bound, lowest_second[cell], lowest_second[goal]):
            following[label], state[UNUSED] = state[UNUSED], label
            continue
        # First costs only grow from here on: no later label is better in both than this one.
        lowest_second[cell] = second[label]
        if cell == goal:
            solutions[state[SOLUTIONS]] = label
            state[SOLUTIONS] += 1
            continue
        n_expanded += 1
        for n in range(8):
            row_neighbour, col_neighbour = cell + ROWS[n] * columns, cell + COLUMNS[n]
            other, length = row_neighbour + COLUMNS[n], LENGTHS[n]
            new_first = first[label] + np.ceil(length * SCALE)
            new_second = second[label] + np.ceil(length * (half[cell] + half[other]))
            # A blocked cell's least second cost is infinite, as that of its step.
            if (
                new_second >= lowest_second[other]
                or half[row_neighbour] + half[col_neighbour] == corner
            ):
                continue
            bound = new_second + second_to_go[other]
            joint_cost = new_first + multiplier * new_second + joint_to_go[other]
            if bound >= lowest_second[goal] or joint_cost > max_joint:
                continue
            new = state[UNUSED]
            if new >= 0:
                state[UNUSED] = following[new]
            else:
                new = state[USED]
                state[USED] += 1
            cells[new], parents[new] = other, label
            first[new], second[new] = new_first, new_second
            bound_first = new_first + first_to_go[other]
            bucket = int(bound_first * (BUCKETS_A_CELL / SCALE))
            if bucket <= state[LOWEST]:
                _push_label(state, heap, new, bound_first, bound)
            else:
                slot = bucket % BUCKETS
                following[new], heads[slot] = heads[slot], new
                state[WAITING] += 1
    return n_expanded


@njit(nogil=True, cache=True)
def trace_label(labels: ParetoLabels, label: int) -> Array:
    """Return the cells of a label's path, from the start on."""
    count, at = 0, label
    while at >= 0:
        count, at = count + 1, labels.parent[at]
    cells, at = np.empty(count, np.int64), label
    for n in range(count - 1, -1, -1):
        cells[n], at = labels.cell[at], labels.parent[at]
    return cells


@njit(inline="always")
def _is_undominated(
    second: float, bound: float, lowest_second: float, least_at_goal: float
) -> bool:
    """Return True if no known path is better than one with this second cost and bound."""
    return second < lowest_second and bound < least_at_goal


@njit(inline="always")
def _comes_before(first: float, second: float, other_first: float, other_second: float) -> bool:
    """Return True if a label leaves the heap before another, by the bounds on both costs."""
    return first < other_first or (first == other_first and second < other_second)


@njit(inline="always")
def _push_label(state: Ints, of_heap: Numbers, label: int, first: float, second: float) -> None:
    heap, heap_first, heap_second = of_heap
    at = state[IN_HEAP]
    state[IN_HEAP] += 1
    while at > 0:
        above = (at - 1) // 2
        if not _comes_before(first, second, heap_first[above], heap_second[above]):
            break
        heap[at], heap_first[at] = heap[above], heap_first[above]
        heap_second[at] = heap_second[above]
        at = above
    heap[at], heap_first[at], heap_second[at] = label, first, second


@njit(inline="always")
def _pop_label(state: Ints, of_heap: Numbers) -> None:
    heap, heap_first, heap_second = of_heap
    state[IN_HEAP] -= 1
    last = state[IN_HEAP]
    label, first, second = heap[last], heap_first[last], heap_second[last]
    at = 0
    while 2 * at + 1 < last:
        below = 2 * at + 1
        if below + 1 < last and _comes_before(
            heap_first[below + 1], heap_second[below + 1], heap_first[below], heap_second[below]
        ):
            below += 1
        if not _comes_before(heap_first[below], heap_second[below], first, second):
            break
        heap[at], heap_first[at] = heap[below], heap_first[below]
        heap_second[at] = heap_second[below]
        at = below
    heap[at], heap_first[at], heap_second[at] = label, first, second
