"""Drives of a robot along all of its trips."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from locplan._kernels.arrays import Floats
from locplan._util.progress import ProgressCallback, parts
from locplan.costs import Path
from locplan.diagnosis.trials import Outcome
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

STREAM = 2_000_000
"""Stream of the random numbers of the first trip's drives, above those of other recipes."""


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
