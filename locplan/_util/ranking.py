"""Statistics of how well predictors rank places by their error: Spearman's coefficient and AUC."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import Interval, of_resamples

Array = NDArray[np.float64]
RESAMPLES = 1000


@dataclass(frozen=True)
class Rank:
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
class Resamples:
    """Numbers of times that places and maps are drawn in each of `RESAMPLES` bootstraps."""

    places: Sequence[Array]
    """Draws of the places within each map, (RESAMPLES, n) a map."""
    maps: Array
    """Draws of the maps, (RESAMPLES, maps)."""

    @classmethod
    def of(cls, counts: Sequence[int], seed: int = 0) -> Resamples:
        """Resamples of maps with these numbers of places."""
        random = np.random.default_rng(seed)
        places = [_draws(random, count) for count in counts]
        maps = _draws(random, len(counts)) if len(counts) > 1 else np.ones((RESAMPLES, 1))
        return cls(places, maps)


def rank(values: Sequence[Array], errors: Sequence[Array], drawn: Resamples) -> Rank:
    """Statistics of how well values rank errors.

    Parameters
    ----------
    values, errors : sequence of (n,) arrays
        Values and errors of each map; greater values should mean greater errors. Constant values
        have the coefficient 0.
    drawn : Resamples
        Resamples of the same numbers of maps and places.
    """
    every, every_error = np.concatenate(values), np.concatenate(errors)
    weights = np.concatenate(
        [own * drawn.maps[:, m, None] for m, own in enumerate(drawn.places)], axis=1
    )
    within = np.array([spearman(v, e) for v, e in zip(values, errors, strict=True)])
    within_drawn = np.stack(
        [_spearmans(v, e, w) for v, e, w in zip(values, errors, drawn.places, strict=True)], axis=1
    )
    means = (within_drawn * drawn.maps).sum(axis=1) / drawn.maps.sum(axis=1)
    return Rank(
        of_resamples(spearman(every, every_error), _spearmans(every, every_error, weights)),
        of_resamples(float(within.mean()), means),
        of_resamples(auc(every, every_error), _aucs(every, every_error, weights)),
    )


def spearman(values: Array, errors: Array) -> float:
    """Spearman's rank correlation, 0 if either is constant."""
    return float(_spearmans(values, errors, np.ones((1, len(values))))[0])


def auc(values: Array, errors: Array) -> float:
    """Area under the ROC curve of finding the worst fifth, by Mann and Whitney; ties count half.

    Examples
    --------
    >>> errors = np.array([0.1, 0.2, 0.3, 0.4, 5.0])
    >>> auc(np.array([1.0, 2.0, 3.0, 4.0, 5.0]), errors), auc(np.ones(5), errors)
    (1.0, 0.5)
    """
    return float(_aucs(values, errors, np.ones((1, len(values))))[0])


def _ranks(values: Array, weights: Array) -> Array:
    """Mean ranks, (m, n), of values that each occur as often as `weights` (m, n) say."""
    _, group = np.unique(values, return_inverse=True)
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    sizes = np.add.reduceat(weights[:, order], starts, axis=1)
    return (np.cumsum(sizes, axis=1) - (sizes - 1) / 2)[:, group]


def _spearmans(values: Array, errors: Array, weights: Array) -> Array:
    """Spearman's coefficient for each row of weights (m, n), (m,)."""
    total = weights.sum(axis=1, keepdims=True)
    a, b = (_ranks(v, weights) - (total + 1) / 2 for v in (values, errors))
    size = np.sqrt((weights * a * a).sum(axis=1) * (weights * b * b).sum(axis=1))
    return np.asarray(
        np.divide((weights * a * b).sum(axis=1), size, out=np.zeros(len(a)), where=size > 0)
    )


def _aucs(values: Array, errors: Array, weights: Array) -> Array:
    """AUC for each row of weights (m, n), (m,); the worst places are the same in all rows."""
    bad = errors >= np.quantile(errors, 0.8, method="higher")
    ranks = (weights * _ranks(values, weights))[:, bad].sum(axis=1)
    count, others = weights[:, bad].sum(axis=1), weights[:, ~bad].sum(axis=1)
    pairs = count * others
    above = ranks - count * (count + 1) / 2
    return np.asarray(np.divide(above, pairs, out=np.full(len(pairs), 0.5), where=pairs > 0))


def _draws(random: np.random.Generator, count: int) -> Array:
    """Number of times that each of `count` items is drawn, (RESAMPLES, count)."""
    return random.multinomial(count, np.full(count, 1 / count), RESAMPLES).astype(float)
