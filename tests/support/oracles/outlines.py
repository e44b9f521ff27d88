"""Cells that a moving outline touches."""

from __future__ import annotations

import itertools
import math

import numpy as np


def polygon_meets(polygon, row, col):
    """Whether a convex polygon (n, 2) of (col, row) meets a cell, by separating axes."""
    square = np.array([(col, row), (col + 1, row), (col + 1, row + 1), (col, row + 1)], float)
    axes = [np.array([1.0, 0.0]), np.array([0.0, 1.0])]
    for a, b in itertools.combinations(polygon, 2):  # the edges are among the chords
        axes.append(np.array([b[1] - a[1], a[0] - b[0]]))
    for axis in axes:
        length = math.hypot(*axis)
        if length < 1e-9:
            continue
        shadow, other = polygon @ axis / length, square @ axis / length
        if shadow.min() >= other.max() - 1e-9 or shadow.max() <= other.min() + 1e-9:
            return False
    return True


def swept_parts(outline, poses):
    """The corners of the outlines at both ends of each part of at most 2 degrees, by moves."""
    for n, (pose, after) in enumerate(itertools.pairwise(poses)):
        turn = math.remainder(after[2] - pose[2], 2 * math.pi)
        parts = max(1, math.ceil(abs(turn) / math.radians(2) - 1e-9))
        for part in range(parts):
            corners = []
            for share in (part / parts, (part + 1) / parts):
                heading = pose[2] + turn * share
                cos, sin = math.cos(heading), math.sin(heading)
                for x, y in outline / math.cos(turn / parts / 2):
                    along = pose[:2] + share * (after[:2] - pose[:2])
                    corners.append((along[0] + cos * x - sin * y, along[1] + sin * x + cos * y))
            yield n, np.array(corners)


def find_first_hit(occupied, outline, poses):
    """Index of the first move between poses that meets an occupied cell, or -1."""
    cells = np.argwhere(occupied)
    for n, corners in swept_parts(outline, poses):
        if any(polygon_meets(corners, row, col) for row, col in cells):
            return n
    return -1


def swept(outline, poses, reach):
    """Cells that an outline sweeps, around cell (0, 0)."""
    size = range(-reach, reach + 1)
    met = np.zeros((len(size), len(size)), bool)
    for _, corners in swept_parts(outline, poses):
        for row, col in itertools.product(size, repeat=2):
            met[row + reach, col + reach] |= polygon_meets(corners, row, col)
    return met
