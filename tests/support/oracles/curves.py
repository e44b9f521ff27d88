"""Costs of arcs and of smoothed paths, in tiny steps."""

from __future__ import annotations

import itertools
import math

import numpy as np


def motion_cost(density, turns, lengths, radius, start, step=1e-4):
    """Integral along the pieces of a curve from (x, y, heading) in tiny steps; inf if blocked."""
    x, y, heading = start
    total = 0.0
    for turn, length in zip(turns, lengths, strict=True):
        count = math.ceil(abs(length) / step)
        for _ in range(count):
            ds = length / count
            half_turn = turn * ds / radius / 2
            x_mid = x + ds / 2 * math.cos(heading + half_turn / 2)
            y_mid = y + ds / 2 * math.sin(heading + half_turn / 2)
            row, col = math.floor(y_mid), math.floor(x_mid)
            inside = 0 <= row < density.shape[0] and 0 <= col < density.shape[1]
            if not inside or math.isinf(density[row, col]):
                return math.inf
            total += density[row, col] * abs(ds)
            x += ds * math.cos(heading + half_turn)
            y += ds * math.sin(heading + half_turn)
            heading += 2 * half_turn
    return total


def arc_crossings(center_x, center_y, radius, low, high, count=200_000):
    """How often an arc crosses a border between cells, and about where, in tiny steps."""
    angles, cell = [], None
    for n in range(count):
        angle = low + (high - low) * (n + 0.5) / count
        here = (
            math.floor(center_y + radius * math.sin(angle)),
            math.floor(center_x + radius * math.cos(angle)),
        )
        if cell is not None and here != cell:
            angles += [angle] * (abs(here[0] - cell[0]) + abs(here[1] - cell[1]))
        cell = here
    return angles


def own_costs(density, drive, poses, step=1e-3):
    """Cost of each line between poses in tiny steps; infinite where it cannot be driven."""
    result, gear = [], 0
    for pose, after in itertools.pairwise(poses.tolist()):
        apart = after[0] - pose[0], after[1] - pose[1]
        length, turn = math.hypot(*apart), math.remainder(after[2] - pose[2], 2 * math.pi)
        if length < 1e-6:
            result.append(drive.turn * abs(turn) if drive.turn > 0 or turn == 0 else math.inf)
            continue
        way = math.atan2(apart[1], apart[0])
        aslant = math.remainder(way - pose[2] - turn / 2, 2 * math.pi)
        now = 1 if abs(aslant) < 0.05 else -1 if math.pi - abs(aslant) < 0.05 else 0
        tight = drive.turn == 0 and abs(turn) * drive.radius > length * 1.001
        if tight or (now < 0 and drive.kind == 1) or (now == 0 and not drive.sideways):
            result.append(math.inf)
            continue
        cost = motion_cost(density, [0.0], [length], 1.0, (pose[0], pose[1], way), step)
        cost *= 1.0 if now > 0 else drive.reverse
        result.append(cost + drive.gear_change * (gear * now < 0))
        gear = now or gear
    return np.array(result)


def curve_cost(density, drive, turns, lengths, start, step=1e-3):
    """Cost of a curve with its turns and lengths, piece by piece, in tiny steps."""
    total, gear = 0.0, 0.0
    (x, y, heading), radius = start, drive.radius
    for turn, length in zip(turns, lengths, strict=True):
        if length == 0:
            continue
        if turn and drive.turn > 0:
            total += drive.turn * abs(length) / radius
        else:
            cost = motion_cost(density, [turn], [length], radius, (x, y, heading), step)
            total += cost * (1.0 if length > 0 else drive.reverse)
            total += drive.gear_change * (gear * length < 0)
            gear = length
        for _ in range(1000):
            half = turn * length / radius / 2000
            x += length / 1000 * math.cos(heading + half)
            y += length / 1000 * math.sin(heading + half)
            heading += 2 * half
    return total


def straightest(count, cost_of, own, lookahead):
    """Least cost of a chain of curves (`cost_of` two knots) and own edges over knots in order."""
    best = [0.0]
    for j in range(1, count):
        ways = [best[j - 1] + own[j - 1]]
        ways += [best[i] + cost_of(i, j) for i in range(max(0, j - lookahead), j)]
        best.append(min(ways))
    return best[-1]


def shift_knots(knots, own, cost_of, steps):
    """Knots shifted in turn wherever both curves beside them cost less, and these costs."""
    knots, own = [tuple(knot) for knot in knots.tolist()], list(own)
    for _ in range(4):
        before = list(knots)
        for k in range(1, len(knots) - 1):
            x, y, heading = knots[k]
            for aside, turn in itertools.product((-1, 0, 1), repeat=2):
                here = (
                    x - aside * steps[0] * math.sin(heading),
                    y + aside * steps[0] * math.cos(heading),
                    heading + turn * steps[1],
                )
                costs = cost_of(knots[k - 1], here), cost_of(here, knots[k + 1])
                if sum(costs) < (own[k - 1] + own[k]) * (1 - 1e-7):
                    knots[k], (own[k - 1], own[k]) = here, costs
        if knots == before:
            break
    return np.array(knots), np.array(own)
