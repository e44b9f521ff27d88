"""The route server's parameters in a robot's own file."""

import json
import warnings

import pytest
import yaml

from locplan import Costmap, plan
from locplan.export import nav2_routes
from locplan.export.parameters import ParametersChanged
from locplan.maps import environments

pytestmark = pytest.mark.usefixtures("undrawn")

PARAMS = """planner_server: {ros__parameters: {planner_plugins: [GridBased]}}
route_server:
  ros__parameters:
    boundary_radius_to_achieve_node: 1.0  # as the hall is
    smooth_corners: true
    operations: ["AdjustSpeedLimit", "CollisionMonitor"]
    AdjustSpeedLimit: {plugin: "nav2_route::AdjustSpeedLimit"}
    CollisionMonitor:
      plugin: "nav2_route::CollisionMonitor"
      max_collision_dist: 3.0  # metres
    edge_cost_functions: ["DistanceScorer", "CostmapScorer"]
    DistanceScorer: {plugin: "nav2_route::DistanceScorer"}
    CostmapScorer: {plugin: "nav2_route::CostmapScorer"}
"""
TYPES = {
    "boundary_radius_to_achieve_node": float,
    "edge_cost_functions": list,
    "graph_file_loader": str,
    "graph_filepath": str,
    "operations": list,
    "smooth_corners": bool,
    "PenaltyScorer.penalty_tag": str,
    "PenaltyScorer.weight": float,
}
"""Parameters of the route server with the types that Nav2 declares (nav2_route, 2026-08)."""


@pytest.fixture(scope="module")
def costs():
    return Costmap.blank(environments.make("two_corridors", resolution=0.1), robot=0.25)


@pytest.fixture(scope="module")
def paths(costs):
    return {"there": plan(costs, (2, 3), (38, 3)).path}


def written(folder, costs, paths):
    (folder / "own.yaml").write_text(PARAMS)
    with warnings.catch_warnings(record=True, action="always") as caught:
        nav2_routes(folder / "g", costs, paths, params=folder / "own.yaml")
    changed = [str(w.message) for w in caught if w.category is ParametersChanged]
    text = (folder / "g" / "nav2.yaml").read_text()
    return text, yaml.safe_load(text)["route_server"]["ros__parameters"], changed


def test_export_keeps_operations_and_comments(tmp_path, costs, paths):
    text, own, changed = written(tmp_path, costs, paths)
    assert "1.0  # as the hall is" in text
    assert "max_collision_dist: 3.0  # metres" in text
    assert own["operations"] == ["AdjustSpeedLimit", "CollisionMonitor"]
    assert own["edge_cost_functions"] == ["DistanceScorer", "PenaltyScorer", "DynamicEdgesScorer"]
    assert own["smooth_corners"] is False
    assert own["graph_filepath"] == str(tmp_path / "g" / "graph.geojson")
    (line,) = changed
    assert "route_server.edge_cost_functions: without CostmapScorer" in line
    assert "route_server.smooth_corners: false (was true)" in line
    # The server that the folder starts itself has the operations, too, and its graph by the launch.
    servers = yaml.safe_load((tmp_path / "g" / "servers.yaml").read_text())
    alone = servers["route_server"]["ros__parameters"]
    assert alone["CollisionMonitor"]["max_collision_dist"] == 3.0
    assert alone.keys() == own.keys() - {"graph_filepath"}


def test_route_server_parameters_have_declared_types(tmp_path, costs, paths):
    _, own, _ = written(tmp_path, costs, paths)
    for name, kind in TYPES.items():
        value = own
        for key in name.split("."):
            value = value[key]
        assert type(value) is kind, name
    for name in (*own["edge_cost_functions"], *own["operations"], own["graph_file_loader"]):
        assert own[name]["plugin"] == f"nav2_route::{name}"


@pytest.mark.parametrize(
    ("distro", "words"),
    [
        ("humble", "nav2_bringup has none in humble"),
        ("jazzy", "params_file:=$PWD/nav2.yaml`"),
        ("kilted", "params_file:=$PWD/nav2.yaml graph:=$PWD/graph.geojson`"),
    ],
)
def test_readme_shows_route_server_commands(tmp_path, costs, paths, distro, words):
    (tmp_path / "own.yaml").write_text(PARAMS)
    with warnings.catch_warnings(action="ignore"):
        settings = {"params": tmp_path / "own.yaml", "distro": distro}
        nav2_routes(tmp_path / "g", costs, paths, **settings)
    text = (tmp_path / "g" / "README.md").read_text()
    assert words in text
    assert "/compute_route nav2_msgs/action/ComputeRoute" in text
    graph = json.loads((tmp_path / "g" / "graph.geojson").read_text())
    nodes = [each["geometry"] for each in graph["features"] if each["geometry"]["type"] == "Point"]
    x, y = nodes[-1]["coordinates"]
    assert f"position: {{x: {x:.2f}, y: {y:.2f}}}" in text  # a place on this map
    assert ("names the graph by its full path on this machine" in text) == (distro == "jazzy")
