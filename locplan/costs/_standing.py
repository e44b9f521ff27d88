"""The cell where a robot is to stand, and the reason and the remedy where it cannot."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import position
from locplan.errors import PoseError
from locplan.maps import OCCUPIED, UNKNOWN, OccupancyGrid


def standing_cell(
    grid: OccupancyGrid,
    density: NDArray[np.float64],
    robot_radius: float,
    xy: Sequence[float],
    role: str,
) -> tuple[int, int]:
    """Row and column of the cell at a world position, see `Costmap.cell_of`."""
    x, y = position(xy, name=role)
    row, col = grid.world_to_cell(x, y)
    fault = _fault(grid, density, robot_radius, row, col)
    if fault is None:
        return row, col
    remedy = f"no cell of the map is free for a robot of radius {robot_radius:g} m"
    if nearest := _nearest_free(grid, density, x, y):
        decimals = max(2, math.ceil(1 - math.log10(grid.resolution)))
        shown = ",".join(f"{v:.{decimals}f}" for v in nearest)
        remedy = f"the nearest free position is {shown}"
    where = "locplan info MAP -o PICTURE shows coordinates"
    raise PoseError(f"{role} {x:.10g},{y:.10g} {fault}; {remedy}; {where}")


def _fault(
    grid: OccupancyGrid, density: NDArray[np.float64], robot_radius: float, row: int, col: int
) -> str | None:
    """Why a robot cannot stand in a cell; None if it can."""
    if not grid.contains(row, col):
        return "lies outside the map"
    if np.isfinite(density[row, col]):
        return None
    level = grid.cells[row, col]
    if level in (OCCUPIED, UNKNOWN):
        return "lies in a wall" if level == OCCUPIED else "lies in unknown space"
    clearance = grid.clearance[row, col]
    if clearance < robot_radius:
        return (
            f"is {clearance:.2f} m from a wall, closer than the robot's radius of"
            f" {robot_radius:g} m"
        )
    return "lies in a blocked cell"


def _nearest_free(
    grid: OccupancyGrid, density: NDArray[np.float64], x: float, y: float
) -> tuple[float, float] | None:
    """Centre of the passable cell next to a world position [m]."""
    rows, cols = np.nonzero(np.isfinite(density))
    if rows.size == 0:
        return None
    row, col = grid.world_to_grid(x, y)
    nearest = np.argmin((rows + 0.5 - row) ** 2 + (cols + 0.5 - col) ** 2)
    return grid.cell_to_world(int(rows[nearest]), int(cols[nearest]))
