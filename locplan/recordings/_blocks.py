"""Blocks of a drive, and how well predicted covariances agree with measured ones along it.

Intervals are bootstrapped from blocks: scans within one see the same walls.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import Interval
from locplan._util.poses import Numbers
from locplan._util.ranking import Rank, Resamples, rank
from locplan.field import position_axes

ELONGATED = 3.0
"""Ratio of the measured deviations from which an ellipse has a direction."""
ALIGNED = math.radians(15.0)
"""Greatest angle between a measured and a predicted axis that agree [rad]."""
LENGTH = 10.0
"""Length of way of a block [m]."""
LEAST_BLOCKS = 5
"""Number of blocks below which there are no intervals."""
RESAMPLES = 1000


def blocks_along(poses: Numbers, length: float = LENGTH) -> NDArray[np.int64]:
    """The block of the way that each of n poses belongs to, (n,)."""
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray((way / length).astype(np.int64))


def draws_of(blocks: NDArray[np.int64], resamples: int = RESAMPLES) -> Numbers:
    """Number of times that the block of each of n values is drawn, (resamples, n).

    There are no resamples of fewer than `LEAST_BLOCKS` blocks.
    """
    known, number = np.unique(blocks, return_inverse=True)
    if len(known) < LEAST_BLOCKS:
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
    return with_ends(float(values.mean()), means)


def intervals(
    statistic: Callable[[Numbers], Numbers], blocks: NDArray[np.int64], resamples: int
) -> list[Interval]:
    """Some statistics (k,) of weighted values, with 95 % intervals over the values' blocks.

    `statistic` is called with weights (n,): 1 for all, and then how often each is drawn.
    """
    found = statistic(np.ones(len(blocks)))
    drawn = np.array([statistic(each) for each in draws_of(blocks, resamples)])
    samples = drawn.reshape(-1, len(found)).T
    return [with_ends(float(value), each) for value, each in zip(found, samples, strict=True)]


def with_ends(value: float, samples: Numbers) -> Interval:
    """A value with the ends of the 95 % interval of its samples; NaN without samples."""
    samples = samples[np.isfinite(samples)]
    if not len(samples):
        return Interval(value, math.nan, math.nan)
    low, high = np.quantile(samples, (0.025, 0.975)).tolist()
    return Interval(value, low, high)


@dataclass(frozen=True)
class Agreement:
    """How well an estimator's deviations agree with the measured ones.

    Intervals are percentiles of a bootstrap over blocks of 10 m of the drive; NaN where it has
    fewer than five.
    """

    rank: Rank
    """Rank correlation, -1..1, and AUC for the worst fifth of the scans, 0..1."""
    aligned: Interval
    """Share of the elongated ellipses whose direction is right to 15 deg, 0..1; NaN without any."""
    factor: Interval
    """Predicted over measured deviation of the position: geometric mean; 1 where they agree."""


def agreement(
    values: Numbers, predicted: Numbers, measured: Numbers, blocks: NDArray[np.int64]
) -> Agreement:
    """Agreement of predicted with measured covariances at n scans.

    Parameters
    ----------
    values : (n,) array
        The scalar by which the estimator ranks places.
    predicted, measured : (n, d, d) arrays
        Covariances [m, m, rad].
    blocks : (n,) array of int
        The block of the drive that each scan belongs to.
    """
    drawn = draws_of(blocks)
    major, minor, direction = position_axes(measured)
    own, _, towards = position_axes(predicted)
    turned = np.abs((towards - direction + np.pi / 2) % np.pi - np.pi / 2)
    elongated = (major > ELONGATED * minor).astype(float)
    return Agreement(
        _ranked(values, major, drawn),
        _mean((turned < ALIGNED).astype(float), elongated, drawn),
        Interval(*np.exp(_mean(np.log(own / major), np.ones(len(own)), drawn)).tolist()),
    )


def _ranked(values: Numbers, measured: Numbers, drawn: Numbers) -> Rank:
    """Rank statistics with intervals over blocks."""
    some = drawn if len(drawn) else np.ones((1, len(values)))
    found = rank([values], [measured], Resamples([some], np.ones((len(some), 1))))
    if len(drawn):
        return found
    return Rank(*(Interval(each.value, math.nan, math.nan) for each in vars(found).values()))


def _mean(values: Numbers, counted: Numbers, drawn: Numbers) -> Interval:
    """Mean of the values that count, 1 or 0 each; NaN where none does."""
    if not counted.any():
        return Interval(math.nan, math.nan, math.nan)
    weights = drawn * counted
    with np.errstate(invalid="ignore"):
        means = (weights @ values) / weights.sum(axis=1)
    return with_ends(float(np.average(values, weights=counted)), means)
