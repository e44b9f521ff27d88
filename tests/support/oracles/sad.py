"""Similarity of map windows (SAD), offset by offset."""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np


def level_at(cells, row, col):
    if 0 <= row < cells.shape[0] and 0 <= col < cells.shape[1]:
        return int(cells[row, col])
    return 127


def similarities(template, levels):
    """Eq. 1-7, cell by cell."""
    pairs = [(int(t), int(m)) for t, m in zip(template.flat, levels.flat, strict=True)]
    mean_t = sum(t for t, _ in pairs) / len(pairs)
    mean_m = sum(m for _, m in pairs) / len(pairs)
    ssd = sad = cc = zcc = tt = mm = zt = zm = 0.0
    for t, m in pairs:
        ssd += (t - m) ** 2
        sad += abs(t - m)
        cc += t * m
        tt += t * t
        mm += m * m
        zcc += (t - mean_t) * (m - mean_m)
        zt += (t - mean_t) ** 2
        zm += (m - mean_m) ** 2

    def ratio(value, square):
        return value / math.sqrt(square) if square > 0 else math.nan

    return {
        "SSD": ssd,
        "SAD": sad,
        "NSSD": ratio(ssd, tt * mm),
        "NCC": ratio(cc, tt * mm),
        "ZNCC": ratio(zcc, zt * zm),
        "ZCC": zcc,
        "CC": cc,
    }


def mismatch_counts(cells, row, col, radius, step, half_steps, angles):
    """S / 127 for every offset, (dx, theta, dy)."""
    centre_row, centre_col = (cells.shape[0] - 1) / 2, (cells.shape[1] - 1) / 2
    offsets = range(-half_steps, half_steps + 1)
    result = np.zeros((len(offsets), len(angles), len(offsets)), np.int64)
    for k, theta in enumerate(angles):
        cos, sin = math.cos(theta), math.sin(theta)
        y, x = row - centre_row, col - centre_col
        turned_row = math.floor(sin * x + cos * y + centre_row + 0.5)
        turned_col = math.floor(cos * x - sin * y + centre_col + 0.5)
        for u in range(-radius, radius + 1):
            for v in range(-radius, radius + 1):
                if u * u + v * v > radius * radius:
                    continue
                y, x = turned_row + u - centre_row, turned_col + v - centre_col
                template = level_at(
                    cells,
                    math.floor(cos * y - sin * x + centre_row + 0.5),
                    math.floor(sin * y + cos * x + centre_col + 0.5),
                )
                for j, dy in enumerate(offsets):
                    for i, dx in enumerate(offsets):
                        level = level_at(cells, row + dy * step + u, col + dx * step + v)
                        result[i, k, j] += abs(template - level) // 127
    return result


def keep_lines(cells, row, col, radius, step, half_steps, angles, sizes, limit, shift):
    """Lines (theta, dx) with an offset in y whose bound by blocks is at most limit << shift.

    That must hold for blocks of each size; `sizes` are lists of (row, col, edge) in the disc's box.
    """
    centre_row, centre_col = (cells.shape[0] - 1) / 2, (cells.shape[1] - 1) / 2
    offsets, box = range(-half_steps, half_steps + 1), range(-radius, radius + 1)
    reach = range(-radius - half_steps * step, radius + half_steps * step + 1)
    around = np.array([[level_at(cells, row + u, col + v) for v in reach] for u in reach])

    @functools.cache
    def there(low, near, edge, level):
        return np.count_nonzero(around[low : low + edge, near : near + edge] == level)

    result = np.zeros((len(angles), len(offsets)), bool)
    for k, theta in enumerate(angles):
        cos, sin = math.cos(theta), math.sin(theta)
        y, x = row - centre_row, col - centre_col
        top = math.floor(sin * x + cos * y + centre_row + 0.5) - centre_row
        left = math.floor(cos * x - sin * y + centre_col + 0.5) - centre_col
        template = np.array(
            [
                [
                    level_at(
                        cells,
                        math.floor(cos * (top + u) - sin * (left + v) + centre_row + 0.5),
                        math.floor(sin * (top + u) + cos * (left + v) + centre_col + 0.5),
                    )
                    for v in box
                ]
                for u in box
            ]
        )
        lines = np.ones(len(offsets), bool)
        for blocks in sizes:
            bounds = np.zeros((len(offsets), len(offsets)), np.int64)
            for (first_row, first_col, edge), level in itertools.product(blocks, (254, 0)):
                part = template[first_row : first_row + edge, first_col : first_col + edge]
                here = np.count_nonzero(part == level)
                for i, j in itertools.product(range(len(offsets)), repeat=2):
                    behind = there(first_row + j * step, first_col + i * step, edge, level)
                    bounds[i, j] += abs(here - behind) >> shift
            lines &= bounds.min(axis=1) <= limit
        result[k] = lines
    return result


def block_counts(plane, edge, row, col):
    """Cells set in the square block that begins there; 0 if it ends beyond the plane."""
    if row + edge > plane.shape[1] or col + edge > plane.shape[0]:
        return 0
    return sum(int(plane[col + i, row + j]) for i in range(edge) for j in range(edge))


def cut_strips(cells, cos, sin, first_row, first_col, rows, cols):
    """Bytes of eight cells along a row of the turned map, (plane, col, row)."""
    centre_row, centre_col = (cells.shape[0] - 1) / 2, (cells.shape[1] - 1) / 2
    result = np.zeros((2, cols, rows), np.uint8)
    for i in range(cols):
        for j in range(rows):
            for bit in range(8):
                if i + bit >= cols:
                    continue
                y, x = first_row + j - centre_row, first_col + i + bit - centre_col
                level = level_at(
                    cells,
                    math.floor(cos * y - sin * x + centre_row + 0.5),
                    math.floor(sin * y + cos * x + centre_col + 0.5),
                )
                result[0, i, j] |= (level == 254) << bit
                result[1, i, j] |= (level == 0) << bit
    return result


def visible_part(cells, row, col, radius, theta, beams, behind):
    """Cells of the disc seen from a cell, turned by theta, (2r + 1, 2r + 1)."""
    reach = []
    for b in range(beams):
        angle = 2 * math.pi * b / beams
        first = 2 * radius
        for step in range(1, 2 * radius + 1):
            i = row + math.floor(math.sin(angle) * step / 2 + 0.5)
            j = col + math.floor(math.cos(angle) * step / 2 + 0.5)
            if (i, j) != (row, col) and level_at(cells, i, j) != 254:
                first = step
                break
        reach.append((first + 1) / 2 + behind)
    result = np.zeros((2 * radius + 1, 2 * radius + 1), bool)
    for u in range(-radius, radius + 1):
        for v in range(-radius, radius + 1):
            beam = math.floor((math.atan2(u, v) - theta) * beams / (2 * math.pi) + 0.5) % beams
            distance = math.hypot(u, v)
            result[u + radius, v + radius] = distance <= min(radius, reach[beam])
    return result


def weighted_covariance(counts, weight_of_count, kept, places):
    """Covariance of (dx, dy, theta) in steps about the weighted mean, of the lines kept."""
    half, half_angles = (len(places) - 1) // 2, (counts.shape[1] - 1) // 2
    poses, weights = [], []
    for i, x in enumerate(places):
        for k in range(counts.shape[1]):
            sides = {math.floor(x): 1 - x % 1, math.ceil(x): x % 1 or 1.0}
            for j, y in enumerate(places) if all(kept[k, side] for side in sides) else ():
                ends = {math.floor(y): 1 - y % 1, math.ceil(y): y % 1 or 1.0}
                terms = (p * q * counts[a, k, b] for a, p in sides.items() for b, q in ends.items())
                poses.append((i - half, j - half, k - half_angles))
                weights.append(weight_of_count[math.floor(sum(terms) + 0.5)])
    poses, weights = np.array(poses, float), np.array(weights) / math.fsum(weights)
    mean = np.array([math.fsum(weights * axis) for axis in poses.T])
    result = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            result[a, b] = math.fsum(weights * (poses[:, a] - mean[a]) * (poses[:, b] - mean[b]))
    return result


def disc_sums(plane, radius, unit, rows, cols):
    """Cells set within the disc around every `unit` cells of one plane, (col, row)."""
    result = np.zeros((cols, rows), np.int64)
    for q in range(cols):
        for p in range(rows):
            for du in range(-radius, radius + 1):
                for dv in range(-radius, radius + 1):
                    if du * du + dv * dv <= radius * radius:
                        result[q, p] += plane[radius + q * unit + du, radius + p * unit + dv]
    return result
