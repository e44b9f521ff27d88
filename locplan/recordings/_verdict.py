"""What the evaluation of a recorded drive comes to, in two sentences."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from locplan.recordings._evaluation import Agreement, DriveEvaluation
from locplan.simulation._formats import plain, short

PREFERRED = ("scan", "fused", "fisher", "sad")
"""The estimators, the one that is named first where it ranks the scans better than chance."""
SHARP = 0.1
"""Deviation up to which nine of ten scans fix the position well enough everywhere [m]."""
MANY = 0.05
"""Share of outdated scans from which on they are worth a sentence."""


def verdict(found: DriveEvaluation) -> list[str]:
    """Two sentences: whether a field says where the drive was badly localized, and where that was.

    Estimators of one's own are named after those of the library.
    """
    return [_about_fields(found.agreements), _about_places(found)]


def _about_fields(agreements: dict[str, Agreement]) -> str:
    names = [name for name in PREFERRED if name in agreements]
    names += [name for name in agreements if name not in names]
    for name in names:
        rank, factor = agreements[name].rank, agreements[name].factor
        if rank.spearman.low > 0 or rank.auc.low > 0.5:
            return (
                f"On this drive `{name}` says where the scans fix the pose badly: rank correlation"
                f" {short(rank.spearman)}, AUC {short(rank.auc)} for the worst fifth, and its"
                f" deviations are {plain(factor.value)} times the measured ones."
            )
    best = max(names, key=lambda name: agreements[name].rank.spearman.value)
    rank = agreements[best].rank
    if math.isnan(rank.spearman.low):
        return (
            f"The drive is too short to tell whether a field is right: `{best}` has a rank"
            f" correlation of {plain(rank.spearman.value)}, but less than 50 m were compared."
        )
    return (
        f"No field ranks the scans of this drive better than chance (`{best}`"
        f" {short(rank.spearman)}): do not plan by a field here before you know why."
    )


def _about_places(found: DriveEvaluation) -> str:
    std = found.matches.position_std
    some = found.compared
    nine_of_ten = float(np.quantile(std[some], 0.9))
    if nine_of_ten <= SHARP:
        text = (
            f"Nine of ten scans fix the position within {100 * nine_of_ten:.0f} cm: there is"
            " little to gain by other ways"
        )
    else:
        worst = _worst_block(found.blocks[some], np.log(std[some]))
        here = np.flatnonzero(some)[found.blocks[some] == worst]
        median, direction = float(np.median(std[here])), _axis(found.matches.direction[here])
        x, y = found.matches.recording.poses[here, :2].mean(axis=0)
        text = (
            f"The worst 10 m lie around {_place(x, y)}, where the position is known to"
            f" {100 * median:.0f} cm along {math.degrees(direction):.0f}°"
        )
    outdated = found.outdated
    if outdated.sum() < max(1, MANY * len(std)):
        return text + "."
    blocks, counts = np.unique(found.blocks[outdated], return_counts=True)
    most = outdated & (found.blocks == blocks[np.argmax(counts)])
    x, y = found.matches.recording.poses[most, :2].mean(axis=0)
    return (
        f"{text}; {outdated.sum()} of {len(std)} scans saw what is not on the map, most around"
        f" {_place(x, y)}: people, or the map is out of date there."
    )


def _worst_block(blocks: NDArray[np.int64], values: NDArray[np.float64]) -> int:
    """The block of the greatest mean, of those with at least three scans if there are any."""
    every, number, counts = np.unique(blocks, return_inverse=True, return_counts=True)
    means = np.bincount(number, values) / counts
    enough = counts >= 3
    return int(every[np.argmax(np.where(enough, means, -np.inf) if enough.any() else means)])


def _axis(directions: NDArray[np.float64]) -> float:
    """Mean of axes, which have no sense, 0 to pi [rad]."""
    return float(np.angle(np.exp(2j * directions).mean()) / 2 % np.pi)


def _place(x: float, y: float) -> str:
    """A position to 0.1 m; no -0.0."""
    return ",".join(f"{round(value, 1) + 0.0:.1f}" for value in (x, y))


def agreement_texts(each: Agreement) -> list[str]:
    """The columns of a table: rank correlation, AUC, direction, and factor."""
    return [
        short(each.rank.spearman),
        short(each.rank.auc),
        "-" if math.isnan(each.aligned.value) else f"{each.aligned.value:.0%}",
        short(each.factor),
    ]
