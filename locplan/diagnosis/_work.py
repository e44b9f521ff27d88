"""The drives of a check: as it is, with each cure, and with those that help together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from locplan._util.intervals import wilson
from locplan._util.progress import ProgressCallback, parts, scaled
from locplan.costs import Costmap
from locplan.diagnosis import _cures as cures
from locplan.diagnosis._cures import Remedy
from locplan.diagnosis._driving import Driver, Site
from locplan.diagnosis._reading import Reading
from locplan.diagnosis._result import (
    NOTHING,
    Cure,
    Rates,
    Trip,
    helps,
    is_seldom,
    ranked,
)
from locplan.diagnosis._weak_spots import WeakSpot, blamed
from locplan.diagnosis.trials import Contrast, Outcome, confirm_cures, contrast, try_cure
from locplan.field import CovarianceField
from locplan.maps import OccupancyGrid
from locplan.simulation import Arrivals, Choice, choose
from locplan.simulation.driver import CHOOSING, FRESH


@dataclass(frozen=True)
class Effort:
    """How much is driven."""

    trips: int
    """Maximum number of trips between places far apart."""
    few: int
    """Number of drives, along all trips together, that a cure has to lead after."""
    drives: int
    """Number of further drives of what leads, on which it is judged."""
    closed: int
    """Number of drives steered by the filter's pose."""
    choosing: int
    """Maximum number of confirming drives of a path; 0 tries no other paths."""
    landmarks: bool
    """Whether landmarks are tried."""
    search: bool = False
    """Whether settings are searched as `tune` does, in place of a few."""


EFFORTS = {
    "quick": Effort(4, 12, 32, 16, 0, False),
    "usual": Effort(6, 24, 96, 48, 16, True),
    "thorough": Effort(6, 48, 288, 96, 64, True, True),
}


class Work:
    """The drives of a check, and what they have shown.

    Parameters
    ----------
    site : Site
        The site as it is.
    effort : Effort
        How much is driven.
    seed : int
        Seed of all random numbers.
    threads : int or None
        Number of threads.
    """

    def __init__(self, site: Site, effort: Effort, seed: int, threads: int | None) -> None:
        self.site, self.effort, self.seed, self.threads = site, effort, seed, threads
        self.remedies: dict[str, Remedy] = {}
        self.taken: tuple[str, ...] = ()
        few, many, closed = (
            -(-number // len(site.paths)) for number in (effort.few, effort.drives, effort.closed)
        )
        # Cures are chosen, judged, and what is recommended confirmed, each on drives of its own.
        self._few, self._many = range(CHOOSING, CHOOSING + few), range(many)
        self._fresh, self._closed = range(FRESH, FRESH + many), range(closed)
        self._driver = Driver(site, seed, threads)
        self._drive = cures.driver_of(seed, threads)

    def as_it_is(
        self, spots: Sequence[WeakSpot], progress: ProgressCallback
    ) -> tuple[Rates, tuple[Trip, ...], tuple[WeakSpot, ...]]:
        """Drive the trips as they are, and count the lost drives of each weak spot."""
        sizes = len(self._few), len(self._many), len(self._closed)
        steps = parts(progress, [each * len(self.site.paths) for each in sizes])
        self._before_few = self._driver(self._few, steps[0])
        self._before = found = self._driver(self._many, steps[1])
        arrivals = self._driver.arrivals(self._closed, steps[2])
        of_trips = [[each] for each in arrivals] or [[]] * len(self.site.paths)
        spots, near, where = blamed(spots, self.site.paths, [*found.lost_at])
        rows: Any = zip(self.site.paths.items(), of_trips, near, where, *found, strict=True)
        trips = tuple(
            Trip(name, path, _rates(Outcome(*own), each), letters, places)
            for (name, path), each, letters, places, *own in rows
        )
        self._as_is = _rates(found, arrivals)
        return self._as_is, trips, spots

    def cures(
        self,
        reading: Reading,
        mended: OccupancyGrid,
        costs: Costmap,
        field: CovarianceField,
        progress: ProgressCallback,
    ) -> Iterator[Cure]:
        """Try the cures that suit, each as far as it leads; other paths where none cures."""
        first, second, third = parts(progress, [100, 200, 150])
        every = [*cures.remedies(self.site, reading, mended)]
        every += filter(None, [self._settings(first)])
        lost = self._before.lost.any()
        steps = parts(second, [200 // max(1, len(every))] * len(every))
        for remedy, step in zip(every, steps, strict=True):
            yield (cure := self._tried(remedy))
            lost &= not (cure.keeps_more and is_seldom(cure.rates.lost))
            step(200 // len(every), 200)
        if self.effort.choosing and lost:
            choices = self._choices(costs, field, third)
            if made := cures.chosen_paths(self.site, choices, self._score):
                yield self._tried(made)

    def _score(self, site: Site) -> float:
        return contrast(self._before_few, self._drive(site, self._few)).score

    def _settings(self, progress: ProgressCallback) -> Remedy | None:
        """Settings of the filter: of a few, or where there is time of the search of `tune`."""
        own = self.seed, self.threads, scaled(progress, 100)
        found = cures.searched(self.site, *own) if self.effort.search else None
        return found or cures.tuned(self.site, self._score)

    def _choices(
        self, costs: Costmap, field: CovarianceField, progress: ProgressCallback
    ) -> dict[str, Choice]:
        """The paths to take on the trips that lose drives."""
        site, found = self.site, {}
        named = zip(site.paths, self._before.lost, strict=True)
        losing = [name for name, lost in named if lost.any()]
        own: Any = {"costs": costs, "drives": self.effort.choosing, "rival": None}
        own |= {"filter_map": None if site.filter_map is site.world else site.filter_map}
        own |= {"seed": self.seed, "threads": self.threads}
        for name, step in zip(losing, parts(progress, [100] * len(losing)), strict=True):
            start, goal = map(tuple, site.paths[name].xy[[0, -1]].tolist())
            choice = choose(site.world, start, goal, site.robot, **own)
            found[name] = choice.with_field(field)
            step(100, 100)
        return found

    def _tried(self, remedy: Remedy) -> Cure:
        """A cure as it was driven, after a few drives no further if it does not lead."""
        self.remedies[remedy.kind] = remedy
        site = remedy.apply(self.site)
        known = (self._few, self._before_few), (self._many, self._before)
        found, outcome, is_stopped = try_cure(partial(self._drive, site), *known)
        driver = Driver(site, self.seed, self.threads)
        arrivals = [] if is_stopped else driver.arrivals(self._closed)
        return self._cure(remedy, site, _rates(outcome, arrivals), found)

    def _cure(self, remedy: Remedy, site: Site, rates: Rates, said: Contrast) -> Cure:
        old, new = (sum(p.length for p in each.paths.values()) for each in (self.site, site))
        longer = (new - old) / len(site.paths)
        about = remedy.kind, remedy.title, remedy.effort
        verdict = said.verdict
        return Cure(
            *(*about, verdict.word, rates, said.gain, verdict.ratio, longer),
            keeps_more=said.keeps_more,
        )

    def together(self, tried: list[Cure], progress: ProgressCallback) -> tuple[Rates, Rates]:
        """What is to be done together, and fresh drives without and with it."""
        sure = tuple(kind for kind, each in self.remedies.items() if each.is_sure)
        order = [each.kind for each in ranked(tried) if helps(each, self._as_is)]
        order = [kind for kind in order if kind not in sure]
        before = after = self._before
        if sure or order:
            self.taken, before, after = confirm_cures(
                *(sure, order, self._drive_together, self._many, self._fresh)
            )
        progress(100, 200)
        if self.effort.landmarks and not is_seldom(after.lost_rate):
            before, after = self._with_landmarks(tried, before, after)
        if not self.taken:
            return _rates(before), _rates(before)
        site = cures.joined(self.remedies, self.taken, self.site)
        cured = Driver(site, self.seed, self.threads)
        closed = [each.arrivals(self._closed) for each in (self._driver, cured)]
        progress(200, 200)
        return _rates(before, closed[0]), _rates(after, closed[1])

    def _drive_together(self, kinds: tuple[str, ...], numbers: range) -> Outcome:
        return self._drive(cures.joined(self.remedies, kinds, self.site), numbers)

    def _with_landmarks(
        self,
        tried: list[Cure],
        before: Outcome,
        after: Outcome,
    ) -> tuple[Outcome, Outcome]:
        """The fresh drives without and with all cures, landmarks among them if they help."""
        site = cures.joined(self.remedies, self.taken, self.site)
        remedy = cures.landmarks(site, self.threads)
        if remedy is None:
            return before, after
        self.remedies[remedy.kind] = remedy
        if not self.taken:
            before = after = self._drive(self.site, self._fresh)
        more = self._drive(remedy.apply(site), self._fresh)
        said = contrast(after, more)
        title = f"{remedy.title}{' besides' if self.taken else ''}"
        tried.append(self._cure(replace(remedy, title=title), site, _rates(more), said))
        if said.keeps_more:
            self.taken, after = (*self.taken, remedy.kind), more
        return before, after


def _rates(found: Outcome, arrivals: Sequence[Arrivals] = ()) -> Rates:
    """The figures of drives along all trips."""
    count = sum(len(each.drives) for each in arrivals)
    arrived = sum(each.count for each in arrivals)
    share = wilson(arrived / count, count) if count else NOTHING
    ends = Counter[str]()
    for each in arrivals:
        ends += each.failed
    most = max(ends, key=lambda what: ends[what], default="")
    return Rates(found.lost.size, found.lost_rate, found.error, share, most)
