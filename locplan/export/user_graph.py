"""A user's route graph with J as the cost of each edge, for Nav2's route server."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from locplan._support.checks import (
    FARTHEST,
    check_file_path,
    is_integer,
    parse_finite_numbers,
    short_repr,
)
from locplan._support.kernels.arrays import Floats, Ints
from locplan._support.reading import MAX_JSON_BYTES, parse_json, read_text
from locplan.errors import ConfigError, LocplanError
from locplan.export.parameters import Nav2Robot, ParameterFiles
from locplan.export.path_joining import LineCosts
from locplan.export.registry import (
    DEFAULT_DISTRO,
    DEFAULT_FRAME,
    ExportSummary,
    create_export_folder,
)
from locplan.export.route_graph import MAX_ID, RouteGraph, save_graph_preview, write_graph
from locplan.export.values import drop_costmap_yaw
from locplan.maps.grid import format_extent
from locplan.planning.costmap import Costmap, summarize_costs

COST_TAG = "localization"
"""Key of J in the metadata of an edge."""
SCORERS: Mapping[str, Any] = {
    "edge_cost_functions": ["PenaltyScorer", "DynamicEdgesScorer"],
    "PenaltyScorer.penalty_tag": COST_TAG,
    "PenaltyScorer.weight": 1.0,
}
"""Parameters of the route server with which an edge costs J."""


@dataclass(frozen=True, eq=False)
class UserGraph:
    """A user's route graph, as read by Nav2's GeoJsonGraphFileLoader."""

    document: Mapping[str, Any]
    """The FeatureCollection."""
    node_ids: tuple[int, ...]
    """Id of each node."""
    nodes: Floats
    """Position of each node, (n, 2) [m]."""
    edge_feature_indices: tuple[int, ...]
    """Index of each edge in the features of the document."""
    edge_nodes: Ints
    """Indices of the nodes where each edge starts and ends, (m, 2)."""

    @classmethod
    def read(cls, file: str | Path, frame: str = DEFAULT_FRAME) -> UserGraph:
        """Read a graph from a GeoJSON file; errors are LocplanErrors.

        Parameters
        ----------
        file : path
            The file.
        frame : str, default "map"
            Frame of the map and of the nodes.
        """
        path = check_file_path("a route graph", file)
        try:
            return cls.from_document(parse_json(read_text(path, MAX_JSON_BYTES)), frame)
        except (ConfigError, ValueError) as error:
            fault = error if isinstance(error, ConfigError) else f"is not JSON: {error}"
            raise LocplanError(f"{path}: {fault}") from None

    @classmethod
    def from_document(cls, document: object, frame: str = DEFAULT_FRAME) -> UserGraph:
        """Return the graph of a FeatureCollection; raise a ConfigError if it is no route graph."""
        features = document.get("features") if isinstance(document, dict) else None
        if (
            not isinstance(document, dict)
            or document.get("type") != "FeatureCollection"
            or not isinstance(features, list)
            or not all(isinstance(feature, dict) for feature in features)
        ):
            raise ConfigError(
                "is no route graph; give a GeoJSON FeatureCollection with nodes (Point) and edges"
                " (LineString), as Nav2's route server reads it"
            )
        try:
            json.dumps(document, allow_nan=False)
        except (ValueError, RecursionError):
            raise ConfigError("holds NaN, infinity or too deep brackets; remove them") from None
        nodes = _read_nodes(features, frame)
        edges = _read_edges(features, [*nodes])
        return cls(
            document,
            node_ids=tuple(nodes),
            nodes=np.array([*nodes.values()]),
            edge_feature_indices=tuple(place for place, _ in edges.values()),
            edge_nodes=np.array([pair for _, pair in edges.values()]),
        )

    @property
    def edge_ids(self) -> list[int]:
        """Id of each edge."""
        return [
            self.document["features"][place]["properties"]["id"]
            for place in self.edge_feature_indices
        ]

    def document_with_edge_costs(
        self, edge_costs: Floats, *, also_sets_cost: bool
    ) -> dict[str, Any]:
        """Return the document with costs (m,) added to the edges."""
        features = list(self.document["features"])
        for place, cost in zip(self.edge_feature_indices, edge_costs.tolist(), strict=True):
            properties = dict(features[place]["properties"])
            # An integer would be read with another type, and the scorer would throw.
            properties["metadata"] = {**(properties.get("metadata") or {}), COST_TAG: cost}
            if also_sets_cost:
                properties["cost"] = cost
            features[place] = {**features[place], "properties": properties}
        return {**self.document, "features": features}


def annotate_graph(
    costs: Costmap, graph: Mapping[str, Any], *, frame: str = DEFAULT_FRAME, set_cost: bool = False
) -> dict[str, Any]:
    """Return a Nav2 route graph with J of each edge as ``metadata.localization`` [m].

    Ids, geometry and other metadata stay unchanged. As in Nav2, an edge is the straight line
    between its nodes, regardless of its geometry.

    Parameters
    ----------
    costs : Costmap
        The costs of travel; the map's yaw is ignored, as in Nav2.
    graph : dict
        A GeoJSON FeatureCollection: nodes (Point) with an id, and edges (LineString or
        MultiLineString) with id, startid and endid, from SWAGGER, Nav2's route tool or by hand.
    frame : str, default "map"
        Frame of the map and of the nodes.
    also_sets_cost : bool, default False
        True also writes J as the edge's ``cost``. Nav2 reads it for edges with ``overridable:
        false``, and for all edges if the server has no scorers.

    Raises
    ------
    ConfigError
        If the graph is invalid, a node is outside the map, or an edge crosses a wall; the error
        names the ids.

    Examples
    --------
    >>> import locplan
    >>> costs = locplan.Costmap.blank(locplan.OccupancyGrid([[254] * 9] * 9, 1.0), robot=0.0)
    >>> nodes = [
    ...     {"type": "Feature", "properties": {"id": n}, "geometry": {"type": "Point",
    ...      "coordinates": [2.0, y]}} for n, y in enumerate((1.0, 4.0))]
    >>> edge = {"type": "Feature", "properties": {"id": 2, "startid": 0, "endid": 1},
    ...         "geometry": {"type": "MultiLineString"}}
    >>> graph = {"type": "FeatureCollection", "features": [*nodes, edge]}
    >>> annotate_graph(costs, graph)["features"][2]["properties"]
    {'id': 2, 'startid': 0, 'endid': 1, 'metadata': {'localization': 3.0}}
    """
    unturned = drop_costmap_yaw(costs)
    user_graph = UserGraph.from_document(graph, frame)
    measured, _ = measure_graph(user_graph, unturned, also_sets_cost=set_cost)
    return user_graph.document_with_edge_costs(measured.cost, also_sets_cost=set_cost)


def measure_graph(
    graph: UserGraph, costs: Costmap, *, also_sets_cost: bool
) -> tuple[RouteGraph, list[int]]:
    """Return the graph with lengths and costs, and the ids of edges that are too narrow.

    Edges too close to walls for the robot get the cost without its radius. See `annotate_graph`
    for the errors.
    """
    grid, ids = costs.grid, graph.edge_ids
    outside = np.flatnonzero(~grid.contains(*grid.cell(graph.nodes)))
    if len(outside):
        raise ConfigError(
            f"{_format_ids('node', [graph.node_ids[n] for n in outside])} outside the map, which"
            f" reaches from {format_extent(grid)}; check the frame and the unit of the graph, or"
            " remove them"
        )
    lines, walls = LineCosts(costs), LineCosts(Costmap.blank(grid, robot=0.0))
    through = np.flatnonzero(~np.isfinite(walls.compute_costs(graph.nodes, graph.edge_nodes)))
    if len(through):
        raise ConfigError(
            f"walls or unknown space on {_format_ids('edge', [ids[n] for n in through])}; move the"
            " nodes, or remove the edges"
        )
    length = np.hypot(
        *(graph.nodes[graph.edge_nodes[:, 0]] - graph.nodes[graph.edge_nodes[:, 1]]).T
    )
    if also_sets_cost and not length.all():
        raise ConfigError(
            f"{_format_ids('edge', [ids[n] for n in np.flatnonzero(length == 0)])} without a"
            " length, and Nav2 rejects a cost of 0; remove them, or do not use --set-cost"
        )
    near = ~np.isfinite(lines.compute_costs(graph.nodes, graph.edge_nodes))
    cost = np.maximum(lines.integrate_layer(lines.density, graph.nodes, graph.edge_nodes), length)
    e, u = (
        lines.integrate_layer(layer, graph.nodes, graph.edge_nodes) for layer in (costs.e, costs.u)
    )
    measured = RouteGraph(graph.nodes, graph.edge_nodes, length, cost, e, u)
    return measured, [ids[n] for n in np.flatnonzero(near)]


def nav2_graph(
    folder: str | Path,
    costs: Costmap,
    graph: str | Path,
    *,
    frame: str = DEFAULT_FRAME,
    distro: str = DEFAULT_DISTRO,
    params: ParameterFiles = None,
    set_cost: bool = False,
    force: bool = False,
) -> ExportSummary:
    """Write a user's route graph with J of each edge, and the parameters of a route server.

    Parameters
    ----------
    folder : path
        The folder, which may exist; an earlier export of this kind is replaced.
    costs, frame, set_cost
        See `annotate_graph`.
    graph : path
        The GeoJSON file of the graph.
    distro, params, force
        See `nav2_routes`.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or the graph does not fit the map, see `annotate_graph`.
    """
    user_graph = UserGraph.read(graph, frame)
    robot = Nav2Robot.from_files(params, distro)
    unturned = drop_costmap_yaw(costs)
    try:
        measured, near = measure_graph(user_graph, unturned, also_sets_cost=set_cost)
    except ConfigError as error:
        raise ConfigError(f"{graph}: {error}") from None
    features = user_graph.document["features"]
    fixed = [
        features[place]["properties"]["id"]
        for place in user_graph.edge_feature_indices
        if not set_cost and features[place]["properties"].get("overridable") is False
    ]
    values = {"nodes": len(user_graph.nodes), "edges": len(user_graph.edge_feature_indices)}
    metadata = {"kind": "nav2-routes", "distro": distro, "set_cost": set_cost} | summarize_costs(
        costs
    )
    name = costs.grid.name or "a map"
    template_values: dict[str, Any] = {
        "map": name,
        "graph": Path(graph).name,
        "robot": robot,
        "costs": costs,
    }
    template_values |= {
        "nodes": user_graph.nodes,
        "ends": user_graph.node_ids[:2],
        "set_cost": set_cost,
    }
    template_values |= {"edges": len(user_graph.edge_feature_indices), "fixed": fixed}
    with create_export_folder(
        folder, "nav2-graph.md", metadata, template_values, force=force
    ) as temporary:
        document = user_graph.document_with_edge_costs(measured.cost, also_sets_cost=set_cost)
        write_graph(temporary, document, SCORERS, robot, Path(folder))
        save_graph_preview(temporary, unturned, measured, f"{name}: {Path(graph).name}")
    rows = [("nodes, edges", f"{values['nodes']:,}, {values['edges']:,}")]
    if fixed:
        text = f"{_format_ids('edge', fixed)}, not overridable; --set-cost replaces it"
        rows.append(("Nav2 keeps the cost of", text))
    if near:
        text = f"{_format_ids('edge', near)}; a robot of this radius touches walls"
        rows.append(("too narrow", text))
    return ExportSummary({**values, "fixed_edges": fixed, "blocked_edges": near}, tuple(rows))


def _read_nodes(features: Sequence[Any], frame: str) -> dict[int, tuple[float, ...]]:
    """Return the position [m] of each node by its id."""
    nodes: dict[int, tuple[float, ...]] = {}
    for place, properties, coordinates in _iterate_features(features, "Point"):
        node = _parse_id(properties, "id", f"feature {place + 1}, a node,")
        if node in nodes:
            raise ConfigError(f"two nodes have the id {node}; give each node its own id")
        xy = parse_finite_numbers(coordinates)[:2] if isinstance(coordinates, list) else ()
        if len(xy) != 2 or max(map(abs, xy)) > FARTHEST:
            raise ConfigError(
                f"node {node} needs coordinates [x, y] in metres, not {short_repr(coordinates)}"
            )
        if properties.get("frame", frame) not in ("", frame):
            raise ConfigError(
                f"node {node} is in the frame {short_repr(properties['frame'])}, but the map is in"
                f" {frame!r}; transform the graph, or name its frame with --frame"
            )
        nodes[node] = xy
    return nodes


def _read_edges(
    features: Sequence[Any], node_ids: Sequence[int]
) -> dict[int, tuple[int, tuple[int, ...]]]:
    """Return the index in the features and the indices of both nodes of each edge by its id."""
    index = {node: n for n, node in enumerate(node_ids)}
    edges: dict[int, tuple[int, tuple[int, ...]]] = {}
    for place, properties, _ in _iterate_features(features, "LineString"):
        edge = _parse_id(properties, "id", f"feature {place + 1}, an edge,")
        if edge in edges:
            raise ConfigError(f"two edges have the id {edge}; give each edge its own id")
        ends = {name: _parse_id(properties, name, f"edge {edge}") for name in ("startid", "endid")}
        for name, node in ends.items():
            if node not in index:
                raise ConfigError(
                    f"edge {edge} has the {name} {node}, which is no node; correct it, or add the"
                    " node"
                )
        metadata = properties.get("metadata")
        if not isinstance(metadata, (dict, type(None))):
            raise ConfigError(
                f"edge {edge} has the metadata {short_repr(metadata)}; write them as an object"
            )
        edges[edge] = place, tuple(index[node] for node in ends.values())
    if not edges:
        raise ConfigError("has no edges; add LineString features with id, startid and endid")
    return edges


def _iterate_features(features: Sequence[Any], kind: str) -> Iterator[tuple[int, Any, Any]]:
    """Yield the index, properties and coordinates of the features of a kind."""
    for place, feature in enumerate(features):
        geometry = feature.get("geometry")
        if isinstance(geometry, dict) and str(geometry.get("type")).removeprefix("Multi") == kind:
            properties = feature.get("properties")
            feature_properties = properties if isinstance(properties, dict) else {}
            yield place, feature_properties, geometry.get("coordinates")


def _parse_id(properties: Mapping[str, Any], name: str, owner_text: str) -> int:
    """Return an id from the properties of a feature; raise a ConfigError if it is invalid."""
    value = properties.get(name)
    if not is_integer(value) or not 0 <= value <= MAX_ID:
        fault = "has no" if value is None else f"has {short_repr(value)} as its"
        raise ConfigError(f"{owner_text} {fault} {name}; write a whole number from 0 to {MAX_ID}")
    return int(value)


def _format_ids(kind: str, ids: Sequence[int]) -> str:
    """Return a text such as "edge 7" or "edges 1, 2, 3 and 4 more"."""
    count_text = f" and {len(ids) - 10} more" if len(ids) > 10 else ""
    return f"{kind}{'s' if len(ids) > 1 else ''} {', '.join(map(str, ids[:10]))}{count_text}"
