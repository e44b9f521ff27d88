"""Exact integrals of a density along motions between poses: straight lines and curves.

A pose is (x, y, heading) on a bordered grid as in `locplan._kernels.search`: column, row [cells]
and the angle from the columns' direction towards the rows' [rad].
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.curves import DUBINS, PIECES, QUARTER, STRAIGHT, TURN, dubins, reeds_shepp
from locplan._kernels.rays import TOUCH, segment_cost

FINEST = 0.02
"""Greatest turn between two positions of a path [rad]: its length is true to 2e-5."""


@njit(nogil=True, cache=True)
def motion_cost(
    half: NDArray[np.float64],
    columns: int,
    kind: int,
    radius: float,
    start: tuple,
    end: tuple,
    corner_cutting: bool,
) -> float:
    """Integral of a density along a motion [density x cells]; infinite if it is blocked.

    Parameters
    ----------
    half : (n,) array
        Half the density on a flat grid with a blocked border.
    columns : int
        Of the bordered grid.
    kind : int
        STRAIGHT, DUBINS or REEDS_SHEPP.
    radius : float
        Least turning radius [cells].
    start, end : (x, y, heading)
        The start must lie on the grid.
    corner_cutting : bool
        Whether corners of blocked cells may be touched.
    """
    if kind == STRAIGHT:
        return segment_cost(half, columns, start[1], start[0], end[1], end[0], corner_cutting)
    turns, lengths = _word(kind, radius, start, end)
    x, y, heading = start
    total = 0.0
    for n in range(PIECES):
        if lengths[n] == 0.0:
            continue
        x1, y1, heading1 = moved(x, y, heading, turns[n], lengths[n], radius)
        if turns[n]:
            total += _arc_cost(
                half, columns, x, y, heading, turns[n], lengths[n], radius, corner_cutting
            )
        else:
            total += segment_cost(half, columns, y, x, y1, x1, corner_cutting)
        if total == np.inf:
            break
        x, y, heading = x1, y1, heading1
    return total


@njit(nogil=True, cache=True)
def motion_poses(kind: int, radius: float, start: tuple, end: tuple) -> NDArray:
    """Poses (n, 3) along a motion, n >= 2, so dense in turns that lines between them will do.

    Wherever a turn crosses a border between cells there is one: the lines cross the same cells as
    the curve.
    """
    first, last = np.array(start).reshape(1, 3), np.array(end).reshape(1, 3)
    if kind == STRAIGHT:
        return np.concatenate((first, last))
    turns, lengths = _word(kind, radius, start, end)
    x, y, heading = start
    poses = first
    for n in range(PIECES):
        if lengths[n] == 0.0:
            continue
        x1, y1, heading1 = moved(x, y, heading, turns[n], lengths[n], radius)
        inner = np.empty((1, 3))
        if turns[n]:
            center_x, center_y, low, high = _arc(x, y, heading, turns[n], lengths[n], radius)
            angles = arc_crossings(center_x, center_y, radius, low, high)
            angles = _closer(angles, FINEST)
            if turns[n] * lengths[n] < 0:
                angles = angles[::-1]
            inner = np.empty((max(1, len(angles) - 1), 3))
            for k, angle in enumerate(angles[1:]):
                inner[k, 0] = center_x + radius * math.cos(angle)
                inner[k, 1] = center_y + radius * math.sin(angle)
                inner[k, 2] = angle + turns[n] * QUARTER
        inner[-1] = x1, y1, heading1
        poses = np.concatenate((poses, inner))
        x, y, heading = x1, y1, heading1
    poses[-1] = last[0]
    return poses


@njit(nogil=True, cache=True)
def moved(
    x: float, y: float, heading: float, turn: int, length: float, radius: float
) -> tuple[float, float, float]:
    """The pose at the end of one piece of a curve."""
    if turn == 0:
        return x + length * math.cos(heading), y + length * math.sin(heading), heading
    heading1 = heading + turn * length / radius
    x1 = x + turn * radius * (math.sin(heading1) - math.sin(heading))
    y1 = y - turn * radius * (math.cos(heading1) - math.cos(heading))
    return x1, y1, heading1


@njit(nogil=True, cache=True)
def arc_crossings(
    center_x: float, center_y: float, radius: float, low: float, high: float
) -> NDArray:
    """Angles, ascending, at which an arc begins, crosses a border between cells, and ends.

    Seen from its centre [rad]; some are doubled.
    """
    angles = np.empty(int(2 * (high - low) * radius) + 32)
    angles[0], count, at = low, 1, low
    while at < high:
        # Within a quadrant of the circle either coordinate only grows or only falls.
        quadrant = math.floor(at / QUARTER + 1e-12)
        until = min((quadrant + 1) * QUARTER, high)
        middle = (at + until) / 2
        x_way = -1 if math.sin(middle) > 0 else 1
        y_way = 1 if math.cos(middle) > 0 else -1
        x_line = _next_line(center_x + radius * math.cos(at), x_way)
        y_line = _next_line(center_y + radius * math.sin(at), y_way)
        x_at = _angle_at((x_line - center_x) / radius, middle, False)
        y_at = _angle_at((y_line - center_y) / radius, middle, True)
        while min(x_at, y_at) < until:
            if x_at < y_at:
                angles[count] = max(at, x_at)
                x_line += x_way
                x_at = _angle_at((x_line - center_x) / radius, middle, False)
            else:
                angles[count] = max(at, y_at)
                y_line += y_way
                y_at = _angle_at((y_line - center_y) / radius, middle, True)
            count += 1
        angles[count] = at = until
        count += 1
    return angles[:count]


@njit(nogil=True, cache=True)
def _word(kind: int, radius: float, start: tuple, end: tuple) -> tuple[NDArray, NDArray]:
    """The shortest curve: turns (5,) and signed lengths (5,) [cells]."""
    x, y = (end[0] - start[0]) / radius, (end[1] - start[1]) / radius
    if kind == DUBINS:
        turns, lengths = dubins(0.0, 0.0, start[2], x, y, end[2])
    else:
        turns, lengths = reeds_shepp(0.0, 0.0, start[2], x, y, end[2])
    return turns, lengths * radius


@njit(nogil=True, cache=True)
def _arc(
    x: float, y: float, heading: float, turn: int, length: float, radius: float
) -> tuple[float, float, float, float]:
    """Centre of a turn, and the least and greatest angle of its arc seen from there."""
    begin, sweep = heading - turn * QUARTER, turn * length / radius
    center_x, center_y = x - radius * math.cos(begin), y - radius * math.sin(begin)
    return center_x, center_y, min(begin, begin + sweep), max(begin, begin + sweep)


@njit(nogil=True, cache=True)
def _arc_cost(
    half: NDArray[np.float64],
    columns: int,
    x: float,
    y: float,
    heading: float,
    turn: int,
    length: float,
    radius: float,
    corner_cutting: bool,
) -> float:
    center_x, center_y, low, high = _arc(x, y, heading, turn, length, radius)
    angles = arc_crossings(center_x, center_y, radius, low, high)
    first, last, way = (0, len(angles) - 1, 1) if turn * length > 0 else (len(angles) - 1, 0, -1)
    total, before_row, before_col = 0.0, -1, -1
    # In the direction of travel: what lies beyond the border must not be looked at.
    for n in range(first, last, way):
        inside = abs(angles[n + way] - angles[n]) * radius
        if inside <= TOUCH:
            continue
        middle = (angles[n] + angles[n + way]) / 2
        row = math.floor(center_y + radius * math.sin(middle))
        col = math.floor(center_x + radius * math.cos(middle))
        at_corner = before_row >= 0 and row != before_row and col != before_col
        beside = before_row * columns + col, row * columns + before_col
        if at_corner and not corner_cutting and half[beside[0]] + half[beside[1]] == np.inf:
            return np.inf
        total += 2 * half[row * columns + col] * inside
        if total == np.inf:
            break
        before_row, before_col = row, col
    return total


@njit(nogil=True, cache=True)
def _closer(angles: NDArray, most: float) -> NDArray:
    """The same angles with more between them where they are further apart than `most`."""
    count = 1
    for n in range(len(angles) - 1):
        count += max(1, math.ceil((angles[n + 1] - angles[n]) / most))
    result = np.empty(count)
    result[0], at = angles[0], 1
    for n in range(len(angles) - 1):
        parts = max(1, math.ceil((angles[n + 1] - angles[n]) / most))
        for part in range(parts):
            share = (part + 1) / parts
            result[at] = angles[n] + share * (angles[n + 1] - angles[n])
            at += 1
    return result


@njit(nogil=True, cache=True)
def _next_line(position: float, way: int) -> float:
    """The next border between cells along one axis."""
    return math.floor(position) + 1.0 if way > 0 else math.ceil(position) - 1.0


@njit(nogil=True, cache=True)
def _angle_at(ratio: float, near: float, of_sine: bool) -> float:
    """Where on a circle the sine (or cosine) has a value, in the quadrant of an angle, or later."""
    if abs(ratio) >= 1:
        return np.inf
    if of_sine:
        angle = math.asin(ratio) if math.cos(near) > 0 else math.pi - math.asin(ratio)
    else:
        angle = math.acos(ratio) if math.sin(near) > 0 else -math.acos(ratio)
    return angle + TURN * round((near - angle) / TURN)


@njit(nogil=True, cache=True)
def world_cost(
    half: NDArray[np.float64],
    columns: int,
    kind: int,
    radius: float,
    frame: tuple,
    x0: float,
    y0: float,
    heading0: float,
    x1: float,
    y1: float,
    heading1: float,
    blocked: float,
) -> float:
    """The same between two poses in the world [m], at least their distance, or `blocked`.

    `frame` holds the cosine and the sine of the grid's yaw, both per cell [1/m], the column and
    the row of the world's origin, and the yaw; the radius is in cells.
    """
    if not stands(half, columns, frame, x0, y0):
        return blocked
    start, end = _on_grid(frame, x0, y0, heading0), _on_grid(frame, x1, y1, heading1)
    cost = motion_cost(half, columns, kind, radius, start, end, False)
    cost /= math.hypot(frame[0], frame[1])
    return max(cost, math.hypot(x1 - x0, y1 - y0)) if cost < np.inf else blocked


@njit(nogil=True, cache=True)
def world_costs(
    half: NDArray[np.float64],
    columns: int,
    kind: int,
    radius: float,
    frame: tuple,
    poses: NDArray[np.float64],
    pairs: NDArray[np.int64],
) -> NDArray:
    """Of motions between pairs (m, 2) of poses (n, 3) in the world; infinite if blocked [m]."""
    result = np.empty(len(pairs))
    for n, (i, j) in enumerate(pairs):
        (x0, y0, heading0), (x1, y1, heading1) = poses[i], poses[j]
        result[n] = world_cost(
            half, columns, kind, radius, frame, x0, y0, heading0, x1, y1, heading1, np.inf
        )
    return result


@njit(nogil=True, cache=True)
def world_poses(
    kind: int,
    radius: float,
    frame: tuple,
    x0: float,
    y0: float,
    heading0: float,
    x1: float,
    y1: float,
    heading1: float,
) -> NDArray:
    """Poses (n, 3) in the world along the very motion whose cost `world_cost` is."""
    along, across, col0, row0, yaw = frame
    start, end = _on_grid(frame, x0, y0, heading0), _on_grid(frame, x1, y1, heading1)
    poses = motion_poses(kind, radius, start, end)
    per_metre = along**2 + across**2
    for pose in poses:
        col, row = pose[0] - col0, pose[1] - row0
        pose[0] = (along * col - across * row) / per_metre
        pose[1] = (across * col + along * row) / per_metre
        pose[2] += yaw
    poses[0, 0], poses[0, 1], poses[0, 2] = x0, y0, heading0
    poses[-1, 0], poses[-1, 1], poses[-1, 2] = x1, y1, heading1
    return poses


@njit(nogil=True, cache=True)
def _on_grid(frame: tuple, x: float, y: float, heading: float) -> tuple[float, float, float]:
    along, across, col0, row0, yaw = frame
    return along * x + across * y + col0, along * y - across * x + row0, heading - yaw


@njit(nogil=True, cache=True)
def stands(half: NDArray[np.float64], columns: int, frame: tuple, x: float, y: float) -> bool:
    """Whether a position in the world [m] lies in a cell that is not blocked."""
    x, y, _ = _on_grid(frame, x, y, 0.0)
    col, row = math.floor(x), math.floor(y)
    inside = 0 < col < columns - 1 and 0 < row < half.size // columns - 1
    return inside and half[int(row) * columns + int(col)] < np.inf
