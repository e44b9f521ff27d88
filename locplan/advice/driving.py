"""Drives of a robot along all of its routes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from locplan._support.kernels.arrays import Floats
from locplan._support.progress import ProgressCallback
from locplan.advice.trials import DrivesOnRoutes
from locplan.maps.grid import OccupancyGrid
from locplan.planning.path import Path
from locplan.robots.robot import Robot
from locplan.simulation.arrivals import Arrivals
from locplan.simulation.driver import drive_closed, drive_open
from locplan.simulation.drives import LOST_DISTANCE, MIN_MEAN_SQUARE, Drives
from locplan.simulation.simulator import Simulator


@dataclass(frozen=True, eq=False)
class Scenario:
    """A simulated situation: the world, the filter's map, the robot, and its paths."""

    world: OccupancyGrid
    """The map in which drives are simulated; each drive varies it."""
    filter_map: OccupancyGrid
    """The filter's map."""
    robot: Robot
    """The robot."""
    paths: Mapping[str, Path]
    """The path of each route by its name."""
    stretch: float = 1.0
    """Ratio of the true lengths to the map's; not 1 if the map's resolution is wrong."""

    @cached_property
    def digest(self) -> str:
        """Digest of everything that determines the drives, without the seed."""
        digest_parts = self.world.digest, self.filter_map.digest, self.robot.digest, self.stretch
        hasher = hashlib.sha256(repr(digest_parts).encode())
        for path in self.paths.values():
            hasher.update(path.poses.tobytes())
        return hasher.hexdigest()


class ScenarioRunner:
    """Simulator of numbered drives in one scenario.

    Parameters
    ----------
    scenario : Scenario
        The scenario.
    seed : int
        Seed of all random numbers.
    threads : int or None
        Number of threads.
    """

    def __init__(self, scenario: Scenario, seed: int, threads: int | None) -> None:
        self.scenario = scenario
        filter_map = None if scenario.filter_map is scenario.world else scenario.filter_map
        self._simulator = Simulator(
            scenario.world,
            scenario.robot,
            filter_map=filter_map,
            seed=seed,
            threads=threads,
            stretch=scenario.stretch,
        )

    def __call__(self, numbers: range, progress: ProgressCallback | None = None) -> DrivesOnRoutes:
        """Simulate the open-loop drives of these numbers along each route."""
        routes = drive_open(
            self._simulator, self.scenario.paths, numbers, progress=progress
        ).values()
        log_error = [0.5 * np.log(drives.mean_squares + MIN_MEAN_SQUARE) for drives in routes]
        lost_at = [_find_loss_distances(drives) for drives in routes]
        off_at_end = [drives.off_at_end for drives in routes]
        lost = ~np.isnan(lost_at)
        return DrivesOnRoutes(np.array(log_error), lost, np.array(lost_at), np.array(off_at_end))

    def drive_closed_loop(
        self, numbers: range, progress: ProgressCallback | None = None
    ) -> list[Arrivals]:
        """Simulate closed-loop drives along each route; none in a stretched world."""
        if self.scenario.stretch != 1:
            return []
        arrivals_by_route = drive_closed(
            self._simulator, self.scenario.paths, numbers, progress=progress
        )
        return [*arrivals_by_route.values()]


def _find_loss_distances(drives: Drives) -> Floats:
    """Return the distance along the path at which each drive gets lost, or NaN, (n,) [m]."""
    is_lost = drives.position_error > LOST_DISTANCE
    return np.where(drives.lost, drives.distance[is_lost.argmax(axis=1)], np.nan)
