"""The part of the world that a map covers, for people, and poses along its axes."""

from __future__ import annotations

import numpy as np

from locplan._kernels.arrays import Floats
from locplan.maps._grid import OccupancyGrid


def extent_text(grid: OccupancyGrid) -> str:
    """Return the lowest and the highest corner of a map in the world, such as 0,0 to 40,14 m.

    Parameters
    ----------
    grid : OccupancyGrid
        The map; a turned one covers less than the box between the corners.
    """
    rows, cols = grid.shape
    xs, ys = grid.grid_to_world([0, 0, rows, rows], [0, cols, 0, cols])
    low, high = ((f(xs), f(ys)) for f in (min, max))
    return f"{low[0]:.6g},{low[1]:.6g} to {high[0]:.6g},{high[1]:.6g} m"


def own_axes(grid: OccupancyGrid, poses: Floats) -> Floats:
    """Poses along a map's columns and rows from its origin on, (n, 3) [m, m, rad].

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    poses : (n, 3) array
        Poses x, y, heading in the world [m, m, rad].
    """
    rows, cols = grid.world_to_grid(*poses[:, :2].T)
    heading = poses[:, 2] - grid.origin[2]
    return np.column_stack([cols * grid.resolution, rows * grid.resolution, heading])
