"""Paths that run side by side, joined to ways over common nodes, and the costs that lead there.

Where the cheapest route of a query is another one than its way, a linear programme changes the
costs of edges as little as that takes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from locplan._support.kernels.arrays import Floats, Ints
from locplan.export.route_graph import Pairs, Positions, make_space
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path

MERGED = 2.0
"""Maximum distance of a lane that a way can join [m]."""
SAME = 0.01
"""Maximum distance of ends that are one place [m]."""
SPACING = 0.5
"""Maximum distance of the positions at which a way can join a lane [m]."""
COSTLIER = 1.1
"""Maximum cost of a way over the lanes of others, as a multiple of its own."""
MARGIN = 0.02
"""Minimum cost by which any other route exceeds a recommended way [m]."""

Ways = dict[str, list[int]]
"""The nodes of each way, from start to goal."""


class LineCosts:
    """The costs of straight lines on a map, also of those that graze blocked cells.

    A line is free, too, if it is a step `side_tolerance` [cells].
    """

    def __init__(self, costs: Costmap, side_tolerance: float = 0.0) -> None:
        from locplan._support.kernels.search import make_bordered_half

        self.resolution = costs.grid.resolution
        self.side_tolerance = side_tolerance * self.resolution
        _, *self.frame = make_space(costs)
        price = costs.unblocked_density
        priced = np.isfinite(price)
        self.density = np.where(priced, price, price[priced].max(initial=1.0))
        self.price = make_bordered_half(self.density, 1)
        self.blocked = make_bordered_half(np.where(np.isfinite(costs.density), 0.0, 1.0), 1)

    def costs(self, xy: Positions, pairs: Pairs) -> Floats:
        """J of the lines between pairs of positions [m]; infinite through what is blocked."""
        from locplan.export.kernels.route import line_costs

        within = line_costs(self.blocked, *self.frame, xy, pairs)
        # A twentieth of a cell counts as none: planned paths touch the corners of blocked cells,
        # and Nav2 keeps positions in single precision.
        grazed = 0.05
        if self.side_tolerance:
            blocked_lines = np.flatnonzero(within > grazed)
            ends = xy[pairs[blocked_lines]]
            along = ends[:, 1] - ends[:, 0]
            length = np.maximum(np.hypot(*along.T), 1e-9)[:, None]
            side_steps = self.side_tolerance * along[:, ::-1] * (1, -1) / length
            end_pairs = np.arange(2 * len(blocked_lines)).reshape(-1, 2)
            for shifted_ends in (ends - side_steps[:, None], ends + side_steps[:, None]):
                shifted_lines = shifted_ends.reshape(-1, 2), end_pairs
                shifted_costs = line_costs(self.blocked, *self.frame, *shifted_lines)
                within[blocked_lines] = np.minimum(within[blocked_lines], shifted_costs)
        price = line_costs(self.price, *self.frame, xy, pairs)
        return np.where(within <= grazed, price * self.resolution, np.inf)

    def integrals(self, layer: Floats, xy: Positions, pairs: Pairs) -> Floats:
        """Integral of a layer along the lines between pairs of positions; NaN without a layer."""
        from locplan._support.kernels.search import make_bordered_half
        from locplan.export.kernels.route import line_costs

        if np.isnan(layer).all():
            return np.full(len(pairs), np.nan)
        half = make_bordered_half(np.nan_to_num(layer), 1)
        return np.asarray(line_costs(half, *self.frame, xy, pairs)) * self.resolution

    def compute_chain_costs(self, xy: Positions) -> Floats:
        """J of the lines from each position to the next [m]."""
        return self.costs(xy, np.column_stack([np.arange(len(xy) - 1), np.arange(1, len(xy))]))


def join_paths(lines: LineCosts, paths: Mapping[str, Path]) -> tuple[Positions, Ways]:
    """Nodes, and each path's way over them; a path takes the lanes of those before it.

    The longest path comes first, since it is most likely to be the lane of others. The next ones
    take the cheapest way over their own positions and over the lanes beside them.
    """
    nodes = np.empty((0, 2))
    ways: Ways = {}
    for name in sorted(paths, key=lambda name: -paths[name].length):
        lanes = np.array([two for way in ways.values() for two in pairwise(way)], int)
        nodes, way = _add_path(lines, nodes, lanes.reshape(-1, 2), divide_path(paths[name]))
        for other in ways.values():
            way = _share_way(lines, nodes, way, other)
        ways[name] = way
    return nodes, {name: ways[name] for name in paths}


def _share_way(
    lines: LineCosts, nodes: Positions, way: list[int], other: Sequence[int]
) -> list[int]:
    """The way, which takes that of another one between nodes of both where it is close and cheap.

    A graph has one cheapest route between two nodes, so that different ways would contradict.
    """
    common = [node for node in way if node in other]
    if len(common) < 2:
        return way
    (a, b), (i, j) = (
        [node_list.index(common[k]) for k in (0, -1)] for node_list in (way, list(other))
    )
    way_part, other_part = (
        way[a : b + 1],
        list(other[i : j + 1] if i < j else other[j : i + 1][::-1]),
    )
    limit = COSTLIER * lines.compute_chain_costs(nodes[way_part]).sum()
    if (
        way_part == other_part
        or lines.compute_chain_costs(nodes[other_part]).sum() > limit
        or are_apart(nodes, way_part, other_part)
    ):
        return way
    return _remove_loops(way[:a] + other_part + way[b + 1 :])


def are_apart(nodes: Positions, way: Sequence[int], other: Sequence[int]) -> bool:
    """Whether two ways lie farther apart than ways that are one."""
    first_xy, second_xy = (
        Path(nodes[list(node_list)]).resample(SPACING).xy for node_list in (way, other)
    )
    distances = np.hypot(*(first_xy[:, None] - second_xy[None]).transpose(2, 0, 1))
    return bool(max(distances.min(axis=0).max(), distances.min(axis=1).max()) > MERGED)


def _remove_loops(way: Sequence[int]) -> list[int]:
    """A way that comes to no node twice, as a server's routes do."""
    result: dict[int, None] = {}
    for node in way:
        while node in result:
            result.popitem()
        result[node] = None
    return list(result)


def _find_first_equal(xy: Positions) -> Ints:
    """The number of the first position that is one place with each."""
    from scipy.spatial import cKDTree

    first = np.arange(len(xy))
    pairs = cKDTree(xy).query_pairs(SAME, output_type="ndarray")
    np.minimum.at(first, pairs[:, 1], pairs[:, 0])
    return first


def _add_path(
    lines: LineCosts, nodes: Positions, lanes: Pairs, xy: Positions
) -> tuple[Positions, list[int]]:
    """The nodes with those that a path adds to them, and its way."""
    from scipy.sparse import coo_array

    old = len(nodes)
    all_nodes = np.concatenate([nodes, xy])
    position_nodes = old + _find_first_equal(
        xy
    )  # the number of each position, an old one where it is there
    links = np.empty((0, 2), int)
    if old:
        distances = np.hypot(*(nodes[:, None] - xy[None]).transpose(2, 0, 1))
        is_node = distances.min(axis=0) <= SAME
        position_nodes[is_node] = distances.argmin(axis=0)[is_node]
        is_near = distances.min(axis=1) <= MERGED
        lanes = lanes[is_near[lanes].all(axis=1)]
        link = np.argwhere((distances <= 3.0) & is_near[:, None])  # [m]
        links = np.column_stack([link[:, 0], position_nodes[link[:, 1]]])
    chain = np.column_stack([position_nodes[:-1], position_nodes[1:]])
    pairs = np.concatenate([chain, links, lanes])
    cost = lines.costs(all_nodes, pairs)
    cost[len(chain) + len(links) :] /= 2  # lanes are cheaper for further ways, which then take them
    usable = np.isfinite(cost) & (pairs[:, 0] != pairs[:, 1])
    pairs, order = np.unique(np.sort(pairs[usable], axis=1)[::-1], axis=0, return_index=True)
    graph = coo_array(
        (cost[usable][::-1][order], pairs.T), shape=(len(all_nodes), len(all_nodes))
    ).tocsr()
    way = _find_cheapest_route(
        graph, int(position_nodes[0]), int(position_nodes[-1]), directed=False
    )
    direct_way = _remove_loops(position_nodes.tolist())
    if (
        lines.compute_chain_costs(all_nodes[way]).sum()
        > COSTLIER * lines.compute_chain_costs(all_nodes[direct_way]).sum()
    ):
        way = direct_way
    added = sorted(node for node in way if node >= old)
    number = {node: old + n for n, node in enumerate(added)}
    return np.concatenate([nodes, all_nodes[added]]), [number.get(node, node) for node in way]


def divide_path(path: Path) -> Positions:
    """The corners of a path, and positions between them, in the single precision of Nav2."""
    between = np.arange(0.0, path.length, SPACING)
    at = np.union1d(path.distance, between)
    at = at[np.concatenate([[True], np.diff(at) > SAME])]
    at[-1] = path.length
    xy = np.stack([np.interp(at, path.distance, v) for v in path.xy.T], axis=1)
    return xy.astype(np.float32).astype(np.float64)


def straighten_ways(lines: LineCosts, nodes: Positions, ways: Ways) -> tuple[Positions, Ways]:
    """Nodes and ways without the nodes that a straight line makes needless.

    Ends and nodes where ways part stay, and no way moves farther than `SPACING`.
    """
    neighbours: dict[int, set[int]] = {}
    for way in ways.values():
        for first, second in pairwise(way):
            neighbours.setdefault(first, set()).add(second)
            neighbours.setdefault(second, set()).add(first)
    ends = {end for way in ways.values() for end in (way[0], way[-1])}
    replaced: dict[frozenset[int], list[int]] = {}  # the nodes that a line stands for, by its ends
    for node in sorted(neighbours):
        if node in ends or len(neighbours[node]) != 2:
            continue
        first, second = sorted(neighbours[node])
        replaced_nodes = [node, *replaced.get(frozenset((first, node)), [])]
        replaced_nodes += replaced.get(frozenset((node, second)), [])
        if (
            second in neighbours[first]
            or _measure_offset(nodes[[first, second]], nodes[replaced_nodes]) > SPACING
        ):
            continue
        pairs = np.array([(first, node), (node, second), (first, second)])
        before, after, straight = lines.costs(nodes, pairs)
        if straight <= 1.001 * (before + after):
            replaced[frozenset((first, second))] = replaced_nodes
            neighbours[first] = neighbours[first] - {node} | {second}
            neighbours[second] = neighbours[second] - {node} | {first}
            del neighbours[node]
    left = sorted(neighbours)
    number = {node: n for n, node in enumerate(left)}
    shorter_ways = {name: [number[n] for n in way if n in number] for name, way in ways.items()}
    return nodes[left], shorter_ways


def _measure_offset(ends: Positions, xy: Positions) -> Any:
    """Maximum distance of positions from the line between two."""
    along = ends[1] - ends[0]
    offsets = xy - ends[0]
    across = along[0] * offsets[:, 1] - along[1] * offsets[:, 0]
    return np.abs(across).max() / max(np.hypot(*along), 1e-9)


def adjust_costs(
    nodes: Floats,
    edges: Pairs,
    price: Floats,
    min_costs: Floats,
    ways: list[list[int]],
    worth: Floats,
) -> tuple[Floats, list[bool]]:
    """Costs of edges by which the cheapest routes are given ways, and for which of them they are.

    The sum of the changes is the least there is. Not all ways are followed where they contradict
    one another, such as two ways between the same nodes. A route that is not `are_apart` from a way
    counts as that way.

    Parameters
    ----------
    nodes : (n, 2) array
        World positions [m].
    edges : (m, 2) array of int
        Pairs of nodes, from the first to the second.
    price, min_costs : (m,) arrays
        The costs as they should be, and their lower bounds.
    ways : sequence of sequences of int
        The nodes of each way.
    worth : (ways,) array
        What each way is worth, in changed costs, where not all can be followed.
    """
    index = {(i, j): n for n, (i, j) in enumerate(edges.tolist())}

    def mark_edges(ways: list[list[int]]) -> Floats:
        """1 for the edges of each way, (ways, edges)."""
        used = np.zeros((len(ways), len(edges)))
        for row, way in zip(used, ways, strict=True):
            row[[index[two] for two in pairwise(way)]] = 1
        return used

    cost, used = price, mark_edges(ways)
    excess, way_numbers = (
        np.empty((0, len(edges))),
        np.empty(0, int),
    )  # a way's edges less a route's
    for _ in range(50):
        routes = {
            n: route
            for n, route in enumerate(_find_cheapest_routes(edges, cost, used, ways))
            if are_apart(nodes, ways[n], route)
        }
        numbers = np.array(list(routes), int)
        extra_edges = used[numbers] - mark_edges([*routes.values()])
        new = zip(numbers, extra_edges, strict=True)
        if all((excess[way_numbers == n] == row).all(axis=1).any() for n, row in new):
            break
        way_numbers, excess = (
            np.concatenate([way_numbers, numbers]),
            np.vstack([excess, extra_edges]),
        )
        cost = _solve_costs(price, min_costs, excess, way_numbers, worth)
    return cost, [n not in routes for n in range(len(ways))]


def _find_cheapest_routes(
    edges: Pairs, cost: Floats, used: Floats, ways: Sequence[Sequence[int]]
) -> Iterator[list[int]]:
    """The nodes of the cheapest route between the ends of each way."""
    from scipy.sparse import csr_array

    count = int(edges.max()) + 1
    for way, way_edges in zip(ways, used, strict=True):
        costlier = (
            cost + way_edges * MARGIN / 2 / way_edges.sum()
        )  # a tie would be followed by chance only
        graph = csr_array((costlier, edges.T), shape=(count, count))
        yield _find_cheapest_route(graph, way[0], way[-1])


def _find_cheapest_route(graph: Any, start: int, goal: int, directed: bool = True) -> list[int]:
    """The nodes of the cheapest route in a sparse matrix of costs."""
    from scipy.sparse.csgraph import dijkstra

    before = dijkstra(graph, directed, start, return_predecessors=True)[1]
    route = [goal]
    while route[-1] != start:
        route.append(int(before[route[-1]]))
    return route[::-1]


def _solve_costs(
    price: Floats, min_costs: Floats, excess: Floats, way_numbers: Ints, weights: Floats
) -> Floats:
    """The costs nearest to `price` with ``excess @ cost <= -MARGIN``, but for contradictions.

    The unknowns are the costs, their changes, and by how much each way misses its margin.
    """
    from scipy.optimize import linprog
    from scipy.sparse import block_array, csr_array, eye_array

    edges, identity = len(price), eye_array(len(price))
    missed = csr_array((way_numbers[:, None] == np.arange(len(weights))).astype(float))
    changes = [[identity, -identity, None], [-identity, -identity, None]]
    limits = block_array([[csr_array(excess), None, -missed], *changes])
    solution = linprog(
        np.concatenate([np.zeros(edges), np.ones(edges), weights]),
        limits,
        np.concatenate([np.full(len(way_numbers), -MARGIN), price, -price]),
        bounds=[(low, None) for low in min_costs] + [(0, None)] * (edges + len(weights)),
    )
    return np.asarray(np.maximum(solution.x[:edges], min_costs))
