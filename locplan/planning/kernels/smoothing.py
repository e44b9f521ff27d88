"""Paths of curves of bounded curvature, straightened and shifted to reduce their cost.

Poses are as in `locplan.planning.kernels.motions`: (x, y, heading) on a bordered grid. Lines
between a path's poses stay allowed, so that the result never costs more.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Bools, Floats, Numbers
from locplan._support.kernels.outlines import CollisionMap, find_first_hit
from locplan._support.kernels.rays import compute_segment_cost
from locplan.planning.kernels import curves
from locplan.planning.kernels.motions import (
    MotionCostmap,
    compute_arc_cost,
    find_shortest_word,
    sample_motion_poses,
)

ASLANT = 0.05
"""Greatest angle between the heading and the way of a motion ahead or in reverse [rad]."""
STILL = 1e-6
"""Distance up to which a move is a turn on the spot [cells]."""


class MotionModel(NamedTuple):
    """The motions that a robot can make, and their costs in addition to the integral."""

    kind: int  # curves forward or also in reverse: DUBINS or REEDS_SHEPP
    radius: float  # turning radius [cells]; nearly 0 turns on the spot
    sideways: bool
    reverse: float  # factor on the cost in reverse and sideways
    gear_change: float  # [cells]
    turn: float  # of turning on the spot [cells/rad]; 0 for a car


@njit(nogil=True, cache=True, error_model="numpy")
def compute_step_costs(ground: MotionCostmap, drive: MotionModel, poses: Floats) -> Array:
    """Return the cost of each move along poses (n, 3), infinite if the robot cannot make it."""
    result, gear = np.empty(len(poses) - 1), 0
    for n in range(len(poses) - 1):
        x, y = poses[n + 1, 0] - poses[n, 0], poses[n + 1, 1] - poses[n, 1]
        turn = poses[n + 1, 2] - poses[n, 2]
        turn -= curves.TURN * round(turn / curves.TURN)
        length = math.hypot(x, y)
        if length <= STILL:
            result[n] = drive.turn * abs(turn) if drive.turn > 0 or abs(turn) < STILL else np.inf
            continue
        heading = poses[n, 2] + turn / 2
        ahead = (x * math.cos(heading) + y * math.sin(heading)) / length
        now = 0 if abs(ahead) < math.cos(ASLANT) else 1 if ahead > 0 else -1
        result[n] = np.inf
        backward = now < 0 and drive.kind == curves.DUBINS
        tight = drive.turn == 0 and abs(turn) * drive.radius > length * (1 + 1e-3) + STILL
        if backward or tight or (now == 0 and not drive.sideways):
            continue
        layer = _get_half_density(ground, heading)
        ends = poses[n, 1], poses[n, 0], poses[n + 1, 1], poses[n + 1, 0]
        # The path itself is taken as it is, also where it cuts a corner.
        cost = compute_segment_cost(layer, ground.columns, *ends, True)
        result[n] = cost * (1.0 if now > 0 else drive.reverse)
        if now != 0:
            result[n] += drive.gear_change * (gear * now < 0)
            gear = now
    return result


@njit(nogil=True, cache=True)
def _get_half_density(ground: MotionCostmap, heading: float) -> Array:
    """Return half the density for a heading."""
    layers = len(ground.half)
    layer_position = (heading - ground.first) / curves.TURN * layers
    return ground.half[math.floor(layer_position + 0.5) % layers]


@njit(nogil=True, cache=True, error_model="numpy")
def compute_curve_cost(
    ground: MotionCostmap, drive: MotionModel, start: Numbers, end: Numbers
) -> float:
    """Return the cost of the shortest curve between poses; infinite if it is blocked."""
    turns, lengths = find_shortest_word(drive.kind, drive.radius, start, end)
    x, y, heading = start
    total, gear = 0.0, 0.0
    for n in range(curves.PIECES):
        length = lengths[n]
        if length == 0.0:
            continue
        x1, y1, heading1 = curves.advance_pose(x, y, heading, turns[n], length, drive.radius)
        if turns[n] != 0 and drive.turn > 0:
            total += drive.turn * abs(length) / drive.radius
        else:
            if turns[n] != 0:
                cost = compute_arc_cost(ground, (x, y, heading, turns[n], length), drive.radius)
            else:
                layer = _get_half_density(ground, heading)
                cost = compute_segment_cost(layer, ground.columns, y, x, y1, x1, False)
            total += cost * (1.0 if length > 0 else drive.reverse)
            total += drive.gear_change * (gear * length < 0)
            gear = length
        if total == np.inf:
            break
        x, y, heading = x1, y1, heading1
    return total


@njit(nogil=True, cache=True)
def is_curve_clear(drive: MotionModel, body: CollisionMap, start: Numbers, end: Numbers) -> bool:
    """Return True if the outline meets no occupied cell along the shortest curve between poses."""
    if len(body.outline) == 0:
        return True
    poses = sample_motion_poses(drive.kind, drive.radius, start, end)
    for pose in poses:
        pose[0] -= 1
        pose[1] -= 1
    return find_first_hit(body.sums, body.outline, poses) < 0


@njit(nogil=True, cache=True, error_model="numpy")
def find_cheapest_chain(
    ground: MotionCostmap,
    drive: MotionModel,
    body: CollisionMap,
    knots: Floats,
    step_costs: Floats,
    lookahead: int,
) -> Array:
    """Return each knot's predecessor i on the cheapest chain: -1 off it, -2 - i by a path line.

    A knot is reached from one of the `lookahead` before it along the shortest curve, or from the
    one just before it by the path lines at cost `step_costs`. The first entry is -1; the last
    is -1 if there is no chain.
    """
    count = len(knots)
    best, before = np.full(count, np.inf), np.full(count, -1)
    best[0] = 0.0
    cheapest = 1.0
    for j in range(1, count):
        best[j], before[j] = best[j - 1] + step_costs[j - 1], -2 - (j - 1)
        end = knots[j, 0], knots[j, 1], knots[j, 2]
        for i in range(max(0, j - lookahead), j):
            start = knots[i, 0], knots[i, 1], knots[i, 2]
            distance = math.hypot(end[0] - start[0], end[1] - start[1])
            if best[i] + cheapest * distance >= best[j]:
                continue
            total = best[i] + compute_curve_cost(ground, drive, start, end)
            if total < best[j] * (1 - 1e-9) and is_curve_clear(drive, body, start, end):
                best[j], before[j] = total, i
    chain = np.full(count, -1)
    if best[count - 1] == np.inf:
        return chain
    j = count - 1
    while j > 0:
        chain[j] = before[j]
        j = before[j] if before[j] >= 0 else -2 - before[j]
    return chain


@njit(nogil=True, cache=True, error_model="numpy")
def shift_knots(
    ground: MotionCostmap,
    drive: MotionModel,
    body: CollisionMap,
    knots: Floats,
    step_costs: Floats,
    curved: Bools,
    steps: tuple[float, float],
) -> None:
    """Shift inner knots sideways by a step [cells] and turn them by another [rad] while it pays.

    `step_costs` holds the cost of the edge after each knot, `curved` if it is the shortest curve
    by now; both are kept up to date.
    """
    for _ in range(4):
        still = True
        for k in range(1, len(knots) - 1):
            before = knots[k - 1, 0], knots[k - 1, 1], knots[k - 1, 2]
            after = knots[k + 1, 0], knots[k + 1, 1], knots[k + 1, 2]
            x, y, heading = knots[k, 0], knots[k, 1], knots[k, 2]
            for choice in range(9):
                shift, turn = (choice // 3 - 1) * steps[0], (choice % 3 - 1) * steps[1]
                candidate = (
                    x - shift * math.sin(heading),
                    y + shift * math.cos(heading),
                    heading + turn,
                )
                first = compute_curve_cost(ground, drive, before, candidate)
                if not first < step_costs[k - 1] + step_costs[k]:
                    continue
                last = compute_curve_cost(ground, drive, candidate, after)
                if not first + last < (step_costs[k - 1] + step_costs[k]) * (1 - 1e-7):
                    continue
                if is_curve_clear(drive, body, before, candidate) and is_curve_clear(
                    drive, body, candidate, after
                ):
                    step_costs[k - 1], step_costs[k], still = first, last, False
                    curved[k - 1] = curved[k] = True
                    knots[k, 0], knots[k, 1], knots[k, 2] = candidate
        if still:
            break
