"""How well predicted covariances agree with measured ones along a drive, in two sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import (
    Interval,
    Rank,
    Resamples,
    draws_of,
    of_resamples,
    plain,
    rank,
    short,
)
from locplan._util.poses import Numbers
from locplan.field import position_axes
from locplan.recordings._matches import Matches

Mask = NDArray[np.bool_]

PREFERRED = ("fused", "scan", "fisher", "sad")
"""The estimators, the one that is named first where it ranks the scans better than chance."""

MAX_OUTDATED = 0.3
"""Share of scans that do not fit the map from which on nothing else is concluded."""


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

    @property
    def texts(self) -> list[str]:
        """The columns of a table: rank correlation, AUC, direction, and factor."""
        aligned = "-" if math.isnan(self.aligned.value) else f"{self.aligned.value:.0%}"
        return [short(self.rank.spearman), short(self.rank.auc), aligned, short(self.factor)]


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
    elongated = (major > 3 * minor).astype(float)  # a rounder ellipse has no direction
    return Agreement(
        _ranked(values, major, drawn),
        _mean((turned < math.radians(15)).astype(float), elongated, drawn),
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
    return of_resamples(float(np.average(values, weights=counted)), means)


def conclusions(
    matches: Matches,
    agreements: Mapping[str, Agreement],
    compared: Mask,
    outdated: Mask,
    blocks: NDArray[np.int64],
) -> list[str]:
    """Two sentences: whether a field says where the scans fix the pose badly, and where they do.

    Estimators of one's own are named after those of the library.

    Parameters
    ----------
    matches : Matches
        The posteriors of n scans.
    agreements : dict of Agreement
        How well each estimator agrees with them.
    compared, outdated : (n,) arrays of bool
        The scans that were compared, and those that saw what is not on the map.
    blocks : (n,) array of int
        The block of the drive that each scan belongs to.
    """
    apart = int(outdated.sum())
    if apart > MAX_OUTDATED * len(outdated):
        return [
            f"{apart} of {len(outdated)} scans do not fit the map at their poses: check how the"
            " lidar is mounted (mount), the poses, and that the map is of this place and time.",
            "Until then the comparison with the fields says little.",
        ]
    return [
        _about_fields(agreements),
        f"{_about_places(matches, compared, blocks)}{_about_map(matches, outdated, blocks)}.",
    ]


def _about_fields(agreements: Mapping[str, Agreement]) -> str:
    names = [name for name in PREFERRED if name in agreements]
    names += [name for name in agreements if name not in names]
    ranks = {name: agreements[name].rank for name in names}
    sure = [name for name, each in ranks.items() if each.spearman.low > 0 and each.auc.value > 0.5]
    for name in sure:
        rank, factor = ranks[name], agreements[name].factor
        if rank.spearman.value >= 0.5:  # good enough to plan by
            return (
                f"On this drive `{name}` says where the scans fix the pose badly: rank correlation"
                f" {short(rank.spearman)}, AUC {short(rank.auc)} for the worst fifth, and its"
                f" deviations are {plain(factor.value)} times the measured ones."
            )
    best = max(names, key=lambda name: ranks[name].spearman.value)
    rank = ranks[best]
    if math.isnan(rank.spearman.low):
        return (
            f"The drive is too short to tell whether a field is right: `{best}` has a rank"
            f" correlation of {plain(rank.spearman.value)}, but less than 50 m were compared."
        )
    if best in sure:
        return (
            f"The fields rank the scans of this drive only a little better than chance (`{best}`"
            f" {short(rank.spearman)}, AUC {short(rank.auc)}): look at the picture before you plan"
            " by one."
        )
    return (
        f"No field ranks the scans of this drive better than chance (`{best}`"
        f" {short(rank.spearman)}): do not plan by a field here before you know why."
    )


def _about_places(matches: Matches, compared: Mask, blocks: NDArray[np.int64]) -> str:
    """Where the scans fix the position worst."""
    std = matches.position_std
    nine_of_ten = float(np.quantile(std[compared], 0.9))
    if nine_of_ten <= 0.1:
        return (
            f"Nine of ten scans fix the position within {100 * nine_of_ten:.0f} cm: there is"
            " little to gain by other ways"
        )
    worst = _worst_block(blocks[compared], np.log(std[compared]))
    here = compared & (blocks == worst)
    count, median = int(here.sum()), float(np.median(std[here]))
    scans = "the only scan compared fixes" if count == 1 else f"{count} scans fix"
    every = len(np.unique(blocks))
    left = every - len(np.unique(blocks[compared]))
    without = f"; {left} of {every} stretches of 10 m have no scan to compare" if left else ""
    return (
        f"The worst 10 m lie around {_middle(matches, here)}, where {scans} the position to"
        f" {100 * median:.0f} cm along {_axis(matches.direction[here])}°{without}"
    )


def _about_map(matches: Matches, outdated: Mask, blocks: NDArray[np.int64]) -> str:
    """Where the map is out of date, if many scans say so."""
    if outdated.sum() < max(1, 0.05 * len(outdated)):
        return ""
    each, counts = np.unique(blocks[outdated], return_counts=True)
    most = outdated & (blocks == each[np.argmax(counts)])
    return (
        f"; {outdated.sum()} of {len(outdated)} scans saw what is not on the map, most around"
        f" {_middle(matches, most)}: people, changes, or what a map leaves out, such as plants"
    )


def _worst_block(blocks: NDArray[np.int64], values: NDArray[np.float64]) -> int:
    """The block of the greatest mean."""
    every, number, counts = np.unique(blocks, return_inverse=True, return_counts=True)
    return int(every[np.argmax(np.bincount(number, values) / counts)])


def _axis(directions: NDArray[np.float64]) -> int:
    """Mean of axes, which have no sense, in whole degrees from 0 to 179."""
    return round(math.degrees(float(np.angle(np.exp(2j * directions).mean()))) / 2) % 180


def _middle(matches: Matches, chosen: Mask) -> str:
    """The middle of some scans' positions, to 0.1 m; no -0.0."""
    middle = matches.recording.poses[chosen, :2].mean(axis=0)
    return ",".join(f"{round(float(value), 1) + 0.0:.1f}" for value in middle)
