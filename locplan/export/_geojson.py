"""Route graphs as the GeoJSON that Nav2's route server reads."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from locplan._util.progress import ProgressCallback, parts, scaled
from locplan.costs import Costmap, about_costs
from locplan.errors import ConfigError
from locplan.export._distros import SERVERS, Server, distribution, lines_on_serving, write_servers
from locplan.export._folders import about_map, export_folder
from locplan.export._roadmap import roadmap
from locplan.export._route_graphs import RouteGraph
from locplan.export._value_maps import PREVIEW, without_yaw

GRAPH = "graph.geojson"
MAX_ID = 65535
"""Greatest id of a node or an edge: Nav2's messages have 16 bits for it."""
SHARES = 90, 10
"""Steps of progress of making a graph and of writing it."""


def to_geojson(graph: RouteGraph, frame: str = "map") -> dict[str, Any]:
    """A route graph as Nav2's route server reads it, with an edge for each direction of travel.

    DistanceScorer and PenaltyScorer with their own defaults add up to J; so do DistanceScorer and
    a PenaltyScorer of `penalty_tag: integrated_u`, with any weight. `cost` is J for a server
    without scorers. No id is both a node's and an edge's: Nav2 blocks either by it.

    Parameters
    ----------
    graph : RouteGraph
        The graph, with an edge at least.
    frame : str, default "map"
        Frame of the nodes.

    Returns
    -------
    dict
        A FeatureCollection, fit for JSON: the nodes as points [m], and then the edges.

    Raises
    ------
    ConfigError
        If there are more nodes and edges than Nav2 has ids, or no edge.
    """
    ids = len(graph.nodes) + (1 if graph.directed else 2) * len(graph.edges)
    if not len(graph.edges):
        raise ConfigError("Nav2 takes no graph without edges; a smaller spacing may make some")
    if ids > MAX_ID:
        raise ConfigError(
            f"Nav2 has {MAX_ID} ids for nodes and directed edges, but these are {ids};"
            f" a spacing {1.1 * math.sqrt(ids / MAX_ID):.2g} times as large should do"
        )
    xy = graph.nodes.tolist()
    features: list[tuple[str, Any, dict[str, Any]]]
    features = [("Point", at, {"id": n, "frame": frame}) for n, at in enumerate(xy, start=1)]
    names = ("length", "integrated_e", "integrated_u", "penalty")
    values = np.column_stack([getattr(graph, name) for name in names]).tolist()
    for (i, j), cost, row in zip(graph.edges.tolist(), graph.cost.tolist(), values, strict=True):
        metadata = {k: v for k, v in zip(names, row, strict=True) if math.isfinite(v)}
        for start, end in ((i, j), (j, i))[: 1 if graph.directed else 2]:
            about = {"id": len(features) + 1, "startid": start + 1, "endid": end + 1}
            about |= {"cost": cost, "overridable": True, "metadata": metadata}
            features.append(("LineString", [xy[start], xy[end]], about))
    return {
        "type": "FeatureCollection",
        "name": "graph",
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}},
        "features": [
            {"type": "Feature", "properties": about, "geometry": {"type": kind, "coordinates": at}}
            for kind, at, about in features
        ],
    }


def route_graph(
    folder: str | Path,
    costs: Costmap,
    *,
    spacing: float = 2.0,
    frame: str = "map",
    distro: str = "jazzy",
    progress: ProgressCallback | None = None,
) -> RouteGraph:
    """Write lanes for Nav2's route server, with the scorers that make it charge J.

    Parameters
    ----------
    folder : path
        The folder; one that holds such an export without changes is replaced.
    costs : Costmap
        The costs of travel; the map's yaw is left out, as Nav2 ignores it. Nodes lie as close to
        blocked cells as pays: make it with a radius one or two cells above the robot's.
    spacing : float, default 2.0
        How close lanes are [m]: nearly all free cells see a node within two spacings, and places
        that far apart are joined, see `roadmap`. A smaller one makes more lanes.
    frame : str, default "map"
        Frame of the nodes.
    distro : str, default "jazzy"
        The distribution of ROS 2, as for `nav2_keepout`.
    progress : callable, optional
        Called with (done, total) steps; what it raises ends the work, and nothing is written.

    Returns
    -------
    RouteGraph
        The graph that was written.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or no graph can be made, see `roadmap` and `to_geojson`.
    """
    from locplan.export import _figures
    from locplan.plotting import save_figure

    runs = distribution(distro)
    runs.warn()
    given, costs = costs, dataclasses.replace(costs, grid=without_yaw(costs.grid))
    laying, writing = parts(progress, SHARES)
    graph = roadmap(costs, spacing=spacing, progress=scaled(laying, SHARES[0]))
    text = json.dumps(to_geojson(graph, frame), allow_nan=False)
    name = costs.grid.name or "a map"
    readme = [
        f"- {GRAPH}: lanes of {len(graph.nodes)} nodes and {len(graph.edges)} edges both ways, each"
        " straight and free, with length, integrated_e, integrated_u and penalty [m]; export.json:"
        " the input.",
        f"- {SERVERS}: the route server with the scorers that add up to J; {PREVIEW}.",
        *lines_on_serving(runs, GRAPH),
        *about_map(given),
    ]
    about = {"kind": "route-graph", "spacing": spacing, "distro": distro} | about_costs(costs)
    with export_folder(Path(folder), f"Route graph of {name}", about, readme) as temporary:
        (temporary / GRAPH).write_text(text + "\n", encoding="utf-8")
        title = f"{name}: {len(graph.nodes)} nodes, {len(graph.edges)} edges each way"
        figure = _figures.routes_figure(costs, graph, title)
        save_figure(figure, temporary / PREVIEW, dpi=110)
        writing(SHARES[1] - 1, SHARES[1])
        write_route_server(temporary, None if np.isnan(costs.weight) else costs.weight)
    return graph


def write_route_server(folder: Path, weight: float | None) -> None:
    """Write the server of a folder's graph; its costs are those of the edges.

    With a weight they are made of `integrated_u`, so that the weight can be changed later.
    """
    files = {"graph_filepath": GRAPH}
    server = Server("nav2_route", "route_server", "route_server", _route_server(weight), files)
    write_servers(folder, [server], "lifecycle_manager_localizability_routes")


def _route_server(weight: float | None) -> dict[str, Any]:
    scorer: dict[str, Any] = {"plugin": "nav2_route::PenaltyScorer"}
    if weight is None:
        scorer |= {"penalty_tag": "penalty", "weight": 1.0}
    else:
        scorer |= {"penalty_tag": "integrated_u", "weight": weight}
    return {
        "graph_file_loader": "GeoJsonGraphFileLoader",
        "GeoJsonGraphFileLoader": {"plugin": "nav2_route::GeoJsonGraphFileLoader"},
        "edge_cost_functions": ["DistanceScorer", "PenaltyScorer", "DynamicEdgesScorer"],
        "DistanceScorer": {"plugin": "nav2_route::DistanceScorer"},
        "PenaltyScorer": scorer,
        "DynamicEdgesScorer": {"plugin": "nav2_route::DynamicEdgesScorer"},
        "smooth_corners": False,  # arcs would leave the edges, which were checked
    }
