"""Look-ups in cumulative shares, to draw indices by their weights without a binary search each."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(nogil=True, cache=True)
def guide_of(shares: NDArray[np.float64]) -> NDArray[np.int64]:
    """Index of the first share above each of n + 1 equal steps from 0 to the last share."""
    count = len(shares)
    guide = np.full(count + 1, count - 1)
    step = 0
    for n in range(count):
        while step <= count and step * shares[-1] < shares[n] * count:
            guide[step] = n
            step += 1
    return guide


@njit(nogil=True, cache=True)
def first_above(value: float, shares: NDArray[np.float64], near: int) -> int:
    """Index of the first share above a value, or the last index, found from an index nearby."""
    at = near
    while at > 0 and shares[at - 1] > value:
        at -= 1
    while at < len(shares) - 1 and shares[at] <= value:
        at += 1
    return at
