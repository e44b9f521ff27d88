"""How well predicted covariances agree with measured ones along a drive."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import Interval
from locplan._util.ranking import Rank, Resamples, rank
from locplan.field import position_axes
from locplan.recordings._blocks import draws_of, with_ends

Numbers = NDArray[np.float64]
ELONGATED = 3.0
"""Ratio of the measured deviations from which an ellipse has a direction."""
ALIGNED = math.radians(15.0)
"""Greatest angle between a measured and a predicted axis that agree [rad]."""


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
