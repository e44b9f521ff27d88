"""Race, confirmation and guard: which driven path to take, and how sure that is.

Nothing here knows of maps or robots: paths are numbers, of which 0 is the shortest path's, and a
function drives them. Drives have numbers, too; drives of one number are pairs, so that their
differences count.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan._util.checks import keep
from locplan._util.intervals import Interval
from locplan._util.saved import Valued
from locplan.simulation.driver import CHOOSING
from locplan.simulation.verdict import (
    BETTER,
    NO_DIFFERENCE,
    UNDECIDED,
    WORDS,
    look,
    plan_looks,
    student_interval,
)

ROUNDS = (4, 8)
"""Drives of all paths, and of those that are kept, in the race."""
KEPT, FINALISTS = 5, 3
"""Maximum numbers of paths beside the shortest that are kept in the race, and confirmed."""
UNSURE, BEHIND = 0.07, 0.3
"""Probability, one-sided, at which a path counts as surely worse than the leader: in the race, and
when finalists are confirmed."""
LEAD = math.log(0.99)
"""Difference of the mean scores by which a path must lead the shortest in the race.

These five were found by tests/benchmarks/power_of_choices.py: among ten candidates a path of .8 of
the shortest's error is found in 91 % of the choices."""
_FORMER_WORDS = {"clearly better": BETTER, "no worthwhile difference": NO_DIFFERENCE}
"""Verdicts by how files before version 3 of a choice name them; their others are undecided."""
WORTHWHILE = math.log(0.9)
"""Logarithm of the ratio of errors from which on a path is worth leaving the shortest."""


class Scores(NamedTuple):
    """What drives are judged by."""

    log_error: Floats
    """Logarithm of the error of each drive, (paths, drives)."""
    lost: Bools
    """True for the drives that were lost, (paths, drives)."""

    def joined(self, later: Scores) -> Scores:
        """These drives and later ones of the same paths.

        Parameters
        ----------
        later : Scores
            Scores of the later drives.
        """
        pairs = zip(self, later, strict=True)
        return Scores(*(np.concatenate(pair, axis=1) for pair in pairs))

    def of(self, paths: Sequence[int]) -> Scores:
        """The drives of some of the paths.

        Parameters
        ----------
        paths : sequence of int
            Numbers of the paths.
        """
        return Scores(self.log_error[paths], self.lost[paths])


Drive = Callable[[Sequence[int], range], Scores]
"""Drives paths of some numbers, with the drives of some numbers."""


@dataclass(frozen=True, eq=False)
class Judgement(Valued):
    """The path that won the race, and what fresh drives of it and of the shortest say."""

    leader: int
    """Number of the path; 0 if none leads clearly, and then nothing is confirmed."""
    verdict: str
    """The verdict on the leader, see `locplan.simulation.verdict`."""
    ratio: Interval
    """Ratio of the leader's error to the shortest's, with the interval that decides; NaN where
    nothing was confirmed."""
    drives: range
    """Numbers of the drives that are shown of the leader and of the shortest."""
    more_lost: bool = False
    """Whether the leader lost more drives than the shortest path, in the race and after it."""

    def __post_init__(self) -> None:
        if self.verdict not in WORDS:  # of an older file
            keep(self, verdict=_FORMER_WORDS.get(self.verdict, UNDECIDED))

    @property
    def is_worthwhile(self) -> bool:
        """True if the leader errs so little that a detour is worth it, and loses no more drives."""
        return not self.more_lost and self.ratio.value <= math.exp(WORTHWHILE)

    def takes(self, bold: bool) -> bool:
        """True if the leader is to be taken in place of the shortest path.

        Parameters
        ----------
        bold : bool
            Whether an undecided leader is taken, too.
        """
        words = (BETTER, UNDECIDED) if bold else (BETTER,)
        return self.is_worthwhile and self.verdict in words


def judged(
    drive: Drive,
    handicaps: Floats,
    price_of_loss: float,
    drives: int,
    enough: Callable[[], bool] | None = None,
) -> Judgement:
    """Race paths, and confirm that the winner is better than the shortest.

    Parameters
    ----------
    drive : callable
        Drives some of the paths.
    handicaps : (paths,) array
        What is added to the score of each path in the race, such as the price of its length.
    price_of_loss : float
        What a lost drive adds to its score, beside the logarithm of its error.
    drives : int
        Maximum number of confirming drives of each path.
    enough : callable, optional
        Whether time is up, asked before each look but the first.
    """
    finalists, lost = race(drive, handicaps, price_of_loss)
    if not finalists:
        nothing, shown = Interval(math.nan, math.nan, math.nan), range(ROUNDS[-1])
        drive([0], shown)  # the race's drives are not those that other commands report
        return Judgement(0, UNDECIDED, nothing, shown)
    return confirmed(drive, finalists, lost, drives, handicaps, enough)


def race(drive: Drive, handicaps: Floats, price_of_loss: float) -> tuple[list[int], Ints]:
    """The paths that may be best and lead the shortest, and how many drives each path lost."""

    def scored(paths: list[int], done: Scores) -> Floats:
        return done.log_error + price_of_loss * done.lost + handicaps[paths][:, None]

    def in_the_race(paths: list[int], done: Scores) -> list[int]:
        return [paths[n] for n in _not_surely_worse(scored(paths, done))]

    few, all_of_them = ROUNDS
    every = [*range(len(handicaps))]
    numbers = range(CHOOSING, CHOOSING + all_of_them)
    done = drive(every, numbers[:few])
    kept = sorted({0, *in_the_race(every, done)[:KEPT]})
    done = done.of(kept).joined(drive(kept, numbers[few:]))
    lost = np.zeros(len(every), np.int64)
    lost[kept] = done.lost.sum(axis=1)
    scores = dict(zip(kept, scored(kept, done).mean(axis=1), strict=True))
    leading = [path for path in in_the_race(kept, done) if scores[path] <= scores[0] + LEAD]
    return leading[:FINALISTS], lost


def _not_surely_worse(scores: Floats) -> list[int]:
    """Rows of the scores of paths that may be as good as the leader, the best first."""
    from scipy.special import stdtrit

    usual, weight = 0.35, 4  # four drives alone would estimate the deviation too badly
    behind = scores - scores[np.argmin(scores.mean(axis=1))]
    count = scores.shape[1]
    freedom = weight + count - 1
    squares = weight * usual**2 + (count - 1) * behind.var(axis=1, ddof=1)
    close = behind.mean(axis=1) <= stdtrit(freedom, 1 - UNSURE) * np.sqrt(squares / freedom / count)
    return [int(n) for n in np.argsort(scores.mean(axis=1), kind="stable") if close[n]]


def confirmed(
    drive: Drive,
    finalists: list[int],
    lost: Ints,
    drives: int,
    handicaps: Floats,
    enough: Callable[[], bool] | None = None,
) -> Judgement:
    """Drive the finalists and the shortest afresh, until a difference is known or none is."""
    paths, count, done = [0, *finalists], 0, None
    looks = plan_looks(drives)
    while True:
        before, count = count, looks.pop(0)
        new = drive(paths, range(before, count))
        done = new if done is None else done.joined(new)
        apart = done.log_error[1:] - done.log_error[0]
        # Choosing the best of several promises too much, not too little: they share the level.
        shown = look(
            apart,
            done.lost[0],
            done.lost[1:],
            looks_left=len(looks),
            n_alternatives=len(finalists),
        )
        all_lost = lost[paths] + done.lost.sum(axis=1)
        losing = all_lost[1:] > all_lost[0]
        safe = ~losing & (shown.mean <= WORTHWHILE)
        clear = safe & shown.is_better
        leads = next(some for some in (clear, safe, shown.mean < math.inf) if some.any())
        # The price of length decides between finalists as in the race, and not on the verdict.
        scores = shown.mean + handicaps[paths[1:]]
        best = int(np.argmin(np.where(leads, scores, math.inf)))
        is_futile = (shown.low > WORTHWHILE).all()
        if clear.any() or is_futile or not looks or (enough and enough()):
            ratio = Interval(*(math.exp(end[best]) for end in shown[:3]))
            word, more_lost = shown.words[best], bool(losing[best])
            return Judgement(paths[best + 1], word, ratio, range(count), more_lost)
        # Finalists that seem worse than the best one, or than what is worthwhile, stay behind: that
        # costs no error, since none of them can be recommended any more.
        _, worse, _ = student_interval(apart - apart[best], BEHIND)
        _, poor, _ = student_interval(apart, BEHIND)
        going = np.append(True, ~((worse > 0) | (poor > WORTHWHILE)))
        going[best + 1] = True
        rows = np.flatnonzero(going).tolist()
        paths, done = [paths[row] for row in rows], done.of(rows)
