"""Nodes that are added to a graph: at stations, and where starts would be far from all others."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from scipy.spatial import cKDTree

from locplan._kernels.arrays import Floats, Ints
from locplan._kernels.route import cover, line_costs
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.export._net import Space
from locplan.export._roadmap import RouteGraph, space_of
from locplan.planners import Station


def with_entries(costs: Costmap, graph: RouteGraph) -> RouteGraph:
    """A graph with more nodes, so that free cells are at most 2 m from one.

    Nav2's server enters and leaves a graph at the nodes nearest to start and goal. New nodes are
    joined to two that were there; cells that see none are left out.
    """
    space = space_of(costs)
    for _ in range(3):  # nodes of one round are seen from the next ones
        cells = _far_cells(costs, graph)
        row, col = np.divmod(cells, costs.grid.shape[1] + 2)
        xy = np.column_stack(costs.grid.grid_to_world(row - 0.5, col - 0.5))
        # An entry is joined to the two of the 12 nearest nodes that cost least.
        near = cKDTree(graph.nodes).query(xy, min(12, len(graph.nodes)))[1]
        among = zip(xy, near.reshape(len(xy), -1) if len(xy) else (), strict=True)
        seen = ((at, _seen(space, graph, at, nodes)) for at, nodes in among)
        entries = [(at, nodes) for at, nodes in seen if nodes]
        if not entries:
            break
        graph = _joined(costs, graph, entries)
    return graph


def _seen(space: Space, graph: RouteGraph, xy: Floats, among: Ints) -> list[int]:
    """Up to two of some nodes, those to which a straight line from a position costs least."""
    lines = np.column_stack([among, np.full(len(among), len(graph.nodes))])
    cost = line_costs(*space, np.vstack([graph.nodes, xy]), lines)
    two = np.argsort(cost, kind="stable")[:2]
    return [int(among[n]) for n in two if np.isfinite(cost[n])]


def _joined(
    costs: Costmap, graph: RouteGraph, entries: Sequence[tuple[Floats, list[int]]]
) -> RouteGraph:
    """A graph with a node at each position, joined to nodes that were there."""
    own = [(n, len(graph.nodes) + k) for k, (_, nodes) in enumerate(entries) for n in nodes]
    own += [way[::-1] for way in own if graph.directed]
    nodes, edges = [*graph.nodes, *(xy for xy, _ in entries)], [*graph.edges.tolist(), *own]
    return RouteGraph.over(costs, nodes, edges, directed=graph.directed)


def _far_cells(costs: Costmap, graph: RouteGraph) -> Ints:
    """Passable cells, with a border around the map, that cover those far from all nodes."""
    inside = np.pad(np.isfinite(costs.density), 1)
    at = np.floor(costs.grid.world_to_grid(*graph.nodes.T)).astype(np.int64) + 1
    away = np.ones(inside.shape, np.uint8)
    away[tuple(at)] = 0
    # Farther from all nodes, no line to the lanes is looked for [m].
    reach = 2.0 / costs.grid.resolution - 1  # nodes lie anywhere in their cells
    far = inside & (cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) > reach)
    clearance = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    cells = np.flatnonzero(far)
    cells = cells[np.argsort(-clearance.reshape(-1)[cells], kind="stable")]
    return np.asarray(cover(inside.reshape(-1), inside.shape[1], cells, reach))


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
    every = np.arange(len(graph.nodes))
    entries: list[tuple[Floats, list[int]]] = []
    at = []
    for station in stations:
        costs.cell_of((station.x, station.y), f"station {station.name}")
        xy = np.array((station.x, station.y), np.float32).astype(np.float64)
        seen = _seen(space, graph, xy, every)
        if not seen:
            text = f"no node is seen from station {station.name}"
            raise ConfigError(f"{text}; take a smaller spacing")
        if np.hypot(*(graph.nodes[seen[0]] - xy)) < resolution:
            at.append(seen[0])
            continue
        at.append(len(graph.nodes) + len(entries))
        entries.append((xy, seen))
    return _joined(costs, graph, entries), at
