"""Any-angle paths: 32 neighbours, and dynamic programming over the positions of a path.

Positions are continuous (row, col) in the cells of a bordered grid, as in
`locplan._support.kernels.search`. The search's circular buckets are as narrow as the cheapest
step, so that their cells need no sorting.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Floats, Ints
from locplan._support.kernels.rays import compute_segment_cost
from locplan._support.kernels.search import find_cost_range, put_into_bucket


@njit(nogil=True, cache=True, error_model="numpy")
def choose_kept_positions(
    half_density: Floats,
    columns: int,
    positions: Floats,
    lookahead: int,
    corner_cutting: bool,
    min_density: float,
) -> Array:
    """Return the indices of the positions of a path, (n, 2), to keep so that it costs least.

    Each position is reached in a straight line from one of the `lookahead` before it; of lines of
    equal cost the longest is taken. The line from the one just before it is always allowed, so
    that the result never costs more than the path. `min_density` is at most the least density: what
    cannot pay at that is not measured.
    """
    # Loops and numbers instead of arrays and lists: numba compiles them in a third of the time.
    count = len(positions)
    best, before = np.empty(count), np.empty(count, np.int64)
    for j in range(count):
        best[j], before[j] = np.inf, -1
    best[0] = 0.0
    for j in range(1, count):
        row, col = positions[j, 0], positions[j, 1]
        for i in range(j - 1, max(-1, j - 1 - lookahead), -1):
            from_row, from_col = positions[i, 0], positions[i, 1]
            distance = np.hypot(row - from_row, col - from_col)
            limit = best[j] * (1 + 1e-13)  # costs that rounding sets apart count as equal
            if best[i] + min_density * distance > limit:
                continue
            step = 0.0
            if distance > 0:
                # The path itself is taken as it is, also where it cuts a corner.
                allowed = corner_cutting or i == j - 1
                step = compute_segment_cost(
                    half_density, columns, from_row, from_col, row, col, allowed
                )
            if best[i] + step <= limit:
                best[j], before[j] = best[i] + step, i
    indices = np.empty(count, np.int64)
    first, j = count - 1, count - 1
    indices[first] = j
    while j > 0:
        j = before[j]
        first -= 1
        indices[first] = j
    return indices[first:]


@njit(nogil=True, cache=True, error_model="numpy")
def shift_positions(
    half_density: Floats,
    columns: int,
    positions: Floats,
    step: float,
    sweeps: int,
    corner_cutting: bool,
) -> Array:
    """Shift the inner positions of a path sideways by `step` while that lowers the cost."""
    count = len(positions)
    shifted, stirred = np.empty((count, 2)), np.empty(count, np.bool_)
    for k in range(count):
        shifted[k, 0], shifted[k, 1], stirred[k] = positions[k, 0], positions[k, 1], True
    for _ in range(sweeps):
        is_unchanged = True
        for k in range(1, count - 1):
            if not (stirred[k - 1] or stirred[k] or stirred[k + 1]):
                continue
            stirred[k] = False
            row0, col0 = shifted[k - 1, 0], shifted[k - 1, 1]
            row, col = shifted[k, 0], shifted[k, 1]
            row1, col1 = shifted[k + 1, 0], shifted[k + 1, 1]
            along = np.hypot(row1 - row0, col1 - col0)
            if along == 0:
                continue
            normal_row, normal_col = step * (col0 - col1) / along, step * (row1 - row0) / along
            lowest_cost = compute_segment_cost(
                half_density, columns, row0, col0, row, col, corner_cutting
            )
            lowest_cost += compute_segment_cost(
                half_density, columns, row, col, row1, col1, corner_cutting
            )
            for side in (-1.0, 1.0):
                to_row, to_col = row + side * normal_row, col + side * normal_col
                cost = compute_segment_cost(
                    half_density, columns, row0, col0, to_row, to_col, corner_cutting
                )
                if cost < lowest_cost:
                    cost += compute_segment_cost(
                        half_density, columns, to_row, to_col, row1, col1, corner_cutting
                    )
                if cost < lowest_cost:
                    lowest_cost, is_unchanged, stirred[k] = cost, False, True
                    shifted[k, 0], shifted[k, 1] = to_row, to_col
        if is_unchanged:
            break
    return shifted


class StraightMoves(NamedTuple):
    """Steps of any shape from a cell, as offsets of flat indices."""

    offsets: Ints  # (m,) the cell to which each move leads
    crossed: Ints  # (m, k) the cells that it crosses
    lengths: Floats  # (m, k) twice its length in each [cells]; 0 in unused entries
    touched: Ints  # (m, t) further cells that must not be blocked


@njit(nogil=True, cache=True, error_model="numpy")
def find_cheapest_move_cells(
    half_density: Floats, start: int, goal: int, moves: StraightMoves
) -> Array:
    """Return the cells of the cheapest path over moves of any shape; empty without a path.

    `start` and `goal` are flat indices. `half_density` has a border as wide as the longest move.
    """
    offsets, crossed, lengths, touched = moves
    nothing = np.empty(0, np.int64)
    if half_density[start] == np.inf or half_density[goal] == np.inf:
        return nothing
    cost = np.full(half_density.size, np.inf)
    move_to = np.full(half_density.size, -1, np.int8)
    is_settled = np.zeros(half_density.size, np.uint8)
    cost[start] = 0.0
    per_cost, buckets = compute_bucket_scale(half_density, lengths)
    if not buckets:
        return nothing  # the costs differ too much for buckets
    mask = np.uint64(buckets - 1)
    heads = np.full(buckets, -1, np.int32)
    cells, following = np.empty(4096, np.uint32), np.empty(4096, np.int32)
    unused, used, waiting = -1, 1, 1
    cells[0], following[0], heads[0] = start, -1, 0
    lowest = 0
    while waiting and lowest <= cost[goal] * per_cost:
        slot = np.uint64(lowest) & mask
        while heads[slot] >= 0:
            node = heads[slot]
            heads[slot], following[node], unused = following[node], unused, node
            waiting -= 1
            cell = np.int64(cells[node])
            if is_settled[cell]:
                continue
            is_settled[cell] = 1
            if used + len(offsets) > cells.size:
                cells = np.concatenate((cells, np.empty_like(cells)))
                following = np.concatenate((following, np.empty_like(following)))
            cell_cost = cost[cell]
            for move in range(len(offsets)):
                other = cell + offsets[move]
                reached = _add_move_cost(
                    half_density, cell, cell_cost, crossed[move], lengths[move]
                )
                if reached < cost[other] and not _touches_blocked_cell(
                    half_density, cell, touched[move]
                ):
                    cost[other], is_settled[other], move_to[other] = reached, 0, move
                    bucket = np.uint64(reached * per_cost) & mask
                    unused, used = put_into_bucket(
                        other, bucket, heads, cells, following, unused, used
                    )
                    waiting += 1
        lowest += 1
    if cost[goal] == np.inf:
        return nothing
    path = [goal]
    while path[-1] != start:
        path.append(path[-1] - offsets[move_to[path[-1]]])
    return np.array(path[::-1])


@njit(inline="always")
def _add_move_cost(
    half_density: Floats, cell: int, cost: float, crossed: Array, lengths: Array
) -> float:
    """Return the cost at the end of a move, from the cost at its beginning and the cells."""
    for k in range(crossed.size):
        if lengths[k] > 0:
            cost += lengths[k] * half_density[cell + crossed[k]]
    return cost


@njit(inline="always")
def _touches_blocked_cell(half_density: Floats, cell: int, touched: Array) -> bool:
    """Return True if a move from a cell touches a blocked one."""
    blocked = False
    for k in range(touched.size):
        blocked |= half_density[cell + touched[k]] == np.inf
    return blocked


@njit(nogil=True, cache=True)
def compute_bucket_scale(half_density: Floats, lengths: Floats) -> tuple[float, int]:
    """Return the buckets per cost, and their number, a power of two (0: too many)."""
    longest = 0.0
    for move in range(len(lengths)):
        longest = max(longest, lengths[move].sum())
    cheapest, costliest, _, _ = find_cost_range(half_density)
    # More buckets than this would take longer to visit than to sort their cells.
    if 2 * cheapest * (1 << 14) <= longest * costliest:
        return 0.0, 0
    buckets = 2
    while buckets < longest / 2 * costliest / cheapest + 2:
        buckets *= 2
    return 0.5 / cheapest, buckets
