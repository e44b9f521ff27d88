"""Information of objects that a lidar sees, and covariances along routes."""

from __future__ import annotations

import itertools
import math

import numpy as np

from support.oracles.beams import enters


def within_object(outline, heading, x, y):
    """Whether a point from the object's centre lies within it."""
    if outline.is_round:
        return math.hypot(x, y) <= outline.half_length
    along = math.cos(heading) * x + math.sin(heading) * y
    across = math.cos(heading) * y - math.sin(heading) * x
    return abs(along) <= outline.half_length and abs(across) <= outline.half_width


def entry(outline, heading, x, y, dx, dy, reach, step=1e-3):
    """Range at which a ray from (x, y) enters an object at the origin, by small steps, or inf."""
    if within_object(outline, heading, x, y):
        return math.inf
    away, size = math.hypot(x, y), math.hypot(outline.half_length, outline.half_width)
    first, last = int((away - size) / step), int((away + size) / step) + 1
    for n in range(max(first, 1), min(last, int(reach / step)) + 1):  # it is nowhere else
        if within_object(outline, heading, x + n * step * dx, y + n * step * dy):
            low, high = (n - 1) * step, n * step
            for _ in range(40):
                middle = (low + high) / 2
                if within_object(outline, heading, x + middle * dx, y + middle * dy):
                    high = middle
                else:
                    low = middle
            return high
    return math.inf


def normal_at(outline, heading, x, y):
    """Unit normal of an object's surface at a point of it."""
    if outline.is_round:
        return x / math.hypot(x, y), y / math.hypot(x, y)
    along = math.cos(heading) * x + math.sin(heading) * y
    across = math.cos(heading) * y - math.sin(heading) * x
    to_end, to_side = outline.half_length - abs(along), outline.half_width - abs(across)
    turn = heading if to_end < to_side else heading + math.pi / 2
    return math.cos(turn), math.sin(turn)


def landmark_information(stops, normals, resolution, rays, n, outline, objects):
    """Sum of g g^T over the rays of a pose on a map with objects (x, y, heading), (3, 3)."""
    total = np.zeros((3, 3))
    x, y = rays.poses[n] + rays.levers[n]
    for b in range(rays.beams):
        bearing = rays.first[n] + b * rays.step
        dx, dy = math.cos(bearing), math.sin(bearing)
        best, normal = math.inf, None
        for cell in np.argwhere(stops):
            at = resolution * enters(y / resolution, x / resolution, dy, dx, *cell, 0.0)
            if at < best:
                best, normal = at, normals[tuple(cell)][::-1]
        for ox, oy, heading in objects:
            at = entry(outline, heading, x - ox, y - oy, dx, dy, rays.max_range + 1)
            if at < best:
                best = at
                normal = normal_at(outline, heading, x + at * dx - ox, y + at * dy - oy)
        if rays.min_range <= best <= rays.max_range:
            hx, hy = rays.levers[n] + best * np.array([dx, dy])
            gradient = np.array([normal[0], normal[1], hx * normal[1] - hy * normal[0]])
            total += np.outer(gradient, gradient) / (1 + rays.swing * best**2)
    return total


def covariances(information, poses, routes, motion):
    """Covariances (n, 3, 3) after each look around, along routes, by matrices as they are."""
    result = []
    for begin, end in itertools.pairwise(routes):
        p = np.diag([motion.start, motion.start, motion.start_turn])
        for n in range(begin, end):
            if n > begin:
                dx, dy = poses[n] - poses[n - 1]
                way = math.hypot(dx, dy)
                turned = np.array([[dx, -dy, 0], [dy, dx, 0], [0, 0, way]]) / way
                q = turned @ np.diag([motion.along, motion.across, motion.turn]) @ turned.T
                f = np.array([[1, 0, -dy], [0, 1, dx], [0, 0, 1]])
                p = f @ p @ f.T + q * way
            p = np.linalg.inv(np.linalg.inv(p) + information[n])
            result.append(p)
    return np.array(result)


def rotated(covariances, yaw):
    """Covariances (..., d, d) of poses whose axes are turned counter-clockwise by `yaw` [rad]."""
    turn = np.eye(covariances.shape[-1])
    turn[0, :2] = math.cos(yaw), -math.sin(yaw)
    turn[1, :2] = math.sin(yaw), math.cos(yaw)
    return np.einsum("ij,...jk,lk->...il", turn, covariances, turn)
