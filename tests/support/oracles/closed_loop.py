"""A robot that follows a path, tick by tick."""

from __future__ import annotations

import math

import numpy as np

from support.oracles.particles import wrapped


def margin_at(walls, resolution, shape, discs, pose):
    """Distance of an outline from the edges of walls, cells of (row, col) [m]."""
    x, y, heading = pose
    margins = []
    for ahead, left, radius in discs:
        row = (y + math.sin(heading) * ahead + math.cos(heading) * left) / resolution
        col = (x + math.cos(heading) * ahead - math.sin(heading) * left) / resolution
        if not (0 <= row < shape[0] and 0 <= col < shape[1]):
            return -math.inf
        gaps = (
            math.hypot(max(i - row, row - i - 1, 0), max(j - col, col - j - 1, 0)) for i, j in walls
        )
        margins.append(resolution * min(gaps) - radius)
    return min(margins)


def follow(random, path, stops, resolution, robot, discs, first, ticks):
    """True poses of a robot that knows them, tick by tick; `path` holds x, y and the gear there."""
    walls = np.argwhere(stops).tolist()

    def margin(pose):
        return margin_at(walls, resolution, stops.shape, discs, pose)

    odometry, speed = robot.odometry, robot.kinematics.speed
    sideways = robot.kinematics.drive == "omnidirectional"
    radius = robot.kinematics.turning_radius
    scale = 1 + odometry.distance_bias * random.standard_normal()
    bend = math.radians(odometry.heading_bias_deg) * random.standard_normal()
    turn_scale = 1 + odometry.turn_bias * random.standard_normal()
    truth, nearest = [tuple(first)], 0

    def after(pose, way, aside, turn):
        middle = pose[2] + turn / 2 + aside
        return (
            pose[0] + way * math.cos(middle),
            pose[1] + way * math.sin(middle),
            pose[2] + turn,
        )

    def is_clear(ahead, left, turn, reach):
        enough, pose = min(0.035, margin(truth[-1])) - 1e-9, truth[-1]
        for _ in range(10):
            pose = after(pose, math.hypot(ahead, left) / 10, math.atan2(left, ahead), turn / 10)
            if math.dist(pose[:2], truth[-1][:2]) > reach:
                break
            if margin(pose) < enough:
                return False
        return True

    def is_there():
        at_end = nearest + 30 >= len(path) - 1
        return at_end and math.dist(truth[-1][:2], path[-1]) <= robot.goal_tolerance

    def within(value, limit):
        return min(max(value, -limit), limit)

    gears = [gear for _, _, gear in path]
    path = [each[:2] for each in path]
    while not is_there() and len(truth) < ticks:
        x, y, heading = truth[-1]
        ends = [k for k in range(nearest, len(path)) if gears[k] != gears[nearest]]
        close = range(nearest, min([nearest + 30, len(path), *ends]))
        nearest = min(close, key=lambda k: math.dist(path[k], (x, y)))
        if nearest + 1 < len(path) and gears[nearest + 1] != gears[nearest]:
            nearest += 1
        gear, carrot = gears[nearest], nearest
        while (
            carrot < len(path) - 1
            and math.dist(path[carrot], (x, y)) < 0.6
            and gears[carrot + 1] == gear
        ):
            carrot += 1
        dx, dy = path[carrot][0] - x, path[carrot][1] - y
        away = math.hypot(dx, dy)
        aside = wrapped(math.atan2(dy, dx) - heading - (math.pi if gear < 0 else 0.0))
        curvature = 2 * math.sin(within(aside, math.pi / 2)) / max(away, 0.1)
        if sideways:
            curvature = 0.0
        if radius:
            curvature = within(curvature, 1 / radius)
        from_walls = margin_at(walls, resolution, stops.shape, [(0.0, 0.0, 0.0)], truth[-1])
        slow = min(speed, speed * from_walls / 0.6, speed / max(abs(curvature) * 0.9, 1e-9))
        pace = min(speed, max(slow, 0.25))
        if carrot == len(path) - 1:
            pace = min(pace, max(pace * away / 0.6, 0.05))
        if sideways:
            command = pace * math.cos(aside), pace * math.sin(aside), within(aside, 1)
        elif not radius and abs(aside) > math.pi / 4:
            command = 0.0, 0.0, math.copysign(min(1.0, 2 * abs(aside)), aside)
        else:
            command = gear * pace, 0.0, within(pace * curvature, 1.0)
        clear = is_clear(*command, away)
        assert clear, "standstills are not in here"
        ahead, left, turn = (each / 10 for each in command)
        way, aside = math.hypot(ahead, left), math.atan2(left, ahead)
        drift = odometry.distance_drift * math.sqrt(way) * random.standard_normal()
        noise = random.standard_normal() * math.hypot(
            math.radians(odometry.heading_drift_deg) * math.sqrt(way),
            math.radians(odometry.turn_drift_deg) * math.sqrt(abs(turn)),
        )
        true_turn = (turn - bend * way - noise) / turn_scale
        new = after(truth[-1], max(0.0, (way - drift) / scale), aside, true_turn)
        margins = [margin(each) for each in (truth[-1], new)]
        truth.append(truth[-1] if margins[1] < min(0.0, margins[0]) else new)
    return np.array(truth)
