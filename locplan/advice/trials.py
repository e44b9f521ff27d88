"""Trials of fixes: which are stopped, which are better, and which fresh drives confirm.

Nothing here knows maps or robots: fixes are kinds, and a function drives them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from locplan._support.intervals import Interval
from locplan._support.kernels.arrays import Bools, Floats
from locplan.simulation.verdict import BETTER, DriveSet, Verdict, compare, confirm

WORTHWHILE = 0.9
"""Ratio of errors from which on a fix is worth its effort, as for paths."""


MIN_FRESH = 24
"""Least number of fresh drives from which rates are reported."""
SUPERFLUOUS = 0.95
"""Ratio of errors that a fix of several must fall below, if it keeps no drive from getting lost."""


class Outcome(NamedTuple):
    """Open-loop drives along all routes; drives at the same place of two sets are a pair."""

    log_error: Floats
    """Logarithm of the error of each drive, (routes, drives) [ln m]."""
    lost: Bools
    """True for the drives that were lost, (routes, drives)."""
    lost_at: Floats
    """Distance along the route where they first were, else NaN, (routes, drives) [m]."""
    off_at_end: Bools
    """True for the drives that are off at the end, (routes, drives)."""

    @classmethod
    def join(cls, parts: Sequence[Outcome]) -> Outcome:
        """Join drives of further numbers along the same routes.

        Parameters
        ----------
        parts : sequence of Outcome
            The drives.
        """
        return cls(*(np.concatenate(arrays, axis=1) for arrays in zip(*parts, strict=True)))

    def select(self, routes: slice = slice(None), drives: slice = slice(None)) -> Outcome:
        """Return the drives along some routes and at some places.

        Parameters
        ----------
        routes : slice, all by default
            The routes; all by default.
        drives : slice, all by default
            The places of the drives; all by default.
        """
        at = routes, drives
        return Outcome(self.log_error[at], self.lost[at], self.lost_at[at], self.off_at_end[at])

    @property
    def drive_set(self) -> DriveSet:
        """The drives along all routes as one set."""
        return DriveSet(self.log_error.ravel(), self.lost.ravel(), self.off_at_end.ravel())


class Contrast(NamedTuple):
    """Comparison of the drives with a fix with those without it."""

    verdict: Verdict
    """The verdict on the fix."""
    gain: Interval
    """Share of the drives that are no longer lost, less those that newly are, -1..1."""
    score: float
    """Mean difference of ln error + 1 if lost, by which fixes are ranked; below 0 is better."""

    @property
    def keeps_more(self) -> bool:
        """True if the fix is better because it keeps drives from getting lost."""
        return self.verdict.word == BETTER and self.verdict.fewer_lost


def contrast(before: Outcome, after: Outcome, *, n_alternatives: int = 1) -> Contrast:
    """Compare two sets of drives of the same numbers.

    Parameters
    ----------
    before, after : Outcome
        Drives of the same numbers without the fix and with it.
    n_alternatives : int, default 1
        Number of fixes that share the error probability.
    """
    log_ratios = after.log_error - before.log_error
    saved = (before.lost & ~after.lost).sum(), (after.lost & ~before.lost).sum()
    gain = paired_shares(*saved, log_ratios.size)
    return Contrast(
        compare(before.drive_set, after.drive_set, n_alternatives=n_alternatives),
        gain,
        float(log_ratios.mean()) - gain.value,
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


def is_hopeless(before: DriveSet, after: DriveSet) -> bool:
    """True if a fix has shown after a few drives that it is not better.

    Parameters
    ----------
    before, after : DriveSet
        Drives of the same numbers without the fix and with it.
    """
    scores = after.log_error + after.lost - before.log_error - before.lost
    error = scores.std(ddof=1) / math.sqrt(scores.size)
    # One-sided at 7 %, as in the race of paths; no effect at all is none later on either.
    return bool(scores.mean() - 1.5 * error >= math.log(WORTHWHILE) / 2)


class Trial(NamedTuple):
    """The drives with one fix."""

    contrast: Contrast
    """The comparison with the drives without it."""
    outcome: Outcome
    """The drives."""
    is_stopped: bool
    """True if it did not lead after a few drives, which are then all."""


def try_fix(
    drive: Callable[[range], Outcome],
    few: tuple[range, Outcome],
    many: tuple[range, Outcome],
) -> Trial:
    """Drive with a fix a few times, and if it leads, with the drives that judge it.

    Parameters
    ----------
    drive : callable
        Drives with the fix.
    few, many : (range, Outcome)
        Numbers of the drives, and the drives without the fix.
    """
    outcome = drive(few[0])
    first = contrast(few[1], outcome)
    if is_hopeless(few[1].drive_set, outcome.drive_set) and first.verdict.word != BETTER:
        return Trial(first, outcome, True)
    outcome = drive(many[0])
    return Trial(contrast(many[1], outcome), outcome, False)


class Combination(NamedTuple):
    """The fixes that are worth being done together, and their fresh drives."""

    kinds: tuple[str, ...]
    """Kinds of the fixes; empty if fresh drives confirm none."""
    before: Outcome
    """Drives of the baseline, fresh ones if fixes had to be confirmed."""
    after: Outcome
    """The same drives with all of the fixes."""


DriveFixes = Callable[[tuple[str, ...], range], Outcome]
"""Function that drives with fixes of some kinds."""


def select_fixes(
    sure: tuple[str, ...],
    order: Sequence[str],
    drive: DriveFixes,
    known: range,
    costly: Sequence[str] = (),
) -> tuple[str, ...]:
    """Select fixes to combine until neither lost drives nor the error fall further.

    Parameters
    ----------
    sure : tuple of str
        Kinds of those that are done whatever drives show.
    order : sequence of str
        Kinds of those that are better alone, the best first.
    drive : callable
        Drives with fixes of some kinds.
    known : range
        Numbers of the drives that judged the fixes.
    costly : sequence of str, default ()
        Kinds that must keep drives from getting lost; a lower error alone is not worth them.
    """
    kinds = sure or tuple(order[:1])
    while kind := _next_fix(kinds, order, drive, known, costly):
        kinds = (*kinds, kind)
    for kind in [kind for kind in kinds if kind not in sure]:
        reduced = tuple(other for other in kinds if other != kind)
        if reduced and _is_superfluous(drive(reduced, known), drive(kinds, known)):
            kinds = reduced
    return kinds


def confirm_fixes(
    sure: tuple[str, ...], taken: tuple[str, ...], drive: DriveFixes, known: range, fresh: range
) -> Combination:
    """Confirm a combination of fixes by fresh drives, which alone decide.

    Fixes that are done whatever drives show need no confirmation: they have known drives.

    Parameters
    ----------
    sure : tuple of str
        Kinds of the fixes that are done whatever drives show.
    taken : tuple of str
        Kinds of all fixes of the combination.
    drive : callable
        Drives with fixes of some kinds.
    known : range
        Numbers of the drives that selected the fixes.
    fresh : range
        Numbers of other drives.
    """
    numbers = known
    if taken != sure:
        n_routes = len(drive(taken, fresh[:1]).lost)
        half = (len(fresh) + 1) // 2
        is_early = half * n_routes >= MIN_FRESH
        verdict = confirm(
            lambda numbers: (drive(sure, numbers).drive_set, drive(taken, numbers).drive_set),
            fresh,
            looks=[half, len(fresh)] if is_early and half < len(fresh) else [len(fresh)],
        )
        numbers = fresh[: verdict.n_drives // n_routes]
        taken = taken if verdict.word == BETTER else sure
    return Combination(taken, drive((), numbers), drive(taken, numbers))


def _next_fix(
    taken: tuple[str, ...],
    order: Sequence[str],
    drive: DriveFixes,
    known: range,
    costly: Sequence[str],
) -> str:
    """Return the fix that is better in addition to others and gains most; empty if none is."""
    left = [kind for kind in order if kind not in taken]
    scores = {}
    for kind in left:
        outcomes = drive(taken, known), drive((*taken, kind), known)
        addition = contrast(*outcomes, n_alternatives=len(left))
        is_better = addition.verdict.word == BETTER
        if addition.keeps_more or (is_better and kind not in costly):
            scores[kind] = addition.score
    return min(scores, key=lambda kind: scores[kind], default="")


def _is_superfluous(without: Outcome, together: Outcome) -> bool:
    """True if one of several fixes neither keeps a drive from getting lost nor lowers the error."""
    addition = contrast(without, together)
    return addition.verdict.ratio.value > SUPERFLUOUS and addition.gain.value <= 0
