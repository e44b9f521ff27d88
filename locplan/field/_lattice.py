"""The lattice of cells that a field is evaluated on, and interpolation between them.

Lattice point ``(i, j)`` is the centre of cell ``(i * stride, j * stride)``.
"""

from __future__ import annotations

import math

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
    standing_rows, standing_cols = rows.copy(), cols.copy()
    for n in np.flatnonzero(~free[rows, cols]):
        row, col = int(rows[n]), int(cols[n])
        top, left = max(0, row - reach), max(0, col - reach)
        box = free[top : row + reach + 1, left : col + reach + 1]
        near = np.argwhere(box) + np.array([top, left])
        if near.size:
            squared = ((near - (row, col)) ** 2).sum(axis=1)
            standing_rows[n], standing_cols[n] = near[np.argmin(squared)]
    return standing_rows, standing_cols


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
