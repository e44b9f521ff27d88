"""The wave of Nav2's NavFn, which stops early, as its Dijkstra search has it."""

from __future__ import annotations

import numpy as np
from numba import njit

from locplan._kernels.arrays import Array

FAR = np.float32(1e10)
"""Potential of a cell that the wave has not reached."""
BUFFER = 10_000
"""Number of cells that one buffer holds; more are dropped."""
OBSTACLE = 254
"""Cost of a cell that is not entered."""


@njit(nogil=True, cache=True)
def from_neighbours(potential: Array, cost: Array, cell: int, columns: int) -> np.float32:
    """Potential of a cell by a plane wave from the lower neighbour of each axis."""
    across = min(potential[cell - 1], potential[cell + 1])
    along = min(potential[cell - columns], potential[cell + columns])
    lower, share = min(across, along), abs(across - along) / cost[cell]
    wave = 1.0 if share >= 1 else -0.2301 * share * share + 0.5307 * share + 0.7040
    return np.float32(lower + cost[cell] * np.float32(wave))


@njit(nogil=True, cache=True)
def push(
    into: Array,
    count: int,
    potential: Array,
    cost: Array,
    pending: Array,
    cell: int,
    columns: int,
) -> int:
    """Number of cells in a buffer with the neighbours that a cell's new potential lowers."""
    for step in (-1, 1, -columns, columns):
        other = cell + step
        if pending[other] or cost[other] >= OBSTACLE or count >= BUFFER:
            continue
        if potential[other] > potential[cell] + np.float32(0.707106781) * cost[other]:
            into[count], pending[other] = other, True
            count += 1
    return count


@njit(nogil=True, cache=True)
def navfn_potential(costs: Array, start: int, goal: int, bucket: float) -> Array:
    """Potential of each cell from the start, until the goal has any; `FAR` where there is none.

    `costs` are those of entering the cells of an (H, W) map, 50 to 254, with obstacles all round;
    cells are flat indices. The wave goes on to cells of a potential up to a threshold, which rises
    by `bucket` when there are none left, at first 254. It is single precision, as NavFn's is.
    """
    columns = costs.shape[1]
    cost = costs.ravel().astype(np.float32)
    potential = np.full(cost.size, FAR, np.float32)
    pending = np.zeros(cost.size, np.bool_)
    now, after, over = np.empty((3, BUFFER), np.int64)
    potential[start] = 0
    count, further, beyond, threshold = 0, 0, 0, float(OBSTACLE)
    for cell in (start + 1, start - 1, start - columns, start + columns):
        if cost[cell] < OBSTACLE:
            now[count], pending[cell] = cell, True
            count += 1
    for _ in range(max(cost.size // 20, costs.shape[0] + columns)):
        if count == 0 or potential[goal] < FAR:
            break
        for n in range(count):
            pending[now[n]] = False
        for n in range(count):
            cell = now[n]
            reached = from_neighbours(potential, cost, cell, columns)
            if reached >= potential[cell]:
                continue
            potential[cell] = reached
            if reached < threshold:
                further = push(after, further, potential, cost, pending, cell, columns)
            else:
                beyond = push(over, beyond, potential, cost, pending, cell, columns)
        now, after, count, further = after, now, further, 0
        if count == 0:
            threshold += bucket
            now, over, count, beyond = over, now, beyond, 0
    return potential.reshape(costs.shape)
