"""Route graphs as files: GeoJSON for Nav2's route server, and VDMA LIF for fleet managers.

LIF is the Layout Interchange Format 1.0.0 (VDA 5050), LIF.md of its branch release/V1.0.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from locplan import __version__
from locplan._util.checks import positive
from locplan._util.files import check_target, replacing
from locplan._util.progress import ProgressCallback, parts, scaled
from locplan._util.tables import collection, feature, write_geojson
from locplan.costs import Costmap, about_costs
from locplan.errors import ConfigError
from locplan.export._entries import with_entries, with_stations
from locplan.export._parameter_files import parameter_files
from locplan.export._parameters import Params, Robot
from locplan.export._registry import export_folder
from locplan.export._roadmap import RouteGraph, roadmap
from locplan.export._servers import Server, write_servers
from locplan.export._values import where_unturned, without_yaw
from locplan.planners import Station
from locplan.robots import Nav2Parameters

VEHICLE = "locplan.robot"
"""Type of vehicle unless another is named, as MANUFACTURER.SERIES."""


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
    ids = len(graph.nodes) + len(graph.directions)
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
    for edge, start, end in graph.directions:
        known = zip(names, values[edge], strict=True)
        about: dict[str, Any] = {"id": len(features) + 1, "startid": start + 1, "endid": end + 1}
        about |= {"cost": float(graph.cost[edge]), "overridable": True}
        about |= {"metadata": {name: value for name, value in known if math.isfinite(value)}}
        features.append(feature("LineString", [xy[start], xy[end]], about))
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}}
    return collection("graph", features, crs=crs)


def route_graph(
    folder: str | Path,
    costs: Costmap,
    *,
    spacing: float = 2.0,
    frame: str = "map",
    distro: str = "jazzy",
    params: Params = None,
    progress: ProgressCallback | None = None,
) -> RouteGraph:
    """Write lanes for Nav2's route server, with the scorers that make its costs J.

    The server enters a graph at the node nearest to the start, so that nodes are added where free
    space would be more than two metres from all of them.

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
    params : path, optional
        A Nav2 parameter file to merge the server's into, as for `nav2_keepout`: its operations
        stay, its scorers give way to ours.
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
    robot = Robot.of(params, distro)
    given, costs = costs, dataclasses.replace(costs, grid=without_yaw(costs.grid))
    laying, writing = parts(progress, (90, 10))
    graph = roadmap(costs, spacing=spacing, progress=scaled(laying, 90))
    graph = with_entries(costs, graph)
    name = costs.grid.name or "a map"
    about = {"kind": "route-graph", "spacing": spacing, "distro": distro} | about_costs(costs)
    title = f"{name}: {len(graph.nodes)} nodes, {len(graph.edges)} edges each way"
    known = {"map": name, "graph": graph, "robot": robot, "costs": given}
    with export_folder(folder, "route-graph.md", about, **known) as temporary:
        weight = None if np.isnan(costs.weight) else costs.weight
        write_graph(temporary, costs, graph, robot, Path(folder), frame, title, weight)
        writing(9, 10)
    return graph


def write_graph(
    folder: Path,
    costs: Costmap,
    graph: RouteGraph,
    robot: Robot,
    target: Path,
    frame: str,
    title: str,
    weight: float | None,
) -> None:
    """Write a graph with its picture and its server, whose costs are those of the edges.

    With a weight they are made of `integrated_u`, so that the weight can be changed later. A
    robot's own parameters name the graph by its place in `target`, which the folder will become.
    """
    from locplan.export import _figures

    write_geojson(folder / "graph.geojson", to_geojson(graph, frame))
    _figures.save_preview(folder, _figures.routes_figure(costs, graph, title))
    scorers = "DistanceScorer", "PenaltyScorer", "DynamicEdgesScorer"
    loader = "GeoJsonGraphFileLoader"
    tag, factor = ("penalty", 1.0) if weight is None else ("integrated_u", weight)
    own: dict[str, Any] = {
        "graph_file_loader": loader,
        "edge_cost_functions": list(scorers),
        **{f"{name}.plugin": f"nav2_route::{name}" for name in (loader, *scorers)},
        "PenaltyScorer.penalty_tag": tag,
        "PenaltyScorer.weight": float(factor),
        "smooth_corners": False,  # arcs would leave the edges, which were checked
    }
    theirs, file = robot.parameters.of(node := "route_server"), "graph.geojson"
    theirs.pop("graph_filepath", None)
    alone = Nav2Parameters().changed(node, theirs | own).content[node]["ros__parameters"]
    server = Server("nav2_route", node, node, alone, {"graph_filepath": file})
    write_servers(folder, [server], "lifecycle_manager_localizability_routes")
    if robot.file:
        place = {"graph_filepath": str(target.resolve() / file)}
        robot.warn_changed(merged := robot.parameters.changed(node, own | place))
        for name, content in parameter_files(robot.parameters, merged)[0].items():
            (folder / name).write_bytes(content)


def to_lif(
    graph: RouteGraph,
    *,
    name: str,
    timestamp: datetime,
    vehicle: str = VEHICLE,
    speed: float | None = None,
    stations: Sequence[Station] = (),
    at: Sequence[int] = (),
) -> dict[str, Any]:
    """A route graph as a LIF layout, with an edge for each direction of travel.

    The format knows no cost of an edge: a fleet manager goes by lengths, or by times of travel.
    With `speed` each edge gets a maxSpeed of speed · length / J, so that its time of travel is
    J / speed, and a manager that minimizes time minimizes J; vehicles do drive more slowly there.
    In any case edgeDescription holds J and the integrals as text, for people and scripts.

    Parameters
    ----------
    graph : RouteGraph
        The graph, with an edge at least.
    name : str
        Name of the map; it is the layout's and the map's id.
    timestamp : datetime
        Time of the export, with its zone.
    vehicle : str, default "locplan.robot"
        The type of vehicle that may use the layout, as MANUFACTURER.SERIES.
    speed : float, optional
        Speed of the vehicle where u is 0 [m/s]; without it edges have no maxSpeed.
    stations : sequence of Station, default ()
        The stations, none by default.
    at : sequence of int, default ()
        The node of each station, as `with_stations` gives them.

    Returns
    -------
    dict
        The layout, fit for JSON, with positions in metres.

    Raises
    ------
    ConfigError
        If the graph has no edge, there is not one node for each station, the speed is not
        positive, or the time has no zone.
    """
    if not len(graph.edges):
        raise ConfigError("a layout needs edges; a smaller spacing may make some")
    if len(at) != len(stations):
        raise ConfigError(f"there are {len(stations)} stations, but nodes for {len(at)}")
    if timestamp.tzinfo is None:
        raise ConfigError("the timestamp needs a time zone, such as datetime.timezone.utc")
    if speed is not None:
        speed = positive("speed", speed, "metres a second")
    nodes = [
        {
            "nodeId": f"n{n}",
            "mapId": name,
            "nodePosition": {"x": x, "y": y},
            "vehicleTypeNodeProperties": [{"vehicleTypeId": vehicle}],
        }
        for n, (x, y) in enumerate(graph.nodes.tolist(), start=1)
    ]
    edges = []
    values = np.column_stack([graph.length, graph.cost, graph.integrated_u]).tolist()
    for edge, start, end in graph.directions:
        length, cost, u = values[edge]
        rules: dict[str, Any] = {"vehicleTypeId": vehicle, "rotationAllowed": True}
        if speed is not None:
            rules["maxSpeed"] = speed * length / cost
        degenerate = "" if math.isnan(u) else f", degenerate {u:.3f} m"
        edges.append(
            {
                "edgeId": f"n{start + 1}-n{end + 1}",
                "edgeDescription": f"length {length:.3f} m, J {cost:.3f} m{degenerate}",
                "startNodeId": f"n{start + 1}",
                "endNodeId": f"n{end + 1}",
                "vehicleTypeEdgeProperties": [rules],
            }
        )
    utc = timestamp.astimezone(UTC)
    stamp = utc.strftime("%Y-%m-%dT%H:%M:%S.") + f"{utc.microsecond // 10000:02}Z"
    return {
        "metaInformation": {
            "projectIdentification": name,
            "creator": f"locplan {__version__}",
            "exportTimestamp": stamp,
            "lifVersion": "1.0.0",
        },
        "layouts": [
            {
                "layoutId": name,
                "layoutName": name,
                "layoutVersion": "1",
                "layoutDescription": "lanes along the ways where a lidar localizes well",
                "nodes": nodes,
                "edges": edges,
                "stations": [
                    {
                        "stationId": station.name,
                        "stationName": station.name,
                        "interactionNodeIds": [f"n{node + 1}"],
                        "stationPosition": {"x": station.x, "y": station.y},
                    }
                    for station, node in zip(stations, at, strict=True)
                ],
            }
        ],
    }


def lif(
    path: str | os.PathLike[str],
    costs: Costmap,
    *,
    spacing: float = 2.0,
    stations: Sequence[Station] = (),
    vehicle: str = VEHICLE,
    speed: float | None = None,
    timestamp: datetime | None = None,
) -> RouteGraph:
    """Write lanes as a LIF layout, in the coordinates of a stack that ignores the map's yaw.

    Parameters
    ----------
    path : path
        The file, .json.
    costs : Costmap
        The costs of travel.
    spacing : float, default 2.0
        How close lanes are [m], at least two cells, see `roadmap`.
    stations : sequence of Station, default ()
        Positions in the world that get nodes, none by default.
    vehicle, speed
        See `to_lif`.
    timestamp : datetime, optional
        Time of the export, with its zone; it is now by default.

    Returns
    -------
    RouteGraph
        The graph that was written.

    Raises
    ------
    LocplanError
        If the file cannot be written, or no layout can be made, see `roadmap` and `to_lif`.
    """
    file = Path(path)
    check_target(file, ".json")
    if costs.grid.origin[2]:
        xy = np.reshape([(each.x, each.y) for each in stations], (-1, 2))
        ends = zip(stations, where_unturned(costs.grid, xy).tolist(), strict=True)
        stations = [Station(each.name, *at) for each, at in ends]
        costs = dataclasses.replace(costs, grid=without_yaw(costs.grid))
    graph, at = with_stations(costs, roadmap(costs, spacing=spacing), stations)
    known: Any = {"name": costs.grid.name or "map", "timestamp": timestamp or datetime.now(UTC)}
    layout = to_lif(graph, **known, vehicle=vehicle, speed=speed, stations=stations, at=at)
    text = json.dumps(layout, indent=1, allow_nan=False, ensure_ascii=True)
    with replacing(file) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
    return graph
