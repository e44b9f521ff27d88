"""Route graphs: nodes and edges with costs, as GeoJSON files for Nav2's route server."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan._support.kernels.arrays import Floats, Ints
from locplan._support.tables import make_geojson_collection, make_geojson_feature, write_geojson
from locplan.errors import ConfigError
from locplan.export.parameters import Nav2Robot, make_parameter_files
from locplan.export.registry import DEFAULT_FRAME
from locplan.export.servers import LifecycleNode, write_servers
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap
from locplan.robots.parameters import Nav2Parameters

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Positions = Floats
"""World positions (n, 2) [m]."""
Pairs = Ints
"""Pairs of nodes (m, 2)."""
GraphSpace = tuple[NDArray[Any], int, tuple[Any, ...]]
"""Half the density with a border, its number of columns, and the frame, as in
`locplan.export.kernels.route`."""
MAX_PRECISION_STEP = 0.02
"""Maximum step of single-precision positions [cells]."""


@dataclass(frozen=True, eq=False, repr=False)
class RouteGraph:
    """A graph of nodes and straight one-way edges, see `build_recommended_routes`."""

    nodes: Positions
    """World positions (n, 2) [m], exact in single precision, which Nav2 uses."""
    edges: Pairs
    """Pairs of nodes (m, 2), from the first to the second."""
    length: Floats
    """Length of each edge (m,) [m]."""
    cost: Floats
    """Cost of each edge (m,) [m], at least its length."""
    integrated_e: Floats
    """Integral of e over each edge (m,) [m^2 rad m]; NaN without a field."""
    integrated_u: Floats
    """Integral of u over each edge (m,) [m]; NaN without a field."""

    def __repr__(self) -> str:
        return f"RouteGraph({len(self.nodes)} nodes, {len(self.edges)} directed edges)"

    @property
    def penalty(self) -> Floats:
        """Excess of the cost over the length (m,) [m]."""
        return self.cost - self.length

    @property
    def cost_matrix(self) -> csr_array:
        """Cost between nodes, (n, n), for `scipy.sparse.csgraph`."""
        from scipy.sparse import coo_array, csr_array

        count = len(self.nodes)
        return csr_array(coo_array((self.cost, tuple(self.edges.T)), shape=(count, count)))


def make_graph_space(costs: Costmap) -> GraphSpace:
    """Return the arrays of a costmap that the kernels of route graphs need.

    Raises
    ------
    ConfigError
        If the map is too far from the world's origin for Nav2's single precision.
    """
    from locplan._support.kernels.search import make_bordered_half_density

    grid = costs.grid
    check_precision(grid)
    x, y, yaw = grid.origin
    frame = math.cos(yaw) / grid.resolution, math.sin(yaw) / grid.resolution, x, y
    return make_bordered_half_density(costs.density, 1), grid.shape[1] + 2, frame


def check_precision(grid: OccupancyGrid) -> None:
    """Raise a ConfigError if the map is too far from the world's origin for single precision."""
    x, y, _ = grid.origin
    farthest = max(abs(x), abs(y)) + math.hypot(*grid.shape) * grid.resolution
    if np.spacing(np.float32(farthest)) > MAX_PRECISION_STEP * grid.resolution:
        raise ConfigError(
            f"the map reaches {farthest:.4g} m from the world's origin, too far for Nav2's single"
            " precision; move the map's origin"
        )


MAX_ID = 2**16 - 1
"""Greatest id of a node or an edge; Nav2's messages have 16 bits for it."""
SCORERS: Mapping[str, Any] = {
    "edge_cost_functions": ["DistanceScorer", "PenaltyScorer", "DynamicEdgesScorer"],
    "PenaltyScorer.penalty_tag": "penalty",
    "PenaltyScorer.weight": 1.0,
}
"""Parameters of the route server with which an edge of `graph_to_geojson` costs J."""


def graph_to_geojson(graph: RouteGraph, frame: str = DEFAULT_FRAME) -> dict[str, Any]:
    """Return a route graph as GeoJSON for Nav2's route server.

    DistanceScorer and PenaltyScorer with their defaults add up to J; so do DistanceScorer and a
    PenaltyScorer with `penalty_tag: integrated_u` and any weight. `cost` is J for a server without
    scorers. Nodes and edges share no id, because Nav2 blocks either by its id.

    Parameters
    ----------
    graph : RouteGraph
        The graph, with at least one edge.
    frame : str, default "map"
        Frame of the nodes.

    Returns
    -------
    dict
        A FeatureCollection for JSON: the nodes as points [m], then the edges.

    Raises
    ------
    ConfigError
        If there is no edge, or there are more nodes and edges than Nav2 has ids.
    """
    ids = len(graph.nodes) + len(graph.edges)
    if not len(graph.edges):
        raise ConfigError("the graph has no edges, which Nav2 rejects; give a path with a length")
    if ids > MAX_ID:
        raise ConfigError(
            f"the graph has {ids} nodes and directed edges, and Nav2 has {MAX_ID} ids; give fewer"
            " paths"
        )
    xy = graph.nodes.tolist()
    features = [
        make_geojson_feature("Point", at, {"id": n, "frame": frame}) for n, at in enumerate(xy, 1)
    ]
    names = ("length", "integrated_e", "integrated_u", "penalty")
    values = np.column_stack([getattr(graph, name) for name in names]).tolist()
    for edge, (start, end) in enumerate(graph.edges.tolist()):
        edge_values = zip(names, values[edge], strict=True)
        properties: dict[str, Any] = {
            "id": len(features) + 1,
            "startid": start + 1,
            "endid": end + 1,
        }
        properties |= {"cost": float(graph.cost[edge]), "overridable": True}
        properties |= {
            "metadata": {name: value for name, value in edge_values if math.isfinite(value)}
        }
        features.append(make_geojson_feature("LineString", [xy[start], xy[end]], properties))
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}}
    return make_geojson_collection("graph", features, crs=crs)


def write_graph(
    folder: Path,
    graph: Mapping[str, Any],
    scorers: Mapping[str, Any],
    robot: Nav2Robot,
    target: Path,
) -> None:
    """Write a graph's GeoJSON, and the route server whose scorers make its edges cost J.

    The robot's parameters name the graph by its path in `target`, the final name of the folder.
    """
    write_geojson(folder / "graph.geojson", graph)
    loader = "GeoJsonGraphFileLoader"
    plugins = (loader, *scorers["edge_cost_functions"])
    server_settings: dict[str, Any] = {
        "graph_file_loader": loader,
        **scorers,
        **{f"{name}.plugin": f"nav2_route::{name}" for name in plugins},
        "smooth_corners": False,  # arcs would leave the checked edges
    }
    robot_settings, file = (
        robot.parameters.read_node_parameters(node := "route_server"),
        "graph.geojson",
    )
    robot_settings.pop("graph_filepath", None)
    merged_settings = (
        Nav2Parameters()
        .with_values(node, robot_settings | server_settings)
        .content[node]["ros__parameters"]
    )
    server = LifecycleNode("nav2_route", node, node, merged_settings, {"graph_filepath": file})
    write_servers(folder, [server], "lifecycle_manager_localizability_routes")
    if robot.main_file:
        place = {"graph_filepath": str(target.resolve() / file)}
        robot.warn_changed(merged := robot.parameters.with_values(node, server_settings | place))
        for name, content in make_parameter_files(robot.parameters, merged)[0].items():
            (folder / name).write_bytes(content)


def save_graph_preview(folder: Path, costs: Costmap, graph: RouteGraph, title: str) -> None:
    """Write the picture of a graph over its map."""
    from locplan.export import figures as _figures

    _figures.save_preview(folder, _figures.routes_figure(costs, graph, title))
