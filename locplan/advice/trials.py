"""Trials of fixes: early stopping, verdicts, combination, and confirmation by fresh drives.

This module does not know maps or robots: a fix is a word, and a function simulates it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from locplan._support.intervals import Interval
from locplan._support.kernels.arrays import Bools, Floats
from locplan.simulation.verdict import (
    BETTER,
    DriveSet,
    Verdict,
    compare_drives,
    confirm_alternative,
)

WORTHWHILE = 0.9
"""Maximum ratio of errors for which a fix is worth its effort, as for paths."""


MIN_FRESH = 24
"""Minimum number of fresh drives for an early decision."""
SUPERFLUOUS = 0.95
"""Maximum ratio of errors of a fix in a combination, unless it prevents lost drives."""


class DrivesOnRoutes(NamedTuple):
    """Open-loop drives along all routes; drives at the same index of two sets are a pair."""

    log_error: Floats
    """Logarithm of the error of each drive, (routes, drives) [ln m]."""
    lost: Bools
    """True for the drives that were lost, (routes, drives)."""
    lost_at: Floats
    """Distance along the route where each gets lost, or NaN, (routes, drives) [m]."""
    off_at_end: Bools
    """True for the drives that are off at the end, (routes, drives)."""

    @classmethod
    def join(cls, parts: Sequence[DrivesOnRoutes]) -> DrivesOnRoutes:
        """Join drives of further numbers along the same routes.

        Parameters
        ----------
        parts : sequence of Outcome
            The drives.
        """
        return cls(*(np.concatenate(arrays, axis=1) for arrays in zip(*parts, strict=True)))

    def select(self, routes: slice = slice(None), drives: slice = slice(None)) -> DrivesOnRoutes:
        """Return the drives of some routes and some indices.

        Parameters
        ----------
        routes : slice, all by default
            The routes; all by default.
        drives : slice, all by default
            The indices of the drives; all by default.
        """
        at = routes, drives
        return DrivesOnRoutes(
            self.log_error[at], self.lost[at], self.lost_at[at], self.off_at_end[at]
        )

    @property
    def drive_set(self) -> DriveSet:
        """The drives along all routes as one set."""
        return DriveSet(self.log_error.ravel(), self.lost.ravel(), self.off_at_end.ravel())


class FixContrast(NamedTuple):
    """Comparison of drives with a fix and without it."""

    verdict: Verdict
    """The verdict on the fix."""
    gain: Interval
    """Share of drives no longer lost minus share of drives newly lost, -1..1."""
    score: float
    """Mean difference of ln error + 1 if lost, by which fixes are ranked; below 0 is better."""

    @property
    def has_fewer_lost(self) -> bool:
        """True if the fix is better because it keeps drives from getting lost."""
        return self.verdict.word == BETTER and self.verdict.has_fewer_lost


def compare_fix(
    before: DrivesOnRoutes, after: DrivesOnRoutes, *, n_alternatives: int = 1
) -> FixContrast:
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
    gain = compare_paired_shares(*saved, log_ratios.size)
    return FixContrast(
        compare_drives(before.drive_set, after.drive_set, n_alternatives=n_alternatives),
        gain,
        float(log_ratios.mean()) - gain.value,
    )


def compare_paired_shares(n_first: int, n_second: int, trials: int) -> Interval:
    """Return the difference of two shares of paired trials, with Bonett and Price's interval.

    Parameters
    ----------
    n_first, n_second : int
        Number of the trials of which only the first, and only the second, is true.
    trials : int
        Number of all trials.
    """
    p, q = (n_first + 1) / (trials + 2), (n_second + 1) / (trials + 2)
    half = 1.96 * math.sqrt((p + q - (p - q) ** 2) / (trials + 2))
    return Interval((n_first - n_second) / trials, max(-1.0, p - q - half), min(1.0, p - q + half))


def is_futile(before: DriveSet, after: DriveSet) -> bool:
    """True if a few drives suffice to see that a fix is not better.

    Parameters
    ----------
    before, after : DriveSet
        Drives of the same numbers without the fix and with it.
    """
    scores = after.log_error + after.lost - before.log_error - before.lost
    error = scores.std(ddof=1) / math.sqrt(scores.size)
    # One-sided at 7 %, as in the race of paths.
    return bool(scores.mean() - 1.5 * error >= math.log(WORTHWHILE) / 2)


class FixTrial(NamedTuple):
    """The drives with one fix."""

    contrast: FixContrast
    """The comparison with the drives without it."""
    outcome: DrivesOnRoutes
    """The drives."""
    is_stopped: bool
    """True if the trial was stopped after a few drives."""


def try_fix(
    drive: Callable[[range], DrivesOnRoutes],
    trial_drives: tuple[range, DrivesOnRoutes],
    full_drives: tuple[range, DrivesOnRoutes],
) -> FixTrial:
    """Simulate a few drives with a fix, and all drives only if it leads.

    Parameters
    ----------
    drive : callable
        Drives with the fix.
    trial_drives, full_drives : (range, Outcome)
        Numbers of the drives, and the drives without the fix.
    """
    outcome = drive(trial_drives[0])
    first = compare_fix(trial_drives[1], outcome)
    if is_futile(trial_drives[1].drive_set, outcome.drive_set) and first.verdict.word != BETTER:
        return FixTrial(first, outcome, True)
    outcome = drive(full_drives[0])
    return FixTrial(compare_fix(full_drives[1], outcome), outcome, False)


class FixCombination(NamedTuple):
    """The recommended fixes together, and the drives that confirm them."""

    kinds: tuple[str, ...]
    """Kinds of the fixes; empty if fresh drives confirm none."""
    before: DrivesOnRoutes
    """Drives of the baseline, fresh ones if fixes had to be confirmed."""
    after: DrivesOnRoutes
    """The same drives with all of the fixes."""


DriveFixes = Callable[[tuple[str, ...], range], DrivesOnRoutes]
"""Function that drives with fixes of some kinds."""


def select_fixes(
    certain_kinds: tuple[str, ...],
    ranked_kinds: Sequence[str],
    drive: DriveFixes,
    selection_numbers: range,
    costly_kinds: Sequence[str] = (),
) -> tuple[str, ...]:
    """Select fixes to combine until neither lost drives nor the error fall further.

    Parameters
    ----------
    certain_kinds : tuple of str
        Kinds of fixes that are recommended even if no drive improves.
    ranked_kinds : sequence of str
        Kinds of fixes that are better alone, the best first.
    drive : callable
        Drives with fixes of some kinds.
    selection_numbers : range
        Numbers of the drives that select the fixes.
    costly_kinds : sequence of str, default ()
        Kinds that must reduce lost drives; a lower error does not justify them.
    """
    kinds = certain_kinds or tuple(ranked_kinds[:1])
    while kind := _find_next_fix(kinds, ranked_kinds, drive, selection_numbers, costly_kinds):
        kinds = (*kinds, kind)
    for kind in [kind for kind in kinds if kind not in certain_kinds]:
        reduced = tuple(other for other in kinds if other != kind)
        if reduced and _is_superfluous(
            drive(reduced, selection_numbers), drive(kinds, selection_numbers)
        ):
            kinds = reduced
    return kinds


def confirm_fixes(
    certain_kinds: tuple[str, ...],
    kinds: tuple[str, ...],
    drive: DriveFixes,
    selection_numbers: range,
    fresh_numbers: range,
) -> FixCombination:
    """Confirm a combination of fixes by fresh drives, which alone decide.

    Fixes that are recommended even if no drive improves need no confirmation.

    Parameters
    ----------
    certain_kinds : tuple of str
        Kinds of fixes that are recommended even if no drive improves.
    kinds : tuple of str
        Kinds of all fixes of the combination.
    drive : callable
        Drives with fixes of some kinds.
    selection_numbers : range
        Numbers of the drives that selected the fixes.
    fresh_numbers : range
        Numbers of the fresh drives.
    """
    numbers = selection_numbers
    if kinds != certain_kinds:
        n_routes = len(drive(kinds, fresh_numbers[:1]).lost)
        half = (len(fresh_numbers) + 1) // 2
        is_early = half * n_routes >= MIN_FRESH
        verdict = confirm_alternative(
            lambda numbers: (
                drive(certain_kinds, numbers).drive_set,
                drive(kinds, numbers).drive_set,
            ),
            fresh_numbers,
            looks=[half, len(fresh_numbers)]
            if is_early and half < len(fresh_numbers)
            else [len(fresh_numbers)],
        )
        numbers = fresh_numbers[: verdict.n_drives // n_routes]
        kinds = kinds if verdict.word == BETTER else certain_kinds
    return FixCombination(kinds, drive((), numbers), drive(kinds, numbers))


def _find_next_fix(
    kinds: tuple[str, ...],
    ranked_kinds: Sequence[str],
    drive: DriveFixes,
    selection_numbers: range,
    costly_kinds: Sequence[str],
) -> str:
    """Return the fix that improves a combination most; empty if no fix does."""
    left = [kind for kind in ranked_kinds if kind not in kinds]
    scores = {}
    for kind in left:
        outcomes = drive(kinds, selection_numbers), drive((*kinds, kind), selection_numbers)
        addition = compare_fix(*outcomes, n_alternatives=len(left))
        is_better = addition.verdict.word == BETTER
        if addition.has_fewer_lost or (is_better and kind not in costly_kinds):
            scores[kind] = addition.score
    return min(scores, key=lambda kind: scores[kind], default="")


def _is_superfluous(reduced: DrivesOnRoutes, combined: DrivesOnRoutes) -> bool:
    """True if adding a fix neither prevents lost drives nor lowers the error."""
    addition = compare_fix(reduced, combined)
    return addition.verdict.ratio.value > SUPERFLUOUS and addition.gain.value <= 0
