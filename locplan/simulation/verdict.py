"""The verdict on two sets of simulated drives, the one definition of "better".

The n-th drives of both sets have the same world and the same random numbers, so that they are
compared in pairs. Two tests share the error probability of 2.5 %: Student's interval of the paired
logarithms for the errors, and the exact sign test of the pairs with one lost drive for the losses.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from locplan._support.intervals import Interval, compute_wilson_interval, estimate_geometric_mean
from locplan._support.kernels.arrays import Bools, Floats
from locplan.simulation.arrivals import Arrivals
from locplan.simulation.drives import MIN_MEAN_SQUARE, Drives

BETTER, WORSE, NO_DIFFERENCE, UNDECIDED = "better", "worse", "no difference", "undecided"
VERDICT_WORDS = (BETTER, WORSE, NO_DIFFERENCE, UNDECIDED)
"""The four verdicts."""
EQUAL_LOG_RATIO = math.log(1.25)
"""Logarithm of the ratio of errors up to which, and down to whose inverse, there is no
difference."""
LOOKS = (8, 16, 32, 64, 128, 256, 512, 1024)
"""Numbers of drives at which a caller looks, up to its maximum; the last look is at that."""
ERROR_PROBABILITY = 0.0125
"""Probability with which a test may err on a side if drives are looked at only once."""
CRITICAL_VALUE, BOUNDARY_EXPONENT = 2.40, 0.15
"""Critical value at the last look, and the exponent of 2 by which it is greater at each look before
that one.

The true value passes it at any of up to eight looks with a probability of at most 1.25 % a side:
the boundaries of Wang and Tsiatis for drives that double. Their critical value, 2.391, is computed
by tests/benchmarks/power_of_choices.py; a hundredth more is for Student's quantiles of few drives.
Fewer looks, or a last one that is nearer, err less often."""
OFTEN_OFF_RATE, RARELY_OFF_PROBABILITY = 0.2, 0.03
"""Share of drives that is often off at the end, and the probability with which so many or more seem
to be rarely off: at 64 drives at most six may be off, at 32 one, and at 16 none."""


@dataclass(frozen=True, eq=False)
class DriveSet:
    """What a set of drives is judged by; drives in the same place of two sets are a pair."""

    log_error: Floats
    """Logarithm of the error of each drive, (n,) [ln m]."""
    lost: Bools
    """True for each drive that was lost, (n,)."""
    off_at_end: Bools | None = None
    """True for each drive that is off at the end, (n,); None if that is not known."""
    reached: Bools | None = None
    """True for each closed-loop drive that reaches the goal, (m,); None if none was driven."""

    @classmethod
    def from_drives(cls, drives: Iterable[Drives], arrivals: Iterable[Arrivals] = ()) -> DriveSet:
        """Join the drives along some lines to one set.

        Parameters
        ----------
        drives : iterable of Drives
            The open-loop drives along each line.
        arrivals : iterable of Arrivals, default ()
            The closed-loop drives along each line; by default none was driven.
        """
        lines, ends = [*drives], [*arrivals]
        squares = np.concatenate([line.mean_squares for line in lines])
        return cls(
            0.5 * np.log(squares + MIN_MEAN_SQUARE),
            np.concatenate([line.lost for line in lines]),
            np.concatenate([line.off_at_end for line in lines]),
            np.concatenate([line_ends.has_reached_goal for line_ends in ends]) if ends else None,
        )

    @property
    def error(self) -> Interval:
        """Error of a typical drive: the geometric mean [m]."""
        return estimate_geometric_mean(np.exp(self.log_error))

    @property
    def lost_rate(self) -> Interval:
        """Share of the drives that were lost, 0..1."""
        return compute_wilson_interval(float(self.lost.mean()), self.lost.size)

    @property
    def off_at_end_rate(self) -> Interval:
        """Share of the drives that are off at the end, 0..1; NaN if that is not known."""
        if self.off_at_end is None:
            return Interval(math.nan, math.nan, math.nan)
        return compute_wilson_interval(float(self.off_at_end.mean()), self.off_at_end.size)

    @property
    def is_rarely_off(self) -> bool:
        """True if so few drives are off at the end that they surely are not often."""
        return self.can_be_rarely_off(self.lost.size)

    def can_be_rarely_off(self, n_drives: int) -> bool:
        """Return whether these and further drives can be rarely off at the end together.

        Parameters
        ----------
        n_drives : int
            Number of all drives.
        """
        from scipy.special import bdtr

        n_off = 0 if self.off_at_end is None else int(self.off_at_end.sum())
        return bool(bdtr(n_off, n_drives, OFTEN_OFF_RATE) <= RARELY_OFF_PROBABILITY)

    def can_be_off_more_often(self, looks_left: int) -> bool:
        """Return whether a baseline may exist that is off at the end significantly less often.

        Parameters
        ----------
        looks_left : int
            Number of looks that may follow.
        """
        level = _compute_error_probability(looks_left)
        return _is_off_more_often(np.zeros_like(self.lost), self.off_at_end, level)

    @classmethod
    def join(cls, sets: Sequence[DriveSet]) -> DriveSet:
        """Join sets to one, in their order.

        Parameters
        ----------
        sets : sequence of DriveSet
            The sets; a field that one set lacks is missing in the result.
        """

        def concatenate_known(parts: Sequence[Bools | None]) -> Bools | None:
            arrays = [part for part in parts if part is not None]
            return np.concatenate(arrays) if len(arrays) == len(parts) else None

        return cls(
            np.concatenate([drives.log_error for drives in sets]),
            np.concatenate([drives.lost for drives in sets]),
            concatenate_known([drives.off_at_end for drives in sets]),
            concatenate_known([drives.reached for drives in sets]),
        )


class RatePair(NamedTuple):
    """The rates of both sets, each with its 95 % interval."""

    baseline: Interval
    """Share of the baseline's drives, 0..1."""
    alternative: Interval
    """Share of the alternative's drives, 0..1."""


@dataclass(frozen=True)
class Verdict:
    """The result of comparing an alternative with a baseline."""

    word: str
    """"better", "worse", "no difference" or "undecided"."""
    ratio: Interval
    """Ratio of the alternative's error to the baseline's: geometric mean. It decides, so that its
    interval holds at all looks together, and covers the truth in 97.5 %."""
    lost: RatePair
    """Shares of lost drives."""
    off_at_end: RatePair | None
    """Shares of drives that are off at the end; None if that is not known."""
    reached: RatePair | None
    """Shares of closed-loop drives that reach the goal; None if none was driven."""
    n_drives: int
    """Number of pairs of drives."""
    has_fewer_lost: bool
    """True if the alternative loses significantly fewer drives."""
    has_more_lost: bool
    """True if the alternative loses significantly more drives."""
    has_more_off: bool = False
    """True if the alternative is off at the end in significantly more drives."""


class LookResult(NamedTuple):
    """What paired drives show of some alternatives; all arrays are (alternatives,)."""

    mean: Floats
    """Logarithm of the ratio of the errors: mean over the drives."""
    low: Floats
    """Lower end of its interval."""
    high: Floats
    """Upper end of its interval."""
    has_fewer_lost: Bools
    """True for alternatives that lose significantly fewer drives than the baseline."""
    has_more_lost: Bools
    """True for alternatives that lose significantly more drives than the baseline."""

    @property
    def is_better(self) -> Bools:
        """True for alternatives that are better."""
        by_error = (self.high < 0) & ~self.has_more_lost
        return by_error | (self.has_fewer_lost & ~(self.low > 0))

    @property
    def is_worse(self) -> Bools:
        """True for alternatives that are worse, the mirror image of better."""
        by_error = (self.low > 0) & ~self.has_fewer_lost
        return by_error | (self.has_more_lost & ~(self.high < 0))

    @property
    def words(self) -> list[str]:
        """The verdict on each alternative."""
        is_equal = (
            (self.low >= -EQUAL_LOG_RATIO)
            & (self.high <= EQUAL_LOG_RATIO)
            & ~self.has_fewer_lost
            & ~self.has_more_lost
        )
        tests = [self.is_better, self.is_worse, is_equal]
        words = np.select(tests, [BETTER, WORSE, NO_DIFFERENCE], UNDECIDED)
        return [str(word) for word in words]


def evaluate_look(
    log_ratios: Floats,
    baseline_lost: Bools,
    alternative_lost: Bools,
    *,
    looks_left: int | None = 0,
    n_alternatives: int = 1,
) -> LookResult:
    """Test the errors and the lost drives of some alternatives against a baseline.

    Parameters
    ----------
    log_ratios : (k, n) array
        Logarithm of the ratio of each alternative's error to the baseline's in each drive.
    baseline_lost : (n,) or (k, n) array
        True for the baseline's drives that were lost.
    alternative_lost : (k, n) array
        True for each alternative's drives that were lost.
    looks_left : int or None, default 0
        Number of looks that may follow, if there are several; None if this is the only one.
    n_alternatives : int, default 1
        Number of alternatives to select the best from; they share the error probability.
    """
    from scipy.special import bdtr

    level = _compute_error_probability(looks_left) / n_alternatives
    mean, low, high = compute_student_interval(log_ratios, level)
    saved = (baseline_lost & ~alternative_lost).sum(axis=1)
    harmed = (alternative_lost & ~baseline_lost).sum(axis=1)
    # P(at most so few of the pairs in which one drive is lost), if both lose drives as often
    has_fewer_lost, has_more_lost = (bdtr(n, saved + harmed, 0.5) <= level for n in (harmed, saved))
    return LookResult(mean, low, high, has_fewer_lost, has_more_lost)


def compute_student_interval(values: Floats, level: float) -> tuple[Floats, Floats, Floats]:
    """Return the mean of each row with both ends of its interval.

    Parameters
    ----------
    values : (k, n) array
        Values, of which each row has a mean.
    level : float
        Probability that the true mean lies beyond one end.
    """
    from scipy.special import stdtrit

    count, mean = values.shape[1], values.mean(axis=1)
    if count < 2:
        return mean, np.full_like(mean, -np.inf), np.full_like(mean, np.inf)
    half = stdtrit(count - 1, 1 - level) * values.std(axis=1, ddof=1) / math.sqrt(count)
    return mean, mean - half, mean + half


def compare_drives(
    baseline: DriveSet,
    alternative: DriveSet,
    *,
    looks_left: int | None = 0,
    n_alternatives: int = 1,
) -> Verdict:
    """Compare two sets of paired drives.

    Parameters
    ----------
    baseline : DriveSet
        Drives of the baseline.
    alternative : DriveSet
        As many drives of the alternative, in the same worlds and with the same random numbers.
    looks_left, n_alternatives
        See `evaluate_look`.

    Examples
    --------
    >>> errors = np.log([0.2, 0.3, 0.25, 0.22, 0.31, 0.18, 0.27, 0.24])
    >>> baseline = DriveSet(errors, np.zeros(8, bool))
    >>> halved = DriveSet(errors - np.linspace(0.6, 0.8, 8), np.zeros(8, bool))
    >>> compare_drives(baseline, halved).word, compare_drives(halved, baseline).word
    ('better', 'worse')
    """
    last_look = evaluate_look(
        (alternative.log_error - baseline.log_error)[None],
        baseline.lost[None],
        alternative.lost[None],
        looks_left=looks_left,
        n_alternatives=n_alternatives,
    )
    (word,) = last_look.words
    lost = _pair_rates(baseline.lost, alternative.lost)
    assert lost is not None
    return Verdict(
        word,
        Interval(*(math.exp(end[0]) for end in last_look[:3])),
        lost,
        _pair_rates(baseline.off_at_end, alternative.off_at_end),
        _pair_rates(baseline.reached, alternative.reached),
        len(baseline.lost),
        bool(last_look.has_fewer_lost[0]),
        bool(last_look.has_more_lost[0]),
        _is_off_more_often(
            baseline.off_at_end, alternative.off_at_end, _compute_error_probability(looks_left)
        ),
    )


def confirm_alternative(
    drive: Callable[[range], tuple[DriveSet, DriveSet]],
    numbers: range,
    looks: Sequence[int] | None = None,
    is_time_up: Callable[[], bool] | None = None,
) -> Verdict:
    """Drive the best of several alternatives again, and the baseline, until they are decided.

    These drives alone decide: the drives that chose the alternative promise too much.

    Parameters
    ----------
    drive : callable
        Drives the baseline and the alternative with the drives of some numbers.
    numbers : range
        Numbers of the drives, none of which chose the alternative.
    looks : sequence of int, optional
        Counts of these numbers at which one looks, the last at all; by default `plan_looks`.
    is_time_up : callable, optional
        Asked before each look but the first; if true, the look before is the last.
    """
    counts = plan_looks(len(numbers)) if looks is None else [*looks]
    baseline, alternative = drive(numbers[: counts[0]])
    verdict = compare_drives(baseline, alternative, looks_left=len(counts) - 1)
    for place, (before, count) in enumerate(itertools.pairwise(counts), 2):
        if verdict.word != UNDECIDED or (is_time_up and is_time_up()):
            break
        further_baseline, further_alternative = drive(numbers[before:count])
        baseline = DriveSet.join([baseline, further_baseline])
        alternative = DriveSet.join([alternative, further_alternative])
        verdict = compare_drives(baseline, alternative, looks_left=len(counts) - place)
    return verdict


def plan_looks(n_drives: int) -> list[int]:
    """Return the numbers of drives after which a caller tests.

    Parameters
    ----------
    n_drives : int
        Maximum number of drives.

    Examples
    --------
    >>> plan_looks(64), plan_looks(20)
    ([8, 16, 32, 64], [8, 16, 20])
    """
    return [*itertools.takewhile(lambda count: count < n_drives, LOOKS), n_drives]


def _compute_error_probability(looks_left: int | None) -> float:
    """Return the error probability of a test at a look, given the looks left."""
    if looks_left is None:
        return ERROR_PROBABILITY
    from scipy.special import ndtr

    return float(ndtr(-CRITICAL_VALUE * 2 ** (BOUNDARY_EXPONENT * looks_left)))


def _is_off_more_often(baseline: Bools | None, alternative: Bools | None, level: float) -> bool:
    """True if an alternative is off at the end in more drives, by the sign test of the pairs."""
    if baseline is None or alternative is None:
        return False
    from scipy.special import bdtr

    returned = int((baseline & ~alternative).sum())
    harmed = int((alternative & ~baseline).sum())
    return bool(bdtr(returned, returned + harmed, 0.5) <= level)


def _pair_rates(baseline: Bools | None, alternative: Bools | None) -> RatePair | None:
    if baseline is None or alternative is None:
        return None
    shares = (
        compute_wilson_interval(float(flags.mean()), flags.size)
        for flags in (baseline, alternative)
    )
    return RatePair(*shares)
