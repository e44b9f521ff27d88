"""Random numbers from one seed, intervals of statistics, rank correlations, and their text."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from locplan._support.kernels.arrays import Floats, Ints
from locplan._support.poses import compute_travel_distances

MIN_SAMPLES = 5
"""Minimum number of values that have an interval; fewer values have only a mean."""


class Interval(NamedTuple):
    """A value with its 95 % interval; NaN where there is none."""

    value: float
    """The estimate, in the unit of what it is of."""
    low: float
    """Lower end of the interval, in that unit."""
    high: float
    """Upper end of the interval, in that unit."""


def _make_point_estimate(value: float) -> Interval:
    return Interval(value, np.nan, np.nan)


def compute_wilson_interval(share: float, trials: int) -> Interval:
    """Return a share with Wilson's 95 % interval."""
    z = 1.959964
    middle = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z * np.sqrt(share * (1 - share) / trials + (z / (2 * trials)) ** 2)
    half /= 1 + z * z / trials
    return Interval(share, max(0.0, float(middle - half)), min(1.0, float(middle + half)))


def estimate_mean(values: Floats) -> Interval:
    """Return the mean of independent values with Student's 95 % interval; NaN for too few."""
    from scipy.special import stdtrit

    values = np.asarray(values, float)
    if values.size < MIN_SAMPLES:
        return _make_point_estimate(float(values.mean()) if values.size else np.nan)
    half = stdtrit(values.size - 1, 0.975) * values.std(ddof=1) / np.sqrt(values.size)
    middle = float(values.mean())
    return Interval(middle, middle - float(half), middle + float(half))


def estimate_geometric_mean(values: Floats) -> Interval:
    """Return the geometric mean of positive values with Student's 95 % interval."""
    return Interval(*np.exp(estimate_mean(np.log(values))).tolist())


def estimate_median(values: Floats) -> Interval:
    """Return the median of values (trials, k) with a 95 % interval; rows are independent.

    It is Woodruff's: Student's interval of the share of values that are at most the median, read
    back through the quantiles of the values.
    """
    if not values.size:
        return _make_point_estimate(np.nan)
    middle = float(np.median(values))
    share = estimate_mean((values <= middle).mean(axis=1))
    if np.isnan(share.low):
        return _make_point_estimate(middle)
    half = (share.high - share.low) / 2
    low, high = np.quantile(values, (max(0.0, 0.5 - half), min(1.0, 0.5 + half))).tolist()
    return Interval(middle, low, high)


def estimate_rms(squares: Floats) -> Interval:
    """Return the root of the mean of the trials' mean squares, with a 95 % interval.

    It is Student's interval of the jackknife's pseudo-values of the logarithm.
    """
    total, count = squares.sum(), squares.size
    if count < MIN_SAMPLES or not total > 0:
        return _make_point_estimate(float(np.sqrt(total / count)) if count else np.nan)
    log_mean_square = np.log(total / count)
    with np.errstate(divide="ignore"):
        log_leave_one_out = np.log((total - squares) / (count - 1))
    pseudo = estimate_mean(count * log_mean_square - (count - 1) * log_leave_one_out)
    half = (pseudo.high - pseudo.low) / 2
    low, high = np.exp((log_mean_square - half) / 2), np.exp((log_mean_square + half) / 2)
    return Interval(float(np.exp(log_mean_square / 2)), float(low), float(high))


def interval_from_resamples(value: float, samples: Floats) -> Interval:
    """Return a value with the 2.5 and 97.5 % quantiles of its resamples; NaN without any."""
    finite_samples = samples[np.isfinite(samples)]
    if not len(finite_samples):
        return _make_point_estimate(value)
    low, high = np.quantile(finite_samples, (0.025, 0.975)).tolist()
    return Interval(value, low, high)


def format_percent(interval: Interval) -> str:
    """Text of a share, such as 25% [12%, 40%]."""
    return _format_interval(interval, "{:.0%}".format)


def format_rate(rate: Interval) -> str:
    """Text of a share of drives, such as 34 % [25, 44]; a dash if it is not known."""
    if math.isnan(rate.value):
        return "-"
    value, low, high = (f"{100 * bound:.0f}" for bound in rate)
    return f"{value} % [{low}, {high}]"


def format_decimal(value: float, digits: int = 2) -> str:
    """Text of a number such as a correlation: .25, -.25 or 1.25; a dash if it is not known."""
    return "-" if np.isnan(value) else re.sub(r"^(-?)0\.", r"\1.", f"{value:.{digits}f}")


def choose_digits(length: float) -> int:
    """Return the decimals of an error [m]: millimetres below 0.1 m, otherwise centimetres."""
    return 3 if length < 0.0995 else 2


def format_metres(length: float) -> str:
    """Text of an error, such as 0.25 m or 0.025 m."""
    return f"{length:.{choose_digits(length)}f} m"


def format_ratio(interval: Interval) -> str:
    """Text of a correlation or a ratio, such as .25 [.12, .40]."""
    return _format_interval(interval, format_decimal)


def format_two_digits(interval: Interval) -> str:
    """Text of a ratio, such as 0.25 [0.12, 0.40]."""
    return _format_interval(interval, "{:.2f}".format)


def _format_interval(interval: Interval, text: Callable[[float], str]) -> str:
    value, low, high = map(text, interval)
    return value if np.isnan(interval.low) else f"{value} [{low}, {high}]"


RESAMPLES = 1000


def assign_blocks(poses: Floats, length: float = 10.0) -> Ints:
    """Return the block of the path, of some length [m], of each of n poses, (n,)."""
    return np.asarray((compute_travel_distances(poses) / length).astype(np.int64))


def count_block_draws(blocks: Ints, resamples: int = RESAMPLES) -> Floats:
    """Return the number of times that each value's block is drawn, (resamples, n).

    There are no resamples of fewer than five blocks.
    """
    block_numbers, number = np.unique(blocks, return_inverse=True)
    if len(block_numbers) < 5:
        return np.empty((0, len(blocks)))
    return _count_draws(np.random.default_rng(0), len(block_numbers), resamples)[:, number]


def estimate_block_mean(values: Floats, blocks: Ints, is_counted: Floats | None = None) -> Interval:
    """Return the mean of values (n,) with a 95 % interval over blocks; NaN for too few blocks.

    Only values with 1 in `is_counted` (n,) count; by default all.
    """
    is_counted = np.ones(len(values)) if is_counted is None else is_counted
    if not is_counted.any():
        return _make_point_estimate(np.nan)
    weights = count_block_draws(blocks) * is_counted
    with np.errstate(invalid="ignore"):  # none that counts may be drawn
        means = (weights @ values) / weights.sum(axis=1)
    return interval_from_resamples(float(np.average(values, weights=is_counted)), means)


def bootstrap_statistics(
    statistic: Callable[[Floats], Floats], blocks: Ints, resamples: int
) -> list[Interval]:
    """Return statistics (k,) of weighted values with 95 % intervals over blocks.

    `statistic` is called with weights (n,): 1 for all, and then how often each is drawn.
    """
    estimates = statistic(np.ones(len(blocks)))
    resampled_statistics = np.array(
        [statistic(statistic_samples) for statistic_samples in count_block_draws(blocks, resamples)]
    )
    samples = resampled_statistics.reshape(-1, len(estimates)).T
    return [
        interval_from_resamples(float(value), statistic_samples)
        for value, statistic_samples in zip(estimates, samples, strict=True)
    ]


@dataclass(frozen=True)
class RankStatistics:
    """Rank statistics of one predictor.

    Intervals are percentiles of a bootstrap over the places or, with several maps, over the maps
    and then the places in each. They hold for more places like these.
    """

    spearman: Interval
    """Spearman's coefficient over all places together."""
    within: Interval
    """Mean over the maps of Spearman's coefficient within each."""
    auc: Interval
    """Probability that a place among the worst 20 % ranks higher than one of the others, over all
    places together."""


@dataclass(frozen=True, eq=False)
class BootstrapResamples:
    """Numbers of times that places and maps are drawn in each of `RESAMPLES` bootstraps."""

    places: Sequence[Floats]
    """Draws of the places within each map, (RESAMPLES, n) a map."""
    maps: Floats
    """Draws of the maps, (RESAMPLES, maps)."""

    @classmethod
    def from_counts(cls, counts: Sequence[int], seed: int = 0) -> BootstrapResamples:
        """Resamples of maps with these numbers of places."""
        random = np.random.default_rng(seed)
        places = [_count_draws(random, count) for count in counts]
        maps = _count_draws(random, len(counts)) if len(counts) > 1 else np.ones((RESAMPLES, 1))
        return cls(places, maps)


def compute_rank_statistics(
    values: Sequence[Floats], errors: Sequence[Floats], resamples: BootstrapResamples
) -> RankStatistics:
    """Compute statistics of how well values rank errors.

    Parameters
    ----------
    values, errors : sequence of (n,) arrays
        Values and errors of each map; greater values should mean greater errors. Constant values
        have the coefficient 0.
    resamples : Resamples
        Resamples of the same numbers of maps and places.
    """
    all_values, all_errors = np.concatenate(values), np.concatenate(errors)
    weights = np.concatenate(
        [
            place_draws * resamples.maps[:, m, None]
            for m, place_draws in enumerate(resamples.places)
        ],
        axis=1,
    )
    within = np.array([compute_spearman(v, e) for v, e in zip(values, errors, strict=True)])
    within_drawn = np.stack(
        [
            _compute_spearmans(v, e, w)
            for v, e, w in zip(values, errors, resamples.places, strict=True)
        ],
        axis=1,
    )
    means = (within_drawn * resamples.maps).sum(axis=1) / resamples.maps.sum(axis=1)
    return RankStatistics(
        interval_from_resamples(
            compute_spearman(all_values, all_errors),
            _compute_spearmans(all_values, all_errors, weights),
        ),
        interval_from_resamples(float(within.mean()), means),
        interval_from_resamples(
            compute_auc(all_values, all_errors), _compute_aucs(all_values, all_errors, weights)
        ),
    )


def compute_spearman(values: Floats, errors: Floats) -> float:
    """Return Spearman's rank correlation, 0 if either is constant."""
    return float(_compute_spearmans(values, errors, np.ones((1, len(values))))[0])


def compute_auc(values: Floats, errors: Floats) -> float:
    """Return the area under the ROC curve of finding the worst fifth; ties count half.

    Examples
    --------
    >>> errors = np.array([0.1, 0.2, 0.3, 0.4, 5.0])
    >>> compute_auc(np.array([1.0, 2.0, 3.0, 4.0, 5.0]), errors), compute_auc(np.ones(5), errors)
    (1.0, 0.5)
    """
    return float(_compute_aucs(values, errors, np.ones((1, len(values))))[0])


def _compute_ranks(values: Floats, weights: Floats) -> Floats:
    """Return the mean ranks, (m, n), of values repeated by `weights` (m, n)."""
    _, group = np.unique(values, return_inverse=True)
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    sizes = np.add.reduceat(weights[:, order], starts, axis=1)
    return (np.cumsum(sizes, axis=1) - (sizes - 1) / 2)[:, group]


def _compute_spearmans(values: Floats, errors: Floats, weights: Floats) -> Floats:
    """Spearman's coefficient for each row of weights (m, n), (m,)."""
    total = weights.sum(axis=1, keepdims=True)
    a, b = (_compute_ranks(v, weights) - (total + 1) / 2 for v in (values, errors))
    size = np.sqrt((weights * a * a).sum(axis=1) * (weights * b * b).sum(axis=1))
    return np.asarray(
        np.divide((weights * a * b).sum(axis=1), size, out=np.zeros(len(a)), where=size > 0)
    )


def _compute_aucs(values: Floats, errors: Floats, weights: Floats) -> Floats:
    """AUC for each row of weights (m, n), (m,); the worst places are the same in all rows."""
    bad = errors >= np.quantile(errors, 0.8, method="higher")
    ranks = (weights * _compute_ranks(values, weights))[:, bad].sum(axis=1)
    bad_count, good_count = weights[:, bad].sum(axis=1), weights[:, ~bad].sum(axis=1)
    pairs = bad_count * good_count
    above = ranks - bad_count * (bad_count + 1) / 2
    return np.asarray(np.divide(above, pairs, out=np.full(len(pairs), 0.5), where=pairs > 0))


def _count_draws(random: np.random.Generator, count: int, resamples: int = RESAMPLES) -> Floats:
    """Number of times that each of `count` items is drawn, (resamples, count)."""
    return random.multinomial(count, np.full(count, 1 / count), resamples).astype(float)


def make_generator(seed: int, *stream: int) -> np.random.Generator:
    """Return the random generator of a stream, independent of all further streams."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=stream))
