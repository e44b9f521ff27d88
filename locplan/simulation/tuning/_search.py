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
from locplan.simulation.tuning._bench import TuningBench
from locplan.simulation.tuning._space import beside, changed_axes, steps_between

WORSE, WORSE_AT_A_COST = math.log(1.02), math.log(1.1)
"""Increase of the score up to which a change is put back; and one that makes the filter compare
more beams a metre, or whose gain the drives do not show clearly."""
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
    """

    def __init__(self, bench: TuningBench, own: Amcl) -> None:
        self.bench, self.own = bench, own
        self.last = paths, drives = len(bench.lines), bench.drives
        # Paths and drives of the first rungs. One path alone would choose the settings that happen
        # to suit it.
        self.parts = [
            (max(bench.fewest_paths, paths // some), max(1, drives // few))
            for some, few in ((4, 8), (4, 4), (2, 2))
        ]
        self.rungs: list[tuple[int, int, int]] = []

    def run(
        self, settings: Sequence[Amcl], progress: Iterator[ProgressCallback]
    ) -> tuple[Amcl, Amcl, Amcl, dict[str, float]]:
        """Find the best of the settings, the first of which is the user's own.

        `progress` has a callback for each of the first rungs, each step, the last rung, and what is
        put back.

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
            Exponential of the score without each change of the best setting less that with it.
        """
        ranked = self._raced(settings, (48, 16), [next(progress) for _ in self.parts])
        staying = self._first(ranked)
        for each_step in [next(progress) for _ in range(STEPS)]:
            near = [each for amcl in staying[:2] for each in beside(self.own, amcl)]
            raced = self._raced(near, (16, 8), [None, None, each_step])
            ranked = self._ranked([*ranked, *raced], self.parts[-1])
            if self._first(ranked) == staying:
                break
            staying = self._first(ranked)
        staying = [*dict.fromkeys([self.own, *staying])]
        self._drive(staying, self.last, next(progress))
        best = self._least(staying)
        frugal = self._least([amcl for amcl in staying if self._is_frugal(amcl)])
        kept, without = self._put_back(best, next(progress))
        return self._nearest(kept, best, staying), frugal, best, without

    def _raced(
        self,
        settings: Sequence[Amcl],
        stay: Sequence[int],
        progress: Sequence[ProgressCallback | None],
    ) -> list[Amcl]:
        """The settings that stay up to the last of the first rungs, the best first."""
        for part, count, each in zip(self.parts, (*stay, len(settings)), progress, strict=True):
            self._drive(settings, part, each)
            settings = self._ranked(settings, part)[:count]
        return [*settings]

    def _drive(
        self, settings: Sequence[Amcl], part: tuple[int, int], progress: ProgressCallback | None
    ) -> None:
        """Drive settings as a rung: at the strongest level, the worst of nearly all."""
        self.bench.drive(settings, *part, self.bench.strongest, progress)
        self.rungs += [(len(settings), *part)] * bool(settings)

    def _ranked(self, settings: Sequence[Amcl], part: tuple[int, int]) -> list[Amcl]:
        """The settings, the best first."""
        return sorted(dict.fromkeys(settings), key=lambda amcl: self._known(amcl, part))

    def _first(self, ranked: Sequence[Amcl]) -> list[Amcl]:
        """The best five, and the best two that compare no more beams than the user's own."""
        frugal = [amcl for amcl in ranked if self._is_frugal(amcl)]
        return [*dict.fromkeys([*ranked[:5], *frugal[:2]])]

    def _is_frugal(self, amcl: Amcl) -> bool:
        return self.beams(amcl) <= self.beams(self.own)

    def beams(self, amcl: Amcl) -> float:
        """Beams that a setting compares on one drive along every path."""
        return self.bench.updates(amcl) * amcl.max_beams

    def _known(self, amcl: Amcl, part: tuple[int, int] | None = None) -> float:
        """Score at the worst of the levels that were driven, by default in the last rung."""
        return float(np.nanmax(self.bench.means(amcl, *(part or self.last))))

    def _least(self, settings: Sequence[Amcl]) -> Amcl:
        """Setting with the least score at its worst level that loses no more than the user's own.

        A setting's other levels can only make it worse, so they are driven for the best so far
        until one stays the best.
        """
        while True:
            best = min(settings, key=lambda amcl: (self._loses(amcl, self.own), self._known(amcl)))
            if not np.isnan(self.bench.means(best, *self.last)).any():
                return best
            self.bench.drive([best], *self.last)

    def _put_back(self, best: Amcl, progress: ProgressCallback) -> tuple[Amcl, dict[str, float]]:
        """The best setting with what gains next to nothing put back, and what each change gains."""
        axes, part = changed_axes(self.own, best), self.parts[-1]
        single = {axis: axis.put(best, axis.of(self.own)) for axis in axes}
        self._drive([*single.values()], part, None)
        losses = {
            axis: self._known(amcl, part) - self._known(best, part) for axis, amcl in single.items()
        }
        unclear = [
            axis
            for axis, amcl in single.items()
            if losses[axis] <= WORSE_AT_A_COST or not self._is_worse(amcl, best, part)
        ]
        self._drive([single[axis] for axis in unclear], self.last, progress)
        losses |= {axis: self._known(single[axis]) - self._known(best) for axis in unclear}
        some = sorted(
            (axis for axis in unclear if losses[axis] <= WORSE_AT_A_COST), key=losses.__getitem__
        )
        # Where other levels than the strongest contradict in the end, they count at each axis.
        for levels in (self.bench.strongest, None):
            kept = best
            for axis in some:
                tried = axis.put(kept, axis.of(self.own))
                if self._is_as_good(tried, kept, best, levels):
                    kept = tried
            if self._is_as_good(kept, best, best):
                break
        return kept, {axis.name: math.exp(loss) for axis, loss in losses.items()}

    def _nearest(self, kept: Amcl, best: Amcl, settings: Sequence[Amcl]) -> Amcl:
        """The setting nearest to the user's own that is hardly worse than the one to be kept."""
        away = steps_between(self.own, kept)
        near = sorted(settings, key=lambda amcl: steps_between(self.own, amcl))
        nearer = (amcl for amcl in near if steps_between(self.own, amcl) < away)
        every = self.bench.strongest, None
        return next(
            (a for a in nearer if all(self._is_as_good(a, kept, best, each) for each in every)),
            kept,
        )

    def _is_as_good(
        self, tried: Amcl, kept: Amcl, best: Amcl, levels: Sequence[int] | None = None
    ) -> bool:
        """Whether a setting loses no more and is hardly worse, so that it is to be kept instead."""
        self.bench.drive([tried], *self.last, levels)
        spared = self.beams(tried) < self.beams(kept) or not self._is_worse(tried, kept, self.last)
        bound = self._known(kept) + (WORSE_AT_A_COST if spared else WORSE)
        # What is put back one after the other must not add up.
        at_most = min(bound, self._known(best) + WORSE_AT_A_COST)
        return self._known(tried) <= at_most and not self._loses(tried, kept)

    def _is_worse(self, tried: Amcl, kept: Amcl, part: tuple[int, int]) -> bool:
        """Whether a setting is clearly worse at its worst level, on drives that both share."""
        paths, drives = part
        level = int(np.nanargmax(self.bench.means(tried, *part)))
        one, other = (
            self.bench.driven[each].scores[level, :paths, :drives] for each in (tried, kept)
        )
        return of_mean((one - other).ravel()).low > 0

    def _loses(self, amcl: Amcl, other: Amcl) -> bool:
        """Whether a setting is lost on more of the drives that both share."""
        one, two = (self.bench.driven[each].lost for each in (amcl, other))
        return bool(np.nansum(one - two) > 0)
