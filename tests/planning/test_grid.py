"""A*, Dijkstra's algorithm and the grid planner that chooses between them."""

import dataclasses
import itertools
import json

import numpy as np
import pytest
from support import oracles
from support.costmaps import costmap_from_density
from support.machine import SHARED_DATA
from support.movingai import find_map_file, find_scenario_files, read_map, read_scenarios

import locplan
from locplan._support.kernels import search, ways
from locplan.comparison import Execution, RandomQueries, compare
from locplan.errors import ConfigError, LocplanError
from locplan.planning import Costmap, PlannerResult, pareto_front, plan


def make_noise_costmap(shape, seed, *, blocked=0.25, greatest=9.0) -> Costmap:
    """A costmap of noise from 1 to `greatest`, of even logarithms, with its corners free."""
    rng = np.random.default_rng(seed)
    density = np.exp(rng.uniform(0, np.log(greatest), shape))
    density[rng.random(shape) < blocked] = np.inf
    density[0, 0] = density[-1, -1] = 1.0
    return costmap_from_density(density)


def corners(costs: Costmap):
    rows, columns = costs.grid.shape
    return (0.5, 0.5), (columns - 0.5, rows - 0.5)


def search_from_corner(
    costs: Costmap, cutting: bool, *, guided=False, goal=True
) -> search.SearchResult:
    """Search from the first cell, to the last one if there is a goal."""
    half, columns = search.make_bordered_half_density(costs.density, 1), costs.grid.shape[1] + 2
    ends = columns + 1, half.size - columns - 2 if goal else -1
    return search.search_grid(
        *(half, columns, *ends, cutting), search.measure_cost_scale(half), guided=guided
    )


def costs_from_corner(costs: Costmap, cutting: bool) -> np.ndarray:
    rows, columns = np.add(costs.grid.shape, 2)
    cost = np.abs(search_from_corner(costs, cutting, goal=False).cost)
    return cost.reshape(rows, columns)[1:-1, 1:-1]


@pytest.mark.parametrize("cutting", [False, True])
@pytest.mark.parametrize("greatest", [1.0, 1.5, 9.0, 1e6])
def test_searches_find_same_cheapest_path(greatest, cutting):
    reached = 0
    for seed in range(6):
        costs = make_noise_costmap((31, 44), seed, greatest=greatest)
        expected = oracles.search.shortest_costs(costs.density, (0, 0), cutting)[-1, -1]
        options = {"allow_corner_cutting": cutting}
        plans = {
            name: plan(costs, *corners(costs), planner=name, **options)
            for name in ("grid", "astar", "dijkstra")
        }
        for name, result in plans.items():
            assert result.planner == name
            assert result.status == ("unreachable" if np.isinf(expected) else "solved")
            assert (result.path is None) == np.isinf(expected)
            if result.path:
                assert result.metrics.cost == pytest.approx(expected, rel=1e-12)
                np.testing.assert_array_equal(result.path.xy, plans["dijkstra"].path.xy)
                reached += 1
    assert reached >= 9


def test_searches_break_ties_equally():
    rng = np.random.default_rng(8)
    solved = 0
    for _ in range(1500):
        density = rng.integers(1, 3, (20, 20)).astype(float) ** rng.integers(2)
        density[rng.random(density.shape) < rng.uniform(0, 0.4)] = np.inf
        cells = rng.integers(20, size=(2, 2))
        density[tuple(cells.T)] = 1.0
        half, scale = search.make_bordered_half_density(density, 1), search.CostScale(1.0, 2.0, 1.5)
        source, goal = ((cells + 1) @ (22, 1)).tolist()
        results = [
            search.search_grid(half, 22, source, goal, False, scale, guided=guided)
            for guided in (False, True)
        ]
        if np.isfinite(results[0].cost[goal]):
            solved += 1
            paths = [ways.trace_path(half, 22, result.cost, goal, False) for result in results]
            np.testing.assert_array_equal(*paths)
    assert solved > 1200


def test_searches_agree_on_real_maps():
    folders = sorted((SHARED_DATA / "rosmaps").glob("*")) if SHARED_DATA.is_dir() else []
    if not folders:
        pytest.skip("the real maps (../shared/data/rosmaps) are not here")
    rng, solved, fewer = np.random.default_rng(5), 0, 0
    for folder in folders[::6]:
        file = next(iter(sorted(folder.glob("*.yaml"))), None)
        try:
            grid = locplan.load_map(file)
        except (LocplanError, UserWarning):
            continue
        if grid.cells.size > 500_000 or grid.free.sum() < 1000:
            continue
        rows, columns = np.indices(grid.shape)
        u = 0.5 + 0.5 * np.sin(rows / 9) * np.cos(columns / 14)
        costs = Costmap.from_density(grid, np.where(grid.free, 1 + 2 * u, np.inf))
        cells = np.argwhere(grid.free)
        for pair in rng.integers(len(cells), size=(3, 2)):
            ends = [grid.position(*map(int, cells[n])) for n in pair]
            plans = [plan(costs, *ends, planner=name) for name in ("astar", "dijkstra", "grid")]
            assert len({result.status for result in plans}) == 1
            if plans[0].path:
                solved += 1
                fewer += plans[0].expanded < plans[1].expanded
                for result in plans[1:]:
                    np.testing.assert_array_equal(result.path.xy, plans[0].path.xy)
    assert solved > 5
    assert fewer >= 0.9 * solved


@pytest.mark.parametrize("guided", [False, True])
def test_search_finds_optimal_scenario_lengths(guided):
    files = find_scenario_files()
    assert files
    for path in files:
        density = read_map(find_map_file(path))
        half, columns = search.make_bordered_half_density(density, 1), density.shape[1] + 2
        scale = search.measure_cost_scale(half)
        for start, goal, optimal in read_scenarios(path):
            source, target = ((row + 1) * columns + col + 1 for row, col in (start, goal))
            result = search.search_grid(half, columns, source, target, False, scale, guided=guided)
            cost = abs(result.cost[target])
            assert cost == pytest.approx(optimal, abs=0.005), (path.name, start, goal)


def test_astar_expands_fewer_cells_than_dijkstra():
    """Without a goal, Dijkstra's algorithm expands each cell once."""
    costs = costmap_from_density(np.ones((101, 101)))
    ends = (50.5, 50.5), (90.5, 50.5)
    around = plan(costs, *ends, planner="dijkstra").expanded
    ahead = plan(costs, *ends, planner="astar").expanded
    assert 2500 < around <= 101 * 101
    assert 40 <= ahead < around / 10
    everywhere = search_from_corner(make_noise_costmap((60, 60), 2, blocked=0.0), False, goal=False)
    assert everywhere.expanded == 3600


def test_grid_planner_chooses_search_by_contrast():
    """At low contrast it runs A*, otherwise Dijkstra's algorithm."""
    for greatest, name in ((6.0, "astar"), (36.0, "dijkstra")):
        density = np.full((60, 60), greatest)
        density[:, 0] = 1.0  # A* believes that a path could be all of such cells
        costs = costmap_from_density(density)
        ends = (20.5, 30.5), (40.5, 30.5)
        counts = {
            each: plan(costs, *ends, planner=each).expanded
            for each in ("grid", "astar", "dijkstra")
        }
        assert counts["astar"] != counts["dijkstra"]
        assert counts["grid"] == counts[name]


@pytest.mark.parametrize("guided", [False, True])
@pytest.mark.parametrize(
    "change",
    [{"MAX_BUCKETS": 4}, {"ROOM": 16, "WIDTH_TO_MEAN": 50.0}, {"STRETCH": 1}],
)
def test_search_costs_ignore_queue_settings(change, guided, monkeypatch):
    costs = make_noise_costmap((30, 37), 4, blocked=0.1, greatest=1e3)
    expected = oracles.search.shortest_costs(costs.density, (0, 0), False)
    plain = search_from_corner(costs, False, guided=guided)
    for name, value in change.items():
        monkeypatch.setattr(search, name, value)
    np.testing.assert_allclose(costs_from_corner(costs, False), expected, rtol=1e-12)
    again = search_from_corner(costs, False, guided=guided)
    last = -costs.grid.shape[1] - 4
    assert abs(again.cost[last]) == pytest.approx(expected[-1, -1], rel=1e-12)
    if "ROOM" not in change:
        assert again.expanded == plain.expanded


@pytest.mark.parametrize("costly", [1e5, 1e9])
def test_search_crosses_costly_wall(costly):
    density = np.random.default_rng(3).uniform(1, 9, (24, 20))
    density[12] = costly
    expected = oracles.search.shortest_costs(density, (0, 0), False)
    np.testing.assert_allclose(
        costs_from_corner(costmap_from_density(density), False), expected, rtol=1e-12
    )


def test_search_without_time_is_unfinished(monkeypatch):
    monkeypatch.setattr(search, "STRETCH", 10)
    half = search.make_bordered_half_density(np.ones((30, 30)), 1)
    arguments = half, 32, 33, -1, False, search.measure_cost_scale(half)
    assert search.search_grid(*arguments).finished
    short = search.search_grid(*arguments, until=0.0)
    assert not short.finished
    assert short.expanded < 900


def test_expansions_stand_in_json():
    costs = costmap_from_density(np.ones((9, 9)))
    plans = {name: plan(costs, *corners(costs), planner=name) for name in ("grid", "any-angle")}
    summaries = {name: json.loads(json.dumps(result.summary())) for name, result in plans.items()}
    assert summaries["grid"]["expanded"] == plans["grid"].expanded > 0
    assert summaries["any-angle"]["expanded"] is None


def test_expansions_are_summed_over_waypoints():
    costs = costmap_from_density(np.ones((20, 20)))
    stops = (0.5, 0.5), (15.5, 3.5), (19.5, 19.5)
    legs = [plan(costs, a, b, planner="astar").expanded for a, b in itertools.pairwise(stops)]
    whole = plan(costs, stops[0], stops[2], planner="astar", via=stops[1:2])
    assert whole.expanded == sum(legs)
    assert plan(costs, stops[0], stops[2], via=stops[1:2]).expanded is None


@pytest.mark.usefixtures("inline_workers")
def test_journal_keeps_expanded_cells_of_runs(tmp_path):
    costs = costmap_from_density(np.ones((12, 12)))
    execution = Execution(workers=1, journal=tmp_path / "runs.jsonl")
    planners = ["astar", "dijkstra", "any-angle"]
    queries = RandomQueries(2, min_distance=3.0)
    found = compare({"mine": costs}, planners, queries, execution=execution)
    again = compare({"mine": costs}, planners, queries, execution=execution)
    for run, read in zip(found.runs, again.runs, strict=True):
        assert read.expanded == run.expanded
        assert (run.expanded is None) == (run.task.planner == "any-angle")


def test_plan_rejects_non_integer_expansions():
    costs = costmap_from_density(np.ones((3, 3)))
    with pytest.raises(LocplanError, match="expanded cells must be whole, not 'many'"):
        plan(costs, *corners(costs), planner=lambda *query: PlannerResult(expanded="many"))


def with_u_and_e(costs: Costmap) -> Costmap:
    u = np.clip((costs.density - 1) / 8, 0, 1)
    return dataclasses.replace(costs, u=u, e=u + 0.1, weight=8.0)


def test_front_reports_timeout(monkeypatch):
    """The time does not suffice even for the ends of the front."""
    costs = with_u_and_e(make_noise_costmap((30, 30), 1, blocked=0.1))
    monkeypatch.setattr(search, "STRETCH", 10)
    front = pareto_front(costs, *corners(costs), time_limit=1e-9)
    assert front.status == "timeout"
    assert len(front) == 0
    assert "no path was found within" in repr(front)
    assert front.report().startswith("timeout: no path was found within")
    about = json.loads(json.dumps(front.summary(), allow_nan=False))
    assert (about["status"], about["epsilon"]) == ("timeout", None)
    with pytest.raises(ConfigError, match="raise time_limit"):
        front.plan(0)
    with pytest.raises(ConfigError, match="raise time_limit"):
        _ = front.knee
    late = plan(costs, *corners(costs), budget=1e3, time_limit=1e-9)
    assert late.status == "timeout"
    assert "take longer than 1e-09 s" in late.note


def test_fronts_say_their_status():
    costs = with_u_and_e(make_noise_costmap((20, 20), 1, blocked=0.1))
    assert pareto_front(costs, *corners(costs)).status == "solved"
    apart = with_u_and_e(costmap_from_density(np.array([[1.0, np.inf, 1.0]])))
    assert pareto_front(apart, (0.5, 0.5), (2.5, 0.5)).status == "unreachable"
