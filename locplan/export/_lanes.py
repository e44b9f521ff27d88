"""Lanes over the free space: few, long and straight lines that routes cost little more over.

Lanes are drawn from a fine net. Places all over it are joined by the cheapest
routes, the farthest ones first; what is no lane yet costs a little more, so that routes take the
lanes there are. Lanes are added to where free space sees none, and where a gap between two makes a
long detour. At last lines that others nearly replace are left out, close nodes are merged, bends
that save nothing are straightened, and nodes move to where the routes through them cost least.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan._kernels.route import line_cost, line_costs, sights, spanner, uncrossed
from locplan._util.progress import ProgressCallback
from locplan.export._net import MERGED, Net, Positions, Space, merged, relaxed, spanned, symmetric

SEEN, KEPT, NEAR, LONGEST = 2.0, 2.5, 4.0, 4.0
"""Distances in spacings: from which free space sees a node at first and in the end, of nodes that
are joined if that spares a detour, and the greatest length of an edge that straightening makes."""
ROOM, CLOSE = 0.5, 1.5
"""Nodes that are closer than this share of their clearance, or this many spacings, are merged."""
ROOMY = CLOSE / ROOM
"""Clearance from which on more makes no difference [spacings]."""
GAP = 1.8
"""A gap between lanes is closed where the way around costs more than this many times as much."""
ROUNDS = 4
"""Number of rounds of thinning, straightening and moving."""


def lanes(
    space: Space,
    net: Net,
    places: Ints,
    points: Positions,
    clearance: Callable[[Floats], Floats],
    spacing: float,
    detour: float,
    progress: ProgressCallback,
) -> Net:
    """The lanes between places, nodes of the net, so that nearly all points see a node.

    A clearance [m] of `ROOMY` spacings or more may be infinite.
    """
    if len(net.edges) == 0:
        return Net(net.xy[:0], net.edges, net.cost)
    reach = spacing * math.hypot(*space[2][:2])
    chosen = _routes(
        net, places, detour, lambda done, total: progress(ROUNDS * done // total, 2 * ROUNDS)
    )
    _look_everywhere(space, net, chosen, points, SEEN * spacing)
    _close_gaps(net, chosen)
    drawn = _without_unused(Net(net.xy, net.edges[chosen], net.cost[chosen]))
    for n in range(ROUNDS):
        progress(ROUNDS + n, 2 * ROUNDS)
        drawn = spanned(space, drawn.xy, drawn.edges, detour, spacing)
        view = View(space, points, drawn.xy, KEPT * spacing)
        room = np.minimum(ROOM * clearance(drawn.xy), CLOSE * spacing)
        close = np.maximum(MERGED * spacing, room)
        xy, edges = merged(space, drawn.xy, drawn.edges, close, view.leave)
        drawn = spanned(space, xy, edges, detour, spacing)
        view = View(space, points, drawn.xy, KEPT * spacing)
        drawn = _without_unused(_straightened(space, drawn, view, LONGEST * spacing))
        drawn = drawn._replace(xy=relaxed(space, drawn, reach))
    drawn = _without_unused(spanned(space, drawn.xy, drawn.edges, detour, spacing))
    drawn = _with_spurs(space, drawn, net.xy, points, LONGEST * spacing)
    return _joined(space, drawn, NEAR * spacing, spacing)


def _with_spurs(space: Space, drawn: Net, ends: Positions, points: Positions, within: float) -> Net:
    """The net with lines to ends that are seen by points which see no node."""
    added = _most_seen(space, points, drawn.xy, ends, within)
    count = len(drawn.xy)
    xy = np.vstack([drawn.xy, ends[added]])
    lines = sights(*space, ends[added], drawn.xy, within, count)
    lines = np.column_stack([lines[:, 1], count + lines[:, 0]])
    cost = line_costs(*space, xy, lines)
    order = np.lexsort((cost, lines[:, 1]))
    _, first = np.unique(lines[order, 1], return_index=True)
    least = order[first][cost[order[first]] > 0]
    edges = np.vstack([drawn.edges, lines[least]]).astype(np.int64)
    return _without_unused(Net(xy, edges, np.concatenate([drawn.cost, cost[least]])))


def _most_seen(
    space: Space, points: Positions, xy: Positions, others: Positions, within: float
) -> Ints:
    """Of other nodes those that all points see one of which see none yet, by most first."""
    unseen = np.ones(len(points), np.bool_)
    unseen[sights(*space, points, xy, within, 1)[:, 0]] = False
    pairs = sights(*space, points[unseen], others, within, len(others))
    found = []
    while len(pairs):
        found.append(int(np.argmax(np.bincount(pairs[:, 1]))))
        done = pairs[pairs[:, 1] == found[-1], 0]
        pairs = pairs[~np.isin(pairs[:, 0], done)]
    return np.array(found, np.int64)


def _joined(space: Space, net: Net, within: float, size: float) -> Net:
    """The net with lines between near nodes that spare a long detour and cross no other."""
    near = cKDTree(net.xy).query_pairs(within, output_type="ndarray")
    near = near[np.lexsort(near.T[::-1])]
    cost = line_costs(*space, net.xy, near)
    order = np.argsort(cost, kind="stable")
    order = order[(cost[order] > 0) & np.isfinite(cost[order])]
    pairs = np.vstack([net.edges, near[order]]).astype(np.int64)
    cost = np.concatenate([net.cost, cost[order]])
    sure = len(net.edges)
    plane = uncrossed(net.xy, pairs, size)
    plane[:sure] = True
    pairs, cost = pairs[plane], cost[plane]
    kept = spanner(pairs, cost, len(net.xy), GAP, sure)
    return Net(net.xy, pairs[kept], cost[kept])


class View:
    """Points that see nodes, and which nodes may leave without one of them seeing none."""

    def __init__(self, space: Space, points: Positions, xy: Positions, within: float) -> None:
        pairs = sights(*space, points, xy, within, 4)  # a point is known to see four at most
        self._nodes_seen = np.bincount(pairs[:, 0], minlength=len(points))
        order = np.argsort(pairs[:, 1], kind="stable")
        ends = np.cumsum(np.bincount(pairs[:, 1], minlength=len(xy)))
        self._points = np.split(pairs[order, 0], ends[:-1])

    def leave(self, node: int) -> bool:
        """Take a node away, unless a point sees no other."""
        points = self._points[node]
        if (self._nodes_seen[points] == 1).any():
            return False
        self._nodes_seen[points] -= 1
        return True


class _Weighted:
    """A net's matrix whose values are set by edge."""

    def __init__(self, net: Net) -> None:
        numbered = symmetric(net.edges, np.arange(len(net.edges)) + 1.0, len(net.xy))
        self._edge = numbered.data.astype(np.int64) - 1
        self._indptr, self._indices = numbered.indptr, numbered.indices
        self._count = len(net.xy)
        row = np.repeat(np.arange(self._count), np.diff(self._indptr))
        self._key = row * self._count + self._indices

    def matrix(self, values: Floats) -> csr_array:
        shape = self._count, self._count
        return csr_array((values[self._edge], self._indices, self._indptr), shape=shape)

    def back(self, before: NDArray[Any], nodes: NDArray[Any]) -> Ints:
        """The edges of the ways back from nodes, by the node before each."""
        passed = set()
        for node in nodes.tolist():
            while before[node] >= 0 and node not in passed:
                passed.add(node)
                node = int(before[node])
        ends = np.array(sorted(passed), np.int64)
        return np.asarray(self._edge[np.searchsorted(self._key, ends * self._count + before[ends])])


def _routes(net: Net, places: Ints, detour: float, progress: ProgressCallback) -> Bools:
    """True for the edges of lanes over which places are at most about a detour from each other."""
    weighted = _Weighted(net)
    graph = weighted.matrix(net.cost)
    chosen = np.zeros(len(net.edges), np.bool_)
    share = (1 + detour) / 2
    nearest = np.full(len(places), np.inf)  # to a place before; negative where it is one
    while (nearest >= 0).any():
        progress(int((nearest < 0).sum()), len(places))
        place = int(np.argmax(nearest))
        start, limit = places[place], 4 * nearest[place]  # it is joined to those within that
        away = dijkstra(graph, indices=start, limit=limit)
        lanes_alone = weighted.matrix(np.where(chosen, net.cost, np.inf))
        over = dijkstra(lanes_alone, indices=start, limit=2 * limit)
        nearest = np.minimum(nearest, away[places])
        nearest[place] = -1
        long = over[places] > detour * away[places] * (1 + 1e-9)
        far = places[long & np.isfinite(away[places])]
        if len(far):
            costlier = weighted.matrix(np.where(chosen, net.cost, share * net.cost))
            _, before = dijkstra(costlier, indices=start, return_predecessors=True, limit=2 * limit)
            chosen[weighted.back(before, far)] = True
    _, piece = connected_components(graph, directed=False)
    of_edge = piece[net.edges[:, 0]]
    return chosen | ~np.isin(of_edge, of_edge[chosen])  # pieces with one place are small


def _look_everywhere(
    space: Space, net: Net, chosen: Bools, points: Positions, within: float
) -> None:
    """Add lanes to nodes that are seen by points which see no node of a lane, by most first."""
    weighted = _Weighted(net)
    on = np.unique(net.edges[chosen])
    graph = weighted.matrix(net.cost)
    _, before, _ = dijkstra(graph, indices=on, min_only=True, return_predecessors=True)
    added = _most_seen(space, points, net.xy[on], net.xy, within)
    chosen[weighted.back(before, added)] = True


def _close_gaps(net: Net, chosen: Bools) -> None:
    """Add edges between lanes, and the ways to them, that spare a long detour."""
    weighted, on = _Weighted(net), np.unique(net.edges[chosen])
    away, before, lane = dijkstra(
        weighted.matrix(net.cost), indices=on, min_only=True, return_predecessors=True
    )
    rest = np.flatnonzero(~chosen & (lane[net.edges] >= 0).all(axis=1))
    cost = net.cost[rest] + away[net.edges[rest]].sum(axis=1)
    order = np.argsort(cost, kind="stable")
    sure = int(chosen.sum())
    pairs = np.vstack([net.edges[chosen], lane[net.edges[rest[order]]]]).astype(np.int64)
    costs = np.concatenate([net.cost[chosen], cost[order]])
    kept = spanner(pairs, costs, len(net.xy), GAP, sure)[sure:]
    closing = rest[order[kept]]
    chosen[closing] = True
    chosen[weighted.back(before, net.edges[closing].ravel())] = True


def _without_unused(net: Net) -> Net:
    """The net without nodes that have no edge."""
    used = np.unique(net.edges)
    return net._replace(xy=net.xy[used], edges=np.searchsorted(used, net.edges))


def _straightened(space: Space, net: Net, view: View, longest: float) -> Net:
    """The net without nodes between two edges that one line replaces, the shortest lines first."""
    joined: list[dict[int, float]] = [{} for _ in net.xy]
    for (i, j), cost in zip(net.edges.tolist(), net.cost.tolist(), strict=True):
        joined[i][j] = joined[j][i] = cost

    def line(node: int) -> tuple[float, int]:
        one, other = joined[node]
        return math.dist(net.xy[one], net.xy[other]), node

    lines = [line(node) for node, ends in enumerate(joined) if len(ends) == 2]
    heapq.heapify(lines)
    while lines:
        length, node = heapq.heappop(lines)
        if len(joined[node]) != 2 or line(node)[0] != length or length > longest:
            continue
        (one, before), (other, after) = joined[node].items()
        if other in joined[one]:
            continue
        cost = line_cost(*space, net.xy[one], net.xy[other])
        if not 0 < cost <= 1.01 * (before + after) or not view.leave(node):
            continue
        joined[node] = {}
        del joined[one][node], joined[other][node]
        joined[one][other] = joined[other][one] = cost
        for end in (one, other):
            if len(joined[end]) == 2:
                heapq.heappush(lines, line(end))
    ends = [(i, j, cost) for i, to in enumerate(joined) for j, cost in sorted(to.items()) if i < j]
    left = np.array(ends).reshape(-1, 3)
    return net._replace(edges=left[:, :2].astype(np.int64), cost=left[:, 2].copy())
