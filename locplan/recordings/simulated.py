"""Recordings of simulated drives."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from locplan._support.checks import check_positive
from locplan._support.poses import compute_travel_distances
from locplan.errors import ConfigError, LocplanError
from locplan.maps.grid import OccupancyGrid, world_to_map_frame
from locplan.recordings.logs import RecordingSource
from locplan.recordings.recording import Recording
from locplan.robots.robot import Robot

if TYPE_CHECKING:
    from locplan.planning.path import AnyPath


def record_drive(
    grid: OccupancyGrid,
    path: AnyPath,
    robot: Robot | None = None,
    *,
    spacing: float = 0.2,
    speed: float = 0.5,
    seed: int = 1,
) -> Recording:
    """Record a simulated drive along a path, in a world that differs slightly from the map.

    The recorded poses are true, and ranges are rounded to millimetres.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    path : Path, Plan, or (n, 2) or (n, 3) array
        The path of the robot, in the world [m, m, rad].
    robot : Robot, optional
        The robot with its lidar; by default with a range of 6 m and a full field of view.
    spacing : float, default 0.2
        Distance between scans [m], above 0, rounded to multiples of 0.05 m.
    speed : float, default 0.5
        Speed of the robot [m/s], above 0.
    seed : int, default 1
        Seed of all random numbers, >= 0.

    Returns
    -------
    Recording
        The scans with times, true poses and odometry.

    Raises
    ------
    LocplanError
        If the path has no length, or leaves the free cells of the map.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> path = locplan.plan(locplan.Costmap.blank(grid), (2.0, 3.0), (20.0, 3.0)).path
    >>> record_drive(grid, path, locplan.Robot(locplan.Lidar(range=6.0, beams=90)), spacing=0.5)
    Recording(simulated, 37 scans of 90 beams, 18 m, with odometry)
    """
    from locplan._support.kernels.drives import simulate_odometry
    from locplan._support.kernels.lidar import simulate_measured_ends
    from locplan.planning.path import as_path
    from locplan.simulation.simulator import Simulator
    from locplan.simulation.worlds import POSE_SPACING, make_path_poses

    path = as_path(path)
    pose_step = max(1, round(check_positive("spacing", spacing, "m") / POSE_SPACING))
    check_positive("speed", speed, "m/s")
    simulator = Simulator(grid, robot, seed=seed, threads=1)
    lidar = simulator.robot.known_lidar
    try:
        line = make_path_poses(path, grid)
    except LocplanError as error:
        raise ConfigError(f"the path {error}") from None
    random = np.random.default_rng(seed)
    arguments = simulator.arguments
    reported = simulate_odometry(random, world_to_map_frame(grid, line), arguments.odometry)[
        ::pose_step
    ]
    poses = line[::pose_step]
    sensor = arguments.lidar._replace(angles=lidar.angles)
    rows, cols = grid.world_to_grid(*poses[:, :2].T)
    headings = poses[:, 2] - grid.origin[2]
    ranges, ends = np.empty((len(poses), lidar.beams)), np.empty((lidar.beams, 2))
    for n, pose in enumerate(np.column_stack([rows, cols, headings])):
        world, size = simulator.worlds[0], grid.resolution
        simulate_measured_ends(random, world, size, pose, sensor, arguments.disturbances, ends)
        beam_vectors = ends * grid.resolution - (lidar.mount_x, lidar.mount_y)
        ranges[n] = np.hypot(*beam_vectors.T)
    # Add 0.01 s per scan, so that turns on the spot take time.
    times = compute_travel_distances(line)[::pose_step] / speed + 0.01 * np.arange(
        len(poses), dtype=float
    )
    return Recording(
        (np.rint(ranges * 1000) / 1000).astype(np.float32),
        lidar,
        np.round(poses, 5),
        np.round(times, 3),
        np.round(reported, 5).astype(np.float64),
        RecordingSource(file="simulated", scans="simulated", poses="true", odometry="simulated"),
    )
