"""Route graphs as VDMA LIF, the Layout Interchange Format 1.0.0 of fleet managers (VDA 5050).

The format: Intralogistics-2X-LIF/Layout-Interchange-Format, LIF.md of branch release/V1.0. Stations
become nodes of the graph.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from locplan import __version__
from locplan._kernels.route import line_costs
from locplan._util.checks import positive
from locplan._util.files import check_target, replacing
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.export._roadmap import RouteGraph, roadmap, space_of
from locplan.export._value_maps import where_unturned, without_yaw
from locplan.planners import Station

VEHICLE = "locplan.robot"
"""Type of vehicle unless another is named, as MANUFACTURER.SERIES."""


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
    for edge, (i, j) in enumerate(graph.edges.tolist()):
        length, cost = float(graph.length[edge]), float(graph.cost[edge])
        rules: dict[str, Any] = {"vehicleTypeId": vehicle, "rotationAllowed": True}
        if speed is not None:
            rules["maxSpeed"] = speed * length / cost
        about = f"length {length:.3f} m, J {cost:.3f} m"
        if graph.integrated_u[edge] >= 0:  # not NaN
            about += f", degenerate {graph.integrated_u[edge]:.3f} m"
        for start, end in ((i, j), (j, i))[: 1 if graph.directed else 2]:
            edges.append(
                {
                    "edgeId": f"n{start + 1}-n{end + 1}",
                    "edgeDescription": about,
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
    target: str | os.PathLike[str],
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
    target : path
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
    file = Path(target)
    check_target(file, ".json")
    grid = costs.grid
    if grid.origin[2]:
        xy = where_unturned(grid, np.array([(each.x, each.y) for each in stations]).reshape(-1, 2))
        stations = [Station(each.name, *at) for each, at in zip(stations, xy.tolist(), strict=True)]
        costs = dataclasses.replace(costs, grid=without_yaw(grid))
    graph, at = with_stations(costs, roadmap(costs, spacing=spacing), stations)
    layout = to_lif(
        graph,
        name=costs.grid.name or "map",
        timestamp=timestamp or datetime.now(UTC),
        vehicle=vehicle,
        speed=speed,
        stations=stations,
        at=at,
    )
    text = json.dumps(layout, indent=1, allow_nan=False, ensure_ascii=True)
    with replacing(file) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
    return graph


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
        seen = np.argsort(cost, kind="stable")[:2]
        seen = seen[np.isfinite(cost[seen])]
        if len(seen) == 0:
            remedy = "take a smaller spacing"
            raise ConfigError(f"no node is seen from station {station.name}; {remedy}")
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
