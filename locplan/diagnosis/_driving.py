"""Drives of a robot along all of its trips, and what two sets of them say of each other."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from locplan._kernels.arrays import Bools, Floats
from locplan._util.intervals import Interval, of_mean, wilson
from locplan._util.progress import ProgressCallback, parts
from locplan.costs import Path
from locplan.maps import OccupancyGrid
from locplan.robots import Robot
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
from locplan.simulation.verdict import BETTER, DriveSet, Verdict, compare

STREAM = 2_000_000
"""Stream of the random numbers of the first trip's drives, above those of other recipes."""
WORTHWHILE = 0.9
"""Ratio of errors from which on a cure is worth its effort, as for paths."""


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
    def drive_set(self) -> DriveSet:
        """The drives along all trips as one set."""
        return DriveSet(self.log_error.ravel(), self.lost.ravel())

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
    """

    def __init__(self, site: Site, seed: int, threads: int | None) -> None:
        self.site = site
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
        found = self._driven(numbers, progress)
        return Outcome(*map(np.array, zip(*found, strict=True)))

    def arrivals(self, numbers: range, progress: ProgressCallback | None = None) -> list[Arrivals]:
        """Drive each trip steered by the filter's pose; none in a world that is stretched."""
        if self.site.stretch != 1:
            return []
        found = self._arrived(numbers, progress)
        return [Arrivals(tuple(Arrival(*each) for each in trip)) for trip in found]

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

    verdict: Verdict
    """The verdict on the cure."""
    gain: Interval
    """Share of the drives that are no longer lost, less those that newly are, -1..1."""
    score: float
    """Mean difference of what drives are ranked by, ln error + 1 where lost; below 0 is better."""

    @property
    def keeps_more(self) -> bool:
        """Whether the cure is better since it keeps drives from getting lost."""
        return self.verdict.word == BETTER and self.verdict.fewer_lost


def contrast(before: Outcome, after: Outcome) -> Contrast:
    """Compare two sets of drives of the same numbers."""
    apart = after.log_error - before.log_error
    saved = (before.lost & ~after.lost).sum(), (after.lost & ~before.lost).sum()
    gain = paired_shares(*saved, apart.size)
    return Contrast(
        compare(before.drive_set, after.drive_set), gain, float(apart.mean()) - gain.value
    )


def paired_shares(ones: int, others: int, trials: int) -> Interval:
    """Difference of two shares of paired trials, by Bonett and Price's adjusted interval.

    Parameters
    ----------
    ones, others : int
        Number of the trials of which only the first, and only the second, is true.
    trials : int
        Number of all trials.
    """
    p, q = (ones + 1) / (trials + 2), (others + 1) / (trials + 2)
    half = 1.96 * math.sqrt((p + q - (p - q) ** 2) / (trials + 2))
    return Interval((ones - others) / trials, max(-1.0, p - q - half), min(1.0, p - q + half))


def is_hopeless(before: Outcome, after: Outcome) -> bool:
    """Whether a cure has shown after a few drives that it is not better."""
    scores = (after.log_error + after.lost - before.log_error - before.lost).ravel()
    error = scores.std(ddof=1) / math.sqrt(scores.size)
    # One-sided at 7 %, as in the race of paths; no effect at all is none later on either.
    return bool(scores.mean() - 1.5 * error >= math.log(WORTHWHILE) / 2)
