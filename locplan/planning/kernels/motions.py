"""Exact integrals of a density along motions between poses: straight lines and curves.

A pose is (x, y, heading) on a bordered grid as in `locplan._support.kernels.search`: column, row
[cells] and the angle from the columns' direction towards the rows' [rad]. If the density depends
on the heading, it has a layer for each of several headings, evenly spaced from `first` on.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Floats, Ints, Numbers
from locplan._support.kernels.outlines import CollisionMap, find_first_hit
from locplan._support.kernels.rays import TOUCH, compute_segment_cost
from locplan.planning.kernels import curves
from locplan.planning.kernels.curves import QUARTER, STRAIGHT, TURN


class MotionCostmap(NamedTuple):
    """What a motion is integrated over."""

    half: Floats  # (layers, n) half the density on a flat grid with a blocked border
    columns: int  # of the bordered grid
    first: float  # the heading of the first layer [rad]
    corner_cutting: bool  # whether corners of blocked cells may be touched


@njit(nogil=True, cache=True)
def compute_motion_cost(
    ground: MotionCostmap, kind: int, radius: float, start: Numbers, end: Numbers
) -> float:
    """Return the integral of a density along a motion [density x cells]; infinite if it is blocked.

    Parameters
    ----------
    ground : Ground
        The density.
    kind : int
        Kind of motion: STRAIGHT, DUBINS or REEDS_SHEPP.
    radius : float
        Least turning radius [cells].
    start, end : (x, y, heading)
        Poses at both ends; the start must lie on the grid.
    """
    if kind == STRAIGHT:
        return _compute_line_cost(ground, start, end)
    half, columns, first, corner_cutting = ground
    turns, lengths = find_shortest_word(kind, radius, start, end)
    x, y, heading = start
    total = 0.0
    for n in range(curves.PIECES):
        if lengths[n] == 0.0:
            continue
        x1, y1, heading1 = curves.advance_pose(x, y, heading, turns[n], lengths[n], radius)
        if turns[n]:
            piece = x, y, heading, turns[n], lengths[n]
            total += compute_arc_cost(ground, piece, radius)
        else:
            layer = half[_find_layer(heading - first, len(half))]
            total += compute_segment_cost(layer, columns, y, x, y1, x1, corner_cutting)
        if total == np.inf:
            break
        x, y, heading = x1, y1, heading1
    return total


@njit(nogil=True, cache=True)
def sample_motion_poses(kind: int, radius: float, start: Numbers, end: Numbers) -> Array:
    """Return poses (n, 3) along a motion, so dense in turns that straight lines can join them.

    There is a pose at each border between cells that a turn crosses, so that the lines cross the
    same cells as the curve.
    """
    first, last = np.array(start).reshape(1, 3), np.array(end).reshape(1, 3)
    if kind == STRAIGHT:
        return np.concatenate((first, last))
    turns, lengths = find_shortest_word(kind, radius, start, end)
    x, y, heading = start
    poses = first
    for n in range(curves.PIECES):
        if lengths[n] == 0.0:
            continue
        x1, y1, heading1 = curves.advance_pose(x, y, heading, turns[n], lengths[n], radius)
        inner = np.empty((1, 3))
        if turns[n]:
            center_x, center_y, low, high = curves.compute_arc(
                x, y, heading, turns[n], lengths[n], radius
            )
            angles = curves.find_arc_crossings(center_x, center_y, radius, low, high)
            angles = curves.refine_angles(angles, 0.02)  # the path's length is then exact to 2e-5
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
def find_shortest_word(
    kind: int, radius: float, start: Numbers, end: Numbers
) -> tuple[Array, Array]:
    """Return the shortest curve: turns (5,) and signed lengths (5,) [cells]."""
    x, y = (end[0] - start[0]) / radius, (end[1] - start[1]) / radius
    if kind == curves.DUBINS:
        turns, lengths = curves.find_dubins_curve(0.0, 0.0, start[2], x, y, end[2])
    else:
        turns, lengths = curves.find_reeds_shepp_curve(0.0, 0.0, start[2], x, y, end[2])
    return turns, lengths * radius


@njit(nogil=True, cache=True)
def _compute_line_cost(ground: MotionCostmap, start: Numbers, end: Numbers) -> float:
    """Return the cost of a straight line with an evenly turning heading, the shorter way round."""
    half, columns, first, corner_cutting = ground
    layers = len(half)
    if layers == 1:
        return compute_segment_cost(
            half[0], columns, start[1], start[0], end[1], end[0], corner_cutting
        )
    heading = start[2] - first
    turn = end[2] - start[2]
    turn -= TURN * round(turn / TURN)
    shares = np.sort(np.append(_find_layer_changes(heading, turn, layers), np.array([0.0, 1.0])))
    dx, dy = end[0] - start[0], end[1] - start[1]
    total = 0.0
    for n in range(len(shares) - 1):
        layer = half[_find_layer(heading + turn * (shares[n] + shares[n + 1]) / 2, layers)]
        x0, y0 = start[0] + shares[n] * dx, start[1] + shares[n] * dy
        x1, y1 = start[0] + shares[n + 1] * dx, start[1] + shares[n + 1] * dy
        total += compute_segment_cost(layer, columns, y0, x0, y1, x1, corner_cutting)
        if total == np.inf:
            break
    return total


@njit(nogil=True, cache=True)
def compute_arc_cost(ground: MotionCostmap, piece: Numbers, radius: float) -> float:
    """Return the cost of one turn (x, y, heading, side, length)."""
    half, columns, first, corner_cutting = ground
    x, y, heading, turn, length = piece
    layers, extent = len(half), half.shape[1] // columns + columns
    if 2 * radius * math.sin(min(abs(length) / radius, math.pi) / 2) > extent:
        return np.inf  # it leaves the map
    center_x, center_y, low, high = curves.compute_arc(x, y, heading, turn, length, radius)
    angles = curves.find_arc_crossings(center_x, center_y, radius, low, high)
    towards = turn * QUARTER - first  # added to an angle on the circle it gives the heading there
    if layers > 1:
        shares = _find_layer_changes(low + towards, high - low, layers)
        angles = np.sort(np.append(angles, low + shares * (high - low)))
    begin, end, way = (0, len(angles) - 1, 1) if turn * length > 0 else (len(angles) - 1, 0, -1)
    total, before_row, before_col = 0.0, -1, -1
    # Go in the direction of travel: cells beyond the border must not be read.
    for n in range(begin, end, way):
        inside = abs(angles[n + way] - angles[n]) * radius
        if inside <= TOUCH:
            continue
        middle = (angles[n] + angles[n + way]) / 2
        row = math.floor(center_y + radius * math.sin(middle))
        col = math.floor(center_x + radius * math.cos(middle))
        layer = half[_find_layer(middle + towards, layers)]
        at_corner = before_row >= 0 and row != before_row and col != before_col
        flanks = before_row * columns + col, row * columns + before_col
        if at_corner and not corner_cutting and layer[flanks[0]] + layer[flanks[1]] == np.inf:
            return np.inf
        total += 2 * layer[row * columns + col] * inside
        if total == np.inf:
            break
        before_row, before_col = row, col
    return total


@njit(nogil=True, cache=True)
def _find_layer(heading: float, layers: int) -> int:
    """Return the layer nearest to `heading`, counted from the first layer's heading."""
    return math.floor(heading / TURN * layers + 0.5) % layers if layers > 1 else 0


@njit(nogil=True, cache=True)
def _find_layer_changes(heading: float, turn: float, layers: int) -> Array:
    """Return the shares of a turn from a heading at which another layer begins."""
    begin, end = heading / TURN * layers + 0.5, (heading + turn) / TURN * layers + 0.5
    low, high = math.ceil(min(begin, end)), math.floor(max(begin, end))
    if begin == end or high < low:
        return np.empty(0)
    return (np.arange(low, high + 1) - begin) / (end - begin)


@njit(nogil=True, cache=True)
def compute_world_cost(
    half_density: Floats,
    columns: int,
    kind: int,
    radius: float,
    frame: Numbers,
    body: CollisionMap,
    start: Numbers,
    end: Numbers,
    blocked_cost: float,
) -> float:
    """Return the cost of a motion between world poses [m], >= their distance, or `blocked_cost`.

    `frame` holds the cosine and the sine of the grid's yaw, both per cell [1/m], the column and
    the row of the world's origin, and the yaw; the radius is in cells. A motion is blocked if the
    outline of `body` meets an occupied cell on it; a circle has no outline.
    """
    (x0, y0, heading0), (x1, y1, heading1) = start, end
    if not (
        can_stand(half_density, columns, frame, x0, y0)
        and can_stand(half_density, columns, frame, x1, y1)
    ):
        return blocked_cost
    if not math.isfinite(heading0 + heading1):
        return blocked_cost
    ends = _grid_from_world(frame, x0, y0, heading0), _grid_from_world(frame, x1, y1, heading1)
    cost = compute_motion_cost(
        MotionCostmap(half_density, columns, -frame[4], False), kind, radius, *ends
    )
    cost /= math.hypot(frame[0], frame[1])
    if cost < np.inf and len(body.outline):
        poses = sample_motion_poses(kind, radius, *ends)
        for pose in poses:  # on the grid without its border
            pose[0] -= 1.0
            pose[1] -= 1.0
        if find_first_hit(body.sums, body.outline, poses) >= 0:
            return blocked_cost
    # Even after rounding no motion costs less than its length.
    return max(cost, (1 + 1e-14) * math.hypot(x1 - x0, y1 - y0)) if cost < np.inf else blocked_cost


@njit(nogil=True, cache=True)
def compute_world_costs(
    half_density: Floats,
    columns: int,
    kind: int,
    radius: float,
    frame: Numbers,
    body: CollisionMap,
    poses: Floats,
    pairs: Ints,
) -> Array:
    """Return the costs of motions between pairs (m, 2) of poses (n, 3) in the world [m]."""
    result = np.empty(len(pairs))
    for n, (i, j) in enumerate(pairs):
        start = poses[i, 0], poses[i, 1], poses[i, 2]
        end = poses[j, 0], poses[j, 1], poses[j, 2]
        result[n] = compute_world_cost(
            half_density, columns, kind, radius, frame, body, start, end, np.inf
        )
    return result


@njit(nogil=True, cache=True)
def sample_world_motion(
    kind: int, radius: float, frame: Numbers, start: Numbers, end: Numbers
) -> Array:
    """Return poses (n, 3) in the world along the motion that `compute_world_cost` measures."""
    along, across, col0, row0, yaw = frame
    (x0, y0, heading0), (x1, y1, heading1) = start, end
    ends = _grid_from_world(frame, x0, y0, heading0), _grid_from_world(frame, x1, y1, heading1)
    poses = sample_motion_poses(kind, radius, *ends)
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
def _grid_from_world(
    frame: Numbers, x: float, y: float, heading: float
) -> tuple[float, float, float]:
    along, across, col0, row0, yaw = frame
    heading -= yaw
    heading -= TURN * round(heading / TURN)
    return along * x + across * y + col0, along * y - across * x + row0, heading


@njit(nogil=True, cache=True)
def can_stand(half_density: Floats, columns: int, frame: Numbers, x: float, y: float) -> bool:
    """True if a position in the world [m] lies in a cell that is not blocked."""
    x, y, _ = _grid_from_world(frame, x, y, 0.0)
    col, row = math.floor(x), math.floor(y)
    inside = 0 < col < columns - 1 and 0 < row < half_density.shape[1] // columns - 1
    return inside and half_density[0, int(row) * columns + int(col)] < np.inf
