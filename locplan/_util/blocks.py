"""Blocks of a drive, over which intervals are bootstrapped.

Scans within one see the same walls.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import Interval, of_resamples
from locplan._util.poses import Numbers, way_along

LENGTH = 10.0
"""Length of way of a block [m]."""
MIN_BLOCKS = 5
"""Number of blocks below which there are no intervals."""
RESAMPLES = 1000


def blocks_along(poses: Numbers, length: float = LENGTH) -> NDArray[np.int64]:
    """The block of the way that each of n poses belongs to, (n,)."""
    return np.asarray((way_along(poses) / length).astype(np.int64))


def draws_of(blocks: NDArray[np.int64], resamples: int = RESAMPLES) -> Numbers:
    """Number of times that the block of each of n values is drawn, (resamples, n).

    There are no resamples of fewer than `MIN_BLOCKS` blocks.
    """
    known, number = np.unique(blocks, return_inverse=True)
    if len(known) < MIN_BLOCKS:
        return np.empty((0, len(blocks)))
    random = np.random.default_rng(0)
    drawn = random.multinomial(len(known), np.full(len(known), 1 / len(known)), resamples)
    return np.asarray(drawn[:, number], float)


def mean_interval(values: Numbers, blocks: NDArray[np.int64]) -> Interval:
    """Mean of values (n,), with a 95 % interval over their blocks; NaN where it has none."""
    if not len(values):
        return Interval(math.nan, math.nan, math.nan)
    drawn = draws_of(blocks)
    means = (drawn @ values) / drawn.sum(axis=1)
    return of_resamples(float(values.mean()), means)


def intervals(
    statistic: Callable[[Numbers], Numbers], blocks: NDArray[np.int64], resamples: int
) -> list[Interval]:
    """Some statistics (k,) of weighted values, with 95 % intervals over the values' blocks.

    `statistic` is called with weights (n,): 1 for all, and then how often each is drawn.
    """
    found = statistic(np.ones(len(blocks)))
    drawn = np.array([statistic(each) for each in draws_of(blocks, resamples)])
    samples = drawn.reshape(-1, len(found)).T
    return [of_resamples(float(value), each) for value, each in zip(found, samples, strict=True)]
