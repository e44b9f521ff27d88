"""The built-in recording of two_corridors, made by the simulator.

`python tests/support/built_in_recording.py` writes it again.
"""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from pathlib import Path

import numpy as np

import locplan
from locplan import Costmap, Lidar, load_map, plan
from locplan.recordings import Recording, record_drive
from locplan.robots import Robot

NAME = "two_corridors"
FILE = Path(locplan.__file__).parent / "recordings" / "drives" / f"{NAME}.npz"
STOPS = ((2.0, 3.0), (5.5, 9.0), (37.0, 12.0), (38.0, 3.0), (2.0, 3.0))
"""Places that the robot drives to [m]: through the long corridor and back through the short one."""
LIDAR = Lidar(range=12.0, min_range=0.1, field_of_view_deg=270.0, beams=121, mount_x=0.12)
SEED = 1


def simulate_recording() -> Recording:
    """Return a recorded drive along shortest paths, in a world that differs from the map."""
    grid = load_map(NAME)
    costs = Costmap.from_density(grid, np.where(grid.clearance > 0.4, 1.0, np.inf))
    parts = [plan(costs, *ends).path for ends in pairwise(STOPS)]
    route = np.concatenate([parts[0].xy[:1], *(part.xy[1:] for part in parts)])
    recording = record_drive(grid, route, Robot(LIDAR), spacing=0.1, seed=SEED)
    source = dataclasses.replace(recording.source, file=NAME)
    return dataclasses.replace(recording, source=source)


if __name__ == "__main__":
    simulate_recording().save(FILE)
    print(f"{FILE.stat().st_size:,} bytes")
    print(Recording.load(FILE).report())
