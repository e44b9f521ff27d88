"""Drives of a robot along all of its routes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from locplan._support.kernels.arrays import Floats
from locplan._support.progress import ProgressCallback
from locplan.advice.trials import Outcome
from locplan.maps.grid import OccupancyGrid
from locplan.planning.path import Path
from locplan.robots.robot import Robot
from locplan.simulation.arrivals import Arrivals
from locplan.simulation.driver import drive_closed, drive_open
from locplan.simulation.drives import FLOOR, LOST, Drives
from locplan.simulation.simulator import Simulator


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
    """The path of each route by its name."""
    stretch: float = 1.0
    """Ratio of the world's lengths to those of the maps: not 1 where their resolution is wrong."""

    @cached_property
    def digest(self) -> str:
        """Digest of all that drives depend on but their seed."""
        digest_parts = self.world.digest, self.filter_map.digest, self.robot.digest, self.stretch
        hasher = hashlib.sha256(repr(digest_parts).encode())
        for path in self.paths.values():
            hasher.update(path.poses.tobytes())
        return hasher.hexdigest()


class SiteRunner:
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
        filter_map = None if site.filter_map is site.world else site.filter_map
        self._simulator = Simulator(
            site.world,
            site.robot,
            filter_map=filter_map,
            seed=seed,
            threads=threads,
            stretch=site.stretch,
        )

    def __call__(self, numbers: range, progress: ProgressCallback | None = None) -> Outcome:
        """Drive each route with the drives of some numbers."""
        routes = drive_open(self._simulator, self.site.paths, numbers, progress=progress).values()
        log_error = [0.5 * np.log(drives.mean_squares + FLOOR) for drives in routes]
        lost_at = [_find_loss_distances(drives) for drives in routes]
        off_at_end = [drives.off_at_end for drives in routes]
        lost = ~np.isnan(lost_at)
        return Outcome(np.array(log_error), lost, np.array(lost_at), np.array(off_at_end))

    def drive_closed_loop(
        self, numbers: range, progress: ProgressCallback | None = None
    ) -> list[Arrivals]:
        """Drive each route steered by the filter's pose; none in a world that is stretched."""
        if self.site.stretch != 1:
            return []
        arrivals_by_route = drive_closed(
            self._simulator, self.site.paths, numbers, progress=progress
        )
        return [*arrivals_by_route.values()]


def _find_loss_distances(drives: Drives) -> Floats:
    """Return the distance along the path where each drive is first lost, else NaN, (n,) [m]."""
    is_lost = drives.position_error > LOST
    return np.where(drives.lost, drives.distance[is_lost.argmax(axis=1)], np.nan)
