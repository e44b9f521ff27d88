"""The passage in which robots fail though they know where they are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from locplan._kernels.arrays import Floats
from locplan.costs import Path
from locplan.diagnosis._failures import TOGETHER
from locplan.diagnosis._weak_spots import gathered
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.robots import Robot
from locplan.simulation import Arrivals

SPARE = 0.3
"""Room beside a robot up to which a passage counts as narrow, on both sides together [m]."""
NEAR, REACH = 3.0, 3.0
"""Distance from where robots end within which the passage lies, and greatest distance of a wall
that bounds it [m]."""


class Passage(NamedTuple):
    """The place where most robots fail that fail with perfect localization, too."""

    x: float
    """World x of its narrowest point on the path [m]."""
    y: float
    """World y of it [m]."""
    width: float
    """Distance between its walls [m]; infinite if none are near."""
    robot_width: float
    """Width of the robot [m]."""
    n_drives: int
    """Number of closed-loop drives that fail near it, with perfect localization, too."""
    routes: tuple[str, ...]
    """Names of their routes."""

    @property
    def is_narrow(self) -> bool:
        """True if the robot has little room in it."""
        return self.width < self.robot_width + SPARE


def find_passage(
    grid: OccupancyGrid, robot: Robot, paths: Mapping[str, Path], arrivals: Mapping[str, Arrivals]
) -> Passage | None:
    """Find the place where most drives fail that fail with perfect localization, too.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    robot : Robot
        The robot.
    paths : mapping of str to Path
        The path of each route by its name.
    arrivals : mapping of str to Arrivals
        Closed-loop drives along each route.

    Returns
    -------
    Passage or None
        None if no drive fails with perfect localization.
    """
    ends = [
        (name, drive.end[:2])
        for name, drives in arrivals.items()
        for drive in drives.drives
        if drive.fault
    ]
    if not ends:
        return None
    middle, members = gathered(np.array([end for _, end in ends]), TOGETHER)[0]
    routes = tuple(dict.fromkeys(ends[n][0] for n in members))
    # A wall may be a cell thick.
    points = np.concatenate([paths[name].resampled(grid.resolution).xy for name in routes])
    near = np.linalg.norm(points - middle, axis=1) <= NEAR
    points = points[near] if near.any() else points
    widths = measure_width(grid, points)
    x, y = points[widths.argmin()].tolist()
    radius = robot.radius - robot.margin
    return Passage(x, y, float(widths.min()), 2 * radius, len(members), routes)


def measure_width(grid: OccupancyGrid, points: Floats) -> Floats:
    """Return the shortest distance between two walls on opposite sides of each point, (n,) [m].

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    points : (n, 2) array
        Positions in the world [m].
    """
    angles = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    steps = np.arange(0.0, REACH, grid.resolution / 4)
    away = steps[:, None] * np.stack([np.cos(angles), np.sin(angles)])[:, None]
    widths = []
    for x, y in points:
        rows, cols = (
            np.floor(at).astype(int) for at in grid.world_to_grid(x + away[0], y + away[1])
        )
        rows, cols = (
            np.clip(at, 0, size - 1) for at, size in zip((rows, cols), grid.shape, strict=True)
        )
        is_wall = grid.cells[rows, cols] == OCCUPIED
        distance = np.where(is_wall.any(axis=0), steps[is_wall.argmax(axis=0)], np.inf)
        widths.append((distance[:36] + distance[36:]).min())
    return np.array(widths)
