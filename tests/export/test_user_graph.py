"""Route graphs of the user: what is read of them, what they get, and what is refused by id."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import yaml
from scipy.sparse.csgraph import dijkstra
from support.command_line import check_refusal
from support.maps import ascii_map

from locplan import save_map
from locplan.errors import ConfigError, LocplanError
from locplan.export.parameters import ParametersChanged
from locplan.export.recommended_routes import build_recommended_routes
from locplan.export.route_graph import graph_to_geojson
from locplan.export.user_graph import annotate_graph, nav2_graph
from locplan.export.values import YawWarning
from locplan.maps import OccupancyGrid
from locplan.planning import Costmap, Path, path_cost

pytestmark = pytest.mark.usefixtures("undrawn")

HALL = (
    "##########",
    "#........#",
    "#........#",
    "#..####..#",
    "#..####..#",
    "#........#",
    "##########",
)
"""A block between two ways, of which the one below is degenerate; cells of 1 m."""
NODES = {0: (1.5, 1.5), 1: (8.5, 1.5), 2: (1.5, 5.5), 3: (8.5, 5.5)}
PAIRS = [(0, 1), (0, 2), (2, 3), (3, 1)]


@pytest.fixture
def costs():
    grid = ascii_map(*HALL)
    u = np.where(np.arange(len(HALL))[:, None] <= 2, 1.0, 0.0) * np.ones(grid.shape)
    return Costmap.from_layers(grid, u=u, weight=4.0, robot=0.2)


def node(number, xy, **properties):
    geometry = {"type": "Point", "coordinates": [*xy]}
    about = {"id": number, "frame": "map", **properties}
    return {"type": "Feature", "properties": about, "geometry": geometry}


def edge(number, start, end, **properties):
    """An edge as Nav2's route tool saves it: the geometry has no coordinates."""
    about = {"id": number, "startid": start, "endid": end, **properties}
    return {"type": "Feature", "properties": about, "geometry": {"type": "MultiLineString"}}


def graph_of(*features):
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}}
    return {"type": "FeatureCollection", "name": "graph", "crs": crs, "features": [*features]}


def swagger_graph():
    """Nodes and edges of both directions, as SWAGGER's gml_to_geojson.py writes them."""
    features = [node(number, xy) for number, xy in NODES.items()]
    for start, end in (way for pair in PAIRS for way in (pair, pair[::-1])):
        line = edge(len(features), start, end)
        line["geometry"]["coordinates"] = [[[*NODES[start]], [*NODES[end]]]]
        features.append(line)
    return graph_of(*features) | {"date_generated": "Sat Nov 28 02:00:00 PM 2026"}


def nav2_graph_of_tool():
    """The form of Nav2's sample_graph.geojson, with all that nodes and edges can have."""
    stop = {"type": "stop", "trigger": "NODE", "metadata": {"wait_for": 5.0}}
    region = {"x_values": [1.0, -1.0], "properties": {"class_type": "room", "lights": 10}}
    photo = {"type": "photo", "trigger": "ON_EXIT", "metadata": {"size": [1080, 720]}}
    first = node(0, NODES[0], metadata={"region": region}, operations={"stop": stop})
    aisle = {"aisle_number": 14, "speed_limit": 0.8500000238418579}
    return graph_of(
        first,
        *(node(number, NODES[number]) for number in (1, 2)),
        edge(9, 0, 1, cost=10.0, overridable=False, metadata=aisle, operations={"photo": photo}),
        edge(13, 0, 2, cost=0.0, overridable=True, metadata=None),
    )


def edges_in(graph):
    lines = (f for f in graph["features"] if f["geometry"]["type"] != "Point")
    return {line["properties"]["id"]: line["properties"] for line in lines}


def test_edge_costs_equal_path_costs(costs):
    annotated = annotate_graph(costs, swagger_graph())
    for about in edges_in(annotated).values():
        line = np.array([NODES[about["startid"]], NODES[about["endid"]]])
        cost = about["metadata"]["localization"]
        assert type(cost) is float
        assert cost == pytest.approx(path_cost(costs, line))
    assert edges_in(annotated)[4]["metadata"]["localization"] == pytest.approx(7 * 5)
    assert '"metadata": {"localization": 7.0}' in json.dumps(annotated)


def test_annotation_reproduces_exported_graph_costs(costs):
    path = Path(np.array([NODES[0], NODES[2], NODES[3], NODES[1]]))
    ours = graph_to_geojson(build_recommended_routes(costs, {"around": path}).graph)
    for about in edges_in(annotate_graph(costs, ours)).values():
        assert about["metadata"]["localization"] == pytest.approx(about["cost"])
        assert {"length", "penalty", "integrated_u"} < {*about["metadata"]}


def test_cheapest_route_avoids_degenerate_edge(costs):
    weights = np.zeros((4, 4))
    for about in edges_in(annotate_graph(costs, swagger_graph())).values():
        weights[about["startid"], about["endid"]] = about["metadata"]["localization"]
    before = dijkstra(weights, indices=0, return_predecessors=True)[1]
    assert (before[1], before[3], before[2]) == (3, 2, 0)


@pytest.mark.parametrize("make", [nav2_graph_of_tool, swagger_graph])
@pytest.mark.parametrize("set_cost", [False, True])
def test_annotated_graph_keeps_other_properties(costs, make, set_cost):
    graph = make()
    annotated = json.loads(json.dumps(annotate_graph(costs, graph, set_cost=set_cost)))
    assert graph == make()
    for number, former in edges_in(graph).items():
        about = edges_in(annotated)[number]
        cost = about["metadata"].pop("localization")
        assert cost > 0
        assert about["metadata"] == (former.get("metadata") or {})
        assert about.get("cost") == (cost if set_cost else former.get("cost"))
        for each in (about, former):  # all else must be equal
            each.pop("metadata", None)
            each.pop("cost", None)
    assert annotated == graph


def changed(change):
    graph = swagger_graph()
    change(graph)
    return graph


def properties_of(graph, place):
    return graph["features"][place]["properties"]


@pytest.mark.parametrize(
    ("graph", "message"),
    [
        ([], "is no route graph; give a GeoJSON FeatureCollection"),
        ({"type": "Feature"}, "is no route graph"),
        ({"type": "FeatureCollection", "features": [3]}, "is no route graph"),
        (graph_of(node(0, NODES[0])), "has no edges; add"),
        (changed(lambda g: properties_of(g, 5).pop("startid")), "edge 5 has no startid; write a"),
        (changed(lambda g: properties_of(g, 5).update(endid="1")), "edge 5 has '1' as its endid"),
        (changed(lambda g: properties_of(g, 5).pop("id")), "feature 6, an edge, has no id"),
        (changed(lambda g: properties_of(g, 2).pop("id")), "feature 3, a node, has no id"),
        (changed(lambda g: properties_of(g, 2).update(id=1)), "two nodes have the id 1"),
        (changed(lambda g: properties_of(g, 5).update(id=7)), "two edges have the id 7"),
        (changed(lambda g: properties_of(g, 5).update(endid=99)), "endid 99, which is no node"),
        (changed(lambda g: properties_of(g, 5).update(id=2**16)), "number from 0 to 65535"),
        (changed(lambda g: properties_of(g, 5).update(metadata="{}")), "edge 5 has the metadata"),
        (changed(lambda g: properties_of(g, 2).update(frame="odom")), "node 2 is in the frame 'od"),
        (changed(lambda g: g["features"][1].update(geometry=None)), "endid 1, which is no node"),
        (
            changed(lambda g: g["features"][1]["geometry"].update(coordinates=[1.0])),
            r"node 1 needs coordinates \[x, y\] in metres",
        ),
        (
            changed(lambda g: g["features"][1]["geometry"].update(coordinates=[400.0, 1.0])),
            r"node 1 outside the map, which reaches from 0,0 to 10,7 m; check the frame",
        ),
        (
            graph_of(*swagger_graph()["features"], edge(20, 0, 3), edge(21, 2, 1)),
            "walls or unknown space on edges 20, 21; move the nodes, or remove the edges",
        ),
        (changed(lambda g: g.update(weight=math.nan)), "holds NaN, infinity or"),
    ],
)
def test_faulty_graphs_are_refused_by_id(costs, graph, message):
    with pytest.raises(ConfigError, match=message):
        annotate_graph(costs, graph)


def test_errors_list_at_most_ten_ids(costs):
    through = [edge(100 + n, 0, 3) for n in range(13)]
    with pytest.raises(ConfigError, match=r"edges 100, .*, 109 and 3 more; move"):
        annotate_graph(costs, graph_of(*swagger_graph()["features"], *through))


def test_set_cost_rejects_zero_length_edges(costs):
    graph = graph_of(*swagger_graph()["features"], node(30, NODES[0]), edge(31, 0, 30))
    assert edges_in(annotate_graph(costs, graph))[31]["metadata"]["localization"] == 0.0
    with pytest.raises(ConfigError, match="edge 31 without a length, and Nav2 rejects a cost of 0"):
        annotate_graph(costs, graph, set_cost=True)


def test_edges_along_walls_are_reported(tmp_path, costs):
    """A dock may stand closer to a wall than the robot's radius, and free space is enough."""
    dock = node(30, (1.1, 1.5))
    graph = graph_of(*swagger_graph()["features"], dock, edge(31, 0, 30))
    (tmp_path / "graph.geojson").write_text(json.dumps(graph))
    wide = Costmap.from_layers(costs.grid, u=np.nan_to_num(costs.u), weight=4.0, robot=0.6)
    summary = nav2_graph(tmp_path / "out", wide, tmp_path / "graph.geojson")
    assert 31 in summary.values["blocked_edges"]
    assert (summary.rows[-1][0], summary.rows[-1][1][:4]) == ("too narrow", "edge")
    written = json.loads((tmp_path / "out" / "graph.geojson").read_text())
    assert edges_in(written)[31]["metadata"]["localization"] == pytest.approx(0.4 * 5)


def test_folder_has_graph_and_scorer(tmp_path, costs):
    (tmp_path / "own.geojson").write_text(json.dumps(nav2_graph_of_tool()))
    (tmp_path / "nav2.yaml").write_text(
        "amcl:\n  ros__parameters:\n    alpha1: 0.2\n"
        "route_server:\n  ros__parameters:\n    operations: [AdjustSpeedLimit]\n"
        "    edge_cost_functions: [CostmapScorer]\n"
    )
    with pytest.warns(ParametersChanged, match="edge_cost_functions: without CostmapScorer"):
        summary = nav2_graph(
            tmp_path / "out", costs, tmp_path / "own.geojson", params=tmp_path / "nav2.yaml"
        )
    assert summary.values == {"nodes": 3, "edges": 2, "fixed_edges": [9], "blocked_edges": []}
    assert "edge 9, not overridable; --set-cost replaces it" in summary.rows[1][1]
    written = json.loads((tmp_path / "out" / "graph.geojson").read_text())
    assert written == annotate_graph(costs, nav2_graph_of_tool())
    for name in ("servers.yaml", "nav2.yaml"):
        server = yaml.safe_load((tmp_path / "out" / name).read_text())["route_server"]
        parameters = server["ros__parameters"]
        assert parameters["operations"] == ["AdjustSpeedLimit"]
        assert parameters["edge_cost_functions"] == ["PenaltyScorer", "DynamicEdgesScorer"]
        scorer = {"penalty_tag": "localization", "weight": 1.0}
        assert parameters["PenaltyScorer"] == {**scorer, "plugin": "nav2_route::PenaltyScorer"}
    readme = (tmp_path / "out" / "README.md").read_text()
    assert "2 directed edges between 3 nodes" in readme
    assert "start_id: 0, goal_id: 1" in readme
    assert "original `cost` of 1 edges" in readme
    (tmp_path / "wall.geojson").write_text(
        json.dumps(graph_of(*swagger_graph()["features"], edge(20, 0, 3)))
    )
    with pytest.raises(LocplanError, match=r"wall\.geojson: walls or unknown space on edge 20"):
        nav2_graph(tmp_path / "out2", costs, tmp_path / "wall.geojson")


def test_annotation_ignores_map_yaw(costs):
    """Nav2 ignores the yaw of a map."""
    grid = OccupancyGrid(costs.grid.cells, 1.0, (0.0, 0.0, 0.7))
    turned = Costmap.from_layers(grid, u=np.nan_to_num(costs.u), weight=4.0, robot=0.2)
    with pytest.warns(YawWarning):
        annotated = annotate_graph(turned, swagger_graph())
    assert annotated == annotate_graph(costs, swagger_graph())


def test_command_writes_costs_into_graph(run, tmp_path):
    save_map(ascii_map(*HALL), tmp_path / "hall.yaml")
    file = tmp_path / "own.geojson"
    file.write_text(json.dumps(swagger_graph()))
    ask = "export", tmp_path / "hall.yaml", "--to", "nav2-routes", "-o", tmp_path / "out"
    settings = "--set", "footprint=0.2", "--graph", file
    code, out, _ = run(*ask, *settings, "--set-cost", "--json")
    assert code == 0
    assert json.loads(out)["edges"] == 8
    written = json.loads((tmp_path / "out" / "graph.geojson").read_text())
    for about in edges_in(written).values():
        assert about["cost"] == about["metadata"]["localization"] > 0
    refusals = {
        "--graph takes no paths": (
            "--graph",
            file,
            "--start",
            "1.5,1.5",
            "--goal",
            "8,5",
        ),
        "--set-cost needs a route graph": ("--set-cost",),
        "node 0 is in the frame 'map', but the map is in 'odom'": (
            "--graph",
            file,
            "--frame",
            "odom",
        ),
        "gone.geojson: ": ("--graph", tmp_path / "gone.geojson"),
    }
    for message, options in refusals.items():
        assert message in check_refusal(run(*ask, *options))
    file.write_text("{")
    assert "own.geojson: is not JSON" in check_refusal(run(*ask, "--graph", file))


def test_folder_is_replaced_by_other_graph(tmp_path, costs):
    for graph in (swagger_graph(), nav2_graph_of_tool()):
        (tmp_path / "own.geojson").write_text(json.dumps(graph))
        nav2_graph(tmp_path / "out", costs, tmp_path / "own.geojson")
    written = json.loads((tmp_path / "out" / "graph.geojson").read_text())
    assert len(edges_in(written)) == 2
