"""Route graphs: lanes over the free space, or straight edges of one's own, with their costs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan._kernels.route import clearances, cover, line_costs
from locplan._kernels.search import bordered_half
from locplan._util.progress import ProgressCallback, parts, scaled
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.export._lanes import ROOMY, lanes
from locplan.export._net import Net, Positions, Space, fine_net, symmetric
from locplan.maps import OCCUPIED, OccupancyGrid

FINENESS = 0.02
"""Coarsest step of single precision that is accepted [cells]."""


@dataclass(frozen=True, eq=False, repr=False)
class RouteGraph:
    """Nodes and straight edges, made by `roadmap`, or by `RouteGraph.over` from lines of one's own.

    Examples
    --------
    >>> import numpy as np
    >>> from locplan.costs import Costmap
    >>> from locplan.maps import environments
    >>> costs = Costmap.blank(environments.make("hall"))
    >>> graph = RouteGraph.over(costs, [(1.5, 2.0), (4.5, 6.0)], [(0, 1)], directed=True)
    >>> graph
    RouteGraph(2 nodes, 1 directed edges)
    >>> float(graph.cost[0])
    5.0
    """

    nodes: Floats
    """World positions (n, 2) [m], exact in single precision: Nav2 keeps no more."""
    edges: Ints
    """Pairs of nodes (m, 2), from the first to the second."""
    length: Floats
    """Length of each edge (m,) [m]."""
    cost: Floats
    """J of each edge (m,) [m], at least its length."""
    integrated_e: Floats
    """Integral of e over each edge (m,) [m^2 rad m]; NaN without a field."""
    integrated_u: Floats
    """Integral of u over each edge (m,) [m]; NaN without a field."""
    directed: bool = False
    """Whether edges lead one way only; otherwise each can be travelled both ways."""

    def __repr__(self) -> str:
        kind = f"{len(self.edges)} " + ("directed edges" if self.directed else "edges each way")
        return f"RouteGraph({len(self.nodes)} nodes, {kind})"

    @classmethod
    def over(
        cls, costs: Costmap, nodes: ArrayLike, edges: ArrayLike, *, directed: bool = False
    ) -> RouteGraph:
        """A graph of given lines, with their exact integrals.

        Parameters
        ----------
        costs : Costmap
            The costs of travel.
        nodes : (n, 2) array
            World positions [m]; they are rounded to single precision.
        edges : (m, 2) array of int
            Pairs of nodes.
        directed : bool, default False
            Whether edges lead from the first node to the second only, as one-way lanes.

        Raises
        ------
        ConfigError
            If an edge has no length or touches a blocked cell, or the map is so far from the
            world's origin that single precision would be too coarse.
        """
        return graph_over(costs, space_of(costs), nodes, edges, directed=directed)

    @property
    def directions(self) -> list[tuple[int, int, int]]:
        """Number, start and end of each edge, once for each direction in which it is travelled."""
        ways = slice(1 if self.directed else 2)
        ends = enumerate(self.edges.tolist())
        return [(n, *way) for n, (i, j) in ends for way in ((i, j), (j, i))[ways]]

    @property
    def penalty(self) -> Floats:
        """Excess of J over the length (m,) [m]: weight * integrated_u."""
        return self.cost - self.length

    @property
    def components(self) -> int:
        """Number of parts of the graph that no route joins."""
        return int(connected_components(self.matrix, directed=False)[0])

    def summary(self) -> dict[str, int]:
        """The size of the graph by name, fit for JSON."""
        nodes, edges = len(self.nodes), len(self.edges)
        return {"nodes": nodes, "edges": edges, "components": self.components}

    def rows(self) -> tuple[tuple[str, str], ...]:
        """The size of the graph for people: labels and texts."""
        each_way = "" if self.directed else " each way"
        return (
            ("nodes, edges", f"{len(self.nodes):,}, {len(self.edges):,}{each_way}"),
            ("parts not joined", f"{self.components:,}"),
        )

    @property
    def matrix(self) -> csr_array:
        """J between nodes, (n, n), for `scipy.sparse.csgraph`; symmetric unless directed."""
        count = len(self.nodes)
        if self.directed:
            return csr_array(coo_array((self.cost, tuple(self.edges.T)), shape=(count, count)))
        return symmetric(self.edges, self.cost, count)


def graph_over(
    costs: Costmap, space: Space, nodes: ArrayLike, edges: ArrayLike, *, directed: bool = False
) -> RouteGraph:
    """The graph that `RouteGraph.over` makes; the space's array is written over, saving memory."""
    xy = np.asarray(nodes, np.float32).astype(np.float64).reshape(-1, 2)
    pairs = np.asarray(edges, np.int64).reshape(-1, 2)
    length = np.hypot(*(xy[pairs[:, 0]] - xy[pairs[:, 1]]).T)
    half = space[0].reshape(-1, space[1])[1:-1, 1:-1]
    passable, integrals = np.isfinite(half), [line_costs(*space, xy, pairs)]
    for layer in (costs.e, costs.u):
        np.multiply(layer, 0.5, out=half, where=passable)
        integrals.append(line_costs(*space, xy, pairs))
    cost, e, u = np.array(integrals) * costs.grid.resolution
    wrong = np.flatnonzero(~np.isfinite(cost) | (length == 0))
    if len(wrong):
        ends = " to ".join("({:.2f}, {:.2f})".format(*xy[end]) for end in pairs[wrong[0]])
        raise ConfigError(f"the edge {ends} has no length, or touches a blocked cell")
    return RouteGraph(xy, pairs, length, np.maximum(cost, length), e, u, directed)


def space_of(costs: Costmap) -> Space:
    """A costmap as the kernels of route graphs take it.

    Raises
    ------
    ConfigError
        If the map is too far from the world's origin for Nav2's single precision.
    """
    grid = costs.grid
    check_precision(grid)
    x, y, yaw = grid.origin
    frame = math.cos(yaw) / grid.resolution, math.sin(yaw) / grid.resolution, x, y
    return bordered_half(costs.density, 1), grid.shape[1] + 2, frame


def check_precision(grid: OccupancyGrid) -> None:
    """Raise a ConfigError if the map is too far from the world's origin for single precision."""
    x, y, _ = grid.origin
    farthest = max(abs(x), abs(y)) + math.hypot(*grid.shape) * grid.resolution
    if np.spacing(np.float32(farthest)) > FINENESS * grid.resolution:
        raise ConfigError(f"positions {farthest:.4g} m from the origin are too coarse for Nav2")


FINE, PLACES, POINTS = 0.8, 2.0, 0.5
"""Distances in spacings: of the nodes of the net that lanes are drawn from, of the places that
lanes join, and of the points that are to see nodes."""


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
    netting, placing, drawing, measuring = parts(progress, (50, 4, 40, 6))
    space = space_of(costs)
    passable = np.isfinite(costs.density)
    _, piece, stats, _ = cv2.connectedComponentsWithStats(passable.astype(np.uint8), connectivity=4)
    large = stats[:, cv2.CC_STAT_AREA] * grid.resolution**2 >= min_area
    inside = np.pad(large[piece] & passable, 1)
    del piece, passable  # saves memory on a large map
    if not inside.any():
        raise ConfigError(f"no connected free space is as large as {min_area:g} m^2")
    finest = max(FINE * spacing, 2 * grid.resolution)
    net = fine_net(costs, space, inside, finest, scaled(netting, 50))
    points = _points(costs, inside, reach, net)
    places = _places(costs, inside, reach, net)
    placing(4, 4)
    occupied, far = grid.cells == OCCUPIED, math.ceil(ROOMY * reach) + 1

    def clearance(xy: Positions) -> Floats:
        row, col = (np.floor(at).astype(np.int64) for at in grid.world_to_grid(*xy.T))
        return np.asarray(clearances(occupied, row, col, far) * grid.resolution)

    laying = scaled(drawing, 40)
    drawn = lanes(space, net, places, points, clearance, spacing, detour, laying)
    graph = graph_over(costs, space, drawn.xy, drawn.edges)
    measuring(6, 6)
    return graph


def _places(costs: Costmap, inside: Bools, reach: float, net: Net) -> Ints:
    """Nodes of the net all over the free space, in the order of the net."""
    row, col = (np.floor(at).astype(np.int64) + 1 for at in costs.grid.world_to_grid(*net.xy.T))
    cells = row * inside.shape[1] + col
    taken = cover(inside.reshape(-1), inside.shape[1], cells, PLACES * reach)
    cells, first = np.unique(cells, return_index=True)
    return np.sort(first[np.searchsorted(cells, taken)])


def _points(costs: Costmap, inside: Bools, reach: float, net: Net) -> Positions:
    """Positions (n, 2) [m] of cells on a lattice, and of the nodes, which are in narrow places."""
    step = max(1, int(POINTS * reach))
    row, col = np.argwhere(inside[1:-1, 1:-1][step // 2 :: step, step // 2 :: step]).T
    first = step // 2 + 0.5
    lattice = costs.grid.grid_to_world(row * step + first, col * step + first)
    return np.vstack([np.column_stack(lattice), net.xy])
