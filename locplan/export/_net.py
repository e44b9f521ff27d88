"""A fine net of straight, collision-free lines over the free space, which lanes are drawn from.

Nodes cover the free space, places of little degeneracy and much clearance first. Each owns the
cells around it; nodes whose cells touch but who see neither each other nor both a third close by
get one more between them, so that the net is as connected as the space. Of the lines between
nodes a spanner is kept, and nodes move to where the routes through them cost least.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan._kernels.route import cover, line_costs, moved, owners, spanner, uncrossed, usage
from locplan._util.progress import ProgressCallback
from locplan.costs import Costmap

CLEAR, MERGED, SHIFT, APART = 0.25, 0.5, 0.5, 0.25
"""Distances in spacings: the clearance that is enough, the greatest distance of nodes that are
merged, the greatest move of a node, and the least distance of neighbours after it."""
ASIDE = 1.5
"""Maximum length of the way over a third node, as a multiple of the straight line; a line that
crosses another is kept where the way around costs more than this."""
BAND = 1 << 20
"""Number of cells whose worth is computed at once, which bounds the memory."""
COVERED = 6
"""Number of rounds that add nodes, about."""

Positions = Floats
"""World positions (n, 2) [m]."""
Pairs = Ints
"""Pairs of nodes (m, 2)."""
Leave = Callable[[int], bool]
"""Whether a node may be taken away."""
Space = tuple[NDArray[Any], int, tuple[Any, ...]]
"""Half the density with its border, its columns, and the frame; see `locplan._kernels.route`."""


class Net(NamedTuple):
    """Nodes and the lines between them, each both ways."""

    xy: Positions
    """World positions (n, 2) [m]."""
    edges: Pairs
    """Pairs of nodes (m, 2)."""
    cost: Floats
    """Cost of each edge (m,) [density x cells]."""


def fine_net(
    costs: Costmap, space: Space, inside: Bools, spacing: float, progress: ProgressCallback
) -> Net:
    """A net whose nodes are about a spacing [m] apart, as connected as the cells inside."""
    reach = spacing / costs.grid.resolution
    xy, pairs = _cover(costs, space, inside, reach, progress)
    xy, pairs = merged(space, xy, pairs, MERGED * spacing)
    near = symmetric(pairs, np.ones(len(pairs)), len(xy))
    pairs = np.unique(np.vstack([pairs, np.column_stack((near @ near).tocoo().coords)]), axis=0)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]].astype(np.int64)
    progress(COVERED, COVERED + 2)
    # A line is left out where a way costs at most 1.05 times as much.
    net = spanned(space, xy, pairs, 1.05, spacing)
    progress(COVERED + 1, COVERED + 2)
    return spanned(space, relaxed(space, net, reach), pairs, 1.05, spacing)


def symmetric(pairs: NDArray[Any], values: NDArray[Any], count: int) -> csr_array:
    """The matrix (count, count) that holds the values both ways."""
    ends = np.concatenate([pairs, pairs[:, ::-1]]).T
    return csr_array(coo_array((np.tile(values, 2), tuple(ends)), shape=(count, count)))


def spanned(space: Space, xy: Positions, pairs: Pairs, detour: float, size: float) -> Net:
    """Of the pairs a spanner whose lines hardly cross, as connected as all of them."""
    cost = line_costs(*space, xy, pairs)
    cost[cost == 0] = np.inf  # Nav2 takes no edge of length 0
    order = np.argsort(cost, kind="stable")
    order = order[np.isfinite(cost[order])]
    plane = uncrossed(xy, pairs[order], size)
    first = order[plane]
    first = first[spanner(pairs[first], cost[first], len(xy), detour, 0)]
    both = np.concatenate([first, order[~plane]])
    kept = spanner(pairs[both], cost[both], len(xy), max(detour, ASIDE), len(first))
    chosen = np.sort(both[kept])
    return Net(xy, pairs[chosen], cost[chosen])


def relaxed(space: Space, net: Net, reach: float) -> Floats:
    """The nodes, moved to where the routes through them cost less."""
    graph = symmetric(net.edges, net.cost, len(net.xy))
    # Those between 32 nodes all over the net stand for all routes.
    starts = np.unique(np.linspace(0, len(net.xy) - 1, 32).astype(int))
    away, before = dijkstra(graph, indices=starts, return_predecessors=True)
    use = usage(np.argsort(away, kind="stable"), before, graph.indptr, graph.indices)
    xy: Positions
    xy = moved(*space, net.xy, graph.indptr, graph.indices, use, SHIFT * reach, APART * reach)
    return xy


def merged(
    space: Space, xy: Positions, pairs: Pairs, within: float | Floats, leave: Leave | None = None
) -> tuple[Positions, Pairs]:
    """The nodes and lines without nodes that a near one replaces, as it sees their neighbours.

    A node goes only if `leave`, which may take note of it, says so, or where there is none.
    """
    joined: list[set[int]] = [set() for _ in xy]
    for i, j in pairs.tolist():
        joined[i].add(j)
        joined[j].add(i)
    left = np.ones(len(xy), np.bool_)
    length = np.hypot(*(xy[pairs[:, 0]] - xy[pairs[:, 1]]).T)
    order = np.argsort(length, kind="stable")
    limit = np.broadcast_to(within, len(xy))[pairs].min(axis=1)
    for i, j in pairs[order[(length < limit)[order]]].tolist():
        if not (left[i] and left[j]) or len(joined[i]) + len(joined[j]) == 2:
            continue  # a piece of two nodes keeps both
        for stays, goes in ((i, j), (j, i)):
            others = joined[goes] - {stays}
            lines = [(stays, other) for other in sorted(others - joined[stays])]
            seen = np.isfinite(line_costs(*space, xy, np.array(lines, int).reshape(-1, 2))).all()
            if seen and (leave is None or leave(goes)):
                left[goes], joined[goes] = False, set()
                joined[stays] = (joined[stays] | others) - {goes}
                for other in others:
                    joined[other] = (joined[other] | {stays}) - {goes}
                break
    number = np.cumsum(left) - 1
    ends = [(i, j) for i, others in enumerate(joined) for j in sorted(others) if i < j]
    return xy[left], number[np.array(ends, int).reshape(-1, 2)]


def _cover(
    costs: Costmap, space: Space, inside: Bools, reach: float, progress: ProgressCallback
) -> tuple[Positions, Pairs]:
    """Nodes (n, 2) and free lines between them (m, 2) that join all connected cells."""
    flat, columns = inside.reshape(-1), inside.shape[1]
    clearance = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    clearance = clearance.reshape(-1)
    nodes = cover(flat, columns, _by_worth(space, flat, clearance, reach), reach)
    done = 0
    while True:
        done += 1
        progress(min(done, COVERED), COVERED + 2)
        row, col = np.divmod(nodes, columns)
        xy = np.column_stack(costs.grid.grid_to_world(row - 0.5, col - 0.5))
        xy = xy.astype(np.float32).astype(np.float64)
        pairs, between = _touching(owners(flat, columns, nodes), columns, nodes, clearance)
        seen = np.isfinite(line_costs(*space, xy, pairs))
        length = np.hypot(*(xy[pairs[:, 0]] - xy[pairs[:, 1]]).T)
        near = symmetric(pairs[seen], length[seen], len(nodes))
        missing = _shortest_by_two(near, pairs[~seen]) > ASIDE * length[~seen]
        if not missing.any():
            return xy, pairs[seen]
        nodes = np.concatenate([nodes, np.unique(between[~seen][missing])])


def _by_worth(space: Space, inside: Bools, clearance: NDArray[Any], reach: float) -> Ints:
    """The cells inside, those with little degeneracy and much clearance [cells] first."""
    cells = np.flatnonzero(inside)

    def worth(some: Ints) -> Floats:
        return np.asarray(np.minimum(clearance[some] / (CLEAR * reach), 1.0) - 2 * space[0][some])

    strips = [cells[first : first + BAND] for first in range(0, len(cells), BAND)]
    ends = np.array([(each.min(), each.max()) for each in map(worth, strips)])
    least, most = ends[:, 0].min(), ends[:, 1].max()
    # Numbers of 16 bits are sorted ten times as fast.
    scale = 65535 / max(most - least, 1e-9)
    steps = [(scale * (most - worth(strip))).astype(np.uint16) for strip in strips]
    return cells[np.argsort(np.concatenate(steps), kind="stable")]


def _shortest_by_two(graph: csr_array, pairs: NDArray[Any]) -> Floats:
    """The length of the shortest way over one node between, for each of the pairs."""
    first, second = graph[pairs[:, 0]], graph[pairs[:, 1]]
    both = first.astype(bool).multiply(second.astype(bool))
    ways = (both.multiply(first) + both.multiply(second)).tocoo()
    result = np.full(len(pairs), np.inf)
    np.minimum.at(result, ways.coords[0], ways.data)
    return result


def _touching(
    owner: NDArray[Any], columns: int, nodes: NDArray[Any], clearance: NDArray[Any]
) -> tuple[Ints, Ints]:
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
