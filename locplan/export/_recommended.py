"""The recommended ways of many queries as one graph, and edge costs by which a server takes them.

Where the cheapest route of a query is another one than its recommended way, a linear programme
changes the costs of edges as little as that takes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from locplan._util.progress import progress_bar
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.export._joined_ways import SAME, Lines, apart, divided, joined, straightened
from locplan.export._net import Pairs, Positions
from locplan.export._registry import ExportJob, ExportSummary
from locplan.export._roadmap import FINENESS, RouteGraph, check_precision

MARGIN = 0.02
"""Minimum cost by which any other route exceeds a recommended way [m]."""
ONE_PLACE = 2 * SAME
"""Maximum distance of ends that can become one node [m]: each may lie that far from it."""


@dataclass(frozen=True, eq=False, repr=False)
class RecommendedWays:
    """A route graph, and the way on it that is recommended for each query."""

    graph: RouteGraph
    """The graph. The cost of a changed edge is no longer J, but still at least its length."""
    ways: Mapping[str, tuple[int, ...]]
    """The nodes of each query's way, from start to goal."""
    changed: int
    """Number of edges whose cost is not J."""
    followed: tuple[str, ...]
    """Names of the queries whose cheapest route on the graph is the recommended way, or runs within
    two metres of all of it."""

    @property
    def contradicted(self) -> tuple[str, ...]:
        """Names of the other queries: their ways contradict those of the ones that are followed."""
        return tuple(name for name in self.ways if name not in self.followed)

    def summary(self) -> dict[str, object]:
        """The size of the graph and what is followed by name, fit for JSON."""
        sizes = {"nodes": len(self.graph.nodes), "edges": len(self.graph.edges)}
        return {**sizes, "followed": list(self.followed), "changed_edges": self.changed}

    def rows(self) -> tuple[tuple[str, str], ...]:
        """The same for people: labels and texts."""
        followed = "ways that the server takes", f"{len(self.followed)} of {len(self.ways)}"
        other = "other routes are cheaper", ", ".join(self.contradicted)
        return (self.graph.rows()[0], followed, *([other] if self.contradicted else []))

    def __repr__(self) -> str:
        return f"RecommendedWays({len(self.followed)} of {len(self.ways)} followed, {self.graph})"


def recommended_ways(costs: Costmap, paths: Mapping[str, Path]) -> RecommendedWays:
    """Join paths to a graph on which the cheapest routes are these paths.

    Ways within two metres of one another become one where that is free and costs little. The way
    back is the same, where that does not contradict other ways.

    Parameters
    ----------
    costs : Costmap
        The costs of travel, on the map of the paths.
    paths : dict of Path
        The recommended path of each query; one within a point is left out.

    Returns
    -------
    RecommendedWays

    Raises
    ------
    ConfigError
        If no path has a length, one leaves the free space of the map or ends where it starts, or
        the map is so far from the world's origin that Nav2's single precision would be too coarse.

    Examples
    --------
    >>> import numpy as np
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> costs = locplan.Costmap.blank(grid)
    >>> there = locplan.plan(costs, (2.0, 3.0), (38.0, 3.0)).path
    >>> half = locplan.plan(costs, (2.0, 3.0), (20.0, 3.0)).path
    >>> recommended_ways(costs, {"there": there, "half": half})
    RecommendedWays(2 of 2 followed, RouteGraph(3 nodes, 4 directed edges))
    """
    paths = {name: path for name, path in paths.items() if path.length > ONE_PLACE}
    if not paths:
        raise ConfigError("there is no way to export; give at least one path of some length")
    check_ways(costs, paths)
    lines = Lines(costs)
    # A path along the edge of a blocked cell can come to lie beyond it in single precision.
    if not all(np.isfinite(lines.along(divided(path))).all() for path in paths.values()):
        lines = Lines(costs, aside=FINENESS)
    nodes, ways = straightened(lines, *joined(lines, paths))
    there = [*ways.values()]
    both = there + [way[::-1] for way in there]
    edges = np.array(sorted({two for way in both for two in pairwise(way)}))
    length = np.hypot(*(nodes[edges[:, 0]] - nodes[edges[:, 1]]).T)
    price = np.maximum(lines.costs(nodes, edges), length)
    # Ways may contradict one another: the price of one, or of the way back, that is not followed.
    weights = np.repeat([1e3, 1e1], len(there))
    cost, followed = followed_costs(nodes, edges, price, length, both, weights)
    e, u = (lines.integrals(layer, nodes, edges) for layer in (costs.e, costs.u))
    return RecommendedWays(
        RouteGraph(nodes, edges, length, cost, e, u, directed=True),
        {name: tuple(way) for name, way in ways.items()},
        int((np.abs(cost - price) > 1e-6).sum()),
        tuple(name for name, is_followed in zip(ways, followed, strict=False) if is_followed),
    )


def chosen_ways(
    job: ExportJob, queries: str | os.PathLike[str], drives: int
) -> tuple[dict[str, Path], ExportSummary]:
    """The paths of the queries in a file, chosen by driving, and what the choices bring."""
    from locplan.planners import read_queries
    from locplan.simulation import choose_many

    asked = read_queries(queries)
    for query in asked:
        if query.name in job.paths:
            raise ConfigError(f"a path and a query are both named {query.name}; rename one")
    with progress_bar("driving the candidates", "queries") as progress:
        choices = choose_many(job.costs, asked, job.robot, drives=drives, progress=progress)
    before, after = choices.lost
    paths = {each.query.name: each.choice.path for each in choices}
    without = [name for name, path in paths.items() if path is None]
    rows = [
        ("queries", f"{len(choices)}, {choices.left} leave the shortest path"),
        ("drives that are lost", f"{before:.0%} -> {after:.0%}"),
    ]
    if without:
        rows.append(("without a path", ", ".join(without)))
    values = {"left_the_shortest": choices.left, "lost": [before, after], "no_path": without}
    found = {name: path for name, path in paths.items() if path is not None}
    return found, ExportSummary(values, tuple(rows))


def check_ways(costs: Costmap, paths: Mapping[str, Path]) -> None:
    """Raise a ConfigError unless paths are ways on the map that a route can follow."""
    check_precision(costs.grid)
    lines = Lines(costs)
    for name, path in paths.items():
        if np.hypot(*(path.xy[-1] - path.xy[0])) <= ONE_PLACE < path.length:
            raise ConfigError(
                f"path {name} ends where it starts, and a server's route there is empty; give the"
                " way out and the way back as two paths"
            )
        if not np.isfinite(lines.along(path.xy)).all():
            raise ConfigError(f"path {name} leaves the map's free space; plan it on this map")


def followed_costs(
    nodes: Positions,
    edges: Pairs,
    price: NDArray[np.float64],
    least: NDArray[np.float64],
    ways: Sequence[Sequence[int]],
    weights: NDArray[np.float64],
) -> tuple[NDArray[np.float64], list[bool]]:
    """Costs of edges by which the cheapest routes are given ways, and for which of them they are.

    The sum of the changes is the least there is. Not all ways are followed where they contradict
    one another, such as two ways between the same nodes. A route that is not `apart` from a way
    counts as that way.

    Parameters
    ----------
    nodes : (n, 2) array
        World positions [m].
    edges : (m, 2) array of int
        Pairs of nodes, from the first to the second.
    price, least : (m,) arrays
        The costs as they should be, and their lower bounds.
    ways : sequence of sequences of int
        The nodes of each way.
    weights : (ways,) array
        What each way is worth, in changed costs, where not all can be followed.
    """
    index = {(i, j): n for n, (i, j) in enumerate(edges.tolist())}
    used = np.zeros((len(ways), len(edges)))
    for n, way in enumerate(ways):
        used[n, [index[two] for two in pairwise(way)]] = 1
    cost = price
    excess, of_way = np.empty((0, len(edges))), np.empty(0, int)  # a way's edges less a route's
    for _ in range(50):
        routes = {
            n: route
            for n, route in enumerate(_cheapest_routes(edges, cost, used, ways))
            if apart(nodes, ways[n], route)
        }
        others = np.zeros((len(routes), len(edges)))
        for row, route in zip(others, routes.values(), strict=True):
            row[[index[two] for two in pairwise(route)]] = 1
        numbers = np.array(list(routes), int)
        more = used[numbers] - others
        if all(
            ((of_way == n) & (excess == row).all(axis=1)).any()
            for n, row in zip(numbers, more, strict=True)
        ):
            break
        of_way, excess = np.concatenate([of_way, numbers]), np.vstack([excess, more])
        cost = _min_changed(price, least, excess, of_way, weights)
    return cost, [n not in routes for n in range(len(ways))]


def _cheapest_routes(
    edges: Pairs,
    cost: NDArray[np.float64],
    used: NDArray[np.float64],
    ways: Sequence[Sequence[int]],
) -> Iterator[list[int]]:
    """The nodes of the cheapest route between the ends of each way."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    count = int(edges.max()) + 1
    for way, own in zip(ways, used, strict=True):
        costlier = cost + own * MARGIN / 2 / own.sum()  # a tie would be followed by chance only
        graph = csr_array((costlier, edges.T), shape=(count, count))
        before = dijkstra(graph, indices=way[0], return_predecessors=True)[1]
        route = [way[-1]]
        while route[-1] != way[0]:
            route.append(int(before[route[-1]]))
        yield route[::-1]


def _min_changed(
    price: NDArray[np.float64],
    least: NDArray[np.float64],
    excess: NDArray[np.float64],
    of_way: NDArray[np.int64],
    weights: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The costs nearest to `price` with ``excess @ cost <= -MARGIN``, but for contradictions.

    The unknowns are the costs, their changes, and by how much each way misses its margin.
    """
    from scipy.optimize import linprog
    from scipy.sparse import block_array, csr_array, eye_array

    edges, one = len(price), eye_array(len(price))
    missed = csr_array(
        (np.ones(len(of_way)), (np.arange(len(of_way)), of_way)), (len(of_way), len(weights))
    )
    limits = block_array(
        [[csr_array(excess), None, -missed], [one, -one, None], [-one, -one, None]]
    )
    found = linprog(
        np.concatenate([np.zeros(edges), np.ones(edges), weights]),
        limits,
        np.concatenate([np.full(len(of_way), -MARGIN), price, -price]),
        bounds=[(low, None) for low in least] + [(0, None)] * (edges + len(weights)),
    )
    cost: NDArray[np.float64] = np.maximum(found.x[:edges], least)
    return cost
