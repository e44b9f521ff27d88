"""Recommended ways as route graphs: joined, free, and followed by the server's search."""

from __future__ import annotations

import csv
import json
import math
from itertools import pairwise

import numpy as np
import pytest
import yaml
from scipy.sparse.csgraph import connected_components, dijkstra
from support.command_line import check_refusal
from support.maps import ascii_map

from locplan import load_or_compute, save_map
from locplan.errors import ConfigError
from locplan.export.figures import routes_figure
from locplan.export.parameters import DistroWarning
from locplan.export.path_joining import LineCosts, adjust_edge_costs, join_paths, straighten_routes
from locplan.export.recommended_routes import build_recommended_routes, nav2_routes
from locplan.export.route_graph import RouteGraph, graph_to_geojson
from locplan.export.values import YawWarning
from locplan.field import FieldConfig
from locplan.maps import FREE, OccupancyGrid, environments
from locplan.planning import Costmap, Path, path_metrics, plan

pytestmark = pytest.mark.usefixtures("undrawn")

STATIONS = {"dock": (2.0, 3.0), "gate": (38.0, 3.0), "desk": (5.0, 10.0), "shelf": (36.0, 12.0)}


@pytest.fixture(scope="module")
def costs():
    grid = environments.make("two_corridors", resolution=0.1)
    return Costmap.from_field(load_or_compute(grid, FieldConfig()), robot=0.25)


@pytest.fixture(scope="module")
def paths(costs):
    """The least costly paths from the dock and between two more, and one that is not the least."""
    found = {
        f"{a} to {b}": plan(costs, STATIONS[a], STATIONS[b]).path
        for a, b in (("dock", "gate"), ("dock", "shelf"), ("desk", "shelf"), ("desk", "gate"))
    }
    short = plan(costs.with_weight(0.0), STATIONS["dock"], STATIONS["gate"]).path
    assert short.xy[:, 1].max() < 6 < found["dock to gate"].xy[:, 1].max()
    return found


def cheapest(graph, start, goal):
    before = dijkstra(graph.cost_matrix, indices=start, return_predecessors=True)[1]
    route = [goal]
    while route[-1] != start:
        route.append(int(before[route[-1]]))
    return route[::-1]


def test_route_graph_joins_recommended_paths(costs, paths):
    found = build_recommended_routes(costs, paths)
    apart = sum(path.length for path in paths.values())
    assert found.graph.length.sum() < 0.7 * apart  # most of the corridor is one lane
    assert connected_components(found.graph.cost_matrix)[0] == 1
    for name, way in found.routes.items():
        xy = found.graph.nodes[list(way)]
        np.testing.assert_allclose(xy[[0, -1]], paths[name].xy[[0, -1]], atol=0.02)
        density = np.array([costs.density[costs.grid.cell(p)] for p in Path(xy).resample(0.01)])
        assert np.isinf(density).mean() < 0.002
        assert (
            path_metrics(costs, paths[name]).cost * 1.11
            > LineCosts(costs).compute_polyline_costs(xy).sum()
        )
    e, u = found.graph.integrated_e, found.graph.integrated_u
    assert np.isfinite(e).all()
    assert (u >= 0).all()


def test_cheapest_routes_follow_recommended_paths(costs, paths):
    for given in (
        paths,
        {**paths, "dock to gate": plan(costs.with_weight(0), *list(STATIONS.values())[:2]).path},
    ):
        found = build_recommended_routes(costs, given)
        assert set(found.followed_queries) == set(given)
        for name, way in found.routes.items():
            route = found.graph.nodes[cheapest(found.graph, way[0], way[-1])]
            high, low = route[:, 1].max(), given[name].xy[:, 1].max()
            assert high == pytest.approx(low, abs=2.1)
        assert (found.graph.cost >= found.graph.length - 1e-12).all()


def test_cheapest_path_keeps_edge_costs(costs, paths):
    least = build_recommended_routes(costs, {"dock to gate": paths["dock to gate"]})
    assert least.n_changed_edges == 0
    graph = least.graph
    expected = LineCosts(costs).compute_costs(graph.nodes, graph.edges)
    np.testing.assert_allclose(graph.cost, expected)


def test_edge_cost_adjustment_is_minimal():
    """A detour of a triangle becomes cheapest; if routes conflict, the heavier one wins."""
    nodes = np.array([[0.0, 0.0], [10.0, 0.0], [5.0, 8.0]])
    edges = np.array([[0, 1], [0, 2], [1, 2], [1, 0], [2, 0], [2, 1]])
    length = np.hypot(*(nodes[edges[:, 0]] - nodes[edges[:, 1]]).T)
    given = nodes, edges, length, length
    cost, followed = adjust_edge_costs(*given, [[0, 2, 1]], np.ones(1) * 100)
    assert followed == [True]
    assert cost[0] > cost[1] + cost[5]
    np.testing.assert_allclose(np.abs(cost - length).sum(), 2 * math.hypot(5, 8) - 10, atol=0.03)
    _, followed = adjust_edge_costs(*given, [[0, 2, 1], [1, 0]], np.ones(2) * 100)
    assert followed == [True, True]
    for first in (True, False):
        weights = np.array([200.0, 100.0] if first else [100.0, 200.0])
        cost, followed = adjust_edge_costs(*given, [[0, 2, 1], [0, 1]], weights)
        assert followed == [first, not first]
        assert (cost >= length - 1e-9).all()


def test_path_joins_and_leaves_parallel_lane():
    grid = OccupancyGrid(np.full((100, 400), 254), 0.1)
    lines = LineCosts(Costmap.blank(grid, robot=0.0))
    lane = Path(np.array([[1.0, 5.0], [39.0, 5.0]]))
    beside = Path(np.array([[8.0, 8.0], [12.0, 6.0], [30.0, 6.0], [33.0, 2.0]]))
    far = Path(np.array([[8.0, 9.0], [33.0, 9.0]]))
    nodes, ways = straighten_routes(lines, *join_paths(lines, {"b": beside, "a": lane, "c": far}))
    assert list(ways) == ["b", "a", "c"]
    on_lane = [node for node in ways["b"] if node in ways["a"]]
    assert len(on_lane) >= 2
    assert np.ptp(nodes[on_lane][:, 0]) > 12
    assert [nodes[n].tolist() for n in ways["c"]] == [[8.0, 9.0], [33.0, 9.0]]
    assert all(one != other for way in ways.values() for one, other in pairwise(way))


def test_route_omits_loop_of_path():
    """The wall makes the line from the loop's last node to where the path goes on impassable."""
    cells = np.full((100, 100), 254)
    cells[55:, 48:52] = 0
    lines = LineCosts(Costmap.blank(OccupancyGrid(cells, 0.1), robot=0.0))
    there = [[1.0, 2.0], [5.0, 2.0], [3.0, 9.0], [2.0, 7.0], [5.0, 2.0], [9.0, 8.0]]
    loop = Path(np.array(there))
    for given in ({"loop": loop}, {"lane": Path(loop.xy[1:3]), "loop": loop}):
        nodes, ways = join_paths(lines, given)
        length = lines.compute_polyline_costs(nodes[ways["loop"]]).sum()
        assert length == pytest.approx(4 + math.hypot(4, 6), rel=1e-6)
        edges = [(nodes[a], nodes[b]) for a, b in pairwise(ways["loop"])]
        assert all(math.dist(*edge) > 0.01 for edge in edges)
        assert len(set(ways["loop"])) == len(ways["loop"])


def test_route_graph_rejects_unusable_paths(costs):
    with pytest.raises(ConfigError, match="no path to export"):
        build_recommended_routes(costs, {"stay": Path(np.array([[2.0, 3.0]]))})
    with pytest.raises(ConfigError, match="path wall leaves the map's free space"):
        build_recommended_routes(costs, {"wall": Path(np.array([[2.0, 3.0], [20.0, 6.0]]))})


def test_route_graph_rejects_round_trips(costs, paths):
    """A server's route from a node to itself is empty."""
    round_trip = Path(np.array([[2.0, 3.0], [10.0, 3.0], [2.0, 3.015]]))
    for given in ({"round": round_trip}, {**paths, "round": round_trip}):
        with pytest.raises(ConfigError, match="path round ends at its start"):
            build_recommended_routes(costs, given)
    within_a_point = Path(np.array([[2.0, 3.0], [2.012, 3.0]]))
    found = build_recommended_routes(costs, {**paths, "stay": within_a_point})
    assert set(found.routes) == set(paths)


def test_route_graph_rejects_distant_origin():
    """Nav2 keeps positions in single precision, whose step is 0.25 m there."""
    grid = OccupancyGrid(np.full((50, 50), 254), 0.1, (4e6, 0.0, 0.0))
    path = Path(np.array([[4e6 + 1, 1.0], [4e6 + 4, 4.0]]))
    with pytest.raises(ConfigError, match="too far for Nav2's single"):
        build_recommended_routes(Costmap.blank(grid), {"there": path})


def features_of(folder):
    found = json.loads((folder / "graph.geojson").read_text())["features"]
    points = {f["properties"]["id"]: f for f in found if f["geometry"]["type"] == "Point"}
    return points, [f["properties"] for f in found if f["geometry"]["type"] == "LineString"]


def test_route_export_writes_graph_and_table(tmp_path, costs, paths):
    found = nav2_routes(tmp_path / "routes", costs, paths, distro="humble")
    points, lines = features_of(tmp_path / "routes")
    assert len(points) == len(found.graph.nodes)
    servers = yaml.safe_load((tmp_path / "routes" / "servers.yaml").read_text())
    scorer = servers["route_server"]["ros__parameters"]["PenaltyScorer"]
    assert (scorer["penalty_tag"], scorer["weight"]) == ("penalty", 1.0)
    costs_of = {
        (line["startid"], line["endid"]): line["metadata"]["length"] + line["metadata"]["penalty"]
        for line in lines
    }
    with open(tmp_path / "routes" / "routes.csv", newline="") as file:
        rows = {row["query"]: row for row in csv.DictReader(file)}
    for name, way in found.routes.items():
        start, goal = (points[int(rows[name][end])] for end in ("start_id", "goal_id"))
        np.testing.assert_allclose(start["geometry"]["coordinates"], paths[name].xy[0], atol=0.02)
        np.testing.assert_allclose(goal["geometry"]["coordinates"], paths[name].xy[-1], atol=0.02)
        total = sum(costs_of[one + 1, other + 1] for one, other in pairwise(way))
        assert float(rows[name]["cost"]) == pytest.approx(total, abs=1e-3)
    readme = (tmp_path / "routes" / "README.md").read_text()
    assert "nav2_bringup has none in humble" in readme


def test_route_table_escapes_formulas(tmp_path, costs, paths):
    named = {"=HYPERLINK(1)": paths["dock to gate"]}
    nav2_routes(tmp_path / "routes", costs, named, distro="jazzy")
    with open(tmp_path / "routes" / "routes.csv", newline="") as file:
        assert [row["query"] for row in csv.DictReader(file)] == ["'=HYPERLINK(1)"]


@pytest.mark.parametrize(
    ("distro", "words"),
    [("jazzy", "starts a route server in jazzy"), ("rolling", "graph:=$PWD/graph.geojson")],
)
def test_readme_explains_graph_per_distribution(tmp_path, costs, paths, distro, words):
    if distro == "rolling":
        with pytest.warns(DistroWarning):
            nav2_routes(tmp_path / "r", costs, paths, distro=distro)
    else:
        nav2_routes(tmp_path / "r", costs, paths, distro=distro)
    assert words in (tmp_path / "r" / "README.md").read_text()


def test_route_graph_drops_map_yaw(tmp_path, costs, paths):
    """Nav2 ignores the yaw of a map."""
    grid = OccupancyGrid(costs.grid.cells, 0.1, (*costs.grid.origin[:2], 0.7), name="turned")
    turned = Costmap.from_density(grid, costs.density)
    here = {
        name: Path(np.column_stack(grid.grid_to_world(*costs.grid.world_to_grid(*path.xy.T))))
        for name, path in paths.items()
    }
    with pytest.warns(YawWarning):
        nav2_routes(tmp_path / "turned", turned, here)
    nav2_routes(tmp_path / "plain", Costmap.from_density(costs.grid, costs.density), paths)
    both = (features_of(tmp_path / name)[0].values() for name in ("turned", "plain"))
    one, other = (np.array([f["geometry"]["coordinates"] for f in each]) for each in both)
    np.testing.assert_allclose(one, other, atol=1e-4)


def test_path_along_wall_survives_rounding():
    """Nav2 keeps positions in single precision, which rounds this path into a wall."""
    density = np.ones((16, 60))
    density[8:] = np.inf
    costs = Costmap.from_density(OccupancyGrid(np.full((16, 60), FREE, np.uint8), 0.1), density)
    y = 0.8 - 1e-9
    assert float(np.float32(y)) > 0.8  # in a blocked cell
    along = Path(np.array([[0.35, y], [3.0, y], [5.05, y]]))
    ways = build_recommended_routes(costs, {"along": along})
    assert ways.graph.cost.sum() / 2 == pytest.approx(along.length, rel=1e-3)


def test_command_writes_paths_as_routes(run, tmp_path):
    save_map(ascii_map(*["." * 40] * 12, resolution=0.25), tmp_path / "hall.yaml")
    for name, rows in (("there", "1,1\n9,1"), ("up", "1,1\n1,2.5"), ("round", "1,1\n9,1\n1,1")):
        (tmp_path / f"{name}.csv").write_text(f"x,y\n{rows}\n")
    ask = "export", tmp_path / "hall.yaml", "--to", "nav2-routes", "-o", tmp_path / "out"
    assert "needs paths; add --path CSV, --choice FOLDER or --graph FILE" in check_refusal(
        run(*ask)
    )
    refusal = check_refusal(run(*ask, "--path", tmp_path / "round.csv"))
    assert "path round ends at its start" in refusal
    given = "--path", tmp_path / "there.csv", "--path", tmp_path / "up.csv"
    code, out, _ = run(*ask, *given, "--start", "9,1", "--goal", "9,2.5", "--json")
    assert code == 0
    assert json.loads(out)["followed"] == ["there", "up", "aware"]


def test_routes_figure_colours_cost_per_metre(costs, paths):
    graph = build_recommended_routes(costs, paths).graph
    figure = routes_figure(costs, graph, "routes")
    axes, bar = figure.axes
    (lines,) = axes.collections
    order = np.argsort(graph.cost / graph.length, kind="stable")
    assert np.allclose(lines.get_array(), (graph.cost / graph.length)[order])
    assert np.allclose(np.array(lines.get_segments()), graph.nodes[graph.edges[order]])
    assert lines.get_clim() == (1.0, max(1.1, (graph.cost / graph.length).max()))
    assert bar.get_ylabel() == "cost per metre of the edge"


def test_geojson_costs_match_nav2_scorers(costs, paths):
    graph = build_recommended_routes(costs, paths).graph
    features = json.loads(json.dumps(graph_to_geojson(graph), allow_nan=False))["features"]
    points = [f for f in features if f["geometry"]["type"] == "Point"]
    lines = [f["properties"] for f in features if f["geometry"]["type"] == "LineString"]
    nodes = {p["properties"]["id"]: p["geometry"]["coordinates"] for p in points}
    ids = [*nodes, *(line["id"] for line in lines)]
    assert len(set(ids)) == len(ids) == len(graph.nodes) + len(graph.edges)
    assert all(type(n) is int and 1 <= n <= 2**16 - 1 for n in ids)
    for line in lines:
        metadata, ends = line["metadata"], (nodes[line["startid"]], nodes[line["endid"]])
        assert all(type(v) is float and v >= 0 for v in (*metadata.values(), line["cost"]))
        assert line["overridable"] is True
        assert math.dist(*ends) + metadata["penalty"] == pytest.approx(line["cost"], rel=1e-5)


def test_geojson_writes_whole_numbers_as_floats():
    one = np.ones(1)
    ends, edge = np.array([[0.0, 0.0], [3.0, 0.0]]), np.array([[0, 1]])
    graph = RouteGraph(ends, edge, 3 * one, 3 * one, np.nan * one, np.nan * one)
    (line,) = graph_to_geojson(graph)["features"][2:]
    assert '"length": 3.0, "penalty": 0.0' in json.dumps(line)
