"""How far a robot's outline is from the walls of the world that it is driven in.

Poses are (x, y, heading) in metres along the columns and rows of that world.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Floats, Octets


class RobotBody(NamedTuple):
    """A robot's outline and motion."""

    discs: Floats  # (n, 3) centre ahead and to the left of the robot's own, and radius [m]
    omnidirectional: bool
    speed: float  # [m/s]
    tolerance: float  # distance from the goal at which the robot believes to be there [m]
    radius: float  # turning radius; 0 where it turns on the spot [m]
    retreat: float  # speed of backing off [m/s]


class DriveWorld(NamedTuple):
    """The true world of a drive."""

    squares: Octets  # (4, H + 2, W + 2) as `rays.compute_empty_squares` gives them
    resolution: float  # edge of a cell [m]


@njit(nogil=True, cache=True)
def measure_wall_distance(squares: Octets, row: float, col: float, max_distance: float) -> float:
    """Distance to the nearest wall's edge, up to `max_distance` [cells]; below 0 off the map."""
    i, j = int(np.floor(row)), int(np.floor(col))
    rows, cols = squares.shape[1] - 2, squares.shape[2] - 2
    if not (0 <= i < rows and 0 <= j < cols):
        return -np.inf
    edge = np.int64(squares[0, i + 1, j + 1])
    for quadrant in range(1, 4):
        edge = min(edge, np.int64(squares[quadrant, i + 1, j + 1]))
    if edge - 1 >= max_distance:
        return max_distance
    min_square = max_distance * max_distance
    for r in range(max(0, int(row - max_distance)), min(rows, int(row + max_distance) + 1)):
        up = max(r - row, row - r - 1, 0.0)
        for c in range(max(0, int(col - max_distance)), min(cols, int(col + max_distance) + 1)):
            if squares[0, r + 1, c + 1] == 0:
                across = max(c - col, col - c - 1, 0.0)
                min_square = min(min_square, up * up + across * across)
    return np.sqrt(min_square)


@njit(nogil=True, cache=True)
def measure_margin(
    surroundings: DriveWorld, body: RobotBody, x: float, y: float, heading: float, max_margin: float
) -> float:
    """Distance of an outline from the walls, up to `max_margin` [m]; below 0 it is in one."""
    cos, sin, cell = np.cos(heading), np.sin(heading), surroundings.resolution
    margin = max_margin
    for n in range(len(body.discs)):
        ahead, left, radius = body.discs[n]
        row, col = (y + sin * ahead + cos * left) / cell, (x + cos * ahead - sin * left) / cell
        reach = max(radius + margin, 0.0) / cell
        margin = min(
            margin, measure_wall_distance(surroundings.squares, row, col, reach) * cell - radius
        )
    return margin
