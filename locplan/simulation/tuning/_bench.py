"""Cases in which settings of AMCL drive: paths in simulated worlds and stretches of recordings."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from locplan._util.intervals import Interval, of_geometric_mean
from locplan._util.poses import Poses, updates_of, way_length
from locplan._util.progress import ProgressCallback
from locplan.robots import Amcl
from locplan.simulation.driver import CHOOSING
from locplan.simulation.verdict import WORSE, DriveSet, Verdict, compare

ROUNDS = (1, 2, 4)
"""Numbers of drives along each line after which presets stop that are clearly worse than the best.

Presets gain much less over each other than over most users' settings, so more drives gain little.
"""


@dataclass(frozen=True, eq=False)
class Case:
    """Lines on which settings drive in the same way.

    They are paths in worlds with one level of disturbance, or stretches of a recording.
    """

    name: str
    """Name in tables."""
    lines: Sequence[Poses]
    """The true poses along each line, (n, 3) [m, m, rad]."""
    drive: Callable[[Amcl, range], DriveSet]
    """Drives settings along each line with the drives of some numbers. Drives in the same place of
    two sets have the same world and the same random numbers."""
    decides: bool = True
    """True if its drives decide; otherwise they may only contradict."""
    is_strict: bool = False
    """True if a single drive more that is lost contradicts, and an error that is not smaller."""


@dataclass(frozen=True)
class JudgedCase:
    """The drives of the best preset and of the user's settings in one case."""

    name: str
    """Name of the case."""
    decides: bool
    """True if its drives decide; otherwise they may only contradict."""
    baseline_error: Interval
    """Error of a typical drive with the user's settings [m]."""
    error: Interval
    """Error of a typical drive with the preset [m]."""
    verdict: Verdict
    """The verdict on this case alone."""
    contradicts: bool
    """True if the preset must not be used because of this case."""

    @classmethod
    def from_drives(cls, case: Case, baseline: DriveSet, preset: DriveSet) -> JudgedCase:
        """Compare the drives of the user's settings and of a preset in a case.

        Parameters
        ----------
        case : Case
            The case.
        baseline, preset : DriveSet
            The drives of both.
        """
        verdict = compare(baseline, preset)
        pairs = (verdict.lost, verdict.off_at_end) if case.is_strict else ()
        more_lost = any(pair and pair.alternative.value > pair.baseline.value for pair in pairs)
        errs_more = case.is_strict and verdict.ratio.value >= 1
        contradicts = verdict.word == WORSE or more_lost or errs_more
        errors = _error(baseline), _error(preset)
        return cls(case.name, case.decides, *errors, verdict, contradicts)


@dataclass(frozen=True, eq=False)
class TuningBench:
    """Drives that choose the best of some settings, and other drives that judge it."""

    choosing: Sequence[Case]
    """The cases that choose."""
    judging: Sequence[Case]
    """The cases that judge; they share no drive with those that choose."""
    drives: int
    """Number of drives along each line that judge."""

    def choose(
        self, settings: Sequence[Amcl], progress: ProgressCallback
    ) -> tuple[Amcl, dict[Amcl, DriveSet]]:
        """Return the settings with the least error, and the drives of all.

        A lost drive counts as an error that is 2.7 times as large.

        Parameters
        ----------
        settings : sequence of Amcl
            The settings.
        progress : callable
            Called with (done, total) drives along a line of each case.
        """
        driven: dict[Amcl, DriveSet] = {}
        rounds = [count for count in ROUNDS if count <= self.drives]
        staying, total = [*settings], len(settings) * rounds[-1]
        best = staying[0]
        for before, count in itertools.pairwise([0, *rounds]):
            numbers = range(CHOOSING + before, CHOOSING + count)
            for place, amcl in enumerate(staying, 1):
                more = [case.drive(amcl, numbers) for case in self.choosing]
                driven[amcl] = DriveSet.join([*filter(None, [driven.get(amcl)]), *more])
                progress(before * len(settings) + place * len(numbers), total)
            best = min(staying, key=lambda amcl: _score(driven[amcl]))
            looks_left = len(rounds) - 1 - rounds.index(count)
            staying = [
                amcl
                for amcl in staying
                if compare(driven[best], driven[amcl], looks_left=looks_left).word != WORSE
            ]
            if staying == [best]:
                break
        progress(total, total)
        return best, driven

    def judge(
        self, own: Amcl, best: Amcl, progress: ProgressCallback
    ) -> tuple[Verdict, tuple[JudgedCase, ...]]:
        """Return the verdict on the best settings by fresh drives, and on each case.

        Parameters
        ----------
        own, best : Amcl
            The user's settings, and the best of those that were chosen from.
        progress : callable
            Called with (done, total) cases.
        """
        sets = []
        for done, case in enumerate(self.judging, 1):
            sets.append([case.drive(amcl, range(self.drives)) for amcl in (own, best)])
            progress(done, len(self.judging))
        deciding = [pair for case, pair in zip(self.judging, sets, strict=True) if case.decides]
        verdict = compare(*(DriveSet.join(drives) for drives in zip(*deciding, strict=True)))
        cases = zip(self.judging, sets, strict=True)
        return verdict, tuple(JudgedCase.from_drives(case, *pair) for case, pair in cases)

    def beams_per_metre(self, amcl: Amcl) -> float:
        """Return the number of beams that settings compare per metre, which their CPU time follows.

        Parameters
        ----------
        amcl : Amcl
            The settings.
        """
        lines = [line for case in self.judging for line in case.lines]
        least = amcl.update_min_d, amcl.update_min_a
        updates = sum(len(updates_of(line, *least)) for line in lines)
        return amcl.max_beams * updates / sum(way_length(line) for line in lines)


def _score(drives: DriveSet) -> float:
    return float((drives.log_error + drives.lost).mean())


def _error(drives: DriveSet) -> Interval:
    return of_geometric_mean(np.exp(drives.log_error))
