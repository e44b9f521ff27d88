"""Trials of cures: which are stopped, which are better, and which are confirmed by fresh drives.

Nothing here knows of maps or robots: cures are kinds, and a function drives them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from locplan._kernels.arrays import Bools, Floats
from locplan._util.intervals import Interval, of_mean, wilson
from locplan.simulation.verdict import BETTER, DriveSet, Verdict, compare, confirm

WORTHWHILE = 0.9
"""Ratio of errors from which on a cure is worth its effort, as for paths."""


class Outcome(NamedTuple):
    """How drives went; those of one place in the arrays have one world and one seed."""

    log_error: Floats
    """Logarithm of the error of each drive, (trips, drives) [ln m]."""
    lost: Bools
    """True for the drives that were off by over 1 m at some time, (trips, drives)."""
    lost_at: Floats
    """Distance along the trip where they first were, else NaN, (trips, drives) [m]."""

    @property
    def drive_set(self) -> DriveSet:
        """The drives along all trips as one set."""
        return DriveSet(self.log_error.ravel(), self.lost.ravel())

    @property
    def error(self) -> Interval:
        """Error of a typical drive: the geometric mean [m]."""
        return Interval(*np.exp(of_mean(self.log_error.ravel())).tolist())

    @property
    def lost_rate(self) -> Interval:
        """Share of the drives that were off by over 1 m at some time, 0..1."""
        return wilson(float(self.lost.mean()), self.lost.size)


class Contrast(NamedTuple):
    """What drives with a cure say beside those without it, with the same worlds and seeds."""

    verdict: Verdict
    """The verdict on the cure."""
    gain: Interval
    """Share of the drives that are no longer lost, less those that newly are, -1..1."""
    score: float
    """Mean difference of what drives are ranked by, ln error + 1 where lost; below 0 is better."""

    @property
    def keeps_more(self) -> bool:
        """Whether the cure is better since it keeps drives from getting lost."""
        return self.verdict.word == BETTER and self.verdict.fewer_lost


def contrast(before: Outcome, after: Outcome) -> Contrast:
    """Compare two sets of drives of the same numbers.

    Parameters
    ----------
    before, after : Outcome
        Drives of the same numbers without the cure and with it.
    """
    apart = after.log_error - before.log_error
    saved = (before.lost & ~after.lost).sum(), (after.lost & ~before.lost).sum()
    gain = paired_shares(*saved, apart.size)
    return Contrast(
        compare(before.drive_set, after.drive_set), gain, float(apart.mean()) - gain.value
    )


def paired_shares(ones: int, others: int, trials: int) -> Interval:
    """Difference of two shares of paired trials, by Bonett and Price's adjusted interval.

    Parameters
    ----------
    ones, others : int
        Number of the trials of which only the first, and only the second, is true.
    trials : int
        Number of all trials.
    """
    p, q = (ones + 1) / (trials + 2), (others + 1) / (trials + 2)
    half = 1.96 * math.sqrt((p + q - (p - q) ** 2) / (trials + 2))
    return Interval((ones - others) / trials, max(-1.0, p - q - half), min(1.0, p - q + half))


def is_hopeless(before: Outcome, after: Outcome) -> bool:
    """Whether a cure has shown after a few drives that it is not better.

    Parameters
    ----------
    before, after : Outcome
        Drives of the same numbers without the cure and with it.
    """
    scores = (after.log_error + after.lost - before.log_error - before.lost).ravel()
    error = scores.std(ddof=1) / math.sqrt(scores.size)
    # One-sided at 7 %, as in the race of paths; no effect at all is none later on either.
    return bool(scores.mean() - 1.5 * error >= math.log(WORTHWHILE) / 2)


class Trial(NamedTuple):
    """What the drives of one cure show."""

    contrast: Contrast
    """The comparison with the drives without it."""
    outcome: Outcome
    """How its drives went."""
    is_stopped: bool
    """True if it did not lead after a few drives, which are then all."""


def try_cure(
    drive: Callable[[range], Outcome],
    few: tuple[range, Outcome],
    many: tuple[range, Outcome],
) -> Trial:
    """Drive a cure a few times, and if it leads, with the drives that judge it.

    Parameters
    ----------
    drive : callable
        Drives the site with the cure.
    few, many : (range, Outcome)
        Numbers of the drives, and how they went without the cure.
    """
    outcome = drive(few[0])
    found = contrast(few[1], outcome)
    if is_hopeless(few[1], outcome) and found.verdict.word != BETTER:
        return Trial(found, outcome, True)
    outcome = drive(many[0])
    return Trial(contrast(many[1], outcome), outcome, False)


def confirm_cures(
    sure: tuple[str, ...],
    order: Sequence[str],
    drive: Callable[[tuple[str, ...], range], Outcome],
    known: range,
    fresh: range,
) -> tuple[tuple[str, ...], Outcome, Outcome]:
    """Choose the cures that are worth being done together, and confirm them by fresh drives.

    Parameters
    ----------
    sure : tuple of str
        Kinds of those that are done whatever drives say.
    order : sequence of str
        Kinds of those that are better alone, the best first.
    drive : callable
        Drives the site with cures of some kinds.
    known, fresh : range
        Numbers of the drives that judged the cures, and of those that alone decide.

    Returns
    -------
    kinds, before, after
        The kinds, and the fresh drives without and with all of them.
    """
    taken = sure or tuple(order[:1])
    for kind in order:
        # A second is worth no lower error alone.
        if kind not in taken:
            both = drive(taken, known), drive((*taken, kind), known)
            taken = (*taken, kind) if contrast(*both).keeps_more else taken
    if taken != sure:
        verdict = confirm(
            lambda some: (drive(sure, some).drive_set, drive(taken, some).drive_set),
            fresh,
            looks=[len(fresh)],
        )
        taken = taken if verdict.word == BETTER else sure
    return taken, drive((), fresh), drive(taken, fresh)
