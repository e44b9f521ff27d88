"""A small recorded drive, made by the simulator: the fixture small_drive.npz.

`python tests/small_drive.py` writes it anew.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from locplan import Costmap, Lidar, OccupancyGrid, load_map, plan
from locplan.costs import Path as Route
from locplan.recordings import Recording, Source
from locplan.simulation import Simulator

HERE = Path(__file__).resolve().parent
FILE = HERE / "small_drive.npz"
MAP = HERE.parent / "maps" / "office.yaml"
STOPS = ((7.0, 7.0), (39.0, 7.0), (39.0, 23.0), (20.5, 15.0))
"""Places that the robot drives to, one after the other [m]."""
LIDAR = Lidar(range=12.0, least_range=0.1, field_of_view_deg=270.0, beams=181, mount_x=0.12)
EVERY = 4
"""A scan is taken at each n-th pose of the simulation, which are 0.05 m apart."""
SPEED = 0.5
"""Speed of the robot [m/s]."""
SEED = 11


def made() -> Recording:
    """Drive along shortest paths in a world that differs from the map, and record it.

    The recorded poses are the true ones. Ranges are whole millimetres, so that the file is small.
    """
    from locplan._kernels.drives import odometry_along
    from locplan._kernels.measured import measured_ends
    from locplan.simulation._motion import poses_along

    grid = load_map(MAP)
    simulator = Simulator(grid, lidar=LIDAR, seed=SEED, threads=1)
    line = poses_along(route(grid), grid)
    random = np.random.default_rng(SEED)
    reported = odometry_along(random, simulator.on_grid(line), simulator.arguments.odometry)
    chosen = slice(None, None, EVERY)
    lidar = simulator.arguments.lidar._replace(angles=LIDAR.angles)
    rows, cols = grid.world_to_grid(*line[chosen, :2].T)
    ranges = np.empty((len(rows), LIDAR.beams))
    ends = np.empty((LIDAR.beams, 2))
    for n, heading in enumerate(line[chosen, 2]):
        pose = np.array([rows[n], cols[n], heading])
        disturbances = simulator.arguments.disturbances
        world = simulator.worlds[0]
        measured_ends(random, world, grid.resolution, pose, lidar, disturbances, ends)
        ranges[n] = np.hypot(*(ends * grid.resolution - (LIDAR.mount_x, LIDAR.mount_y)).T)
    # A hundredth more for each scan: the robot turns on the spot, too.
    way = np.concatenate([[0.0], np.hypot(*np.diff(line[:, :2], axis=0).T).cumsum()])
    return Recording(
        np.rint(ranges * 1000) / 1000,
        LIDAR,
        np.round(line[chosen], 5),
        np.round(way[chosen] / SPEED + 0.01 * np.arange(len(ranges)), 3),
        np.round(reported[chosen], 5),
        Source(file="small_drive", scans="simulated", poses="true", odometry="simulated"),
    )


def route(grid: OccupancyGrid) -> Route:
    """Shortest paths from stop to stop."""
    costs = Costmap.from_density(grid, np.where(grid.clearance > 0.4, 1.0, np.inf))
    parts = []
    for start, goal in pairwise(STOPS):
        path = plan(costs, start, goal).path
        assert path is not None
        parts.append(path.xy if not parts else path.xy[1:])
    return Route(np.concatenate(parts))


if __name__ == "__main__":
    drive = made()
    drive.save(FILE)
    print(drive, f"{FILE.stat().st_size:,} bytes")
    print(drive.summary().table())
