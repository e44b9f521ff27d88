"""A sparse roadmap of straight, collision-free lines over the free space, for route servers.

Nodes cover the free space, places of little degeneracy and much clearance first. Each owns the
cells around it; nodes whose cells touch but who see neither each other nor both a third close by
get one more between them, so that the roadmap is as connected as the space. Of the lines between
nodes a spanner is kept, and nodes move to where the routes through them cost least.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from locplan._kernels.route import cover, line_costs, moved, owners, spanner, usage
from locplan._kernels.search import bordered_half
from locplan.costs import Costmap
from locplan.errors import ConfigError

CLEAR, MERGED, SHIFT, APART = 0.25, 0.5, 0.5, 0.25
"""Distances in spacings: the clearance that is enough, the greatest distance of nodes that are
merged, the greatest move of a node, and the least distance of neighbours after it."""
ASIDE = 1.5
"""Greatest length of the way over a third node, as a multiple of the straight line."""
LEVELS = 65535
"""Steps of worth that cells are sorted by; numbers of 16 bits are sorted ten times as fast."""
FINENESS = 0.02
"""Coarsest step of single precision that is accepted [cells]."""
ROUNDS, LANDMARKS = 2, 32
"""Number of rounds in which nodes move, and of the nodes whose routes they move for."""


@dataclass(frozen=True, eq=False, repr=False)
class RouteGraph:
    """Nodes, and straight edges that can be travelled both ways; made by `roadmap`."""

    nodes: NDArray[np.float64]
    """World positions (n, 2) [m], exact in single precision: Nav2 keeps no more."""
    edges: NDArray[np.int64]
    """Pairs of nodes (m, 2), the lower one first."""
    length: NDArray[np.float64]
    """Length of each edge (m,) [m]."""
    cost: NDArray[np.float64]
    """J of each edge (m,) [m], at least its length."""
    integrated_e: NDArray[np.float64]
    """Integral of e over each edge (m,) [m^2 rad m]; NaN without a field."""
    integrated_u: NDArray[np.float64]
    """Integral of u over each edge (m,) [m]; NaN without a field."""

    def __repr__(self) -> str:
        return f"RouteGraph({len(self.nodes)} nodes, {len(self.edges)} edges each way)"

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
        """J between nodes, (n, n) and symmetric, for `scipy.sparse.csgraph`."""
        return _symmetric(self.edges, self.cost, len(self.nodes))


def roadmap(
    costs: Costmap, *, spacing: float = 2.0, detour: float = 1.2, min_area: float = 1.0
) -> RouteGraph:
    """Cover the free space with nodes and join them by straight lines.

    Parameters
    ----------
    costs : Costmap
        The costs of travel.
    spacing : float
        Distance of neighbouring nodes in open space [m]; in narrow places they are closer.
    detour : float
        A line is left out where two others cost at most this many times as much, >= 1.
    min_area : float
        Connected free space smaller than this gets no nodes [m^2].

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
    x, y, yaw = grid.origin
    farthest = max(abs(x), abs(y)) + math.hypot(*grid.shape) * grid.resolution
    if np.spacing(np.float32(farthest)) > FINENESS * grid.resolution:
        raise ConfigError(f"positions {farthest:.4g} m from the origin are too coarse for Nav2")
    passable = np.isfinite(costs.density)
    frame = math.cos(yaw) / grid.resolution, math.sin(yaw) / grid.resolution, x, y
    space = bordered_half(costs.density, 1), grid.shape[1] + 2, frame
    _, piece, stats, _ = cv2.connectedComponentsWithStats(passable.astype(np.uint8), connectivity=4)
    large = stats[:, cv2.CC_STAT_AREA] * grid.resolution**2 >= min_area
    inside = np.pad(large[piece] & passable, 1)
    if not inside.any():
        raise ConfigError(f"no connected free space is as large as {min_area:g} m^2")
    xy, pairs = _cover(costs, space, inside, reach)
    xy, pairs = _merged(space, xy, pairs, MERGED * spacing)
    near = _symmetric(pairs, np.ones(len(pairs)), len(xy))
    pairs = np.unique(np.vstack([pairs, np.column_stack((near @ near).tocoo().coords)]), axis=0)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]].astype(np.int64)
    kept, cost = _kept(space, xy, pairs, detour)
    for _ in range(ROUNDS):
        graph = _symmetric(kept, cost, len(xy))
        starts = np.unique(np.linspace(0, len(xy) - 1, LANDMARKS).astype(int))
        away, before = dijkstra(graph, indices=starts, return_predecessors=True)
        use = usage(np.argsort(away, kind="stable"), before, graph.indptr, graph.indices)
        xy = moved(*space, xy, graph.indptr, graph.indices, use, SHIFT * reach, APART * reach)
        kept, cost = _kept(space, xy, pairs, detour)
    length = np.hypot(*(xy[kept[:, 0]] - xy[kept[:, 1]]).T)
    e, u = (
        line_costs(bordered_half(np.where(passable, layer, np.inf), 1), *space[1:], xy, kept)
        for layer in (costs.e, costs.u)
    )
    cost, e, u = (total * grid.resolution for total in (cost, e, u))
    joined = np.unique(kept)  # a node alone would be the nearest to goals that no route reaches
    number = np.searchsorted(joined, kept)
    return RouteGraph(xy[joined], number, length, np.maximum(cost, length), e, u)


def _symmetric(pairs: NDArray[Any], values: NDArray[Any], count: int) -> csr_array:
    ends = np.concatenate([pairs, pairs[:, ::-1]]).T
    return csr_array(coo_array((np.tile(values, 2), tuple(ends)), shape=(count, count)))


def _cover(
    costs: Costmap, space: tuple[Any, ...], inside: NDArray[np.bool_], reach: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Nodes (n, 2) and free lines between them (m, 2) that join all connected cells."""
    flat, columns = inside.reshape(-1), inside.shape[1]
    clearance = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    clearance = clearance.reshape(-1)
    cells = np.flatnonzero(flat)
    worth = np.minimum(clearance[cells] / (CLEAR * reach), 1.0) - 2 * space[0][cells]
    steps = (LEVELS * (worth.max() - worth) / max(np.ptp(worth), 1e-9)).astype(np.uint16)
    nodes = cover(flat, columns, cells[np.argsort(steps, kind="stable")], reach)
    while True:
        row, col = np.divmod(nodes, columns)
        xy = np.column_stack(costs.grid.grid_to_world(row - 0.5, col - 0.5))
        xy = xy.astype(np.float32).astype(np.float64)
        pairs, between = _touching(owners(flat, columns, nodes), columns, nodes, clearance)
        seen = np.isfinite(line_costs(*space, xy, pairs))
        length = np.hypot(*(xy[pairs[:, 0]] - xy[pairs[:, 1]]).T)
        near = _symmetric(pairs[seen], length[seen], len(nodes))
        missing = _shortest_by_two(near, pairs[~seen]) > ASIDE * length[~seen]
        if not missing.any():
            return xy, pairs[seen]
        nodes = np.concatenate([nodes, np.unique(between[~seen][missing])])


def _shortest_by_two(graph: csr_array, pairs: NDArray[Any]) -> NDArray[np.float64]:
    """The length of the shortest way over one node between, for each of the pairs."""
    first, second = graph[pairs[:, 0]], graph[pairs[:, 1]]
    both = first.astype(bool).multiply(second.astype(bool))
    ways = (both.multiply(first) + both.multiply(second)).tocoo()
    result = np.full(len(pairs), np.inf)
    np.minimum.at(result, ways.coords[0], ways.data)
    return result


def _touching(
    owner: NDArray[Any], columns: int, nodes: NDArray[Any], clearance: NDArray[Any]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of nodes (m, 2) whose cells touch, and the cell there with most clearance (m,)."""
    parts = []
    for step in (1, columns):
        one, other = owner[:-step], owner[step:]
        cell = np.flatnonzero((one != other) & (one >= 0) & (other >= 0))
        parts.append(np.column_stack([cell, cell + step]))
    cells = np.vstack(parts)
    low, high = np.sort(owner[cells].astype(np.int64), axis=1).T
    key = low * len(nodes) + high
    is_node = nodes[owner[cells[:, 0]]] == cells[:, 0]
    at = np.where(is_node, cells[:, 1], cells[:, 0])
    order = np.lexsort((-clearance[at], key))
    key, first = np.unique(key[order], return_index=True)
    return np.column_stack(np.divmod(key, max(1, len(nodes)))), at[order][first]


def _merged(
    space: tuple[Any, ...], xy: NDArray[Any], pairs: NDArray[Any], within: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The nodes and lines without nodes that a near one replaces, as it sees their neighbours."""
    joined: list[set[int]] = [set() for _ in xy]
    for i, j in pairs.tolist():
        joined[i].add(j)
        joined[j].add(i)
    left = np.ones(len(xy), np.bool_)
    length = np.hypot(*(xy[pairs[:, 0]] - xy[pairs[:, 1]]).T)
    order = np.argsort(length, kind="stable")
    for i, j in pairs[order[length[order] < within]].tolist():
        if not (left[i] and left[j]) or len(joined[i]) + len(joined[j]) == 2:
            continue  # a piece of two nodes keeps both
        for stays, goes in ((i, j), (j, i)):
            others = joined[goes] - {stays}
            lines = [(stays, other) for other in sorted(others - joined[stays])]
            if np.isfinite(line_costs(*space, xy, np.array(lines, int).reshape(-1, 2))).all():
                left[goes], joined[goes] = False, set()
                joined[stays] = (joined[stays] | others) - {goes}
                for other in others:
                    joined[other] = (joined[other] | {stays}) - {goes}
                break
    number = np.cumsum(left) - 1
    ends = [(i, j) for i, others in enumerate(joined) for j in sorted(others) if i < j]
    return xy[left], number[np.array(ends, int).reshape(-1, 2)]


def _kept(
    space: tuple[Any, ...], xy: NDArray[Any], pairs: NDArray[Any], detour: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The pairs that make a spanner, and their cost [density x cells]."""
    cost = line_costs(*space, xy, pairs)
    cost[cost == 0] = np.inf  # Nav2 takes no edge of length 0
    order = np.argsort(cost, kind="stable")
    kept = np.sort(order[spanner(pairs[order], cost[order], len(xy), detour)])
    return pairs[kept], cost[kept]
