import dataclasses
import math

import numpy as np
import pytest
from skimage.graph import MCP_Geometric
from support import oracles
from support.costmaps import costmap_from_density, random_density
from support.machine import SHARED_DATA
from support.maps import ascii_map, random_rooms
from support.toy_planner import ToyPlanner
from support.zones import crosses, random_zones

from locplan._support.kernels import search
from locplan.comparison import Execution, RandomQueries, compare
from locplan.errors import ConfigError, LocplanError, PoseError
from locplan.maps import OccupancyGrid, read_map
from locplan.planning import (
    PLANNERS,
    Costmap,
    Path,
    Plan,
    Planner,
    PlannerResult,
    path_metrics,
    plan,
    plan_field,
    random_queries,
)
from locplan.planning.any_angle import AnyAngle
from locplan.planning.grid import GridPlanner
from locplan.planning.ompl.planner import Ompl
from locplan.planning.plans import plan_with_shortest
from locplan.planning.registry import PlannerEntry, list_planner_names
from locplan.planning.requests import make_planner


@pytest.mark.parametrize("planner", ["grid", "any-angle", "lattice"])
def test_no_path_crosses_zone(planner):
    """Zones lie on the path that the grid planner finds without them."""
    grid = OccupancyGrid(random_rooms((60, 90), seed=6), 0.1, (2.0, -1.0, 0.3))
    blank, rng, solved = Costmap.blank(grid, robot=0.1), np.random.default_rng(3), 0
    for query in random_queries(blank, 2, seed=2, min_distance=4.0):
        before = plan(blank, query.start, query.goal, planner="grid").path
        zones = random_zones(rng, grid, before.resample(0.1).xy)
        assert crosses(zones, grid, before.xy)
        costs = Costmap.from_layers(grid, u=rng.random(grid.shape), robot=0.1, zones=zones)
        for each in (costs, costs.for_shortest, Costmap.blank(grid, robot=0.1, zones=zones)):
            path = plan(each, query.start, query.goal, planner=planner).path
            if path is not None:
                solved += 1
                assert not crosses(zones, grid, path.xy)
    assert solved > 2


@pytest.mark.long
@pytest.mark.parametrize("name", ["nav2_depot", "rmf_office_scan", "tb4_maze"])
def test_real_map_path_crosses_no_zone(name):
    folder = SHARED_DATA / "rosmaps" / name
    if not folder.is_dir():
        pytest.skip("the real maps (../shared/data/rosmaps) are not here")
    grid, _ = read_map(min(folder.glob("*.yaml")))
    blank, rng = Costmap.blank(grid, robot=0.2), np.random.default_rng(1)
    for query in random_queries(blank, 4, seed=2, min_distance=3.0):
        before = plan(blank, query.start, query.goal, planner="grid").path
        zones = random_zones(rng, grid, before.resample(0.1).xy)
        costs = Costmap.from_layers(grid, u=rng.random(grid.shape), robot=0.2, zones=zones)
        for planner in ("grid", "any-angle"):
            path = plan(costs, query.start, query.goal, planner=planner).path
            assert path is None or not crosses(zones, grid, path.xy)


def costs_from_corner(density, corner_cutting) -> np.ndarray:
    """The kernel's costs from cell (0, 0), (H, W)."""
    rows, columns = density.shape[0] + 2, density.shape[1] + 2
    half = search.make_bordered_half_density(density, 1)
    cost = search.compute_shortest_costs(half, columns, columns + 1, -1, corner_cutting)
    return cost.reshape(rows, columns)[1:-1, 1:-1]


@pytest.mark.parametrize("corner_cutting", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_costs_equal_plain_search(seed, corner_cutting):
    density = random_density((23, 31), seed)
    expected = oracles.search.shortest_costs(density, (0, 0), corner_cutting)
    np.testing.assert_allclose(costs_from_corner(density, corner_cutting), expected)


@pytest.mark.parametrize("greatest", [1.0, 1e4, 1e9])
def test_costs_are_exact_at_any_contrast(greatest):
    density = np.exp(np.random.default_rng(1).uniform(0, np.log(greatest), (25, 25)))
    expected = oracles.search.shortest_costs(density, (0, 0), False)
    np.testing.assert_allclose(costs_from_corner(density, False), expected, rtol=1e-12)


@pytest.mark.parametrize("corner_cutting", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_costs_of_free_travel_are_exact(seed, corner_cutting):
    density = random_density((30, 20), seed)
    density[density < 4] = 0.0
    expected = oracles.search.shortest_costs(density, (0, 0), corner_cutting)
    np.testing.assert_allclose(costs_from_corner(density, corner_cutting), expected)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("blocked", [0.0, 0.2])
def test_costs_equal_scikit_images(seed, blocked):
    density = random_density((40, 55), seed, blocked=blocked)
    expected, _ = MCP_Geometric(np.where(np.isinf(density), -1, density)).find_costs([(0, 0)])
    np.testing.assert_allclose(costs_from_corner(density, True), expected)


def test_uniform_density_gives_shortest_path():
    grid = ascii_map(
        ".....",
        ".###.",
        ".....",
        resolution=2.0,
    )
    costs = Costmap.from_density(grid, np.ones(grid.shape))
    result = plan(costs, (1.0, 3.0), (9.0, 3.0), planner="grid")
    assert result.metrics.length == pytest.approx(12.0)
    cut = plan(costs, (1.0, 3.0), (9.0, 3.0), planner="grid", allow_corner_cutting=True)
    assert cut.metrics.length == pytest.approx(4 + 4 * np.sqrt(2))


def test_corners_are_not_cut_unless_allowed():
    grid = ascii_map(".#", "..")
    costs = Costmap.from_density(grid, np.ones((2, 2)))
    ends = (0.5, 1.5), (1.5, 0.5)
    assert plan(costs, *ends, planner="grid").metrics.length == pytest.approx(2.0)
    cut = plan(costs, *ends, planner="grid", allow_corner_cutting=True)
    assert cut.metrics.length == pytest.approx(np.sqrt(2))


def test_path_ends_equal_start_and_goal():
    cells = random_rooms((60, 60), seed=21, blocks=4)
    grid = OccupancyGrid(cells, 0.1, (5.0, -3.0, 0.4))
    free = np.argwhere(grid.free)
    start, goal = (grid.position(*map(int, cell)) for cell in free[[0, -1]])
    start = (start[0] + 0.02, start[1] - 0.03)
    costs = Costmap.from_density(grid, np.ones(grid.shape))
    result = plan(costs, start, goal, planner="grid")
    np.testing.assert_allclose(result.path.xy[0], start)
    np.testing.assert_allclose(result.path.xy[-1], goal)
    assert np.isfinite(result.metrics.cost)
    assert result.metrics.cost == path_metrics(costs, result.path).cost


def test_plan_solves_ends_within_cell():
    costs = Costmap.from_density(ascii_map("..", ".."), np.ones((2, 2)))
    result = plan(costs, (0.2, 0.2), (0.2, 0.2), planner="grid")
    assert result.status == "solved"
    assert result.metrics.length == result.metrics.cost == 0.0
    near = plan(costs, (0.2, 0.2), (0.4, 0.3), planner="grid")
    assert near.metrics.length == pytest.approx(math.hypot(0.2, 0.1))
    across = plan(costs, (0.9, 0.5), (1.1, 0.5), planner="grid")
    assert across.metrics.length == pytest.approx(0.2)


def test_unreachable_goal_returns_plan():
    costs = Costmap.from_density(ascii_map(".#."), np.ones((1, 3)))
    result = plan(costs, (0.5, 0.5), (2.5, 0.5))
    assert result.status == "unreachable"
    assert result.path is result.metrics is None
    assert result.with_costs(costs) is result


def test_plan_rejects_bad_goal_and_planner():
    costs = Costmap.from_density(ascii_map(".#."), np.ones((1, 3)))
    with pytest.raises(PoseError, match="goal"):
        plan(costs, (0.5, 0.5), (1.5, 0.5))
    with pytest.raises(ConfigError, match="grid"):
        plan(costs, (0.5, 0.5), (2.5, 0.5), planner="teleport")
    with pytest.raises(ConfigError, match="allow_corner_cutting"):
        plan(costs, (0.5, 0.5), (2.5, 0.5), patience=3)
    assert "grid" in list_planner_names()


def test_paths_have_no_needless_positions():
    costs = Costmap.from_density(ascii_map(*["......"] * 6), np.ones((6, 6)))
    assert len(plan(costs, (0.5, 0.5), (5.5, 5.5), planner="grid").path.xy) == 2


@pytest.mark.parametrize("corner_cutting", [False, True])
def test_plan_field_serves_all_starts(corner_cutting):
    density = random_density((25, 30), 3, blocked=0.3)
    costs = costmap_from_density(density)
    to_goal = plan_field(costs, (29.5, 24.5), allow_corner_cutting=corner_cutting)
    expected = oracles.search.shortest_costs(density, (24, 29), corner_cutting)
    np.testing.assert_allclose(to_goal.cost, expected)
    starts = np.argwhere(np.isfinite(density))[::17]
    for row, col in starts:
        start = (col + 0.4, row + 0.7)
        options = {"planner": "grid", "allow_corner_cutting": corner_cutting}
        single = plan(costs, start, (29.5, 24.5), **options)
        result = to_goal.plan(start)
        assert result.status == single.status
        assert (to_goal.path(start) is None) == np.isinf(expected[row, col])
        if result.metrics:
            assert result.metrics.cost == pytest.approx(single.metrics.cost)
    assert len(starts) > 20


def test_plan_field_rejects_blocked_ends():
    costs = costmap_from_density(np.array([[1.0, np.inf, 1.0]]))
    with pytest.raises(PoseError, match="goal"):
        plan_field(costs, (1.5, 0.5))
    with pytest.raises(PoseError, match="start"):
        plan_field(costs, (2.5, 0.5)).path((1.5, 0.5))


@pytest.mark.parametrize("planner", ["grid", "any-angle"])
def test_waypoints_are_visited_in_order(planner):
    costs = costmap_from_density(np.ones((20, 20)))
    via = [(15.25, 3.5), (2.5, 16.75)]
    result = plan(costs, (1.5, 1.5), (18.5, 18.5), planner=planner, via=via)
    at = [np.flatnonzero((result.path.xy == xy).all(axis=1))[0] for xy in via]
    assert at == sorted(at)
    assert result.via == tuple(via)
    legs = [
        plan(costs, a, b, planner=planner).metrics.cost
        for a, b in zip([(1.5, 1.5), *via], [*via, (18.5, 18.5)], strict=True)
    ]
    assert result.metrics.cost == pytest.approx(sum(legs))


def test_plan_rejects_blocked_waypoint():
    costs = costmap_from_density(np.array([[1.0, np.inf, 1.0]]))
    with pytest.raises(PoseError, match="waypoint 1"):
        plan(costs, (0.5, 0.5), (0.6, 0.5), via=[(1.5, 0.5)])
    result = plan(costs, (0.5, 0.5), (0.6, 0.5), via=[(2.5, 0.5)])
    assert result.status == "unreachable"
    assert result.note == "no path leads to waypoint 1"


@pytest.mark.parametrize("planner", ["grid", "any-angle"])
def test_plan_costs_at_most_shortest_path(planner):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        grid = OccupancyGrid(random_rooms((50, 50), seed, blocks=6), 1.0)
        u = rng.random(grid.shape)
        density = np.where(grid.free, 1 + 4 * u, np.inf)
        costs = dataclasses.replace(
            Costmap.blank(grid, robot=0.0), density=density, u=u, e=u + 0.1, weight=4.0
        )
        free = np.argwhere(grid.free)
        ends = [grid.position(*map(int, free[index])) for index in (0, -1)]
        plans = plan_with_shortest(costs, *ends, planner=planner)
        if plans["shortest"].path:
            shortest, aware = (one.metrics for one in plans.values())
            assert aware.cost <= shortest.cost
            assert shortest.length <= aware.length


def test_registry_matches_planner_attributes():
    for name, entry in PLANNERS.items():
        planner = make_planner(name)
        assert isinstance(planner, Planner)
        assert (planner.name, planner.minimises) == (name, entry.minimises)
        assert planner.space == entry.spaces[0]
        assert set(entry.options()) | {"name"} >= {
            field.name for field in dataclasses.fields(planner)
        }
        for space in entry.spaces[1:]:
            curved = {} if space == "SE2" else {"turning_radius": 1.0}
            assert make_planner(name, {"space": space, **curved}).space == space
    assert PLANNERS["grid"].options() == {"allow_corner_cutting": False}


def test_registry_entry_adds_planner(monkeypatch):
    monkeypatch.setitem(PLANNERS, "toy", PlannerEntry(ToyPlanner, minimises=None))
    costs = costmap_from_density(np.ones((6, 9)))
    result = plan(costs, (0.5, 0.5), (8.5, 5.5), planner="toy", rows_first=True)
    assert result.path.xy.tolist() == [[0.5, 0.5], [0.5, 5.5], [8.5, 5.5]]
    assert (result.planner, result.minimises) == ("toy", False)
    assert result.metrics.cost == pytest.approx(13.0)
    with pytest.raises(ConfigError, match="it has: rows_first, seed"):
        plan(costs, (0.5, 0.5), (8.5, 5.5), planner="toy", columns_first=True)
    with pytest.raises(ConfigError, match="rows_first must be"):
        make_planner("toy", {"rows_first": 3})
    planners = ["toy:rows_first=true", ToyPlanner(rows_first=True, seed=7), "grid"]
    queries, execution = RandomQueries(2, min_distance=3.0), Execution(workers=1)
    runs = compare({"mine": costs}, planners, queries, seeds=[1, 2], execution=execution).runs
    assert {run.status for run in runs} == {"solved"}
    seeds = {}
    for run in runs:
        seeds.setdefault(run.task.planner, set()).add(run.note)
    assert seeds["toy:rows_first=true"] == {"seed 1", "seed 2"}
    assert seeds["toy:rows_first=True,seed=7"] == {"seed 7"}


def test_planners_are_named_functions_or_objects():
    costs = costmap_from_density(random_density((30, 40), 1, blocked=0.1))
    ends = (0.5, 0.5), (39.5, 29.5)

    def mine(costs, start, goal, *, accuracy):
        return plan(costs, start, goal, accuracy=accuracy).path

    named = plan(costs, *ends, accuracy="high")
    assert named.planner == "any-angle"
    for planner, options in (
        ("any-angle", {"accuracy": "high"}),
        (AnyAngle(accuracy="high"), {}),
        (AnyAngle(), {"accuracy": "high"}),
        (mine, {"accuracy": "high"}),
        (lambda *query: PlannerResult(plan(*query, accuracy="high").path), {}),
        (lambda *query: plan(*query, accuracy="high"), {}),
    ):
        result = plan(costs, *ends, planner=planner, **options)
        np.testing.assert_array_equal(result.path.xy, named.path.xy)
        assert result.metrics.cost == named.metrics.cost
    assert result.planner == "<lambda>"
    np.testing.assert_array_equal(
        plan(costs, *ends, planner=GridPlanner()).path.xy,
        plan(costs, *ends, planner="grid").path.xy,
    )
    via = plan(costs, *ends, planner=mine, via=[ends[1]], accuracy="normal")
    np.testing.assert_array_equal(via.path.xy[-1], ends[1])


@pytest.mark.parametrize(
    ("planner", "options", "message"),
    [
        (AnyAngle(accuracy="perfect"), {}, "accuracy must be one of"),
        (AnyAngle(), {"patience": 3}, "it has: accuracy, allow_corner_cutting"),
        (Ompl("AORRTC"), {}, "OMPL's planners are"),
        (lambda costs, start, goal: None, {"patience": 3}, "no option 'patience'; it has: none"),
        (AnyAngle, {}, "planner must be a name, a function"),
        (3, {}, "planner must be a name, a function"),
        (lambda *query: None, {}, "not NoneType"),
        (lambda *query: Path([(0.5, 0.5), (0.5, 1.5)]), {}, "does not lead from start to goal"),
        (lambda *query: PlannerResult(status="solved"), {}, "without a path"),
        (lambda *query: PlannerResult(status="lost"), {}, "with a status of solved, unreachable"),
        (lambda *query: Path(query[1:]), {}, "enters cells where the robot cannot be"),
    ],
)
def test_plan_rejects_invalid_planners(planner, options, message):
    costs = costmap_from_density(np.array([[1.0, np.inf, 1.0], [1.0, 1.0, 1.0]]))
    with pytest.raises(LocplanError, match=message):
        plan(costs, (0.5, 0.5), (2.5, 0.5), planner=planner, **options)


def test_limits_are_kept_by_functions_too():
    costs = dataclasses.replace(costmap_from_density(np.ones((9, 9))), e=np.indices((9, 9))[0] / 10)
    ends = (0.5, 0.5), (8.5, 0.5)

    def upwards(costs, start, goal):
        return Path([start, (4.5, 4.5), goal])

    assert plan(costs, *ends, planner=upwards, max_e=0.45).status == "solved"
    with pytest.raises(LocplanError, match="cannot be"):
        plan(costs, *ends, planner=upwards, max_e=0.35)


def test_reported_solve_time_counts_if_plausible():
    costs = costmap_from_density(np.ones((3, 3)))
    ends = (0.5, 0.5), (2.5, 2.5)

    def get_solve_time(seconds):
        def mine(costs, start, goal):
            return Plan("solved", "mine", start, goal, Path([start, goal]), None, seconds)

        return plan(costs, *ends, planner=mine).solve_time

    assert get_solve_time(1e-9) == 1e-9
    assert 0 < get_solve_time(99.0) < 99.0
    assert get_solve_time(math.nan) > 0
