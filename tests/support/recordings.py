"""Recorded drives made by the simulator, with odometry and scans of our choice."""

from __future__ import annotations

import dataclasses

import numpy as np

from locplan import Lidar
from locplan.maps.grid import world_to_map_frame
from locplan.recordings import Recording
from locplan.robots import Disturbances, Robot
from locplan.simulation import Simulator

LIDAR = Lidar(
    range=8.0, min_range=0.1, field_of_view_deg=270.0, beams=91, range_sigma=0.02, mount_x=0.1
)


def simulate_recording(
    grid, line, *, lidar=LIDAR, disturbances=None, seed=1, odometry=None
) -> Recording:
    """Record a drive along poses (n, 3) in the world, which are the recorded ones.

    `odometry` replaces the simulated one, (n, 3).
    """
    from locplan._support.kernels.drives import simulate_odometry
    from locplan._support.kernels.lidar import simulate_measured_ends

    disturbances = dataclasses.replace(disturbances or Disturbances(), worlds=1)
    simulator = Simulator(grid, robot=Robot(lidar, disturbances=disturbances), seed=seed, threads=1)
    random = np.random.default_rng(seed)
    own = world_to_map_frame(simulator.grid, line)
    if odometry is None:
        odometry = simulate_odometry(random, own, simulator.arguments.odometry)
    beams = simulator.arguments.lidar._replace(angles=lidar.angles)
    ranges, ends = np.empty((len(line), lidar.beams)), np.empty((lidar.beams, 2))
    for n, (x, y, heading) in enumerate(own):
        simulate_measured_ends(
            random,
            simulator.worlds[0],
            grid.resolution,
            np.array([y / grid.resolution, x / grid.resolution, heading]),
            beams,
            simulator.arguments.disturbances,
            ends,
        )
        ahead, left = (ends * grid.resolution - (lidar.mount_x, lidar.mount_y)).T
        ranges[n] = np.nan_to_num(np.hypot(ahead, left), nan=np.inf)
    return Recording(ranges, lidar, line, odometry=odometry)
