"""Route graphs as the GeoJSON that Nav2's route server reads, of lanes or of recommended ways."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from locplan._util.geojson import collection, feature, write_geojson
from locplan._util.progress import ProgressCallback, parts, scaled
from locplan._util.records import Column, Table
from locplan.costs import Costmap, Path, about_costs
from locplan.errors import ConfigError
from locplan.export._bags import bag, topics_of
from locplan.export._recommended import RecommendedWays, recommended_ways
from locplan.export._registry import export_folder
from locplan.export._roadmap import RouteGraph, roadmap
from locplan.export._travel_costs import Server, distribution, write_servers
from locplan.export._value_maps import where_unturned, without_yaw
from locplan.maps import OccupancyGrid


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
    most = 2**16 - 1  # Nav2's messages have 16 bits for the id of a node or an edge
    if ids > most:
        raise ConfigError(
            f"Nav2 has {most} ids for nodes and directed edges, but these are {ids};"
            f" a spacing {1.1 * math.sqrt(ids / most):.2g} times as large should do"
        )
    xy = graph.nodes.tolist()
    features = [feature("Point", at, {"id": n, "frame": frame}) for n, at in enumerate(xy, 1)]
    names = ("length", "integrated_e", "integrated_u", "penalty")
    values = np.column_stack([getattr(graph, name) for name in names]).tolist()
    for (i, j), cost, row in zip(graph.edges.tolist(), graph.cost.tolist(), values, strict=True):
        metadata = {k: v for k, v in zip(names, row, strict=True) if math.isfinite(v)}
        for start, end in ((i, j), (j, i))[: 1 if graph.directed else 2]:
            about = {"id": len(features) + 1, "startid": start + 1, "endid": end + 1}
            about |= {"cost": cost, "overridable": True, "metadata": metadata}
            features.append(feature("LineString", [xy[start], xy[end]], about))
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}}
    return collection("graph", features, crs=crs)


def route_graph(
    folder: str | FilePath,
    costs: Costmap,
    *,
    spacing: float = 2.0,
    frame: str = "map",
    distro: str = "jazzy",
    progress: ProgressCallback | None = None,
) -> RouteGraph:
    """Write lanes for Nav2's route server, with the scorers that make its costs J.

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
    runs = distribution(distro)
    runs.warn()
    given, costs = costs, dataclasses.replace(costs, grid=without_yaw(costs.grid))
    laying, writing = parts(progress, (90, 10))
    graph = roadmap(costs, spacing=spacing, progress=scaled(laying, 90))
    name = costs.grid.name or "a map"
    about = {"kind": "route-graph", "spacing": spacing, "distro": distro} | about_costs(costs)
    title = f"{name}: {len(graph.nodes)} nodes, {len(graph.edges)} edges each way"
    known = {"map": name, "graph": graph, "runs": runs, "costs": given}
    with export_folder(folder, "route-graph.md", about, **known) as temporary:
        weight = None if np.isnan(costs.weight) else costs.weight
        _write_graph(temporary, costs, graph, frame, title, weight)
        writing(9, 10)
    return graph


def _write_graph(
    folder: FilePath,
    costs: Costmap,
    graph: RouteGraph,
    frame: str,
    title: str,
    weight: float | None = None,
) -> None:
    """Write a graph with its picture and its server, whose costs are those of the edges.

    With a weight they are made of `integrated_u`, so that the weight can be changed later.
    """
    from locplan.export import _figures

    write_geojson(folder / "graph.geojson", to_geojson(graph, frame))
    _figures.save_preview(folder, _figures.routes_figure(costs, graph, title))
    files = {"graph_filepath": "graph.geojson"}
    server = Server("nav2_route", "route_server", "route_server", _route_server(weight), files)
    write_servers(folder, [server], "lifecycle_manager_localizability_routes")


def _route_server(weight: float | None) -> dict[str, Any]:
    tag, factor = ("penalty", 1.0) if weight is None else ("integrated_u", weight)
    scorer = {"plugin": "nav2_route::PenaltyScorer", "penalty_tag": tag, "weight": factor}
    return {
        "graph_file_loader": "GeoJsonGraphFileLoader",
        "GeoJsonGraphFileLoader": {"plugin": "nav2_route::GeoJsonGraphFileLoader"},
        "edge_cost_functions": ["DistanceScorer", "PenaltyScorer", "DynamicEdgesScorer"],
        "DistanceScorer": {"plugin": "nav2_route::DistanceScorer"},
        "PenaltyScorer": scorer,
        "DynamicEdgesScorer": {"plugin": "nav2_route::DynamicEdgesScorer"},
        "smooth_corners": False,  # arcs would leave the edges, which were checked
    }


def nav2_routes(
    folder: str | FilePath,
    costs: Costmap,
    paths: Mapping[str, Path],
    *,
    frame: str = "map",
    distro: str = "jazzy",
) -> RecommendedWays:
    """Write recommended paths as a route graph that Nav2's server follows, and into a bag.

    The graph's edges are the paths, joined where they run side by side, and its costs make each
    path the cheapest route between its ends, as far as the paths do not contradict one another.

    Parameters
    ----------
    folder : path
        The folder; one that holds such an export without changes is replaced.
    costs : Costmap
        The costs of travel; the map's yaw is left out, as Nav2 ignores it.
    paths : dict of Path
        The recommended path of each query by its name, such as those of `choose_many`.
    frame : str, default "map"
        Frame of the nodes and of the paths.
    distro : str, default "jazzy"
        The distribution of ROS 2, as for `nav2_keepout`.

    Returns
    -------
    RecommendedWays
        The graph, each query's way on it, and the queries for which it is the cheapest route.

    Raises
    ------
    LocplanError
        If the package mcap is missing, the folder cannot be written, or a path does not lie in the
        map's free space.
    """
    runs = distribution(distro)
    runs.warn()
    grid = costs.grid
    unturned = dataclasses.replace(costs, grid=without_yaw(grid))
    if grid.origin[2]:
        paths = {name: _unturned(grid, path) for name, path in paths.items()}
    ways = recommended_ways(unturned, paths)
    name = grid.name or "a map"
    about = {"kind": "nav2-routes", "distro": distro, "changed_edges": ways.changed}
    about |= {"queries": list(ways.ways), "followed": list(ways.followed)} | about_costs(costs)
    known = {"map": name, "ways": ways, "runs": runs, "costs": costs}
    with export_folder(folder, "nav2-routes.md", about, **known) as temporary:
        count = len(ways.ways)
        title = f"{name}: recommended ways of {count} quer{'y' if count == 1 else 'ies'}"
        _write_graph(temporary, unturned, ways.graph, frame, title)
        bag(temporary / "routes.mcap", unturned.grid, paths=paths, frame=frame)
        _table(ways, topics_of(paths)).write_csv(temporary / "routes.csv")
    return ways


def _unturned(grid: OccupancyGrid, path: Path) -> Path:
    """A path on the map without its yaw."""
    heading = None if path.heading is None else path.heading - grid.origin[2]
    return Path(where_unturned(grid, path.xy), heading)


def _table(ways: RecommendedWays, topics: Mapping[str, str]) -> Table:
    """A row for each query, with the ids of its ends in the graph's file and its topic."""
    matrix, rows = ways.graph.matrix, []
    for name, way in ways.ways.items():
        cost = float(sum(matrix[one, other] for one, other in pairwise(way)))
        followed = "yes" if name in ways.followed else "no"
        rows.append((name, way[0] + 1, way[-1] + 1, round(cost, 3), followed, topics[name]))
    columns = (
        *(Column("query"), Column("start_id"), Column("goal_id")),
        *(Column("cost", "m"), Column("followed"), Column("topic")),
    )
    return Table(columns, tuple(rows))
