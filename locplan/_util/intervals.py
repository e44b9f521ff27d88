"""95 % intervals of shares, means, medians, and of root mean squares and their ratios."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MIN_SAMPLES = 5
"""Least number of values that have an interval; fewer values have only a mean."""


class Interval(NamedTuple):
    """A value with its 95 % interval; NaN where there is none."""

    value: float
    """The estimate, in the unit of what it is of."""
    low: float
    """Lower end of the interval, in that unit."""
    high: float
    """Upper end of the interval, in that unit."""


def wilson(share: float, trials: int) -> Interval:
    """Wilson's 95 % interval of a share."""
    z = 1.959964
    middle = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z * np.sqrt(share * (1 - share) / trials + (z / (2 * trials)) ** 2)
    half /= 1 + z * z / trials
    return Interval(share, max(0.0, float(middle - half)), min(1.0, float(middle + half)))


def of_mean(values: NDArray[np.float64]) -> Interval:
    """Student's 95 % interval of the mean of independent values; NaN if they are too few."""
    from scipy.special import stdtrit

    values = np.asarray(values, float)
    if values.size < MIN_SAMPLES:
        return Interval(float(values.mean()) if values.size else np.nan, np.nan, np.nan)
    half = stdtrit(values.size - 1, 0.975) * values.std(ddof=1) / np.sqrt(values.size)
    middle = float(values.mean())
    return Interval(middle, middle - float(half), middle + float(half))


def of_geometric_mean(values: NDArray[np.float64]) -> Interval:
    """Student's 95 % interval of the geometric mean of positive values, from their logarithms."""
    return Interval(*np.exp(of_mean(np.log(values))).tolist())


def of_median(values: NDArray[np.float64]) -> Interval:
    """95 % interval of the median of all values (trials, k), whose rows are independent trials.

    It is Woodruff's: Student's interval of the share of values that are at most the median, read
    back through the quantiles of the values.
    """
    if not values.size:
        return Interval(np.nan, np.nan, np.nan)
    middle = float(np.median(values))
    share = of_mean((values <= middle).mean(axis=1))
    if np.isnan(share.low):
        return Interval(middle, np.nan, np.nan)
    half = (share.high - share.low) / 2
    low, high = np.quantile(values, (max(0.0, 0.5 - half), min(1.0, 0.5 + half))).tolist()
    return Interval(middle, low, high)


def of_rms(squares: NDArray[np.float64], others: NDArray[np.float64] | None = None) -> Interval:
    """95 % interval of a root mean square, or of the ratio of two over the same trials.

    `squares` are the mean squares of the trials, and `others` those of the root mean square to
    divide by. It is Student's interval of the jackknife's pseudo-values of the logarithm.
    """
    below = np.ones_like(squares) if others is None else others
    total, total_below, count = squares.sum(), below.sum(), squares.size
    if count < MIN_SAMPLES or not total > 0 or not total_below > 0:
        value = np.sqrt(total / total_below) if total_below > 0 else np.nan
        return Interval(float(value), np.nan, np.nan)
    whole = np.log(total / total_below)
    with np.errstate(divide="ignore"):
        without = np.log((total - squares) / (total_below - below))
    pseudo = of_mean(count * whole - (count - 1) * without)
    half = (pseudo.high - pseudo.low) / 2
    low, high = np.exp((whole - half) / 2), np.exp((whole + half) / 2)
    return Interval(float(np.exp(whole / 2)), float(low), float(high))


def of_resamples(value: float, samples: NDArray[np.float64]) -> Interval:
    """A value with the 2.5 and 97.5 % quantiles of its resamples; NaN where none is finite."""
    known = samples[np.isfinite(samples)]
    if not len(known):
        return Interval(value, np.nan, np.nan)
    low, high = np.quantile(known, (0.025, 0.975)).tolist()
    return Interval(value, low, high)
