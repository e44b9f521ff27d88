"""Graphs of straight edges over a costmap, as route servers and fleet managers take them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from locplan._kernels.route import line_costs
from locplan._kernels.search import bordered_half
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.export._net import Space, symmetric
from locplan.maps import OccupancyGrid

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

    nodes: NDArray[np.float64]
    """World positions (n, 2) [m], exact in single precision: Nav2 keeps no more."""
    edges: NDArray[np.int64]
    """Pairs of nodes (m, 2), from the first to the second."""
    length: NDArray[np.float64]
    """Length of each edge (m,) [m]."""
    cost: NDArray[np.float64]
    """J of each edge (m,) [m], at least its length."""
    integrated_e: NDArray[np.float64]
    """Integral of e over each edge (m,) [m^2 rad m]; NaN without a field."""
    integrated_u: NDArray[np.float64]
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
    def penalty(self) -> NDArray[np.float64]:
        """Excess of J over the length (m,) [m]: weight * integrated_u."""
        return self.cost - self.length

    @property
    def components(self) -> int:
        """Number of parts of the graph that no route joins."""
        return int(connected_components(self.matrix, directed=False)[0])

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
    cost = line_costs(*space, xy, pairs) * costs.grid.resolution
    half = space[0].reshape(-1, space[1])[1:-1, 1:-1]
    passable = np.isfinite(half)
    e, u = np.empty(len(pairs)), np.empty(len(pairs))
    for layer, found in ((costs.e, e), (costs.u, u)):
        np.multiply(layer, 0.5, out=half, where=passable)
        found[:] = line_costs(*space, xy, pairs) * costs.grid.resolution
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
