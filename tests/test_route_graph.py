"""Route graphs: free, connected, cheap, and as Nav2 reads them."""

from __future__ import annotations

import json
import math

import cv2
import numpy as np
import pytest
from figure_looks import check_looks
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components, dijkstra

from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.export import RouteGraph, _net, roadmap, routes_figure, to_geojson
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from locplan.planners import plan_field


def rooms(
    size: int = 160, origin: tuple[float, float, float] = (-3.0, 7.0, 0.0), seed: int = 1
) -> Costmap:
    """Four rooms with doors and furniture, and degeneracy in the middle of each; no outer wall."""
    rng = np.random.default_rng(seed)
    cells = np.full((size, size), FREE, np.uint8)
    half, door = size // 2, size // 4
    cells[half - 1 : half + 1] = cells[:, half - 1 : half + 1] = OCCUPIED
    for at in (door, size - door):
        cells[half - 1 : half + 1, at - 4 : at + 4] = FREE
        cells[at - 4 : at + 4, half - 1 : half + 1] = FREE
    for row, col, height, width in rng.integers(4, size - 12, (size // 8, 4)):
        cells[row : row + 2 + height % 8, col : col + 2 + width % 8] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1, origin)
    wave = np.sin(np.arange(size) / half * math.pi) ** 2
    u = np.outer(wave, wave)
    return Costmap.from_layers(grid, u=u, e=u / 10, weight=0.0, robot=0.2)


def pieces(costs: Costmap) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    free = np.isfinite(costs.density).astype(np.uint8)
    _, piece, stats, _ = cv2.connectedComponentsWithStats(free, connectivity=4)
    return piece, stats[:, cv2.CC_STAT_AREA]


def cells_of(costs: Costmap, xy: NDArray[np.float64]) -> tuple[NDArray[np.int64], ...]:
    return tuple(np.floor(v).astype(np.int64) for v in costs.grid.world_to_grid(*xy.T))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("origin", [(-3.0, 7.0, 0.0), (5.0, -2.0, 0.7)])
def test_edges_are_free_and_join_what_is_connected(seed: int, origin: tuple) -> None:
    costs = rooms(origin=origin, seed=seed).with_weight(4.0)
    graph = roadmap(costs)
    # Independent of the exact integral: positions every twentieth of a cell.
    share = np.linspace(0, 1, 1 + math.ceil(graph.length.max() / 0.005))[:, None, None]
    first, second = graph.nodes[graph.edges.T]
    along = (first + share * (second - first)).reshape(-1, 2)
    density = costs.density[cells_of(costs, along)].reshape(len(share), -1)
    assert np.isfinite(density).all()
    assert np.allclose(density.mean(axis=0) * graph.length, graph.cost, rtol=0.02)
    assert graph.length.min() > 0
    assert (graph.nodes == graph.nodes.astype(np.float32)).all()
    # The graph's components are the pieces of free space.
    piece, area = pieces(costs)
    of_node = piece[cells_of(costs, graph.nodes)]
    large = np.flatnonzero((area * 0.01 >= 1.0) & (np.arange(len(area)) > 0))
    assert set(of_node) == set(large)
    _, component = connected_components(graph.matrix, directed=False)
    assert len(set(zip(of_node, component, strict=True))) == len(large) == component.max() + 1


@pytest.mark.parametrize("weight", [0.0, 4.0])
def test_routes_cost_little_more_than_the_grid_planners(weight: float) -> None:
    costs = rooms().with_weight(weight)
    graph = roadmap(costs)
    ratios = []
    for goal in range(0, len(graph.nodes), max(1, len(graph.nodes) // 12)):
        exact = plan_field(costs, graph.nodes[goal]).cost[cells_of(costs, graph.nodes)]
        far = exact > 2.0
        ratios.append(dijkstra(graph.matrix, indices=goal)[far] / exact[far])
    ratio = np.concatenate(ratios)
    assert np.median(ratio) < 1.01
    assert np.quantile(ratio, 0.95) < 1.15
    assert len(graph.edges) < 1.7 * len(graph.nodes)


def test_lanes_follow_the_cheap_ways() -> None:
    costs = rooms().with_weight(4.0)
    shares = []
    for each in (roadmap(costs), roadmap(costs.with_weight(0.0))):
        graph = RouteGraph.over(costs, each.nodes, each.edges)
        shares.append(graph.cost.sum() / graph.length.sum())
    assert shares[0] < 0.8 * np.mean(costs.density[np.isfinite(costs.density)])
    assert shares[0] < 0.9 * shares[1]


def test_open_floor_has_few_long_lanes_that_do_not_cross() -> None:
    costs = Costmap.blank(OccupancyGrid(np.full((300, 400), FREE), 0.1), robot=0.3)
    graph = roadmap(costs)
    assert len(graph.nodes) < 1200 / 5.0**2
    assert graph.length.mean() > 4.5
    ends = graph.nodes @ (1, 1j)
    a, b = ends[graph.edges].T[:, :, None]
    c, d = ends[graph.edges].T[:, None]
    with np.errstate(all="ignore"):
        s = ((c - a).conj() * (d - c)).imag / ((b - a).conj() * (d - c)).imag
        t = ((c - a).conj() * (b - a)).imag / ((b - a).conj() * (d - c)).imag
    assert not ((s > 1e-6) & (s < 1 - 1e-6) & (t > 1e-6) & (t < 1 - 1e-6)).any()
    far = np.hypot(*(graph.nodes[:, None] - graph.nodes).T)
    ratio = dijkstra(graph.matrix)[far > 2] / far[far > 2]
    assert np.median(ratio) < 1.07
    assert ratio.max() < 1.9


def test_a_corridor_is_a_chain_of_long_edges() -> None:
    costs = Costmap.blank(OccupancyGrid(np.full((20, 600), FREE), 0.1), robot=0.3)
    graph = roadmap(costs)
    assert len(graph.edges) == len(graph.nodes) - 1 <= 12
    assert (np.bincount(graph.edges.ravel()) <= 2).all()
    straight = np.ptp(graph.nodes[:, 0])
    assert straight > 44
    assert graph.length.sum() < 1.001 * straight


def test_every_block_has_lanes_around_it() -> None:
    cells = np.full((170, 170), FREE, np.uint8)
    for row, col in np.argwhere(np.ones((4, 4))) * 40:
        cells[row + 10 : row + 40, col + 10 : col + 40] = OCCUPIED
    graph = roadmap(Costmap.blank(OccupancyGrid(cells, 0.1), robot=0.2))
    assert len(graph.edges) - len(graph.nodes) + graph.components == 16
    assert len(graph.edges) < 70  # 40 from crossing to crossing


def test_lanes_lead_into_nooks() -> None:
    cells = np.full((70, 300), OCCUPIED, np.uint8)
    cells[30:40] = FREE
    for col in range(20, 260, 34):
        cells[40:70, col : col + 8] = cells[60:70, col : col + 26] = FREE
    costs = Costmap.blank(OccupancyGrid(cells, 0.1), robot=0.2)
    assert seen_share(costs, roadmap(costs), np.isfinite(costs.density)) > 0.99


def test_closer_lanes_are_more_and_cheaper() -> None:
    costs = rooms().with_weight(4.0)
    near, far = roadmap(costs, spacing=1.0), roadmap(costs, spacing=3.0)
    assert len(near.edges) > 3 * len(far.edges)
    loose, tight = roadmap(costs, spacing=1.0, detour=1.5), roadmap(costs, spacing=1.0, detour=1.0)
    assert len(loose.edges) < len(near.edges) < len(tight.edges)


def test_graphs_of_lines_of_ones_own() -> None:
    costs = rooms().with_weight(4.0)
    made = roadmap(costs)
    again = RouteGraph.over(costs, made.nodes, made.edges[:, ::-1])
    for name in ("nodes", "length", "cost", "integrated_e", "integrated_u"):
        assert np.array_equal(getattr(made, name), getattr(again, name))
    assert RouteGraph.over(costs, made.nodes[:2], []).components == 2
    one = RouteGraph.over(costs, made.nodes[made.edges[0]], [(0, 1)], directed=True)
    assert one.matrix.toarray().tolist() == [[0.0, made.cost[0]], [0.0, 0.0]]
    assert "1 directed edges" in repr(one)
    lines = [f["properties"] for f in to_geojson(one)["features"] if "startid" in f["properties"]]
    assert [(line["startid"], line["endid"]) for line in lines] == [(1, 2)]
    wall = [(costs.grid.grid_to_world(row, 30.5)) for row in (75.5, 84.5)]
    for nodes in (wall, [made.nodes[0], made.nodes[0]]):
        with pytest.raises(ConfigError, match="has no length, or touches a blocked cell"):
            RouteGraph.over(costs, nodes, [(0, 1)])


@pytest.mark.draws
def test_the_picture_has_each_edge_in_the_colour_of_its_cost_per_metre() -> None:
    costs = rooms().with_weight(4.0)
    graph = roadmap(costs)
    figure = routes_figure(costs, graph, "rooms")
    check_looks(figure, "routes")
    axes, bar = figure.axes
    (lines,) = axes.collections
    order = np.argsort(graph.cost / graph.length, kind="stable")
    assert np.allclose(lines.get_array(), (graph.cost / graph.length)[order])
    assert np.allclose(np.array(lines.get_segments()), graph.nodes[graph.edges[order]])
    assert lines.get_clim() == (1.0, (graph.cost / graph.length).max())
    assert bar.get_ylabel() == "cost per metre of an edge"
    assert axes.get_title() == "rooms"
    blank = Costmap.blank(costs.grid, robot=0.2)
    assert routes_figure(blank, roadmap(blank), "").axes[0].collections[0].get_clim() == (1.0, 1.1)


def seen_share(costs: Costmap, graph: RouteGraph, inside: NDArray[np.bool_]) -> float:
    """The share of cells that see a node within 5 m."""
    xy = np.column_stack(costs.grid.grid_to_world(*(np.argwhere(inside)[::17] + 0.5).T))
    seen = []
    for position in xy:
        near = graph.nodes[np.hypot(*(graph.nodes - position).T) < 5.0]
        lines = position + np.linspace(0, 1, 500)[:, None, None] * (near - position)
        density = costs.density[cells_of(costs, lines.reshape(-1, 2))].reshape(500, -1)
        seen.append(np.isfinite(density).all(axis=0).any())
    return float(np.mean(seen))


def test_free_cells_see_a_node() -> None:
    costs = rooms().with_weight(4.0)
    piece, area = pieces(costs)
    inside = (piece > 0) & (area[piece] * 0.01 >= 1.0)
    assert seen_share(costs, roadmap(costs), inside) > 0.98


def test_integrals_and_determinism() -> None:
    costs = rooms().with_weight(4.0)
    one, two = roadmap(costs), roadmap(costs)
    for name in ("nodes", "edges", "length", "cost", "integrated_e", "integrated_u"):
        assert np.array_equal(getattr(one, name), getattr(two, name))
    assert np.allclose(one.penalty, 4.0 * one.integrated_u, atol=1e-9)
    assert np.allclose(one.integrated_e, one.integrated_u / 10)
    assert (one.penalty >= 0).all()


def test_progress_counts_up_and_can_end_the_work() -> None:
    costs, told = rooms().with_weight(4.0), []

    def note(done: int, total: int) -> None:
        told.append((done, total))

    roadmap(costs, progress=note)
    done, totals = zip(*told, strict=True)
    assert list(done) == sorted(done)
    assert {*totals} == {done[-1]}
    assert len({*done}) > 10

    def stop(now: int, total: int) -> None:
        if now >= 40:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        roadmap(costs, progress=stop)


def test_lanes_do_not_depend_on_the_strips_whose_worth_is_computed(monkeypatch) -> None:
    costs = rooms().with_weight(4.0)
    whole = roadmap(costs)
    monkeypatch.setattr(_net, "BAND", 700)
    strips = roadmap(costs)
    for name in ("nodes", "edges", "cost"):
        assert np.array_equal(getattr(whole, name), getattr(strips, name))


def test_a_map_without_walls_has_lanes() -> None:
    cells = np.full((80, 80), UNKNOWN, np.uint8)
    cells[5:75, 5:75] = FREE
    assert roadmap(Costmap.blank(OccupancyGrid(cells, 0.1))).components == 1


def loaded(text: str) -> tuple[dict[int, NDArray], list[dict]]:
    """As GeoJsonGraphFileLoader: what is written with a point or an exponent is a float."""
    features = json.loads(text)["features"]
    points = [f for f in features if f["geometry"]["type"] == "Point"]
    lines = [f["properties"] for f in features if f["geometry"]["type"] == "LineString"]
    nodes = {
        p["properties"]["id"]: np.array(p["geometry"]["coordinates"], np.float32) for p in points
    }
    assert len(nodes) == len(points)
    assert all(line["startid"] in nodes and line["endid"] in nodes for line in lines)
    return nodes, lines


def test_geojson_makes_nav2s_scorers_add_up_to_j() -> None:
    costs = rooms().with_weight(4.0)
    graph = roadmap(costs)
    nodes, lines = loaded(json.dumps(to_geojson(graph), allow_nan=False))
    ids = [*nodes, *(line["id"] for line in lines)]
    assert len(set(ids)) == len(ids) == len(graph.nodes) + 2 * len(graph.edges)
    assert all(type(n) is int and 1 <= n <= 2**16 - 1 for n in ids)
    ways = {(line["startid"], line["endid"]): line for line in lines}
    assert len(ways) == len(lines)
    for (start, end), line in ways.items():
        metadata, distance = line["metadata"], float(np.hypot(*(nodes[end] - nodes[start])))
        assert all(type(v) is float and v >= 0 for v in (*metadata.values(), line["cost"]))
        assert line["cost"] > 0
        assert line["overridable"] is True
        assert distance + metadata["penalty"] == pytest.approx(line["cost"], rel=1e-5)
        assert distance + 4.0 * metadata["integrated_u"] == pytest.approx(line["cost"], rel=1e-5)
        assert ways[end, start]["metadata"] == metadata


def test_whole_numbers_are_written_as_floats() -> None:
    one = np.ones(1)
    graph = RouteGraph(
        np.array([[0.0, 0.0], [3.0, 0.0]]), np.array([[0, 1]]), 3 * one, 3 * one, one, 0 * one
    )
    _, lines = loaded(json.dumps(to_geojson(graph)))
    assert '"length": 3.0' in json.dumps(lines[0])
    assert '"penalty": 0.0' in json.dumps(lines[0])


def test_without_a_field_there_is_no_e_and_no_u() -> None:
    costs = Costmap.blank(OccupancyGrid(np.full((60, 80), FREE), 0.1), robot=0.0)
    _, lines = loaded(json.dumps(to_geojson(roadmap(costs)), allow_nan=False))
    assert lines[0]["metadata"].keys() == {"length", "penalty"}


@pytest.mark.parametrize("shape", [(1, 60), (2, 2), (60, 1)])
def test_the_least_spaces(shape: tuple[int, int]) -> None:
    graph = roadmap(
        Costmap.blank(OccupancyGrid(np.full(shape, FREE), 0.1), robot=0.0), min_area=0.0
    )
    assert graph.components == (1 if len(graph.nodes) else 0)
    assert set(graph.edges.ravel()) == set(range(len(graph.nodes)))


def test_by_default_a_square_metre_of_free_space_has_lanes_and_less_has_none() -> None:
    def laid(rows: int) -> RouteGraph:
        cells = np.full((rows, 10), FREE)
        return roadmap(Costmap.blank(OccupancyGrid(cells, 0.1), robot=0.0), spacing=0.3)

    assert len(laid(12).nodes)
    with pytest.raises(ConfigError, match="as large as 1 m"):
        laid(9)


def test_what_cannot_be() -> None:
    costs = rooms(80)
    for wrong in ({"spacing": 0.1}, {"spacing": math.nan}, {"detour": 0.9}, {"min_area": 1e6}):
        with pytest.raises(ConfigError):
            roadmap(costs, **wrong)
    with pytest.raises(ConfigError, match="too coarse"):
        roadmap(rooms(80, origin=(4e5, 5e6, 0.0)))
    alone = Costmap.blank(OccupancyGrid(np.full((2, 2), FREE), 0.1), robot=0.0)
    with pytest.raises(ConfigError, match="without edges"):
        to_geojson(roadmap(alone, min_area=0.0))
    count = 2**16 - 1
    many = RouteGraph(*(np.zeros((count, 2)),), np.zeros((9, 2), int), *(np.zeros(9),) * 4)
    with pytest.raises(ConfigError, match="times as large"):
        to_geojson(many)
