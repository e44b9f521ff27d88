"""Route graphs that look like lanes: straight, collision-free lines along the cheap ways."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from locplan._kernels.route import clearances, cover
from locplan._util.progress import ProgressCallback, parts, scaled
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.export._lanes import ROOMY, lanes
from locplan.export._net import Net, fine_net
from locplan.export._route_graphs import RouteGraph, graph_over, space_of
from locplan.maps import OCCUPIED

FINE, PLACES, POINTS = 0.8, 2.0, 0.5
"""Distances in spacings: of the nodes of the net that lanes are drawn from, of the places that
lanes join, and of the points that are to see nodes."""
SHARES = 50, 4, 40, 6
"""Steps of progress of the net, the places, the lanes and their costs."""


def roadmap(
    costs: Costmap,
    *,
    spacing: float = 2.0,
    detour: float = 1.2,
    min_area: float = 1.0,
    progress: ProgressCallback | None = None,
) -> RouteGraph:
    """Lay lanes over the free space along the ways that cost little.

    Every connected piece of free space gets lanes that are connected, too. Where nothing bends or
    branches, lanes are long straight edges, of about four spacings at most in the open.

    Parameters
    ----------
    costs : Costmap
        The costs of travel.
    spacing : float, default 2.0
        How close lanes are [m], at least two cells: nearly all free cells see a node two spacings
        away or less, and places that are two spacings apart are joined. A smaller one makes more
        lanes.
    detour : float, default 1.2
        Routes over lanes between these places cost about this many times as much as the cheapest
        ones at most, >= 1; half of them cost no more than a grid planner's paths. Less makes more
        lanes.
    min_area : float, default 1.0
        Connected free space smaller than this gets no nodes [m^2], >= 0.
    progress : callable, optional
        Called with (done, total) steps of about equal time; what it raises ends the work.

    Returns
    -------
    RouteGraph
        The lanes, which can be travelled both ways.

    Raises
    ------
    ConfigError
        If a number is out of range, no connected free space is as large as that, or the map is so
        far from the world's origin that Nav2's single precision would be too coarse.
    """
    grid = costs.grid
    reach = spacing / grid.resolution
    if not (2 <= reach < math.inf and 1 <= detour < math.inf and 0 <= min_area < math.inf):
        raise ConfigError(
            "spacing must be at least two cells, detour at least 1 and min_area at least 0, not"
            f" {spacing:g} m, {detour:g} and {min_area:g} m^2"
        )
    netting, placing, drawing, measuring = parts(progress, SHARES)
    space = space_of(costs)
    passable = np.isfinite(costs.density)
    _, piece, stats, _ = cv2.connectedComponentsWithStats(passable.astype(np.uint8), connectivity=4)
    large = stats[:, cv2.CC_STAT_AREA] * grid.resolution**2 >= min_area
    inside = np.pad(large[piece] & passable, 1)
    del piece, passable  # saves memory on a large map
    if not inside.any():
        raise ConfigError(f"no connected free space is as large as {min_area:g} m^2")
    finest = max(FINE * spacing, 2 * grid.resolution)
    net = fine_net(costs, space, inside, finest, scaled(netting, SHARES[0]))
    points = _points(costs, inside, reach, net)
    places = _places(costs, inside, reach, net)
    placing(SHARES[1], SHARES[1])
    occupied, far = grid.cells == OCCUPIED, math.ceil(ROOMY * reach) + 1

    def clearance(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        row, col = (np.floor(at).astype(np.int64) for at in grid.world_to_grid(*xy.T))
        return np.asarray(clearances(occupied, row, col, far) * grid.resolution)

    laying = scaled(drawing, SHARES[2])
    drawn = lanes(space, net, places, points, clearance, spacing, detour, laying)
    graph = graph_over(costs, space, drawn.xy, drawn.edges)
    measuring(SHARES[3], SHARES[3])
    return graph


def _places(costs: Costmap, inside: NDArray[np.bool_], reach: float, net: Net) -> NDArray[np.int64]:
    """Nodes of the net that are well spread over the free space, in the order of the net."""
    row, col = (np.floor(at).astype(np.int64) + 1 for at in costs.grid.world_to_grid(*net.xy.T))
    cells = row * inside.shape[1] + col
    taken = cover(inside.reshape(-1), inside.shape[1], cells, PLACES * reach)
    cells, first = np.unique(cells, return_index=True)
    return np.sort(first[np.searchsorted(cells, taken)])


def _points(
    costs: Costmap, inside: NDArray[np.bool_], reach: float, net: Net
) -> NDArray[np.float64]:
    """Positions (n, 2) [m] of cells on a lattice, and of the nodes, which are in narrow places."""
    step = max(1, int(POINTS * reach))
    row, col = np.argwhere(inside[1:-1, 1:-1][step // 2 :: step, step // 2 :: step]).T
    first = step // 2 + 0.5
    lattice = costs.grid.grid_to_world(row * step + first, col * step + first)
    return np.vstack([np.column_stack(lattice), net.xy])
