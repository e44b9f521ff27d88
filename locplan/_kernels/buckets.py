"""Circular buckets as narrow as the cheapest step, for searches whose cells need no sorting."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

MAX_BUCKETS = 1 << 14
_UNUSED, _USED, _WAITING = 0, 1, 2
"""Indices of the pool of entries: first one free again, number ever used, number that wait."""


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
