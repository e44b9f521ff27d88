"""The lattice of cells that a field is evaluated on, and reading between them.

Lattice point ``(i, j)`` is the centre of cell ``(i * stride, j * stride)``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from locplan.config import FieldConfig


def stride_cells(config: FieldConfig, resolution: float) -> int:
    """Spacing of the lattice in whole cells."""
    return max(1, round(config.stride / resolution))


def evaluated_points(free: NDArray[np.bool_], stride: int) -> NDArray[np.bool_]:
    """Lattice points to evaluate, (h, w), so that every free cell can be read from one at least."""
    wanted = free[::stride, ::stride].copy()
    covered = spread(wanted.astype(float), free.shape, stride) > 0
    rows, cols = np.nonzero(free & ~covered)
    nearest = [
        np.minimum((index + stride // 2) // stride, size - 1)
        for index, size in zip((rows, cols), wanted.shape, strict=True)
    ]
    wanted[nearest[0], nearest[1]] = True
    return wanted


def spread(values: NDArray[np.float64], shape: tuple[int, int], stride: int) -> NDArray[np.float64]:
    """Lattice values (h, w) read bilinearly at every cell (H, W); beyond the last, the last."""
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
