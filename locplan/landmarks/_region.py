"""A region in which a robot may be anywhere: poses in it, and routes across it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from locplan._util.poses import Poses
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.maps import OccupancyGrid
from locplan.planners import plan
from locplan.robots import Lidar

MIN_STEP = 0.5
"""Least spacing of the poses [m]."""
MAX_POSES = 1200
"""Number of poses, about, from which on they are farther apart."""
MAX_HEADINGS = 8
"""Greatest number of headings at a position, for a narrow field of view."""
ENDS = 6
"""Number of places that drives join, in pairs far apart."""


def where_robot_is(
    grid: OccupancyGrid, region: NDArray[np.bool_], robot_radius: float
) -> NDArray[np.bool_]:
    """Cells of a region where the robot's centre can be, all joined by ways on the map, (H, W).

    Raises
    ------
    ConfigError
        If there is no such cell.
    """
    import cv2

    space = grid.free & ~grid.closer_than(robot_radius - 1e-9)
    _, parts = cv2.connectedComponents(space.astype(np.uint8), connectivity=4)
    counts = np.bincount(parts[space & region], minlength=1)
    if not counts.any():
        raise ConfigError(
            f"a robot of {robot_radius:g} m radius cannot be anywhere in the region; give one with"
            " free cells"
        )
    return np.asarray(region & (parts == int(counts.argmax())))


def poses_in(grid: OccupancyGrid, cells: NDArray[np.bool_], lidar: Lidar) -> Poses:
    """Poses in the world on a lattice over cells, with headings all round, (n, 3).

    The fewer a lidar sees at once, the more headings there are: any direction is seen twice.
    """
    headings = 1
    if not lidar.sees_all_round:
        headings = min(math.ceil(720 / lidar.field_of_view_deg), MAX_HEADINGS)
    area = cells.sum() * grid.resolution**2
    step = max(MIN_STEP, math.sqrt(area * headings / MAX_POSES))
    edge = max(round(step / grid.resolution), 1)
    # Of each square of the lattice, the cell that is nearest to its middle.
    rows, cols = np.nonzero(cells)
    away = np.hypot(rows % edge - (edge - 1) / 2, cols % edge - (edge - 1) / 2)
    order = np.lexsort((away, cols // edge, rows // edge))
    square = rows[order] // edge * (grid.shape[1] + 1) + cols[order] // edge
    _, firsts = np.unique(square, return_index=True)
    x, y = grid.grid_to_world(rows[order][firsts] + 0.5, cols[order][firsts] + 0.5)
    turns = np.tile(np.arange(headings) * 2 * math.pi / headings, len(firsts))
    return np.column_stack([np.repeat(x, headings), np.repeat(y, headings), turns])


def routes_across(
    grid: OccupancyGrid, cells: NDArray[np.bool_], robot_radius: float
) -> dict[str, Path]:
    """Shortest paths between places in a region, of which each is far from those before it.

    Raises
    ------
    ConfigError
        If the region is too small for two places.
    """
    rows, cols = np.nonzero(cells)
    xy = np.column_stack(grid.grid_to_world(rows + 0.5, cols + 0.5))
    clear = grid.clearance[rows, cols]
    ends = [int(np.argmax(np.hypot(*(xy - xy.mean(axis=0)).T)))]
    apart = np.full(len(xy), np.inf)
    while len(ends) < ENDS:
        apart = np.minimum(apart, np.hypot(*(xy - xy[ends[-1]]).T))
        # Rather in the open than in a corner.
        ends.append(int(np.argmax(apart + np.minimum(clear, 1.0))))
    ends = list(dict.fromkeys(_in_the_open(n, xy, clear) for n in ends))
    costs = Costmap.blank(grid, robot_radius=robot_radius)
    routes: dict[str, Path] = {}
    left = ends
    while len(left) > 1:
        one = left.pop(0)
        other = max(left, key=lambda n: float(np.hypot(*(xy[n] - xy[one]))))
        left.remove(other)
        found = plan(costs, tuple(xy[one]), tuple(xy[other])).path
        if found is not None and found.length > 2 * robot_radius:
            routes[f"across {len(routes) + 1}"] = found
    if not routes:
        raise ConfigError("the region is too small to drive in; give a larger one")
    return routes


def _in_the_open(place: int, xy: NDArray[np.float64], clear: NDArray[np.float64]) -> int:
    """The clearest place within 1 m."""
    near = np.flatnonzero(np.hypot(*(xy - xy[place]).T) <= 1.0)
    return int(near[np.argmax(clear[near])])
