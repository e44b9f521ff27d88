"""The floor of a large map in larger cells, for drafts of paths."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap
from locplan.maps import FREE, UNKNOWN, OccupancyGrid

FACTOR = 4
"""Number of cells of the map along a side of a coarse one."""


@dataclass(frozen=True, eq=False)
class Floor:
    """The floor that a robot can stand on, in larger cells."""

    grid: OccupancyGrid
    """The map: free where at least half of a cell's floor is."""
    u: NDArray[np.float64]
    """Mean degeneracy of the floor in each cell, (h, w); 0 without a field."""

    @classmethod
    def of(cls, fine: Costmap, factor: int = FACTOR) -> Floor:
        """The floor of a costmap, in blocks of its cells."""
        shape = -(-fine.grid.shape[0] // factor), -(-fine.grid.shape[1] // factor)
        total, count = np.zeros(shape), np.zeros(shape, np.uint8)
        for row, col in itertools.product(range(factor), repeat=2):  # no copy of the whole map
            some = slice(row, None, factor), slice(col, None, factor)
            free, u = np.isfinite(fine.density[some]), fine.u[some]
            at = slice(0, free.shape[0]), slice(0, free.shape[1])
            total[at] += np.where(free & ~np.isnan(u), u, 0.0)
            count[at] += free
        free = count >= factor * factor / 2
        cells = np.where(free, FREE, UNKNOWN).astype(np.uint8)
        grid = OccupancyGrid(cells, fine.grid.resolution * factor, fine.grid.origin)
        return cls(grid, total / np.maximum(count, 1))
