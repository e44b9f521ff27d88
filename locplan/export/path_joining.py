"""Routes over common nodes for paths that run side by side, and edge costs that select them.

If the cheapest route of a query is not the recommended one, a linear programme changes the costs
of edges as little as possible.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from locplan._support.kernels.arrays import Floats, Ints
from locplan.export.route_graph import Pairs, Positions, make_graph_space
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path

MAX_LANE_DISTANCE = 2.0
"""Maximum distance of a lane that a route joins [m]."""
SAME_PLACE_DISTANCE = 0.01
"""Maximum distance of positions that count as the same place [m]."""
JOIN_SPACING = 0.5
"""Maximum distance between positions at which a route can join a lane [m]."""
MAX_COST_RATIO = 1.1
"""Maximum cost of a route over existing lanes, as a multiple of the cost of its path."""
MIN_COST_MARGIN = 0.02
"""Minimum extra cost of any other route over a recommended route [m]."""

NodeRoutes = dict[str, list[int]]
"""The nodes of each route by name, from start to goal."""


class LineCosts:
    """Calculator of the costs of straight lines on a map, including lines that graze blocked cells.

    A line also counts as free if it is free after a shift to the side by `side_tolerance` [cells].
    """

    def __init__(self, costs: Costmap, side_tolerance: float = 0.0) -> None:
        from locplan._support.kernels.search import make_bordered_half_density

        self.resolution = costs.grid.resolution
        self.side_tolerance = side_tolerance * self.resolution
        _, *self.frame = make_graph_space(costs)
        price = costs.unblocked_density
        priced = np.isfinite(price)
        self.density = np.where(priced, price, price[priced].max(initial=1.0))
        self.price = make_bordered_half_density(self.density, 1)
        self.blocked = make_bordered_half_density(np.where(np.isfinite(costs.density), 0.0, 1.0), 1)

    def compute_costs(self, xy: Positions, pairs: Pairs) -> Floats:
        """Return J of the lines between pairs of positions [m]; infinite through blocked cells."""
        from locplan.export.kernels.route import integrate_line_costs

        blocked_length = integrate_line_costs(self.blocked, *self.frame, xy, pairs)
        # A twentieth of a cell is tolerated: planned paths touch the corners of blocked cells, and
        # Nav2 stores positions in single precision.
        max_blocked = 0.05
        if self.side_tolerance:
            blocked_lines = np.flatnonzero(blocked_length > max_blocked)
            ends = xy[pairs[blocked_lines]]
            along = ends[:, 1] - ends[:, 0]
            length = np.maximum(np.hypot(*along.T), 1e-9)[:, None]
            side_steps = self.side_tolerance * along[:, ::-1] * (1, -1) / length
            end_pairs = np.arange(2 * len(blocked_lines)).reshape(-1, 2)
            for shifted_ends in (ends - side_steps[:, None], ends + side_steps[:, None]):
                shifted_lines = shifted_ends.reshape(-1, 2), end_pairs
                shifted_costs = integrate_line_costs(self.blocked, *self.frame, *shifted_lines)
                blocked_length[blocked_lines] = np.minimum(
                    blocked_length[blocked_lines], shifted_costs
                )
        price = integrate_line_costs(self.price, *self.frame, xy, pairs)
        return np.where(blocked_length <= max_blocked, price * self.resolution, np.inf)

    def integrate_layer(self, layer: Floats, xy: Positions, pairs: Pairs) -> Floats:
        """Return the integral of a layer along lines between positions; NaN without a layer."""
        from locplan._support.kernels.search import make_bordered_half_density
        from locplan.export.kernels.route import integrate_line_costs

        if np.isnan(layer).all():
            return np.full(len(pairs), np.nan)
        half = make_bordered_half_density(np.nan_to_num(layer), 1)
        return np.asarray(integrate_line_costs(half, *self.frame, xy, pairs)) * self.resolution

    def compute_polyline_costs(self, xy: Positions) -> Floats:
        """Return J of the lines from each position to the next [m]."""
        return self.compute_costs(
            xy, np.column_stack([np.arange(len(xy) - 1), np.arange(1, len(xy))])
        )


def join_paths(lines: LineCosts, paths: Mapping[str, Path]) -> tuple[Positions, NodeRoutes]:
    """Return nodes and a route over them for each path; paths share lanes if they run side by side.

    The longest path comes first, since other paths are most likely to share it. Each next path
    takes the cheapest route over its positions and over nearby lanes.
    """
    nodes = np.empty((0, 2))
    routes: NodeRoutes = {}
    for name in sorted(paths, key=lambda name: -paths[name].length):
        lanes = np.array([two for route in routes.values() for two in pairwise(route)], int)
        nodes, route = _add_path(lines, nodes, lanes.reshape(-1, 2), subdivide_path(paths[name]))
        for other in routes.values():
            route = _reuse_route(lines, nodes, route, other)
        routes[name] = route
    return nodes, {name: routes[name] for name in paths}


def _reuse_route(
    lines: LineCosts, nodes: Positions, route: list[int], other_route: Sequence[int]
) -> list[int]:
    """Return the route, changed to another one between common nodes if that is close and cheap.

    A graph has one cheapest route between two nodes, so different routes would contradict each
    other.
    """
    common = [node for node in route if node in other_route]
    if len(common) < 2:
        return route
    (a, b), (i, j) = (
        [node_list.index(common[k]) for k in (0, -1)] for node_list in (route, list(other_route))
    )
    route_part, other_part = (
        route[a : b + 1],
        list(other_route[i : j + 1] if i < j else other_route[j : i + 1][::-1]),
    )
    limit = MAX_COST_RATIO * lines.compute_polyline_costs(nodes[route_part]).sum()
    if (
        route_part == other_part
        or lines.compute_polyline_costs(nodes[other_part]).sum() > limit
        or are_routes_apart(nodes, route_part, other_part)
    ):
        return route
    return _remove_loops(route[:a] + other_part + route[b + 1 :])


def are_routes_apart(nodes: Positions, route: Sequence[int], other_route: Sequence[int]) -> bool:
    """True if two routes are too far apart to be merged."""
    first_xy, second_xy = (
        Path(nodes[list(node_list)]).resample(JOIN_SPACING).xy for node_list in (route, other_route)
    )
    distances = np.hypot(*(first_xy[:, None] - second_xy[None]).transpose(2, 0, 1))
    return bool(max(distances.min(axis=0).max(), distances.min(axis=1).max()) > MAX_LANE_DISTANCE)


def _remove_loops(route: Sequence[int]) -> list[int]:
    """Return a route that visits no node twice, like a server's routes."""
    result: dict[int, None] = {}
    for node in route:
        while node in result:
            result.popitem()
        result[node] = None
    return list(result)


def _find_coincident_positions(xy: Positions) -> Ints:
    """Return for each position the index of the first position at the same place."""
    from scipy.spatial import cKDTree

    first = np.arange(len(xy))
    pairs = cKDTree(xy).query_pairs(SAME_PLACE_DISTANCE, output_type="ndarray")
    np.minimum.at(first, pairs[:, 1], pairs[:, 0])
    return first


def _add_path(
    lines: LineCosts, nodes: Positions, lanes: Pairs, xy: Positions
) -> tuple[Positions, list[int]]:
    """Return the nodes, including new ones of a path, and the route of the path."""
    from scipy.sparse import coo_array

    old = len(nodes)
    all_nodes = np.concatenate([nodes, xy])
    position_nodes = old + _find_coincident_positions(xy)
    links = np.empty((0, 2), int)
    if old:
        distances = np.hypot(*(nodes[:, None] - xy[None]).transpose(2, 0, 1))
        is_node = distances.min(axis=0) <= SAME_PLACE_DISTANCE
        position_nodes[is_node] = distances.argmin(axis=0)[is_node]
        is_near = distances.min(axis=1) <= MAX_LANE_DISTANCE
        lanes = lanes[is_near[lanes].all(axis=1)]
        link = np.argwhere((distances <= 3.0) & is_near[:, None])  # [m]
        links = np.column_stack([link[:, 0], position_nodes[link[:, 1]]])
    chain = np.column_stack([position_nodes[:-1], position_nodes[1:]])
    pairs = np.concatenate([chain, links, lanes])
    cost = lines.compute_costs(all_nodes, pairs)
    cost[len(chain) + len(links) :] /= 2  # lanes are cheaper, so that later paths use them
    usable = np.isfinite(cost) & (pairs[:, 0] != pairs[:, 1])
    pairs, order = np.unique(np.sort(pairs[usable], axis=1)[::-1], axis=0, return_index=True)
    graph = coo_array(
        (cost[usable][::-1][order], pairs.T), shape=(len(all_nodes), len(all_nodes))
    ).tocsr()
    route = _find_cheapest_route(
        graph, int(position_nodes[0]), int(position_nodes[-1]), directed=False
    )
    direct_route = _remove_loops(position_nodes.tolist())
    if (
        lines.compute_polyline_costs(all_nodes[route]).sum()
        > MAX_COST_RATIO * lines.compute_polyline_costs(all_nodes[direct_route]).sum()
    ):
        route = direct_route
    added = sorted(node for node in route if node >= old)
    number = {node: old + n for n, node in enumerate(added)}
    return np.concatenate([nodes, all_nodes[added]]), [number.get(node, node) for node in route]


def subdivide_path(path: Path) -> Positions:
    """Return the corners of a path and positions between them, in Nav2's single precision."""
    between = np.arange(0.0, path.length, JOIN_SPACING)
    at = np.union1d(path.distance, between)
    at = at[np.concatenate([[True], np.diff(at) > SAME_PLACE_DISTANCE])]
    at[-1] = path.length
    xy = np.stack([np.interp(at, path.distance, v) for v in path.xy.T], axis=1)
    return xy.astype(np.float32).astype(np.float64)


def straighten_routes(
    lines: LineCosts, nodes: Positions, routes: NodeRoutes
) -> tuple[Positions, NodeRoutes]:
    """Return nodes and routes without nodes that a straight line can replace.

    Ends and branching nodes stay, and no route moves farther than `JOIN_SPACING`.
    """
    neighbours: dict[int, set[int]] = {}
    for route in routes.values():
        for first, second in pairwise(route):
            neighbours.setdefault(first, set()).add(second)
            neighbours.setdefault(second, set()).add(first)
    ends = {end for route in routes.values() for end in (route[0], route[-1])}
    replaced: dict[frozenset[int], list[int]] = {}  # the nodes that a line replaces, by its ends
    for node in sorted(neighbours):
        if node in ends or len(neighbours[node]) != 2:
            continue
        first, second = sorted(neighbours[node])
        replaced_nodes = [node, *replaced.get(frozenset((first, node)), [])]
        replaced_nodes += replaced.get(frozenset((node, second)), [])
        if (
            second in neighbours[first]
            or _measure_max_offset(nodes[[first, second]], nodes[replaced_nodes]) > JOIN_SPACING
        ):
            continue
        pairs = np.array([(first, node), (node, second), (first, second)])
        before, after, straight = lines.compute_costs(nodes, pairs)
        if straight <= 1.001 * (before + after):
            replaced[frozenset((first, second))] = replaced_nodes
            neighbours[first] = neighbours[first] - {node} | {second}
            neighbours[second] = neighbours[second] - {node} | {first}
            del neighbours[node]
    left = sorted(neighbours)
    number = {node: n for n, node in enumerate(left)}
    shorter_routes = {
        name: [number[n] for n in route if n in number] for name, route in routes.items()
    }
    return nodes[left], shorter_routes


def _measure_max_offset(ends: Positions, xy: Positions) -> Any:
    """Return the maximum distance of positions from the line between two ends."""
    along = ends[1] - ends[0]
    offsets = xy - ends[0]
    across = along[0] * offsets[:, 1] - along[1] * offsets[:, 0]
    return np.abs(across).max() / max(np.hypot(*along), 1e-9)


def adjust_edge_costs(
    nodes: Floats,
    edges: Pairs,
    true_costs: Floats,
    min_costs: Floats,
    routes: list[list[int]],
    priorities: Floats,
) -> tuple[Floats, list[bool]]:
    """Return costs of edges that make routes the cheapest, and for each route if it is.

    The sum of the changes is minimal. If routes contradict each other, such as two routes between
    the same nodes, the costs follow the ones with the higher priority. A cheapest route that is
    not `are_routes_apart` from a recommended one counts as the same.

    Parameters
    ----------
    nodes : (n, 2) array
        World positions [m].
    edges : (m, 2) array of int
        Pairs of nodes, from the first to the second.
    true_costs, min_costs : (m,) arrays
        The true costs of the edges, and the lower bounds of the adjusted costs.
    routes : sequence of sequences of int
        The nodes of each route.
    priorities : (routes,) array
        Priority of each route, in changed costs, if not all can be followed.
    """
    index = {(i, j): n for n, (i, j) in enumerate(edges.tolist())}

    def mark_edges(routes: list[list[int]]) -> Floats:
        """Return a matrix (routes, edges) with 1 for the edges of each route."""
        used = np.zeros((len(routes), len(edges)))
        for row, route in zip(used, routes, strict=True):
            row[[index[two] for two in pairwise(route)]] = 1
        return used

    cost, used = true_costs, mark_edges(routes)
    excess, route_numbers = (
        np.empty((0, len(edges))),
        np.empty(0, int),
    )  # the edges of a route minus those of the cheaper one
    for _ in range(50):
        deviating_routes = {
            n: deviating_route
            for n, deviating_route in enumerate(_find_cheapest_routes(edges, cost, used, routes))
            if are_routes_apart(nodes, routes[n], deviating_route)
        }
        numbers = np.array(list(deviating_routes), int)
        extra_edges = used[numbers] - mark_edges([*deviating_routes.values()])
        new = zip(numbers, extra_edges, strict=True)
        if all((excess[route_numbers == n] == row).all(axis=1).any() for n, row in new):
            break
        route_numbers, excess = (
            np.concatenate([route_numbers, numbers]),
            np.vstack([excess, extra_edges]),
        )
        cost = _solve_edge_costs(true_costs, min_costs, excess, route_numbers, priorities)
    return cost, [n not in deviating_routes for n in range(len(routes))]


def _find_cheapest_routes(
    edges: Pairs, edge_costs: Floats, is_on_route: Floats, routes: Sequence[Sequence[int]]
) -> Iterator[list[int]]:
    """Yield the nodes of the cheapest route between the ends of each recommended route."""
    from scipy.sparse import csr_array

    count = int(edges.max()) + 1
    for route, route_edges in zip(routes, is_on_route, strict=True):
        costlier = (
            edge_costs + route_edges * MIN_COST_MARGIN / 2 / route_edges.sum()
        )  # a tie would be followed only by chance
        graph = csr_array((costlier, edges.T), shape=(count, count))
        yield _find_cheapest_route(graph, route[0], route[-1])


def _find_cheapest_route(graph: Any, start: int, goal: int, directed: bool = True) -> list[int]:
    """Return the nodes of the cheapest route in a sparse matrix of costs."""
    from scipy.sparse.csgraph import dijkstra

    before = dijkstra(graph, directed, start, return_predecessors=True)[1]
    route = [goal]
    while route[-1] != start:
        route.append(int(before[route[-1]]))
    return route[::-1]


def _solve_edge_costs(
    true_costs: Floats,
    min_costs: Floats,
    route_excess: Floats,
    route_numbers: Ints,
    weights: Floats,
) -> Floats:
    """Return the costs closest to `true_costs` with ``excess @ cost <= -MIN_COST_MARGIN``.

    The unknowns are the costs, their changes, and how far each route misses its margin, which is
    above 0 only for contradicting routes.
    """
    from scipy.optimize import linprog
    from scipy.sparse import block_array, csr_array, eye_array

    edges, identity = len(true_costs), eye_array(len(true_costs))
    missed = csr_array((route_numbers[:, None] == np.arange(len(weights))).astype(float))
    changes = [[identity, -identity, None], [-identity, -identity, None]]
    limits = block_array([[csr_array(route_excess), None, -missed], *changes])
    solution = linprog(
        np.concatenate([np.zeros(edges), np.ones(edges), weights]),
        limits,
        np.concatenate([np.full(len(route_numbers), -MIN_COST_MARGIN), true_costs, -true_costs]),
        bounds=[(low, None) for low in min_costs] + [(0, None)] * (edges + len(weights)),
    )
    return np.asarray(np.maximum(solution.x[:edges], min_costs))
