"""Race, confirmation and guard: which driven path to take, and how sure that is.

Nothing here knows of maps or robots: paths are numbers, of which 0 is the shortest path's, and a
function drives them. Drives have numbers, too; drives of one number have one world and one seed,
so that their differences count.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import Interval
from locplan._util.tables import finite

CLEARLY_BETTER, NO_DIFFERENCE, PROBABLY_BETTER, LOSES_MORE, NONE_LED = (
    "clearly better",
    "no worthwhile difference",
    "probably better",
    "more drives lost",
    "none led the race",
)
"""Verdicts, beside "undecided after 64 drives".

If no other path led the shortest in the race, nothing is confirmed."""
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
WORTHWHILE = math.log(0.9)
"""Logarithm of the ratio of errors from which on a path is worth leaving the shortest."""
FIRST_LOOK, MAX_DRIVES = 8, 1024
"""Number of confirming drives at the first look; each further look has twice as many, up to the
greatest number."""
BELOW, ABOVE = (2.03, 0.3), (2.15, 0.15)
"""Where the interval's lower and upper end lie: critical value at the last look, and the exponent
of 2 by which it is greater at each look before that one.

Each end passes the true value at any of up to eight looks with a probability of 2.5 %: the
boundaries of Wang and Tsiatis for drives that double, whose critical values
tests/benchmarks/power_of_choices.py computes. Fewer looks, or a last one that is nearer, err less
often. The upper end shows that a path is better, which may end the drives early; the lower one that
it is not, where an early end would save only time, and so it keeps more for the last look."""


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
    """The verdict on the leader in the words above."""
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
        Maximum number of confirming drives of each path.
    enough : callable, optional
        Whether time is up, asked before each look but the first.
    """
    finalists, lost = race(drive, handicaps, price_of_loss)
    if not finalists:
        nothing = Interval(math.nan, math.nan, math.nan)
        return Judgement(0, NONE_LED, nothing, range(ROUNDS[-1]))
    return confirmed(drive, finalists, lost, drives, enough)


def race(
    drive: Drive, handicaps: NDArray[np.float64], price_of_loss: float
) -> tuple[list[int], NDArray[np.int64]]:
    """The paths that may be best and lead the shortest, and how many drives each path lost."""

    def scored(paths: list[int], done: Scores) -> NDArray[np.float64]:
        return done.log_error + price_of_loss * done.lost + handicaps[paths][:, None]

    def in_the_race(paths: list[int], done: Scores) -> list[int]:
        return [paths[n] for n in _not_surely_worse(scored(paths, done))]

    few, all_of_them = ROUNDS
    every = [*range(len(handicaps))]
    done = drive(every, range(few))
    kept = sorted({0, *in_the_race(every, done)[:KEPT]})
    done = done.of(kept).joined(drive(kept, range(few, all_of_them)))
    lost = np.zeros(len(every), np.int64)
    lost[kept] = done.lost.sum(axis=1)
    scores = dict(zip(kept, scored(kept, done).mean(axis=1), strict=True))
    leading = [path for path in in_the_race(kept, done) if scores[path] <= scores[0] + LEAD]
    return leading[:FINALISTS], lost


def _not_surely_worse(scores: NDArray[np.float64]) -> list[int]:
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
    lost: NDArray[np.int64],
    drives: int,
    enough: Callable[[], bool] | None = None,
) -> Judgement:
    """Drive the finalists and the shortest path afresh, until a difference is known or none is."""
    looks = looks_of(drives)
    first = ROUNDS[-1]
    known = dict.fromkeys([0, *finalists], Scores(np.empty((1, 0)), np.empty((1, 0), bool)))
    running, count = [*finalists], 0
    while True:
        before, count = count, looks.pop(0)
        paths = [0, *running]
        new = drive(paths, range(first + before, first + count))
        known |= {path: known[path].joined(new.of([n])) for n, path in enumerate(paths)}
        apart = {each: known[each].log_error[0] - known[0].log_error[0] for each in running}
        below, above = (_level(*end, left=len(looks)) for end in (BELOW, ABOVE))
        # Choosing the best of several promises too much, not too little: the upper level is shared.
        above /= len(finalists)
        ratios = {each: interval_of(apart[each], below, above) for each in running}
        all_lost = {path: lost[path] + known[path].lost.sum() for path in paths}
        losing = {each for each in running if all_lost[each] > all_lost[0]}
        last = not looks or bool(enough and enough())
        leader, verdict = _verdict(ratios, losing, count if last else None)
        if verdict:
            shown = Interval(*np.exp(ratios[leader]).tolist())
            return Judgement(leader, verdict, shown, range(first, first + count), leader in losing)
        # Finalists that seem worse than the best one, or than what is worthwhile, stay behind: that
        # costs no error, since none of them can be recommended any more.
        behind = {
            each
            for each in running
            if interval_of(apart[each] - apart[leader], BEHIND).low > 0
            or interval_of(apart[each], BEHIND).low > WORTHWHILE
        }
        running = [each for each in running if each == leader or each not in behind]


def _verdict(
    ratios: Mapping[int, Interval], losing: Collection[int], drives: int | None
) -> tuple[int, str]:
    """The leader at a look by the logarithms of the ratios, and the verdict on it.

    It is empty if more drives are to come, and there is no number of all drives.
    """
    order = sorted(ratios, key=lambda each: ratios[each].value)
    safe = [each for each in order if each not in losing and ratios[each].value <= WORTHWHILE]
    clear = [each for each in safe if ratios[each].high < 0]
    leader = [*clear, *safe, *order][0]
    if clear:
        return leader, CLEARLY_BETTER
    if all(ratio.low > WORTHWHILE for ratio in ratios.values()):
        return leader, NO_DIFFERENCE
    if drives is None:
        return leader, ""
    if ratios[leader].value > WORTHWHILE:
        return leader, f"undecided after {drives} drives"
    return leader, PROBABLY_BETTER if safe else LOSES_MORE


def looks_of(drives: int) -> list[int]:
    """Numbers of drives at which one looks: 8, twice as many, and so on, and all of them."""
    looks = [FIRST_LOOK]
    while looks[-1] < drives:
        looks.append(2 * looks[-1])
    return [*looks[:-1], drives]


def _level(critical: float, exponent: float, left: int) -> float:
    """One-sided level of a look by the number of looks that are left after it."""
    from scipy.special import ndtr

    return float(ndtr(-critical * 2 ** (exponent * left)))


def interval_of(
    differences: NDArray[np.float64], below: float, above: float | None = None
) -> Interval:
    """Student's interval of a mean, at the one-sided levels below and above it."""
    from scipy.special import stdtrit

    count, mean = differences.size, float(differences.mean())
    error = float(differences.std(ddof=1)) / math.sqrt(count)
    low, high = stdtrit(count - 1, [1 - below, 1 - (above or below)]) * error
    return Interval(mean, mean - float(low), mean + float(high))
