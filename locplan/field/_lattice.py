"""The lattice of cells that a field is evaluated on, and interpolation between them.

Lattice point ``(i, j)`` is the centre of cell ``(i * stride, j * stride)``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray


def stride_cells(stride: float, resolution: float) -> int:
    """Spacing in metres rounded to whole cells, at least one."""
    return max(1, round(stride / resolution))


def evaluated_points(free: NDArray[np.bool_], stride: int) -> NDArray[np.bool_]:
    """Mask of the lattice points to evaluate, (h, w): each free cell needs one to read from."""
    wanted = free[::stride, ::stride].copy()
    covered = interpolate(wanted.astype(float), free.shape, stride) > 0
    nearest = (
        np.minimum((index + stride // 2) // stride, size - 1)
        for index, size in zip(np.nonzero(free & ~covered), wanted.shape, strict=True)
    )
    wanted[tuple(nearest)] = True
    return wanted


def standing_cells(
    free: NDArray[np.bool_], rows: NDArray[np.intp], cols: NDArray[np.intp], reach: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Cells to put a lidar on: each cell, or the nearest free one within `reach` rows and columns.

    A lattice point in a wall serves free cells beside it; a lidar inside the wall sees nothing.
    """
    rows, cols = rows.copy(), cols.copy()
    lost = np.flatnonzero(~free[rows, cols])
    for move in _moves(min(reach, max(free.shape))):
        if not lost.size:
            break
        row, col = rows[lost] + move[0], cols[lost] + move[1]
        inside = (row >= 0) & (row < free.shape[0]) & (col >= 0) & (col < free.shape[1])
        found = inside & free[np.where(inside, row, 0), np.where(inside, col, 0)]
        rows[lost[found]], cols[lost[found]] = row[found], col[found]
        lost = lost[~found]
    return rows, cols


def _moves(reach: int) -> Iterator[tuple[int, int]]:
    """Rows and columns up to `reach` away, the nearest first; no list of all is made."""
    for ring in range(math.ceil(math.sqrt(2) * reach) + 1):
        moves = []
        for row in range(-min(ring, reach), min(ring, reach) + 1):
            within = (ring - 1) ** 2 - row**2 if ring else -1
            least = math.isqrt(within) + 1 if within >= 0 else 0
            most = min(reach, math.isqrt(ring**2 - row**2))
            cols = {*range(-most, 1 - least), *range(least, most + 1)}
            moves += [(row, col) for col in sorted(cols)]
        yield from sorted(moves, key=lambda move: math.hypot(*move))


def interpolate(
    values: NDArray[np.float64], shape: tuple[int, int], stride: int
) -> NDArray[np.float64]:
    """Interpolate lattice values (h, w) bilinearly at all cells (H, W); the last ones extend."""
    for axis, size in enumerate(shape):
        last = values.shape[axis] - 1
        position = np.minimum(np.arange(size) / stride, last)
        low = np.floor(position).astype(np.intp)
        part = position - low
        part = part[:, None] if axis == 0 else part[None, :]
        below = np.take(values, low, axis)
        above = np.take(values, np.minimum(low + 1, last), axis)
        values = below * (1 - part) + above * part
    return values


def neighbours(position: float, size: int) -> list[tuple[int, float]]:
    """Lattice indices on either side of a position, with their bilinear weights."""
    position = min(max(position, 0.0), size - 1.0)
    low = math.floor(position)
    return [(low, 1 - (position - low)), (min(low + 1, size - 1), position - low)]


def well_spaced(
    xy: NDArray[np.float64], priority: NDArray[np.float64], spacing: float
) -> NDArray[np.int64]:
    """Indices of positions at least `spacing` apart that leave no gap, high priority first.

    Examples
    --------
    >>> xy = np.array([[0.1, 0.5], [0.9, 0.5], [1.1, 0.5], [2.5, 0.5]])
    >>> well_spaced(xy, np.array([1.0, 2.0, 3.0, 1.0]), 0.9).tolist()
    [2, 0, 3]
    """
    from scipy.spatial import cKDTree

    tree, covered, chosen = cKDTree(xy), np.zeros(len(xy), bool), []
    for k in np.argsort(-priority, kind="stable").tolist():
        if not covered[k]:
            chosen.append(k)
            covered[tree.query_ball_point(xy[k], spacing * (1 - 1e-9))] = True
    return np.array(chosen, np.int64)
