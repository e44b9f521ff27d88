"""The search among settings of AMCL.

It is successive halving of settings drawn at random, then steps from the best ones along each axis;
what of the best hardly matters is put back, as far as the drives show.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from locplan._util.intervals import of_mean
from locplan._util.progress import ProgressCallback
from locplan.robots import Amcl
from locplan.simulation._drives import FLOOR
from locplan.simulation.tuning._bench import TuningBench
from locplan.simulation.tuning._space import beside, changed_axes, steps_between

WORSE, WORSE_AT_A_COST = math.log(1.02), math.log(1.1)
"""Increase of the logarithm of the error up to which a change is put back; and one that makes the
filter compare more beams a metre, or whose gain the drives do not show clearly."""
HOPEFUL = 10
"""Number of settings that a step drives on more than the first rung's paths and drives."""
STEPS = 3
"""Maximum number of steps from the best two settings, each along every axis."""


class Search:
    """Search among settings that all drive on one bench.

    Parameters
    ----------
    bench : Bench
        What drives them.
    own : Amcl
        The user's own settings.
    drives : int
        Number of drives along each path of the last rung.
    """

    def __init__(self, bench: TuningBench, own: Amcl, drives: int) -> None:
        self.bench, self.own, paths = bench, own, len(bench.lines)
        # A quarter, then half of the paths and of the drives, and how many settings stay. One path
        # alone would choose the settings that happen to suit it.
        self.parts = [
            (max(bench.fewest_paths, paths // part), max(1, drives // part), stay)
            for part, stay in ((4, 16), (2, 5))
        ]
        self.last = paths, drives
        self.rungs: list[tuple[int, int, int]] = []

    def run(
        self, settings: Sequence[Amcl], progress: Iterator[ProgressCallback]
    ) -> tuple[Amcl, Amcl, Amcl, dict[str, float]]:
        """Find the best of the settings, the first of which is the user's own.

        `progress` has a callback for each rung and step, and one for what is put back.

        Returns
        -------
        kept : Amcl
            The best one with the user's own values put back where that costs next to nothing, or
            one nearer to the user's own that is hardly worse.
        frugal : Amcl
            Best setting, of those that compare no more beams a metre than the user's own.
        best : Amcl
            Setting that is best at its worst level.
        without : dict of str to float
            Error without each change of the best setting, relative to that with it, by axis.
        """
        staying = list(settings)
        for paths, drives, stay in self.parts:
            self.bench.drive(staying, paths, drives, self.bench.strongest, next(progress))
            self.rungs.append((len(staying), paths, drives))
            ranked = self._ranked(staying, paths, drives)
            staying = self._first(ranked, stay)
        for each_step in [next(progress) for _ in range(STEPS)]:
            near = self._hopeful([each for amcl in staying[:2] for each in beside(self.own, amcl)])
            self.bench.drive(near, paths, drives, self.bench.strongest, each_step)
            self.rungs.append((len(near), paths, drives))
            ranked = self._ranked([*ranked, *near], paths, drives)
            if self._first(ranked, stay) == staying:
                break
            staying = self._first(ranked, stay)
        self.bench.drive(staying, *self.last, self.bench.strongest, next(progress))
        self.rungs.append((len(staying), *self.last))
        best = self._least(staying)
        frugal = self._least([amcl for amcl in staying if self._is_frugal(amcl)])
        kept, without = self._put_back(best, next(progress))
        return self._nearest(kept, best, staying), frugal, best, without

    def _hopeful(self, settings: Sequence[Amcl]) -> list[Amcl]:
        """The best of the settings on the paths and drives of the first rung."""
        paths, drives, _ = self.parts[0]
        self.bench.drive(settings, paths, drives, self.bench.strongest)
        return self._ranked(settings, paths, drives)[:HOPEFUL]

    def _ranked(self, settings: Sequence[Amcl], paths: int, drives: int) -> list[Amcl]:
        """The settings, the best first."""
        every = dict.fromkeys(settings)
        return sorted(every, key=lambda amcl: self._known(amcl, paths, drives))

    def _first(self, ranked: Sequence[Amcl], count: int) -> list[Amcl]:
        """The best, and the best two that compare no more beams than the user's own."""
        frugal = [amcl for amcl in ranked if self._is_frugal(amcl)]
        return [*dict.fromkeys([*ranked[:count], *frugal[:2]])]

    def _is_frugal(self, amcl: Amcl) -> bool:
        return self.beams(amcl) <= self.beams(self.own)

    def beams(self, amcl: Amcl) -> float:
        """Beams that a setting compares on one drive along every path."""
        return self.bench.updates(amcl) * amcl.max_beams

    def _known(self, amcl: Amcl, paths: int, drives: int) -> float:
        """Logarithm of the error at the worst of the levels that were driven."""
        return float(np.nanmax(self.bench.means(amcl, paths, drives)))

    def _least(self, settings: Sequence[Amcl]) -> Amcl:
        """Setting with the least error at its worst level.

        A setting's other levels can only make it worse, so they are driven for the best so far
        until one stays the best.
        """
        while True:
            best = min(settings, key=lambda amcl: self._known(amcl, *self.last))
            if not np.isnan(self.bench.means(best, *self.last)).any():
                return best
            self.bench.drive([best], *self.last)

    def _put_back(self, best: Amcl, progress: ProgressCallback) -> tuple[Amcl, dict[str, float]]:
        """The best setting with what gains next to nothing put back, and what each change gains."""
        axes, worst = changed_axes(self.own, best), self._known(best, *self.last)
        single = {axis: axis.put(best, axis.of(self.own)) for axis in axes}
        self.bench.drive([*single.values()], *self.last, self.bench.strongest, progress)
        losses = {axis: self._known(amcl, *self.last) - worst for axis, amcl in single.items()}
        kept = best
        for axis in sorted(axes, key=lambda axis: losses[axis]):
            tried = axis.put(kept, axis.of(self.own))
            if losses[axis] <= WORSE_AT_A_COST and self._is_as_good(tried, kept, best):
                kept = tried
        return kept, {axis.name: math.exp(loss) for axis, loss in losses.items()}

    def _nearest(self, kept: Amcl, best: Amcl, settings: Sequence[Amcl]) -> Amcl:
        """The setting nearest to the user's own that is hardly worse than the one to be kept."""
        away = steps_between(self.own, kept)
        near = sorted(settings, key=lambda amcl: steps_between(self.own, amcl))
        nearer = (amcl for amcl in near if steps_between(self.own, amcl) < away)
        return next((amcl for amcl in nearer if self._is_as_good(amcl, kept, best)), kept)

    def _is_as_good(self, tried: Amcl, kept: Amcl, best: Amcl) -> bool:
        """Whether a setting is hardly worse at every level, so that it is to be kept instead."""
        for levels in (self.bench.strongest, None):
            self.bench.drive([tried], *self.last, levels)
            spared = self.beams(tried) < self.beams(kept) or not self._is_worse(tried, kept)
            bound = self._known(kept, *self.last) + (WORSE_AT_A_COST if spared else WORSE)
            # What is put back one after the other must not add up.
            at_most = min(bound, self._known(best, *self.last) + WORSE_AT_A_COST)
            if self._known(tried, *self.last) > at_most:
                return False
        return True

    def _is_worse(self, tried: Amcl, kept: Amcl) -> bool:
        """Whether a setting is clearly worse at its worst level, on drives that both share."""
        level = int(np.nanargmax(self.bench.means(tried, *self.last)))
        one, other = (
            np.log(self.bench.driven[each].squares[level] + FLOOR) for each in (tried, kept)
        )
        return of_mean((one - other).ravel()).low > 0
