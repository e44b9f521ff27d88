"""The search for AMCL's settings: successive halving, and what of the best is put back."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from locplan._util.progress import ProgressCallback
from locplan.robots import Amcl
from locplan.simulation.tuning._bench import TuningBench
from locplan.simulation.tuning._space import changed_axes

RUNGS = ((4, 4, 24), (2, 2, 5))
"""Rungs before the last: what paths and drives are divided by, and how many settings stay."""
FRUGAL = 2
"""Number of settings that stay besides, of those that take no more beams than the user's own."""
WORSE, WORSE_AT_A_COST = math.log(1.02), math.log(1.1)
"""Increase of the logarithm of the error up to which a change is put back, and one that makes the
filter compare more beams a metre."""


@dataclass(frozen=True)
class Found:
    """What a search found."""

    best: Amcl
    """Setting that is best at its worst level."""
    kept: Amcl
    """The best one with the user's own values put back where that costs next to nothing."""
    frugal: Amcl
    """Best setting, of those that compare no more beams a metre than the user's own."""
    without: dict[str, float]
    """Error without each change of the best setting, relative to that with it, by axis."""
    rungs: tuple[tuple[int, int, int], ...]
    """Settings, paths and drives of each rung."""


class Search:
    """Search among settings that all drive on one bench.

    Parameters
    ----------
    bench : Bench
        What drives them.
    own : Amcl
        The user's own settings.
    paths, drives : int
        Numbers of the last rung.
    """

    def __init__(self, bench: TuningBench, own: Amcl, paths: int, drives: int) -> None:
        self.bench, self.own = bench, own
        # Nearly every setting is worst there; other levels are driven where they can matter.
        self.strongest = [len(bench.levels) - 1]
        self.rungs = [
            (max(1, paths // fewer), max(1, drives // rarer), stay) for fewer, rarer, stay in RUNGS
        ]
        self.last = paths, drives

    def run(self, settings: Sequence[Amcl], progress: Iterator[ProgressCallback]) -> Found:
        """Find the best of the settings, the first of which is the user's own.

        `progress` has a callback for each rung and one for what is put back.
        """
        allowed = [amcl for amcl in settings if self.beams(amcl) <= self.beams(self.own)]
        staying, sizes = list(settings), []
        for paths, drives, stay in self.rungs:
            self.bench.drive(staying, paths, drives, self.strongest, next(progress))
            sizes.append((len(staying), paths, drives))
            ranked = sorted(staying, key=lambda amcl: self._known(amcl, paths, drives))
            frugal = [amcl for amcl in ranked if amcl in set(allowed)][:FRUGAL]
            staying = [*dict.fromkeys([*ranked[:stay], *frugal])]
        self.bench.drive(staying, *self.last, self.strongest, next(progress))
        sizes.append((len(staying), *self.last))
        best = self._least(staying)
        frugal_best = self._least([amcl for amcl in staying if amcl in set(allowed)])
        kept, without = self._put_back(best, next(progress))
        return Found(best, kept, frugal_best, without, tuple(sizes))

    def beams(self, amcl: Amcl) -> int:
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
        self.bench.drive([*single.values()], *self.last, self.strongest, progress)
        losses = {axis: self._known(amcl, *self.last) - worst for axis, amcl in single.items()}
        kept = best
        for axis in sorted(axes, key=lambda axis: losses[axis]):
            tried = axis.put(kept, axis.of(self.own))
            costs = self.beams(kept) > self.beams(tried)
            bound = self._known(kept, *self.last) + (WORSE_AT_A_COST if costs else WORSE)
            if losses[axis] <= WORSE_AT_A_COST and self._within(tried, bound):
                kept = tried
        return kept, {axis.name: math.exp(loss) for axis, loss in losses.items()}

    def _within(self, amcl: Amcl, bound: float) -> bool:
        """Whether the logarithm of the error is up to a bound at every level."""
        for levels in (self.strongest, None):
            self.bench.drive([amcl], *self.last, levels)
            if self._known(amcl, *self.last) > bound:
                return False
        return True
