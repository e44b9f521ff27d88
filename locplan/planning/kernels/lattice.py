"""Search over (row, col, heading) by motions of a few shapes: a state lattice.

One bit shows if a motion is free: the occupied cells, dilated by all cells that the outline
sweeps along it, 64 cells in a word. A bound for the cost to the goal is found first by a backward
search over cells alone, which may use any heading's motions: it never exceeds the cost, and no
motion lowers it by more than its cost. Both searches have circular buckets, first in, first out.

The number of the cell (row, col) is ``row * columns + col``. The states of a cell are adjacent,
so that states that differ by a turn or a gear share cache lines: a state's number is its
cell's times the number of layers, plus its layer's; a layer is a heading, or a heading and a gear.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Floats, Ints, Singles, Words

FORWARD, BACKWARD, EITHER = 0, 1, 2
"""Gears of a motion; a turn on the spot and a motion sideways keep the one before."""
FINISHED, OUT_OF_ROOM, PAUSED, READY = range(4)
UNUSED, USED, WAITING, LOWEST, EXPANDED, BEST = range(6)
"""Places in a queue's state: first entry free again, number of entries ever used, number that
wait, lowest bucket, number of expansions, and the best state at the goal, or -1."""
ROUNDING = 1e-6
"""Share by which a bound in single precision is lowered."""


class LatticeMoves(NamedTuple):
    """The motions, by the heading that they begin with."""

    begin: Ints  # (headings + 1,) first motion of each heading
    source: Ints  # (m,) heading that it begins with
    target: Ints  # (m,) heading that it ends with
    row: Ints  # (m,) rows that it leads on
    col: Ints  # (m,) columns that it leads on
    gear: Ints  # (m,) FORWARD, BACKWARD or EITHER
    at_end: Ints  # (m,) 1 if its mask is that of the motion from its end
    mask_heading: Ints  # (m,) where its mask stands
    slot: Ints  # (m,) likewise
    crossed: Ints  # (m, k) number of each cell that it crosses from its beginning's, by layers
    lengths: Floats  # (m, k) twice its length in each, times its factor [cells]
    cells: Ints  # (m,) number of crossed cells
    extra: Floats  # (m,) further cost [cells]
    base_cost: Floats  # (m,) cost without `extra` where the density is 1 [cells]


class LatticeCostmap(NamedTuple):
    """The map that the motions pass over."""

    half: Floats  # (n,) half the density of each cell, by layers of headings
    masks: Words  # (headings, rows, words, slots) bit 1 where a motion from a cell is not free
    rows: int
    columns: int
    cheapest: float  # least density
    nearby: Singles  # (rows * columns,) at most the density that motions to or from a cell meet


class LatticeConstants(NamedTuple):
    """What stays the same during a search."""

    per_cost: float  # buckets per cost
    gear_change: float  # cost of a change of the gear [cells]
    gears: int  # 2 where changes cost, else 1
    cap: float  # bound of all cells whose own is not known to be lower
    goal_headings: int  # bit 1 for each heading that the goal may have


class StateGraph(NamedTuple):
    """The states of a search, and what leads from one to another."""

    ground: LatticeCostmap
    moves: LatticeMoves
    terms: LatticeConstants


class StateQueue(NamedTuple):
    """States that wait in buckets."""

    state: Ints
    heads: NDArray[np.int32]  # first entry of each bucket
    tails: NDArray[np.int32]  # last entry of each bucket
    states: NDArray[np.uint32]  # state of each entry
    following: NDArray[np.int32]  # next entry of a bucket, or of those free again


def make_queue(buckets: int, lowest: int) -> StateQueue:
    """Return an empty queue with a power of two of buckets."""
    return StateQueue(
        np.array([-1, 0, 0, lowest, 0, -1]),
        np.full(buckets, -1, np.int32),
        np.full(buckets, -1, np.int32),
        np.empty(1 << 16, np.uint32),
        np.empty(1 << 16, np.int32),
    )


def grow_queue(queue: StateQueue) -> StateQueue:
    """Return the queue with twice the room."""
    states, following = (np.concatenate([a, a]) for a in (queue.states, queue.following))
    return queue._replace(states=states, following=following)


@njit(nogil=True, cache=True)
def put_state(queue: StateQueue, state: int, bucket: int) -> None:
    """Put a state into a bucket; states beyond the last bucket wait in it."""
    numbers, heads, tails, states, following = queue
    slot = min(bucket, numbers[LOWEST] + heads.size - 1) & (heads.size - 1)
    node = numbers[UNUSED]
    if node >= 0:
        numbers[UNUSED] = following[node]
    else:
        node = numbers[USED]
        numbers[USED] += 1
    states[node], following[node] = state, -1
    if heads[slot] < 0:
        heads[slot] = node
    else:
        following[tails[slot]] = node
    tails[slot] = node
    numbers[WAITING] += 1


@njit(nogil=True, cache=True)
def take_state(queue: StateQueue, slot: int) -> int:
    """Take the first state out of a bucket that is not empty."""
    numbers, heads, _, states, following = queue
    node = heads[slot]
    heads[slot], following[node], numbers[UNUSED] = following[node], numbers[UNUSED], node
    numbers[WAITING] -= 1
    return int(states[node])


@njit(nogil=True, cache=True, error_model="numpy")
def find_next_bucket(
    queue: StateQueue, max_bucket: float, room: int, pause_at_expansions: int
) -> int:
    """Continue to the first bucket with a state: READY, or the reason why the search stops here.

    It is FINISHED beyond bucket `max_bucket`, OUT_OF_ROOM without `room` for so many entries, and
    PAUSED after so many expansions as `pause_at_expansions`.
    """
    numbers, heads = queue.state, queue.heads
    while numbers[WAITING] and not numbers[LOWEST] > max_bucket:
        if heads[numbers[LOWEST] & (heads.size - 1)] < 0:
            numbers[LOWEST] += 1
        elif numbers[USED] + room > queue.states.size:
            return OUT_OF_ROOM
        else:
            return PAUSED if numbers[EXPANDED] >= pause_at_expansions else READY
    return FINISHED


@njit(inline="always")
def is_free(ground: LatticeCostmap, moves: LatticeMoves, move: int, row: int, col: int) -> bool:
    """Return True if a motion from a cell is free and its far end lies on the map."""
    if moves.at_end[move]:
        row, col = row + moves.row[move], col + moves.col[move]
    word = ground.masks[moves.mask_heading[move], row, col >> 6, moves.slot[move]]
    return (word >> np.uint64(col & 63)) & np.uint64(1) == 0


@njit(inline="always")
def compute_move_cost(ground: LatticeCostmap, moves: LatticeMoves, move: int, cell: int) -> float:
    """Return the cost of a free motion from a cell [density x cells]."""
    total = moves.extra[move]
    for k in range(moves.cells[move]):
        total += moves.lengths[move, k] * ground.half[cell + moves.crossed[move, k]]
    return total


@njit(nogil=True, cache=True, error_model="numpy")
def search_cells_backward(
    queue: StateQueue, graph: StateGraph, cost_to_go: Singles, cell: int, max_expansions: int
) -> int:
    """Continue the backward search over cells until `cell` is settled (-1: never), or pause.

    `cost_to_go` holds the costs to the goal, infinite where nothing was seen. The caller has put in
    the goal's cells.
    """
    ground, moves, terms = graph
    numbers, mask = queue.state, queue.heads.size - 1
    pausing = numbers[EXPANDED] + max_expansions
    rows, columns, per_cost = ground.rows, ground.columns, terms.per_cost
    room = 2 * len(moves.row)
    while True:
        status = find_next_bucket(
            queue, cost_to_go[cell] * per_cost if cell >= 0 else np.inf, room, pausing
        )
        if status != READY:
            return status
        lowest = numbers[LOWEST]
        to = take_state(queue, lowest & mask)
        target_cost = np.float64(cost_to_go[to])
        bucket = np.int64(target_cost * per_cost)
        if bucket != lowest:
            if bucket > lowest:
                put_state(queue, to, bucket)
            continue
        numbers[EXPANDED] += 1
        to_row, to_col = to // columns, to % columns
        nearby = np.float64(ground.nearby[to])
        for move in range(len(moves.row)):
            row, col = to_row - moves.row[move], to_col - moves.col[move]
            if not (0 <= row < rows and 0 <= col < columns):
                continue
            source = row * columns + col
            old_bound = np.float64(cost_to_go[source])
            if target_cost + moves.base_cost[move] * nearby + moves.extra[move] >= old_bound:
                continue
            if not is_free(ground, moves, move, row, col):
                continue
            reached = np.float32(target_cost + compute_move_cost(ground, moves, move, source))
            if reached < old_bound:
                cost_to_go[source], later = reached, np.int64(reached * per_cost)
                if (
                    old_bound == np.inf or np.int64(old_bound * per_cost) != later
                ):  # else it waits there
                    put_state(queue, source, later)


@njit(nogil=True, cache=True, error_model="numpy")
def search_states(
    queue: StateQueue, graph: StateGraph, cost_to_go: Singles, cost: Singles, max_expansions: int
) -> int:
    """Continue the search over states until the goal is settled, or pause.

    `cost` holds the costs from the start plus 1, negative where expanded, and 0 where nothing was
    seen, so that memory that is never written takes no room. The caller has put in the start's
    states.
    """
    _, moves, terms = graph
    numbers, mask = queue.state, queue.heads.size - 1
    pausing, room = numbers[EXPANDED] + max_expansions, 2 * len(moves.row)
    layers, per_cost = (len(moves.begin) - 1) * terms.gears, terms.per_cost
    while True:
        cost_limit = np.inf
        if numbers[BEST] >= 0:
            cost_limit = abs(np.float64(cost[numbers[BEST]])) - 1.0
        status = find_next_bucket(queue, cost_limit * per_cost, room, pausing)
        if status != READY:
            return status
        state = take_state(queue, numbers[LOWEST] & mask)
        if cost[state] < 0 or is_surpassed(cost, terms, state, layers):
            continue
        total = (
            np.float64(cost[state]) - 1.0 + compute_cost_bound(cost_to_go, terms, state // layers)
        )
        bucket = np.int64(total * per_cost)
        if bucket > numbers[LOWEST]:
            put_state(queue, state, bucket)
        elif total < cost_limit:
            expand_state(queue, graph, cost_to_go, cost, state, cost_limit)


@njit(nogil=True, cache=True, error_model="numpy")
def expand_state(
    queue: StateQueue,
    graph: StateGraph,
    cost_to_go: Singles,
    cost: Singles,
    state: int,
    cost_limit: float,
) -> None:
    """Expand a state: queue the states that its motions reach at less cost, below `cost_limit`."""
    ground, moves, terms = graph
    numbers, rows, columns = queue.state, ground.rows, ground.columns
    headings = len(moves.begin) - 1
    layers = headings * terms.gears
    state_cost, cell, layer = np.float64(cost[state]) - 1.0, state // layers, state % layers
    cost[state] = -cost[state]
    numbers[EXPANDED] += 1
    row, col = cell // columns, cell % columns
    heading, gear = layer % headings, layer // headings
    nearby = np.float64(ground.nearby[cell])
    for move in range(moves.begin[heading], moves.begin[heading + 1]):
        to_row, to_col = row + moves.row[move], col + moves.col[move]
        if not (0 <= to_row < rows and 0 <= to_col < columns):
            continue
        if not is_free(ground, moves, move, row, col):
            continue
        to_gear, change = shift_gear(moves.gear[move], gear, terms)
        to_cell = to_row * columns + to_col
        other = to_cell * layers + to_gear * headings + moves.target[move]
        old_cost = abs(np.float64(cost[other]))
        lowest = state_cost + change + moves.extra[move] + moves.base_cost[move] * nearby + 1.0
        if old_cost != 0.0 and lowest >= old_cost:  # the exact cost takes longest
            continue
        reached = state_cost + change + compute_move_cost(ground, moves, move, cell) + 1.0
        if old_cost != 0.0 and reached >= old_cost * (1 - 1e-7):
            continue
        total = reached - 1.0 + compute_cost_bound(cost_to_go, terms, to_cell)
        if not total < cost_limit:
            continue
        cost[other] = reached
        if cost_to_go[to_cell] == 0 and (terms.goal_headings >> moves.target[move]) & 1:
            numbers[BEST], cost_limit = other, reached - 1.0
        put_state(queue, other, max(np.int64(total * terms.per_cost), numbers[LOWEST]))


@njit(inline="always")
def is_surpassed(cost: Singles, terms: LatticeConstants, state: int, layers: int) -> bool:
    """Return True if a state costs no less than its pose in the opposite gear and a change."""
    if terms.gears == 1:
        return False
    half = layers // 2
    other = state + half if state % layers < half else state - half
    other_cost = abs(cost[other])
    return other_cost != 0 and other_cost + terms.gear_change <= cost[state]


@njit(inline="always")
def compute_cost_bound(cost_to_go: Singles, terms: LatticeConstants, cell: int) -> float:
    """Return a lower bound of the cost from a cell to the goal."""
    return min(np.float64(cost_to_go[cell]) * (1 - ROUNDING), terms.cap)


@njit(inline="always")
def shift_gear(gear_of_move: int, gear: int, terms: LatticeConstants) -> tuple[int, float]:
    """Return the gear after a motion, and the cost of changing it."""
    if terms.gears == 1 or gear_of_move in (EITHER, gear):
        return gear, 0.0
    return gear_of_move, terms.gear_change


@njit(nogil=True, cache=True, error_model="numpy")
def trace_motions(graph: StateGraph, cost: Singles, state: int) -> Array:
    """Return the start's state, and the motions that lead from it to a state."""
    ground, moves, terms = graph
    headings = len(moves.begin) - 1
    layers, path = headings * terms.gears, [state]
    while abs(cost[state]) > 1.0:
        cell, layer = state // layers, state % layers
        heading, gear = layer % headings, layer // headings
        lowest_cost, before, by = np.inf, -1, -1
        for move in range(len(moves.row)):
            if moves.target[move] != heading:
                continue
            row = cell // ground.columns - moves.row[move]
            col = cell % ground.columns - moves.col[move]
            if not (0 <= row < ground.rows and 0 <= col < ground.columns):
                continue
            if not is_free(ground, moves, move, row, col):
                continue
            source = row * ground.columns + col
            step = compute_move_cost(ground, moves, move, source)
            for from_gear in range(terms.gears):
                to_gear, change = shift_gear(moves.gear[move], from_gear, terms)
                other = source * layers + from_gear * headings + moves.source[move]
                source_cost = abs(np.float64(cost[other]))
                if to_gear != gear or source_cost == 0.0 or source_cost >= abs(cost[state]):
                    continue
                if source_cost + change + step < lowest_cost:
                    lowest_cost, before, by = source_cost + change + step, other, move
        path.append(by)
        state = before
    motions = np.empty(len(path), np.int64)
    motions[0] = state
    for n in range(1, len(path)):
        motions[n] = path[len(path) - n]
    return motions
