"""Circular arcs over the cells of a grid.

Positions are (x, y): column and row in cells; headings turn from the columns' direction towards
the rows' [rad]. A turn goes to one side, 1 (left) or -1 (right), over a length that is negative in
reverse [cells].
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.curves import QUARTER, TURN


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
) -> NDArray[Any]:
    """Angles, ascending, at which an arc begins, crosses a border between cells, and ends.

    The angles are seen from its centre [rad]; some occur twice.
    """
    angles = np.empty(int(2 * (high - low) * radius) + 32)
    angles[0], count, at = low, 1, low
    quadrant = math.floor(low / QUARTER + 1e-12)
    while at < high:
        # Within a quadrant of the circle each coordinate only grows or only falls.
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
        quadrant += 1
    return angles[:count]


@njit(nogil=True, cache=True)
def arc(
    x: float, y: float, heading: float, turn: int, length: float, radius: float
) -> tuple[float, float, float, float]:
    """Centre of a turn, and the least and greatest angle of its arc seen from there."""
    begin, sweep = heading - turn * QUARTER, turn * length / radius
    center_x, center_y = x - radius * math.cos(begin), y - radius * math.sin(begin)
    return center_x, center_y, min(begin, begin + sweep), max(begin, begin + sweep)


@njit(nogil=True, cache=True)
def closer(angles: NDArray[Any], most: float) -> NDArray[Any]:
    """Angles with further ones inserted where neighbours are more than `most` apart."""
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
    """Angle at which the sine (or cosine) equals `ratio`, in the quadrant of `near` or later."""
    if abs(ratio) >= 1:
        return np.inf
    if of_sine:
        angle = math.asin(ratio) if math.cos(near) > 0 else math.pi - math.asin(ratio)
    else:
        angle = math.acos(ratio) if math.sin(near) > 0 else -math.acos(ratio)
    return angle + TURN * round((near - angle) / TURN)
