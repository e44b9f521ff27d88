"""The arc that regulated pure pursuit takes along a path, and whether it leads into a wall.

The names in brackets are the parameters of nav2_regulated_pure_pursuit_controller (RPP).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Floats, Ints
from locplan._support.kernels.particles import wrap_angle
from locplan.simulation.kernels.bodies import DriveWorld, RobotBody, measure_margin

TICK = 0.1
"""Time between two commands [s]."""
LOOKAHEAD = 0.6
"""Distance to the point that is pursued [m] (lookahead_dist)."""
SPOT = np.pi / 4
"""Angle to it above which a robot turns on the spot [rad] (rotate_to_heading_min_angle)."""
MAX_TURN = 1.0
"""Maximum turning rate [rad/s]."""
TIGHT, NEAR, APPROACH = 0.9, 0.6, 0.6
"""Radius of an arc, distance from walls and distance from the goal below which the robot slows down
[m] (regulated_linear_scaling_min_radius, cost_scaling_dist, approach_velocity_scaling_dist)."""
MIN_SPEED, MIN_APPROACH = 0.25, 0.05
"""Minimum speed in tight arcs and near walls, and near the goal [m/s]."""
LOOK = 10
"""Ticks of the arc that are checked (max_allowed_time_to_collision_up_to_carrot)."""
MARGIN = 0.035
"""Distance from walls that an arc keeps [m]: the padding of a footprint, 0.01, and half a cell of
the local costmap, since a cell in which a scan ends is a wall throughout."""
REACH = 30
"""Points of the path among which RPP looks for the nearest one: 1.5 m, half of Nav2's local
costmap."""
SIGHT = 50
"""Points of the path ahead on which walls are seen."""
TICKS, AT, BLOCKED, PLAN_TICK, FAILED, RECOVERY, SINCE, STANDSTILLS = range(8)
"""Places in `Trace.counts`."""


class DriveTrace(NamedTuple):
    """A drive until now."""

    truth: Floats  # (ticks, 3) true poses
    believed: Floats  # (ticks, 3) the filter's poses
    reported: Floats  # (ticks, 3) odometry, from 0, 0, 0
    command: Floats  # (3,) the last command: ahead, to the left [m/s], and turn [rad/s]
    biases: Floats  # (3,) factor on distances, bend [rad / m], and factor on turns
    counts: Ints  # (8,)


@njit(nogil=True, cache=True)
def is_arc_clear(
    surroundings: DriveWorld, body: RobotBody, max_distance: float, trace: DriveTrace
) -> bool:
    """True if a second of the command, at most so far [m], keeps off the walls.

    A robot that is too close to a wall may move if it comes no nearer.
    """
    ahead, left, turn = trace.command
    x, y, heading = first = trace.truth[trace.counts[TICKS]]
    margin = measure_margin(surroundings, body, x, y, heading, MARGIN)
    for _ in range(LOOK):
        middle = heading + turn * TICK / 2
        cos, sin = np.cos(middle) * TICK, np.sin(middle) * TICK
        x, y = x + cos * ahead - sin * left, y + sin * ahead + cos * left
        heading += turn * TICK
        if np.hypot(x - first[0], y - first[1]) > max_distance:
            return True
        if measure_margin(surroundings, body, x, y, heading, margin) < margin - 1e-9:
            return False
    return True


@njit(nogil=True, cache=True)
def advance_to_nearest(path: Floats, x: float, y: float, counts: Ints) -> float:
    """Return the distance from the path up to its next change of gear [m]; advance the count."""
    first, nearest, distance = counts[AT], counts[AT], np.inf
    for k in range(first, min(first + REACH, len(path))):
        if path[k, 2] != path[first, 2]:
            break
        point_distance = np.hypot(path[k, 0] - x, path[k, 1] - y)
        if point_distance < distance:
            nearest, distance = k, point_distance
    if nearest + 1 < len(path) and path[nearest + 1, 2] != path[nearest, 2]:
        nearest += 1
    counts[AT] = nearest
    return float(distance)


@njit(nogil=True, cache=True)
def find_carrot(path: Floats, x: float, y: float, nearest: int) -> int:
    """Return the index of the point to pursue, before the next change of gear."""
    carrot, last = nearest, len(path) - 1
    while (
        carrot < last
        and np.hypot(path[carrot, 0] - x, path[carrot, 1] - y) < LOOKAHEAD
        and path[carrot + 1, 2] == path[nearest, 2]
    ):
        carrot += 1
    return int(carrot)


@njit(nogil=True, cache=True)
def regulate_speed(
    speed: float, curvature: float, wall_distance: float, goal_distance: float
) -> float:
    """Return the speed on an arc at a distance from walls and from the goal [m]."""
    slow = speed * min(1.0, wall_distance / NEAR)
    if abs(curvature) * TIGHT > 1:
        slow = min(slow, speed / (abs(curvature) * TIGHT))
    speed = min(speed, max(slow, MIN_SPEED))
    return min(speed, max(speed * min(1.0, goal_distance / APPROACH), MIN_APPROACH))


@njit(nogil=True, cache=True)
def write_pursuit_command(
    path: Floats, body: RobotBody, wall_distance: float, trace: DriveTrace
) -> float:
    """Write the command that leads to the point ahead on the path; return its distance [m]."""
    x, y, heading = trace.believed[trace.counts[TICKS]]
    carrot, last = find_carrot(path, x, y, trace.counts[AT]), len(path) - 1
    gear = path[carrot, 2]
    heading += np.pi * (gear < 0)
    dx, dy = path[carrot, 0] - x, path[carrot, 1] - y
    carrot_distance = np.hypot(dx, dy)
    bearing = wrap_angle(np.arctan2(dy, dx) - heading)
    curvature = 2 * np.sin(min(max(bearing, -np.pi / 2), np.pi / 2)) / max(carrot_distance, 0.1)
    if body.omnidirectional:
        curvature = 0.0
    if body.radius > 0:
        curvature = min(max(curvature, -1 / body.radius), 1 / body.radius)
    left = np.hypot(path[last, 0] - x, path[last, 1] - y) if carrot == last else np.inf
    speed, command = regulate_speed(body.speed, curvature, wall_distance, left), trace.command
    if body.omnidirectional:
        command[0], command[1] = speed * np.cos(bearing), speed * np.sin(bearing)
        command[2] = min(max(bearing, -MAX_TURN), MAX_TURN)
    elif body.radius == 0 and abs(bearing) > SPOT:
        command[2] = np.sign(bearing) * min(MAX_TURN, 2 * abs(bearing))
    else:
        command[0] = gear * speed
        command[2] = min(max(speed * curvature, -MAX_TURN), MAX_TURN)
    return float(carrot_distance)


@njit(nogil=True, cache=True)
def is_path_ahead_clear(
    path: Floats, surroundings: DriveWorld, body: RobotBody, trace: DriveTrace
) -> bool:
    """True if the path ahead keeps the margin of an arc from the walls that the robot sees.

    The robot places these walls relative to the filter's pose.
    """
    n, first = trace.counts[TICKS], trace.counts[AT]
    x, y, heading = trace.truth[n]
    turn = heading - trace.believed[n, 2]
    cos, sin = np.cos(turn), np.sin(turn)
    for k in range(first, min(first + SIGHT, len(path) - 1)):
        dx, dy = path[k, 0] - trace.believed[n, 0], path[k, 1] - trace.believed[n, 1]
        along = np.arctan2(path[k + 1, 1] - path[k, 1], path[k + 1, 0] - path[k, 0]) + turn
        along += np.pi * (path[k + 1, 2] < 0)
        at = x + cos * dx - sin * dy, y + sin * dx + cos * dy
        if measure_margin(surroundings, body, at[0], at[1], along, MARGIN) < MARGIN - 1e-9:
            return False
    return True
