"""Nodes of route graphs at stations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from locplan._kernels.route import line_costs
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.export._route_graphs import RouteGraph, space_of
from locplan.planners import Station

LANES = 2
"""Number of edges to the lanes that a station gets at most."""


def with_stations(
    costs: Costmap, graph: RouteGraph, stations: Sequence[Station]
) -> tuple[RouteGraph, list[int]]:
    """A graph with a node at each station, and these nodes.

    A station is joined to the two nodes that its straight lines to cost least; one that is nearly
    at a node takes that one.

    Parameters
    ----------
    costs : Costmap
        The costmap that the graph was made of.
    graph : RouteGraph
        The graph, such as `roadmap` makes.
    stations : sequence of Station
        The stations in the world.

    Returns
    -------
    graph : RouteGraph
        The graph with more nodes and edges; the nodes that were there keep their numbers.
    at : list of int
        The node of each station.

    Raises
    ------
    LocplanError
        If the robot cannot stand at a station, or no node is seen from it.
    """
    space, resolution = space_of(costs), costs.grid.resolution
    nodes, edges = [*graph.nodes], graph.edges.tolist()
    at = []
    for station in stations:
        costs.cell_of((station.x, station.y), f"station {station.name}")
        xy = np.array((station.x, station.y), np.float32).astype(np.float64)
        away = np.hypot(*(graph.nodes - xy).T)
        lines = np.column_stack([np.arange(len(away)), np.full(len(away), len(away))])
        cost = line_costs(*space, np.vstack([graph.nodes, xy]), lines)
        seen = np.argsort(cost, kind="stable")[:LANES]
        seen = seen[np.isfinite(cost[seen])]
        if len(seen) == 0:
            raise ConfigError(
                f"no node is seen from station {station.name}; take a smaller spacing"
            )
        if away[seen[0]] < resolution:
            at.append(int(seen[0]))
            continue
        for node in seen.tolist():
            edges.append((node, len(nodes)))
            if graph.directed:
                edges.append((len(nodes), node))
        at.append(len(nodes))
        nodes.append(xy)
    return RouteGraph.over(costs, nodes, edges, directed=graph.directed), at
