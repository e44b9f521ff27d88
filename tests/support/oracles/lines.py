"""Cells that a line crosses, and costs along it."""

from __future__ import annotations

import itertools
import math

import numpy as np


def cells_along(positions):
    """(row, col, length) of every cell crossed: cut at all lines, look at the middles."""
    result = []
    for (row0, col0), (row1, col1) in itertools.pairwise(positions):
        cuts = {0.0, 1.0}
        for a, b in ((row0, row1), (col0, col1)):
            if a != b:
                for line in range(math.floor(min(a, b)), math.ceil(max(a, b)) + 1):
                    cuts.add((line - a) / (b - a))
        cuts = sorted(t for t in cuts if 0 <= t <= 1)
        length = math.hypot(row1 - row0, col1 - col0)
        for low, high in itertools.pairwise(cuts):
            if (high - low) * length > 1e-9:
                middle = (low + high) / 2
                row = math.floor(row0 + middle * (row1 - row0))
                col = math.floor(col0 + middle * (col1 - col0))
                result.append((row, col, (high - low) * length))
    return result


def line_integral(density, row0, col0, row1, col1):
    """Sum of length times density over the cells of one line."""
    total = 0.0
    for row, col, length in cells_along([(row0, col0), (row1, col1)]):
        inside = 0 <= row < density.shape[0] and 0 <= col < density.shape[1]
        total += length * (density[row, col] if inside else math.inf)
    return total


def touches(row0, col0, row1, col1, row, col, margin=1e-5):
    """Whether a line comes into a cell's square, less a margin: clipped side by side."""
    enter, leave = 0.0, 1.0
    for start, delta, low in ((row0, row1 - row0, row), (col0, col1 - col0, col)):
        low, high = low + margin, low + 1 - margin
        if delta == 0:
            if not low < start < high:
                return False
            continue
        near, far = sorted(((low - start) / delta, (high - start) / delta))
        enter, leave = max(enter, near), min(leave, far)
    return enter < leave


def line_cost(density, resolution, origin, a, b):
    """Integral along a line between world positions [density x cells].

    Infinite where the line so much as touches a blocked cell, or one beyond the grid.
    """
    x, y, yaw = origin
    turn = complex(math.cos(yaw), -math.sin(yaw)) / resolution
    a, b = (turn * complex(at[0] - x, at[1] - y) for at in (a, b))
    line = a.imag, a.real, b.imag, b.real
    if not (0 <= a.imag < density.shape[0] and 0 <= a.real < density.shape[1]):
        return math.inf
    bordered = np.pad(density, 1, constant_values=math.inf)
    for row, col in np.argwhere(bordered == math.inf) - 1:
        if touches(*line, row, col, margin=-1e-9):
            return math.inf
    return line_integral(density, *line)


def line_costs(density, resolution, origin, xy, pairs):
    """The same for pairs of positions."""
    return [line_cost(density, resolution, origin, xy[i], xy[j]) for i, j in pairs]


def list_passed_cells(origin, end, margin):
    """Cells of a beam up to a margin before its end, as `cells_along` has them."""
    origin, end = np.asarray(origin), np.asarray(end)
    length = np.hypot(*(end - origin))
    kept = max(0.0, 1 - margin / length) if length else 0.0
    way = np.array([origin, origin + kept * (end - origin)])
    return [(row, col) for row, col, _ in cells_along(way)]


def count_scans(stops, origins, ends, margin):
    """Numbers of the scans that pass each cell, and that end in it, up to cells that stop beams."""
    passed, hit = np.zeros(stops.shape, int), np.zeros(stops.shape, int)
    for origin, scan in zip(origins, ends, strict=True):
        on_way, at_end = set(), set()
        for end in scan[~np.isnan(scan[:, 0])]:
            way = [each for each in list_passed_cells(origin, end, margin) if _on(stops, each)]
            stopped = [n for n, each in enumerate(way) if stops[each]]
            on_way |= {*way[: stopped[0] if stopped else None]}
            last = tuple(np.floor(end).astype(int).tolist())
            at_end |= {last} if not stopped and _on(stops, last) else set()
        for cell in on_way:
            passed[cell] += 1
        for cell in at_end:
            hit[cell] += 1
    return passed, hit


def _on(mask, cell):
    return 0 <= cell[0] < mask.shape[0] and 0 <= cell[1] < mask.shape[1]
