"""A small recorded drive, made by the simulator: data/small_drive.npz.

`python tests/support/small_drive.py` writes it again.
"""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from pathlib import Path

import numpy as np

from locplan import Costmap, Lidar, OccupancyGrid, load_map, plan
from locplan.planning import Path as Route
from locplan.recordings import Recording, record_drive
from locplan.robots import Robot

TESTS = Path(__file__).resolve().parents[1]
FILE = TESTS / "data" / "small_drive.npz"
MAP = TESTS.parent / "maps" / "office.yaml"
STOPS = ((7.0, 7.0), (39.0, 7.0), (39.0, 23.0), (20.5, 15.0))
"""Places that the robot drives to, one after the other [m]."""
LIDAR = Lidar(range=12.0, min_range=0.1, field_of_view_deg=270.0, beams=181, mount_x=0.12)
SEED = 11


def simulate_drive() -> Recording:
    """Drive along shortest paths in a world that differs from the map, and record it."""
    grid = load_map(MAP)
    drive = record_drive(grid, route(grid), Robot(LIDAR), spacing=0.2, seed=SEED)
    return dataclasses.replace(drive, source=dataclasses.replace(drive.source, file="small_drive"))


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
    drive = simulate_drive()
    drive.save(FILE)
    print(drive, f"{FILE.stat().st_size:,} bytes")
    print(drive.report())
