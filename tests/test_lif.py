"""Route graphs as VDMA LIF layouts: complete, both ways, with J and stations, and reproducible."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from test_route_graph import rooms

from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError, PoseError
from locplan.export import RouteGraph, YawWarning, lif, roadmap, to_lif, with_stations
from locplan.maps import FREE, OccupancyGrid
from locplan.planners import Station

NOON = datetime(2026, 3, 4, 12, 30, 5, 678_912, UTC)


@pytest.fixture(scope="module")
def costs() -> Costmap:
    return rooms(origin=(-3.0, 7.0, 0.3)).with_weight(4.0)


@pytest.fixture(scope="module")
def graph(costs: Costmap) -> RouteGraph:
    return roadmap(costs)


def check(lif: dict) -> dict:
    """The only layout, if all is there that LIF 1.0.0 requires, of its types, and nothing else."""

    def has(value: dict, required: dict, optional: dict) -> None:
        assert required.keys() <= value.keys() <= required.keys() | optional.keys()
        for name, each in value.items():
            assert type(each) is (required | optional)[name], name

    has(lif, {"metaInformation": dict, "layouts": list}, {})
    words = ("projectIdentification", "creator", "exportTimestamp", "lifVersion")
    has(lif["metaInformation"], dict.fromkeys(words, str), {})
    assert lif["metaInformation"]["lifVersion"] == "1.0.0"
    stamp = lif["metaInformation"]["exportTimestamp"]
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d\dZ", stamp)
    (layout,) = lif["layouts"]
    has(
        layout,
        {"layoutId": str, "layoutVersion": str, "nodes": list, "edges": list, "stations": list},
        dict.fromkeys(("layoutName", "layoutLevelId", "layoutDescription"), str),
    )
    for node in layout["nodes"]:
        has(
            node,
            {"nodeId": str, "nodePosition": dict, "vehicleTypeNodeProperties": list},
            dict.fromkeys(("nodeName", "nodeDescription", "mapId"), str),
        )
        has(node["nodePosition"], {"x": float, "y": float}, {})
        for rules in node["vehicleTypeNodeProperties"]:
            has(rules, {"vehicleTypeId": str}, {"theta": float, "actions": list})
    for edge in layout["edges"]:
        has(
            edge,
            {
                "edgeId": str,
                "startNodeId": str,
                "endNodeId": str,
                "vehicleTypeEdgeProperties": list,
            },
            {"edgeName": str, "edgeDescription": str},
        )
        for rules in edge["vehicleTypeEdgeProperties"]:
            has(rules, {"vehicleTypeId": str, "rotationAllowed": bool}, {"maxSpeed": float})
    for station in layout["stations"]:
        has(
            station,
            {"stationId": str, "interactionNodeIds": list},
            {"stationName": str, "stationPosition": dict},
        )
        has(station["stationPosition"], {"x": float, "y": float}, {"theta": float})
    nodes = [node["nodeId"] for node in layout["nodes"]]
    ids = nodes + [each["edgeId"] for each in layout["edges"]]
    ids += [each["stationId"] for each in layout["stations"]]
    assert len(set(ids)) == len(ids)
    ends = [edge[end] for edge in layout["edges"] for end in ("startNodeId", "endNodeId")]
    ends += [end for each in layout["stations"] for end in each["interactionNodeIds"]]
    assert set(ends) <= set(nodes)
    several = [each["vehicleTypeNodeProperties"] for each in layout["nodes"]]
    several += [each["vehicleTypeEdgeProperties"] for each in layout["edges"]]
    several += [each["interactionNodeIds"] for each in layout["stations"]]
    assert all(len(each) >= 1 for each in several)
    return layout


def test_a_layout_has_every_node_and_every_edge_both_ways(graph: RouteGraph) -> None:
    layout = check(to_lif(graph, name="rooms", timestamp=NOON))
    at = {node["nodeId"]: tuple(node["nodePosition"].values()) for node in layout["nodes"]}
    assert list(at.values()) == [tuple(xy) for xy in graph.nodes.tolist()]
    ways = {(at[edge["startNodeId"]], at[edge["endNodeId"]]) for edge in layout["edges"]}
    first, second = ([tuple(xy) for xy in graph.nodes[end].tolist()] for end in graph.edges.T)
    assert ways == set(zip(first, second, strict=True)) | set(zip(second, first, strict=True))
    about = layout["edges"][0]["edgeDescription"]
    assert f"J {graph.cost[0]:.3f} m" in about
    assert f"degenerate {graph.integrated_u[0]:.3f} m" in about


def test_directed_edges_lead_one_way(costs: Costmap, graph: RouteGraph) -> None:
    ring = RouteGraph.over(costs, graph.nodes, graph.edges[:5], directed=True)
    layout = check(to_lif(ring, name="rooms", timestamp=NOON))
    ends = [(edge["startNodeId"], edge["endNodeId"]) for edge in layout["edges"]]
    assert ends == [(f"n{i + 1}", f"n{j + 1}") for i, j in graph.edges[:5].tolist()]


def test_the_quickest_routes_are_those_of_least_j(graph: RouteGraph) -> None:
    layout = check(to_lif(graph, name="rooms", timestamp=NOON, speed=1.5))
    number = {node["nodeId"]: n for n, node in enumerate(layout["nodes"])}
    count = len(number)
    times = np.zeros((count, count))
    for edge in layout["edges"]:
        i, j = number[edge["startNodeId"]], number[edge["endNodeId"]]
        (rules,) = edge["vehicleTypeEdgeProperties"]
        assert 0 < rules["maxSpeed"] <= 1.5
        times[i, j] = math.dist(graph.nodes[i], graph.nodes[j]) / rules["maxSpeed"]
    quickest = dijkstra(csr_array(times), indices=0)
    assert np.allclose(1.5 * quickest, dijkstra(graph.matrix, indices=0))
    slow = to_lif(graph, name="rooms", timestamp=NOON)["layouts"][0]["edges"]
    assert "maxSpeed" not in slow[0]["vehicleTypeEdgeProperties"][0]


def test_files_are_the_same_at_the_same_time(costs: Costmap, tmp_path: Path) -> None:
    zone = timezone(timedelta(hours=2))
    for name, when in (("a", NOON), ("b", NOON.astimezone(zone))):
        with pytest.warns(YawWarning):
            lif(tmp_path / f"{name}.json", costs, timestamp=when, vehicle="acme.mule")
    text = (tmp_path / "a.json").read_text()
    assert text == (tmp_path / "b.json").read_text()
    content = json.loads(text)
    assert content["metaInformation"]["exportTimestamp"] == "2026-03-04T12:30:05.67Z"
    assert check(content)["nodes"][0]["vehicleTypeNodeProperties"] == [
        {"vehicleTypeId": "acme.mule"}
    ]


def test_stations_get_nodes_that_lanes_lead_to(costs: Costmap, graph: RouteGraph) -> None:
    free = np.argwhere(np.isfinite(costs.density))[[700, 9000, 15000]]
    xy = np.column_stack(costs.grid.grid_to_world(*(free + 0.5).T))
    stations = [Station(f"s{n}", *at) for n, at in enumerate(xy.tolist())]
    stations.append(Station("node", *graph.nodes[3].tolist()))
    joined, at = with_stations(costs, graph, stations)
    assert at[3] == 3
    assert len(joined.nodes) == len(graph.nodes) + 3
    assert joined.components == graph.components
    assert np.allclose(joined.nodes[at[:3]], xy, atol=1e-5)
    degree = np.bincount(joined.edges.ravel())[at[:3]]
    assert (degree == 2).all()
    layout = check(to_lif(joined, name="rooms", timestamp=NOON, stations=stations, at=at))
    assert [each["stationId"] for each in layout["stations"]] == ["s0", "s1", "s2", "node"]
    assert layout["stations"][1]["interactionNodeIds"] == [f"n{at[1] + 1}"]
    both, _ = with_stations(
        costs, RouteGraph.over(costs, graph.nodes, graph.edges, directed=True), stations[:1]
    )
    ends = {tuple(pair) for pair in both.edges.tolist()}
    assert all((j, i) in ends for i, j in both.edges[len(graph.edges) :].tolist())


def test_a_layout_is_unturned_as_nav2_has_the_map(tmp_path: Path) -> None:
    plain = rooms(80, origin=(-3.0, 7.0, 0.0))
    grid = OccupancyGrid(plain.grid.cells, 0.1, (-3.0, 7.0, 0.6))
    turned = dataclasses.replace(plain, grid=grid)
    at = plain.grid.cell_to_world(20, 20)
    there = grid.cell_to_world(20, 20)
    with pytest.warns(YawWarning):
        lif(tmp_path / "a.json", turned, stations=[Station("s", *there)], timestamp=NOON)
    lif(tmp_path / "b.json", plain, stations=[Station("s", *at)], timestamp=NOON)
    one, other = (json.loads((tmp_path / f"{n}.json").read_text()) for n in "ab")
    for key in ("nodes", "stations"):
        positions = [
            [(p["x"], p["y"]) for each in layout["layouts"][0][key] for p in [place_of(each)]]
            for layout in (one, other)
        ]
        np.testing.assert_allclose(*positions, atol=1e-4)


def place_of(each: dict) -> dict:
    return each.get("nodePosition") or each["stationPosition"]


def test_what_cannot_be(costs: Costmap, graph: RouteGraph, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="time zone"):
        to_lif(graph, name="a", timestamp=datetime(2026, 3, 4))
    with pytest.raises(ConfigError, match="positive"):
        to_lif(graph, name="a", timestamp=NOON, speed=0.0)
    with pytest.raises(ConfigError, match="1 stations, but nodes for 0"):
        to_lif(graph, name="a", timestamp=NOON, stations=[Station("b", 0.0, 0.0)])
    with pytest.raises(PoseError, match="station far"):
        with_stations(costs, graph, [Station("far", 1e3, 0.0)])
    with pytest.raises(LocplanError, match=r"must end in \.json"):
        lif(tmp_path / "a.lif", costs)
    alone = Costmap.blank(OccupancyGrid(np.full((2, 2), FREE), 0.1), robot=0.0)
    empty = roadmap(alone, min_area=0.0)
    with pytest.raises(ConfigError, match="needs edges"):
        to_lif(empty, name="a", timestamp=NOON)
    with pytest.raises(ConfigError, match="no node is seen from station b"):
        with_stations(alone, empty, [Station("b", 0.05, 0.05)])
