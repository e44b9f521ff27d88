"""Drives of a robot along all of its trips, and what two sets of them say of each other."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path as File
from typing import Any, NamedTuple

import numpy as np

import locplan
from locplan._kernels.arrays import Bools, Floats
from locplan._util.files import replacing
from locplan._util.intervals import Interval, of_mean, wilson
from locplan._util.progress import ProgressCallback, parts
from locplan._util.reading import parsed_json, read_text
from locplan.costs import Path
from locplan.errors import LocplanError
from locplan.field import kept
from locplan.maps import OccupancyGrid
from locplan.robots import Amcl, Robot
from locplan.simulation import (
    FLOOR,
    LOST,
    Arrival,
    Arrivals,
    Drives,
    Simulator,
    drive_closed,
    poses_along,
)

STREAM = 2_000_000
"""Stream of the random numbers of the first trip's drives, above those of other recipes."""
CRITICAL = 2.4
"""Critical value from which on a cure is clearly better: 95 % for some three that are tried."""
WORTHWHILE = 0.9
"""Ratio of errors from which on a cure is worth its effort, as for paths."""
BETTER, WORSE, NO_BETTER = "better", "worse", "no better"
"""Verdicts on a cure."""


@dataclass(frozen=True, eq=False)
class Site:
    """What is driven: the world, what the filter knows of it, the robot, and its paths."""

    world: OccupancyGrid
    """The map that is driven in, of which each drive has a world of its own."""
    filter_map: OccupancyGrid
    """The filter's map."""
    robot: Robot
    """The robot."""
    paths: Mapping[str, Path]
    """The path of each trip by its name."""
    stretch: float = 1.0
    """Ratio of the world's lengths to those of the maps: not 1 where their resolution is wrong."""

    @cached_property
    def digest(self) -> str:
        """Digest of all that drives depend on but their seed."""
        about = self.world.digest, self.filter_map.digest, self.robot.digest, self.stretch
        found = hashlib.sha256(repr(about).encode())
        for path in self.paths.values():
            found.update(path.poses.tobytes())
        return found.hexdigest()


class Journal:
    """What was found before by what it depends on, as files of a folder; none keeps nothing."""

    def __init__(self, folder: File | None) -> None:
        self._folder = folder

    @classmethod
    @contextmanager
    def of(cls, site: Site, seed: int) -> Iterator[Journal]:
        """The journal of a site's drives in the cache, of this version of locplan."""
        # The 2 rises when drives, cures or choices of the same version find something else.
        key = hashlib.sha256(repr(("check", 2, locplan.__version__, site.digest, seed)).encode())
        folder = None
        with ExitStack() as stack:
            with suppress(LocplanError):  # a cache that cannot be written keeps nothing
                if isinstance(site.robot.filter, Amcl):  # the code of another has no digest
                    entry = kept(key.hexdigest()[:32], "driven check", site.world.name)
                    folder = stack.enter_context(entry)
            yield cls(folder)

    def __call__(
        self,
        about: object,
        make: Callable[[], Any],
        load: Callable[[File], Any] = lambda file: parsed_json(read_text(file)),
        write: Callable[[Any, File], None] | None = None,
    ) -> Any:
        """What was found before; else it is made and kept, by default as JSON."""
        if self._folder is None:
            return make()
        name = hashlib.sha256(repr(about).encode()).hexdigest()[:32]
        file = self._folder / f"{name}.json"
        with suppress(LocplanError, ValueError):
            return load(file)
        made = make()
        with suppress(LocplanError):  # what cannot be kept is made anew
            (write or _write_json)(made, file)
        return made


def _write_json(found: object, file: File) -> None:
    with replacing(file) as temporary:
        temporary.write_text(json.dumps(found), "utf-8")


class _Stretched(Simulator):
    """A simulator of a world that is larger than its map says."""

    stretch = 1.0

    def stage(self, lines: Sequence[Any] = ()) -> Any:
        made = super().stage(lines)
        return replace(made, resolution=made.resolution * self.stretch)


class Outcome(NamedTuple):
    """How drives went; those of one place in the arrays have one world and one seed."""

    log_error: Floats
    """Logarithm of the error of each drive, (trips, drives) [ln m]."""
    lost: Bools
    """True for the drives that were off by over 1 m at some time, (trips, drives)."""
    lost_at: Floats
    """Distance along the trip where they first were, else NaN, (trips, drives) [m]."""

    def joined(self, later: Outcome) -> Outcome:
        """These drives and later ones."""
        pairs = zip(self, later, strict=True)
        return Outcome(*(np.concatenate(pair, axis=1) for pair in pairs))

    @property
    def error(self) -> Interval:
        """Error of a typical drive: the geometric mean [m]."""
        return error_of(self.log_error)

    @property
    def lost_rate(self) -> Interval:
        """Share of the drives that were off by over 1 m at some time, 0..1."""
        return rate_of(self.lost)


def error_of(log_error: Floats) -> Interval:
    """Error of a typical drive, of the logarithms of all [m]."""
    return Interval(*np.exp(of_mean(log_error.ravel())).tolist())


def rate_of(lost: Bools) -> Interval:
    """Share of drives that are lost, 0..1."""
    return wilson(float(lost.mean()), lost.size)


class Driver:
    """Drives of one site by their numbers.

    Parameters
    ----------
    site : Site
        What is driven.
    seed : int
        Seed of all random numbers.
    threads : int or None
        Number of threads.
    journal : Journal, optional
        What was driven before.
    """

    def __init__(
        self, site: Site, seed: int, threads: int | None, journal: Journal | None = None
    ) -> None:
        self.site, self._journal, self._seed = site, journal or Journal(None), seed
        own = None if site.filter_map is site.world else site.filter_map
        self._simulator = _Stretched(
            site.world, site.robot, filter_map=own, seed=seed, threads=threads
        )
        self._simulator.stretch = site.stretch

    @cached_property
    def lines(self) -> list[Floats]:
        """The poses along each trip, (n, 3) each [m, m, rad]."""
        return [poses_along(path, self.site.world) for path in self.site.paths.values()]

    def __call__(self, numbers: range, progress: ProgressCallback | None = None) -> Outcome:
        """Drive each trip with the drives of some numbers."""
        found = self._kept("open", numbers, progress, self._driven)
        return Outcome(*map(np.array, zip(*found, strict=True)))

    def arrivals(self, numbers: range, progress: ProgressCallback | None = None) -> list[Arrivals]:
        """Drive each trip steered by the filter's pose; none in a world that is stretched."""
        if self.site.stretch != 1:
            return []
        found = self._kept("closed", numbers, progress, self._arrived)
        return [Arrivals(tuple(Arrival(*each) for each in trip)) for trip in found]

    def _kept(
        self,
        how: str,
        numbers: range,
        progress: ProgressCallback | None,
        drive: Callable[[range, ProgressCallback | None], list[Any]],
    ) -> list[Any]:
        about = self.site.digest, self._seed, how, numbers
        found: list[Any] = self._journal(about, lambda: drive(numbers, progress))
        if progress:  # of what was found before nothing else tells
            count = len(numbers) * len(self.site.paths)
            progress(count, count)
        return found

    def _driven(self, numbers: range, progress: ProgressCallback | None) -> list[Any]:
        rows = []
        steps = parts(progress, [len(numbers)] * len(self.lines))
        for trip, (line, step) in enumerate(zip(self.lines, steps, strict=True)):
            # A stream for each trip: drives of one number would share the errors of odometry.
            (errors,) = self._simulator.drive_together(
                [line], numbers, stream=STREAM + trip, progress=step
            )
            drives = Drives(line, errors)
            away = drives.position_error > LOST
            first = np.where(drives.lost, drives.distance[away.argmax(axis=1)], np.nan)
            log_error = 0.5 * np.log(drives.mean_squares + FLOOR)
            rows.append([each.tolist() for each in (log_error, drives.lost, first)])
        return rows

    def _arrived(self, numbers: range, progress: ProgressCallback | None) -> list[Any]:
        found = drive_closed(self._simulator, self.site.paths, numbers, progress=progress)
        return [
            [(a.outcome, a.seconds, a.end, a.believed_end, (), (), a.fault) for a in trip.drives]
            for trip in found.values()
        ]


class Contrast(NamedTuple):
    """What drives with a cure say beside those without it, with the same worlds and seeds."""

    gain: Interval
    """Share of the drives that are no longer lost, less those that newly are, -1..1."""
    ratio: Interval
    """Ratio of the errors: geometric mean."""
    verdict: str
    """One of the verdicts above."""
    score: float
    """Mean difference of what drives are ranked by, ln error + 1 where lost; below 0 is better."""


def contrast(before: Outcome, after: Outcome) -> Contrast:
    """Compare two sets of drives of the same numbers."""
    apart = (after.log_error - before.log_error).ravel()
    saved = (before.lost & ~after.lost).sum(), (after.lost & ~before.lost).sum()
    gain, sure_gain = (paired_shares(*saved, apart.size, z) for z in (1.96, CRITICAL))
    error = apart.std(ddof=1) / math.sqrt(apart.size)
    ratio, sure_ratio = (_ratio(float(apart.mean()), z * error) for z in (1.96, CRITICAL))
    verdict = NO_BETTER
    if sure_gain.low > 0 or (sure_ratio.high < 1 and ratio.value <= WORTHWHILE and gain.value >= 0):
        verdict = BETTER
    elif sure_gain.high < 0 or (sure_ratio.low > 1 and gain.value <= 0):
        verdict = WORSE
    return Contrast(gain, ratio, verdict, float(apart.mean()) - gain.value)


def keeps_more(verdict: str, gain: Interval) -> bool:
    """Whether a cure clearly keeps drives from getting lost, and does not lower errors alone."""
    return verdict == BETTER and gain.low > 0


def _ratio(mean: float, half: float) -> Interval:
    return Interval(math.exp(mean), math.exp(mean - half), math.exp(mean + half))


def paired_shares(ones: int, others: int, trials: int, z: float = 1.96) -> Interval:
    """Difference of two shares of paired trials, by Bonett and Price's adjusted interval.

    Parameters
    ----------
    ones, others : int
        Number of the trials of which only the first, and only the second, is true.
    trials : int
        Number of all trials.
    z : float, default 1.96
        Critical value.
    """
    p, q = (ones + 1) / (trials + 2), (others + 1) / (trials + 2)
    half = z * math.sqrt((p + q - (p - q) ** 2) / (trials + 2))
    return Interval((ones - others) / trials, max(-1.0, p - q - half), min(1.0, p - q + half))


def is_hopeless(before: Outcome, after: Outcome) -> bool:
    """Whether a cure has shown after a few drives that it is not better."""
    scores = (after.log_error + after.lost - before.log_error - before.lost).ravel()
    error = scores.std(ddof=1) / math.sqrt(scores.size)
    # One-sided at 7 %, as in the race of paths; no effect at all is none later on either.
    return bool(scores.mean() - 1.5 * error >= math.log(WORTHWHILE) / 2)
