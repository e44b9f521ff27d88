"""Kernels of route graphs: the costs of lines.

Cells are flat indices into a grid with a blocked border of one cell; positions are in the world
[m]. `frame` holds the cosine and the sine of the grid's yaw, both per cell [1/m], and the world's
x and y of its origin. `half` is half the density, see `locplan._support.kernels.search`.
"""

from __future__ import annotations

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Numbers
from locplan._support.kernels.rays import TOUCH, compute_segment_cost


@njit(nogil=True, cache=True)
def integrate_line_cost(
    half_density: Array, columns: int, grid_pose: Numbers, start: Array, end: Array
) -> float:
    """Integral along the line between two positions, in the costlier direction [density x cells].

    Infinite if either direction is blocked, or an end is outside the grid or at a blocked cell.
    """
    along, across, x, y = grid_pose
    row0 = along * (start[1] - y) - across * (start[0] - x) + 1
    row1 = along * (end[1] - y) - across * (end[0] - x) + 1
    col0 = along * (start[0] - x) + across * (start[1] - y) + 1
    col1 = along * (end[0] - x) + across * (end[1] - y) + 1
    for row, col in ((row0, col0), (row1, col1)):
        if not (1 <= row < len(half_density) // columns - 1 and 1 <= col < columns - 1):
            return np.inf
        for up in (-TOUCH, TOUCH):
            for right in (-TOUCH, TOUCH):
                if half_density[int(row + up) * columns + int(col + right)] == np.inf:
                    return np.inf
    forward_cost = compute_segment_cost(half_density, columns, row0, col0, row1, col1, False)
    return max(
        forward_cost, compute_segment_cost(half_density, columns, row1, col1, row0, col0, False)
    )


@njit(nogil=True, cache=True)
def integrate_line_costs(
    half_density: Array, columns: int, grid_pose: Numbers, xy: Array, pairs: Array
) -> Array:
    """Costs, by `integrate_line_cost`, of the lines between pairs (m, 2) of positions (n, 2)."""
    result = np.empty(len(pairs))
    for n, (i, j) in enumerate(pairs):
        result[n] = integrate_line_cost(half_density, columns, grid_pose, xy[i], xy[j])
    return result
