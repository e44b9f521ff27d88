"""Race, confirmation and guard: which driven path to take, and how sure that is.

Nothing here knows of maps or robots: paths are numbers, of which 0 is the shortest path's, and a
function drives them. Drives have numbers, too; drives of one number have one world and one seed,
so that their differences count.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import Interval
from locplan._util.tables import finite

Verdict = Literal[
    "clearly better",
    "no worthwhile difference",
    "probably better",
    "undecided after {} drives",
    "none led the race",
]
NONE_LED = "none led the race"
"""The verdict where nothing was confirmed, as no path led clearly."""
CLEARLY_BETTER, NO_DIFFERENCE, PROBABLY_BETTER = (
    "clearly better",
    "no worthwhile difference",
    "probably better",
)
ROUNDS = (4, 8)
"""Drives of all paths, and of those that are kept, in the race."""
KEPT = 3
"""Greatest number of paths that are kept beside the shortest."""
UNSURE = 0.1
"""Probability, one-sided, at which a path counts as surely worse than the leader."""
DEVIATION, WEIGHT = 0.35, 4
"""Usual deviation of paired differences of the scores, and the drives that it counts as.

Four drives alone would estimate it too badly."""
AHEAD = math.log(0.95)
"""Difference of the mean scores by which a path must lead in the race."""
WORTHWHILE = math.log(0.9)
"""Logarithm of the ratio of errors from which on a path is worth leaving the shortest."""
FIRST_LOOK = 8
"""Number of confirming drives at the first look; each further look has twice as many."""
LEVELS = (0.025, 0.0147, 0.0104, 0.0081, 0.0064, 0.0055, 0.0047, 0.0041)
"""One-sided level of each look, by the number of looks: 5 % in all (Pocock's, of doubled drives).

They follow from the greatest of the correlated z values of all looks under no difference."""
MAX_DRIVES = FIRST_LOOK * 2 ** (len(LEVELS) - 1)
"""Greatest number of confirming drives of a path."""


class Scores(NamedTuple):
    """What drives are judged by."""

    log_error: NDArray[np.float64]
    """Logarithm of the error of each drive, (paths, drives)."""
    lost: NDArray[np.bool_]
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


@dataclass(frozen=True)
class Judgement:
    """The path that won the race, and what fresh drives of it and of the shortest say."""

    leader: int
    """Number of the path; 0 if none leads clearly, and then nothing is confirmed."""
    verdict: str
    """The verdict on the leader in the words of `Verdict`."""
    ratio: Interval
    """Ratio of the leader's error to the shortest's, with the interval of repeated looks; NaN
    where nothing was confirmed."""
    drives: range
    """Numbers of the drives that are shown: those of the confirmation, or else of the race."""
    more_lost: bool = False
    """Whether the leader lost more drives than the shortest path, in the race and after it."""

    def summary(self) -> dict[str, Any]:
        """The verdict and its drives, fit for JSON."""
        about = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        drives = {"drives": len(self.drives), "first_drive": self.drives.start}
        return finite({**about, **drives, "ratio": list(self.ratio)})

    @classmethod
    def from_summary(cls, about: Mapping[str, Any]) -> Judgement:
        """Judgement that `summary` described.

        Parameters
        ----------
        about : mapping
            What `summary` gives.
        """
        first = about["first_drive"]
        numbers = range(first, first + about["drives"])
        ratio = Interval(*(math.nan if each is None else each for each in about["ratio"]))
        return cls(about["leader"], about["verdict"], ratio, numbers, about["more_lost"])


def judged(
    drive: Drive,
    handicaps: NDArray[np.float64],
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
        Greatest number of confirming drives of each of both paths.
    enough : callable, optional
        Whether time is up, asked before each look but the first.
    """
    leader, lost = race(drive, handicaps, price_of_loss)
    if leader == 0:
        nothing = Interval(math.nan, math.nan, math.nan)
        return Judgement(0, NONE_LED, nothing, range(ROUNDS[-1]))
    return confirmed(drive, leader, lost, drives, enough)


def race(
    drive: Drive, handicaps: NDArray[np.float64], price_of_loss: float
) -> tuple[int, NDArray[np.int64]]:
    """The path with the least mean score, and how many drives it and the shortest lost.

    It is 0, the shortest path's, unless another one leads by `AHEAD`.
    """

    def scored(paths: Sequence[int], done: Scores) -> NDArray[np.float64]:
        return done.log_error + price_of_loss * done.lost + handicaps[paths][:, None]

    few, all_of_them = ROUNDS
    every = [*range(len(handicaps))]
    done = drive(every, range(few))
    kept = sorted({0, *_not_surely_worse(scored(every, done))[:KEPT]})
    done = done.of(kept).joined(drive(kept, range(few, all_of_them)))
    means = scored(kept, done).mean(axis=1)
    best = int(np.argmin(means))
    if means[best] > means[0] + AHEAD:
        best = 0
    return kept[best], done.lost[[best, 0]].sum(axis=1)


def _not_surely_worse(scores: NDArray[np.float64]) -> list[int]:
    """Numbers of the paths that may be as good as the leader, the best first."""
    from scipy.special import stdtrit

    behind = scores - scores[np.argmin(scores.mean(axis=1))]
    count = scores.shape[1]
    known = (count - 1) * behind.var(axis=1, ddof=1)
    freedom = WEIGHT + count - 1
    deviation = np.sqrt((WEIGHT * DEVIATION**2 + known) / freedom / count)
    close = behind.mean(axis=1) <= stdtrit(freedom, 1 - UNSURE) * deviation
    return [int(n) for n in np.argsort(scores.mean(axis=1), kind="stable") if close[n]]


def confirmed(
    drive: Drive,
    leader: int,
    lost: NDArray[np.int64],
    drives: int,
    enough: Callable[[], bool] | None = None,
) -> Judgement:
    """Drive the leader and the shortest path afresh, until the difference is known."""
    looks = looks_of(drives)
    level, first = LEVELS[len(looks) - 1], ROUNDS[-1]
    done: Scores | None = None
    for number, count in enumerate(looks):
        before = 0 if done is None else looks[number - 1]
        if done is not None and enough and enough():
            break
        new = drive([leader, 0], range(first + before, first + count))
        done = new if done is None else done.joined(new)
        ratio = interval_of(done.log_error[0] - done.log_error[1], level)
        more_lost = np.diff(lost + done.lost.sum(axis=1))[0] < 0
        verdict = _verdict(ratio, bool(more_lost))
        if verdict:
            break
    assert done is not None, "there is one look at least"
    count = done.lost.shape[1]
    if not verdict:
        probable = ratio.value <= WORTHWHILE and not more_lost
        verdict = PROBABLY_BETTER if probable else f"undecided after {count} drives"
    shown = Interval(*np.exp(ratio).tolist())
    return Judgement(leader, verdict, shown, range(first, first + count), bool(more_lost))


def _verdict(ratio: Interval, more_lost: bool) -> str:
    """The verdict at a look, by the logarithm of the ratio; empty if it needs more drives."""
    if ratio.low > WORTHWHILE:
        return NO_DIFFERENCE
    if ratio.high < 0 and ratio.value <= WORTHWHILE and not more_lost:
        return CLEARLY_BETTER
    return ""


def looks_of(drives: int) -> list[int]:
    """Numbers of drives at which one looks: 8, twice as many, and so on, and all of them."""
    looks = [FIRST_LOOK * 2**n for n in range(len(LEVELS))]
    return [*(count for count in looks if count < drives), drives]


def interval_of(differences: NDArray[np.float64], level: float) -> Interval:
    """Student's interval of a mean, at a one-sided level."""
    from scipy.special import stdtrit

    count = differences.size
    mean = float(differences.mean())
    half = float(stdtrit(count - 1, 1 - level) * differences.std(ddof=1) / math.sqrt(count))
    return Interval(mean, mean - half, mean + half)
