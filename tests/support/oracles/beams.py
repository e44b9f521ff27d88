"""Ranges of rays, and the information of a simulated scan."""

from __future__ import annotations

import itertools
import math

import numpy as np


def enters(row, col, drow, dcol, cell_row, cell_col, margin):
    """Where a ray enters a cell's square, less a margin on each side; inf if it misses it."""
    enter, leave = 0.0, math.inf
    for start, delta, low in ((row, drow, cell_row), (col, dcol, cell_col)):
        low, high = low + margin, low + 1 - margin
        if delta == 0:
            if not low <= start <= high:
                return math.inf
            continue
        near, far = sorted(((low - start) / delta, (high - start) / delta))
        enter, leave = max(enter, near), min(leave, far)
    return enter if enter <= leave else math.inf


def cast(stops, row, col, drow, dcol, max_range, margin=0.0):
    """Range of a ray: the least entry into any cell that stops it, within the map's own square.

    With a negative margin cells that are only touched stop the ray, with a positive one not.
    """
    best = math.inf
    for cell_row, cell_col in np.argwhere(stops):
        best = min(best, enters(row, col, drow, dcol, cell_row, cell_col, margin))
    return best if best <= max_range else math.inf


def empty_squares(stops):
    """Grow a square from each cell until it holds a stop or leaves the map."""
    rows, cols = stops.shape
    result = np.zeros((4, rows + 2, cols + 2), np.uint8)
    for quadrant in range(4):
        for row in range(rows):
            for col in range(cols):
                for edge in range(1, 256):
                    top = row if quadrant & 2 else row - edge + 1
                    left = col if quadrant & 1 else col - edge + 1
                    inside = 0 <= top <= rows - edge and 0 <= left <= cols - edge
                    if not inside or stops[top : top + edge, left : left + edge].any():
                        break
                    result[quadrant, row + 1, col + 1] = edge
    return result


def information(
    stops, normals, resolution, row, col, heading, lidar, of_ranges, least_cosine=0.15, step=1e-5
):
    """Central differences of what the beams tell of the tangents of the surfaces that they hit.

    That is the range to the tangent, or how far the beam's end, as it was measured, departs from
    it when the robot moves.
    """
    total = np.zeros((3, 3))

    def turned(x, y, theta):
        return np.array(
            [math.cos(theta) * x - math.sin(theta) * y, math.sin(theta) * x + math.cos(theta) * y]
        )

    def origin(x, y, theta):
        return np.array([x, y]) + turned(lidar.forward, lidar.left, theta)

    pose = np.array([col * resolution, row * resolution, heading])
    for angle in lidar.angles:

        def direction(theta, angle=angle):
            return turned(1.0, 0.0, theta + lidar.yaw + angle)

        start, along = origin(*pose), direction(heading)
        first, best = None, lidar.max_range / resolution
        for cell in np.argwhere(stops):
            at = enters(
                start[1] / resolution, start[0] / resolution, along[1], along[0], *cell, 0.0
            )
            if at < best:
                first, best = cell, at
        if first is None or best == 0 or best * resolution < lidar.min_range:
            continue
        normal = np.array(normals[tuple(first)][::-1], float)
        if not normal.any():
            continue
        hit = start + best * resolution * along
        on_robot = turned(*(hit - pose[:2]), -heading)

        def told(moved, normal=normal, hit=hit, direction=direction, on_robot=on_robot):
            if of_ranges:
                return (normal @ (hit - origin(*moved))) / (normal @ direction(moved[2]))
            return normal @ (moved[:2] + turned(*on_robot, moved[2]) - hit)

        gradient = np.array(
            [
                (told(pose + step * axis) - told(pose - step * axis)) / (2 * step)
                for axis in np.eye(3)
            ]
        )
        if of_ranges:
            cosine = abs(normal @ along)
            gradient *= cosine / max(cosine, least_cosine)
        total += np.outer(gradient, gradient)
    return total


def radical_inverse(number):
    """The number's binary digits, mirrored at the point: van der Corput's sequence."""
    digits = reversed(f"{number:b}")
    return sum(int(digit) / 2**place for place, digit in zip(itertools.count(1), digits))


def moved_ends(cells, resolution, row, col, heading, sensor, angles, noise):
    """Ends of a simulated scan's beams, x and y from the robot [cells].

    Each is moved along its beam by ``noise[b][0]`` [m] and ``noise[b][1]`` of its range.
    """
    lever_x = (math.cos(heading) * sensor.mount_x - math.sin(heading) * sensor.mount_y) / resolution
    lever_y = (math.sin(heading) * sensor.mount_x + math.cos(heading) * sensor.mount_y) / resolution
    ends = []
    for angle, (shift, growth) in zip(angles, noise, strict=True):
        bearing = heading + sensor.mount_yaw + angle
        start, reach = (row + lever_y, col + lever_x), sensor.range / resolution
        at = middle_of_hit(cells, *start, bearing, reach, least=sensor.min_range / resolution)
        at += shift / resolution + growth * at
        ends.append((lever_x + at * math.cos(bearing), lever_y + at * math.sin(bearing)))
    return np.array(ends)


def middle_of_hit(cells, row, col, bearing, reach, least=0.0):
    """Distance to the middle of a ray's way through the first occupied cell [cells], or NaN.

    A cell that is entered at less than `least` or beyond `reach` gives no return.
    """
    drow, dcol = math.sin(bearing), math.cos(bearing)
    hits = [
        (enters(row, col, drow, dcol, i, j, 0.0), i, j) for i, j in np.argwhere(cells == 0).tolist()
    ]
    entry, i, j = min(hits, default=(math.inf, 0, 0))
    if entry == 0 or not least <= entry <= reach:  # at 0 the lidar itself is within a wall
        return math.nan
    leave = min((i + (drow >= 0) - row) / drow, (j + (dcol >= 0) - col) / dcol)
    return (entry + leave) / 2
