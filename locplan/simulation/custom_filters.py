"""Simulated drives with a filter that is not AMCL, open-loop and closed-loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from locplan._support.kernels.arrays import Floats, Octets, Singles
from locplan._support.poses import Poses
from locplan.errors import LocplanError
from locplan.maps.grid import world_to_map_frame
from locplan.robots.amcl import Tracker
from locplan.simulation.drives import CustomFilter, DriveArguments


def track_drive(
    random: np.random.Generator,
    truth: Poses,
    reported: Poses,
    world: Any,
    scores: None,
    lidar: Any,
    disturbances: Any,
    start: Any,
    custom_filter: CustomFilter,
    errors: Floats,
) -> None:
    """Simulate a drive with a filter other than AMCL, as `drives.simulate_drive` does with AMCL.

    The filter gets every scan with all beams, and separate random numbers. Its start pose is off by
    the deviation that it is given.
    """
    tracker = start_tracker(random, custom_filter, truth[0], start)
    for n, pose in enumerate(world.poses):
        scan = measure_ranges(random, world.squares, world.resolution, pose, lidar, disturbances)
        errors[n] = update_tracker(tracker, custom_filter, reported[n], scan) - truth[n]
    errors[:, 2] = np.remainder(errors[:, 2] + np.pi, 2 * np.pi) - np.pi


def start_tracker(
    random: np.random.Generator, custom_filter: CustomFilter, first_pose: Any, start_deviations: Any
) -> Tracker:
    """Start a filter near a pose (3,) in its map's axes, with separate random numbers."""
    filter_random = random.spawn(1)[0]
    deviation = np.array(
        [start_deviations.position, start_deviations.position, start_deviations.heading]
    )
    x, y, heading = first_pose + deviation * random.standard_normal(3)
    at = custom_filter.grid.grid_to_world(
        y / custom_filter.grid.resolution, x / custom_filter.grid.resolution
    )
    pose = np.array([*at, heading + custom_filter.grid.origin[2]])
    deviations = start_deviations.position, start_deviations.heading
    return custom_filter.settings.start(
        custom_filter.grid, custom_filter.lidar, pose, deviations, filter_random
    )


def measure_ranges(
    random: np.random.Generator,
    squares: Octets,
    resolution: float,
    pose: Floats,
    lidar: Any,
    disturbances: Any,
) -> Singles:
    """A measured scan at a pose (row, col, heading) of a world, inf without a return [m]."""
    from locplan._support.kernels.lidar import simulate_measured_ends

    ends = np.empty((lidar.angles.size, 2))
    simulate_measured_ends(random, squares, resolution, pose, lidar, disturbances, ends)
    rays = resolution * ends - (lidar.forward, lidar.left)
    ranges = np.nan_to_num(np.hypot(*rays.T), nan=np.inf)
    return np.asarray(ranges, np.float32)


def update_tracker(
    tracker: Tracker, custom_filter: CustomFilter, odometry: Floats, scan: Singles
) -> Floats:
    """Return the filter's pose (3,) in its map's axes after a motion and a scan."""
    tracker.motion(odometry)
    tracker.scan(scan)
    estimate = np.asarray(tracker.estimate(), float)
    if estimate.shape != (3,) or not np.isfinite(estimate).all():
        raise LocplanError(
            f"{custom_filter.settings.title}: estimate() must be three finite numbers;"
            " locplan.testing.check_filter checks a filter"
        )
    return np.asarray(world_to_map_frame(custom_filter.grid, estimate[None])[0])


class CustomFilterLoop:
    """The loop of a filter that is not AMCL, which `follower.follow` is for AMCL."""

    def __init__(
        self, arguments: DriveArguments, frame: Any, random: tuple[Any, Any], first: Any, trace: Any
    ) -> None:
        self.arguments, self.frame, self.trace = arguments, frame, trace
        self.random, self.sensing = random
        self.tracker = start_tracker(
            self.sensing, self.arguments.filter, first, self.arguments.start
        )
        self.sensed = -1

    def follow(self, way: Any, surroundings: Any, body: Any, period: int, perfect: bool) -> int:
        """Drive until a plan is needed or the drive has ended."""
        from locplan.simulation.kernels.follower import (
            GO,
            apply_command,
            decide_next_command,
            write_believed_pose,
        )
        from locplan.simulation.kernels.pursuit import TICKS

        trace, arguments = self.trace, self.arguments
        while True:
            n = int(trace.counts[TICKS])
            if perfect:
                trace.believed[n] = trace.truth[n]
            elif n > self.sensed:
                write_believed_pose(self._estimate_pose(n, surroundings), self.frame, trace)
                self.sensed = n
            decision: int = decide_next_command(way, surroundings, body, period, trace)
            if decision != GO:
                return decision
            apply_command(self.random, surroundings, body, arguments.odometry, trace)

    def _estimate_pose(self, tick: int, surroundings: Any) -> tuple[float, ...]:
        x, y, heading = self.trace.truth[tick]
        resolution, arguments = surroundings.resolution, self.arguments
        cell = np.array([y / resolution, x / resolution, heading])
        sensor = arguments.lidar, arguments.disturbances
        scan = measure_ranges(self.sensing, surroundings.squares, resolution, cell, *sensor)
        pose = update_tracker(self.tracker, arguments.filter, self.trace.reported[tick], scan)
        return tuple(pose.tolist())
