"""Scans matched with a whole map: shortlists, refinement, branch and bound."""

from __future__ import annotations

import heapq
import itertools
import math

import numpy as np

from support.oracles.beams import enters


def settle(loss, stands, refine, half_steps, step, half_turns, turn, pose):
    """A pose (x, y, heading) and its loss where no offset on a lattice about it has a lower one.

    `loss` and `stands` take a pose, `refine` gives one of lower loss next to it.
    """
    best = refine(pose)
    for _ in range(6):
        around = [
            (best[0] + i * step, best[1] + j * step, best[2] + k * turn)
            for k in range(-half_turns, half_turns + 1)
            for j in range(-half_steps, half_steps + 1)
            for i in range(-half_steps, half_steps + 1)
        ]
        around = [each for each in around if stands(each)]
        least = min(around, key=loss, default=best)
        if loss(least) >= loss(best):
            break
        best = refine(least)
    return best, loss(best)


def gap(code, other):
    """Distance of two codes on a circle of 256."""
    between = abs(int(code) - int(other))
    return min(between, 256 - between)


def shortlist(ranges, beams, scan, most, keep):
    """Scores and indices of the best pairs of a place and a turn, for codes (place, beam)."""
    places, turns = ranges.shape
    found = []
    for place in range(places):
        scores = [
            sum(
                min(gap(ranges[place, (b + turn) % turns], code), most)
                for b, code in zip(beams, scan, strict=True)
            )
            for turn in range(turns)
        ]
        for turn, score in enumerate(scores):
            if score < scores[turn - 1] and score <= scores[(turn + 1) % turns]:
                found.append((score, place * turns + turn))
    return sorted(found)[:keep]


def ranges_from(stops, resolution, poses, lidar):
    """Ranges of scans at poses (row, col, heading), cell by cell (n, beam) [m]."""
    result = np.full((len(poses), len(lidar.angles)), np.inf)
    for n, (row, col, heading) in enumerate(poses):
        x = lidar.forward * math.cos(heading) - lidar.left * math.sin(heading)
        y = lidar.forward * math.sin(heading) + lidar.left * math.cos(heading)
        at_row, at_col = row + y / resolution, col + x / resolution
        for b, angle in enumerate(lidar.angles):
            bearing = heading + lidar.yaw + angle
            hits = [
                (enters(at_row, at_col, math.sin(bearing), math.cos(bearing), *cell, 0.0), cell)
                for cell in np.argwhere(stops)
            ]
            near, cell = min(hits, key=lambda hit: hit[0])
            if lidar.min_range <= near * resolution <= lidar.max_range:
                drow, dcol = math.sin(bearing), math.cos(bearing)
                far_row = (cell[0] + (drow >= 0) - at_row) / drow
                far_col = (cell[1] + (dcol >= 0) - at_col) / dcol
                result[n, b] = resolution * (near + min(far_row, far_col)) / 2
    return result


def loss_at(losses, margin, ends, x, y, heading):
    """Sum of the losses [steps] of ends (2, k) at a pose, between cell centres, (H, W) losses."""
    total = 0.0
    rows, cols = losses.shape
    for ahead, left in ends.T:
        u = x + margin - 0.5 + math.cos(heading) * ahead - math.sin(heading) * left
        v = y + margin - 0.5 + math.sin(heading) * ahead + math.cos(heading) * left
        u, v = min(max(u, 0.0), cols - 1.01), min(max(v, 0.0), rows - 1.01)
        i, j = int(v), int(u)
        a, c = u - j, v - i
        below = losses[i, j] * (1 - a) + losses[i, j + 1] * a
        above = losses[i + 1, j] * (1 - a) + losses[i + 1, j + 1] * a
        total += below * (1 - c) + above * c
    return total


def apart(a, b):
    """Distance and turn between two poses."""
    turn = abs((a[2] - b[2] + math.pi) % (2 * math.pi) - math.pi)
    return math.hypot(a[0] - b[0], a[1] - b[1]), turn


def unlike(poses, order, distance, turn):
    """Indices, in order, of poses that are like none before that is kept."""
    kept = []
    for n in order:
        between = [apart(poses[n], poses[k]) for k in kept]
        if not any(d < distance and t < turn for d, t in between):
            kept.append(n)
    return kept


def refine(loss, fits, pose, steps, lever, rounds):
    """The pose that steps along the axes and turns lead to, each the first that lowers the loss."""
    pose, best = list(pose), loss(*pose)
    for step, _ in itertools.product(steps, range(rounds)):
        for axis in range(3) if step > 0 else ():
            for sign in (1, -1):
                tried = list(pose)
                tried[axis] += sign * (step if axis < 2 else step / lever)
                if (axis == 2 or fits(*tried[:2])) and loss(*tried) < best:
                    pose, best = tried, loss(*tried)
                    break
    return pose, best


def polish(loss, fits, pose, steps, lever, rounds):
    """The pose that steps in all 26 directions lead to, each of which is taken if it is lower."""
    pose, best = list(pose), loss(*pose)
    for step, _ in itertools.product(steps, range(rounds)):
        for turn, along, across in itertools.product((-1, 0, 1), repeat=3) if step > 0 else ():
            moves = across * step, along * step, turn * step / lever
            tried = [value + move for value, move in zip(pose, moves, strict=True)]
            if (turn, along, across) != (0, 0, 0) and fits(*tried[:2]) and loss(*tried) < best:
                pose, best = tried, loss(*tried)
    return pose, best


def best_pose(lower_bound, loss, fits, box, steps):
    """Pose of least loss of a lattice, by branch and bound, and its loss.

    The lattice has `steps` (of x, y and heading) in a box (3, 2); a box of poses is split in two
    along its longest edge in steps, unless `lower_bound(middle, half)` is above the best loss.
    """
    best, where, count = math.inf, None, itertools.count()
    sizes = [
        max(1, round((high - low) / step)) for (low, high), step in zip(box, steps, strict=True)
    ]
    waiting = [(0.0, next(count), [(0, size) for size in sizes])]
    while waiting:
        bound, _, part = heapq.heappop(waiting)
        if bound >= best:
            break
        if all(end - begin == 1 for begin, end in part):
            pose = [
                low + (begin + 0.5) * step
                for (low, _), step, (begin, _) in zip(box, steps, part, strict=True)
            ]
            if fits(*pose[:2]) and loss(*pose) < best:
                best, where = loss(*pose), pose
            continue
        widest = max(range(3), key=lambda axis: part[axis][1] - part[axis][0])
        begin, end = part[widest]
        for both in ((begin, (begin + end) // 2), ((begin + end) // 2, end)):
            half = [*part[:widest], both, *part[widest + 1 :]]
            middle = [
                low + (a + b) / 2 * step
                for (low, _), step, (a, b) in zip(box, steps, half, strict=True)
            ]
            width = [(b - a) / 2 * step for step, (a, b) in zip(steps, half, strict=True)]
            heapq.heappush(waiting, (max(bound, lower_bound(middle, width)), next(count), half))
    return where, best


def loss_tables(occupied, resolution, sigmas, z_rand, margin):
    """Losses at the centres of a cell and of its neighbours above, as bytes of a word."""
    cells = np.pad(occupied, 1)
    around = [np.roll(cells, step, (0, 1)) for step in itertools.product((-1, 0, 1), repeat=2)]
    walls = np.argwhere((cells & ~np.logical_and.reduce(around))[1:-1, 1:-1]) + margin
    height, width = (size + 2 * margin for size in occupied.shape)
    words = np.zeros((len(sigmas), height, width), np.uint32)
    for n, sigma in enumerate(sigmas):
        losses = np.full((height + 1, width + 1), 255)
        for row in range(height):
            for col in range(width):
                distance = resolution * math.sqrt(((walls - (row, col)) ** 2).sum(axis=1).min())
                likelihood = (1 - z_rand) * math.exp(-0.5 * (distance / sigma) ** 2) + z_rand
                losses[row, col] = round(255 * math.log(likelihood) / math.log(z_rand))
        for byte, (row, col) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
            part = losses[row : row + height, col : col + width].astype(np.uint32)
            words[n] |= part << np.uint32(8 * byte)
    return words
