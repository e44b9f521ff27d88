"""Pareto fronts and budgets."""

import dataclasses
import json

import cv2
import numpy as np
import pytest
from support import oracles
from support.cases import sample_cases

from locplan.errors import ConfigError, PoseError
from locplan.field import FieldConfig, Sad, load_or_compute
from locplan.maps import FREE, OccupancyGrid, environments
from locplan.planning import Costmap, ParetoFront, PathMetrics, pareto_front, plan


def costmap_from_u(u, free, resolution=1.0) -> Costmap:
    """A costmap with this u, and an e that is three times as much."""
    grid = OccupancyGrid(np.where(free, FREE, 0), resolution)
    u = np.where(free, u, np.nan)
    blank = Costmap.blank(grid, robot=0.0)
    return dataclasses.replace(blank, u=u, e=3 * u + 0.5, weight=1.0)


def random_costs(seed, shape=(8, 9), blocked=0.25, zeros=0.0) -> Costmap:
    rng = np.random.default_rng(seed)
    free = rng.random(shape) >= blocked
    free[0, 0] = free[-1, -1] = True
    u = rng.random(shape)
    u[rng.random(shape) < zeros] = 0.0
    return costmap_from_u(u, free)


def far_corner(costs: Costmap) -> tuple[float, float]:
    return costs.grid.position(*(size - 1 for size in costs.grid.shape))


def get_integral(metrics: PathMetrics, objective: str) -> float:
    return metrics.integrated_e if objective == "e" else metrics.integrated_u


def compute_corner_front(costs: Costmap, **options) -> ParetoFront:
    options = {"time_limit": 600.0, **options}  # however busy the machine is
    return pareto_front(costs, costs.grid.position(0, 0), far_corner(costs), **options)


@pytest.mark.parametrize("corner_cutting", [False, True])
@pytest.mark.parametrize("zeros", [0.0, 0.5])
def test_fronts_equal_brute_force(zeros, corner_cutting):
    sizes = []
    for seed in range(50):
        costs = random_costs(seed, zeros=zeros)
        last = tuple(size - 1 for size in costs.grid.shape)
        free = costs.grid.free.astype(int)
        expected = oracles.search.pareto_front(costs.u, free, (0, 0), last, corner_cutting)
        front = compute_corner_front(costs, allow_corner_cutting=corner_cutting)
        assert front.epsilon == 0
        points = np.column_stack([front.length, front.integral])
        np.testing.assert_allclose(points, np.reshape(expected, (-1, 2)), atol=1e-4)
        sizes.append(len(front))
    assert max(sizes) > 3


def test_front_table_converts_to_frame():
    front = compute_corner_front(random_costs(3, (20, 24), blocked=0.15))
    frame = front.table().to_frame()
    assert len(frame) == len(front) > 1
    np.testing.assert_allclose(frame["length"], front.length)


@pytest.mark.parametrize("objective", ["u", "e"])
def test_front_plans_match_front_values(objective):
    costs = random_costs(3, (20, 24), blocked=0.15)
    front = compute_corner_front(costs, objective=objective)
    assert len(front) > 5
    for index in range(len(front)):
        metrics = front.plan(index).metrics
        assert metrics.length == pytest.approx(front.length[index], rel=1e-12)
        assert get_integral(metrics, objective) == pytest.approx(front.integral[index], rel=1e-12)
        assert np.isfinite(metrics.cost)
    assert (np.diff(front.length) > 0).all()
    assert (np.diff(front.integral) < 0).all()


def test_front_lengths_include_end_legs():
    costs = costmap_from_u(np.full((3, 6), 0.5), np.ones((3, 6), bool))
    front = pareto_front(costs, (0.2, 1.5), (5.9, 1.5))
    assert front.length[0] == pytest.approx(0.3 + 5 + 0.4, abs=1e-4)
    assert front.integral[0] == pytest.approx(0.5 * 5.7, abs=1e-4)


def smooth_costs(grid, seed) -> Costmap:
    """A costmap whose u varies smoothly, for a robot of 0.2 m."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).random(grid.shape), (0, 0), 3.0)
    u = (noise - noise.min()) / np.ptp(noise)
    return Costmap.from_layers(grid, u=u, weight=4.0, robot=0.2)


def random_ends(costs: Costmap, rng, within=np.inf) -> list[tuple[float, float]]:
    """Two positions anywhere in free cells, at most so many cells apart."""
    free = np.argwhere(np.isfinite(costs.density))
    cell = free[rng.integers(len(free))]
    near = free[np.hypot(*(free - cell).T) <= within]
    cells = np.array([cell, near[rng.integers(len(near))]]) + rng.uniform(0.001, 0.999, (2, 2))
    return [tuple(xy) for xy in np.column_stack(costs.grid.grid_to_world(*cells.T)).tolist()]


def check_exact_planners_agree(costs: Costmap, start, goal, *, cutting: bool = False) -> None:
    """The front holds or dominates grid paths of any weight, and a budget finds its paths."""
    options = {"allow_corner_cutting": cutting}
    front = pareto_front(costs, start, goal, time_limit=600.0, **options)
    for weight in (1e-6, 1.0, 16.0):
        weighted = costs.with_weight(weight)
        found = plan(weighted, start, goal, planner="grid", **options)
        if not len(front):
            assert found.status == front.status == "unreachable"
            return
        best, slack = found.metrics, 1e-9 * (1 + found.metrics.length)
        as_short = front.length <= best.length + slack
        assert (as_short & (front.integral <= best.integrated_u + slack)).any()
        least = (front.length + weight * front.integral).min()
        assert least == pytest.approx(best.cost, rel=1e-6, abs=1e-9)
        assert plan(weighted, start, goal, **options).metrics.cost <= best.cost * (1 + 1e-12)
    for index in (0, len(front) // 2, -1):
        budget = float(front.integral[index])
        within = plan(costs, start, goal, budget=budget, **options)
        assert within.metrics.length == pytest.approx(front.length[index], rel=1e-9, abs=1e-9)
        assert within.bound == pytest.approx(within.metrics.length)


@pytest.mark.parametrize("name", ["two_corridors", "places"])
def test_front_dominates_grid_paths(name):
    """Ends lie anywhere in their cells, for which all exact planners have the same end legs."""
    costs, rng = smooth_costs(environments.make(name, resolution=0.1), 1), np.random.default_rng(2)
    for within in [*[np.inf] * 4, *[4.0] * 6]:
        check_exact_planners_agree(costs, *random_ends(costs, rng, within))


@pytest.mark.parametrize("resolution", [0.05, 0.1])
def test_exact_planners_agree_off_centre(resolution):
    grid = environments.make("two_corridors", resolution=resolution)
    costs = Costmap.from_layers(grid, u=np.full(grid.shape, 0.5))
    ends = (2.0, 3.0), (38.0, 3.0)
    assert plan(costs, *ends, planner="grid").metrics.length == pytest.approx(36.0)
    assert plan(costs, *ends, budget=100.0).metrics.length == pytest.approx(36.0)
    assert pareto_front(costs, *ends).length == pytest.approx([36.0])


@pytest.mark.parametrize("cutting", [False, True])
@pytest.mark.parametrize(
    "ends",
    [
        ((1.2, 1.3), (1.9, 1.6)),  # in one cell
        ((1.2, 1.3), (1.2, 1.3)),  # equal
        ((1.5, 1.5), (1.5, 1.5)),  # equal, and a centre
        ((1.2, 1.3), (2.9, 1.1)),  # in adjacent cells
        ((1.2, 1.3), (2.9, 2.8)),  # in diagonal ones
        ((1.0, 1.0), (3.0, 1.0)),  # on the edge of walls
        ((3.9, 1.1), (4.9, 2.9)),  # past the corner of a wall
        ((3.9, 1.9), (4.1, 2.1)),  # close to it
        ((1.2, 1.3), (6.9, 2.1)),
    ],
)
def test_exact_planners_agree_in_degenerate_cases(ends, cutting):
    free = np.zeros((5, 9), bool)
    free[1:4, 1:8] = True
    free[1, 4] = False
    u = np.random.default_rng(0).random(free.shape)
    check_exact_planners_agree(costmap_from_u(u, free), *ends, cutting=cutting)


@pytest.mark.parametrize("cap", [{"max_labels": 100}, {"time_limit": 1e-6}])
@pytest.mark.parametrize("seed", range(4))
def test_capped_front_is_within_epsilon(seed, cap, monkeypatch):
    monkeypatch.setattr("locplan.planning.pareto.STRETCH", 50)
    costs = random_costs(seed, (40, 40), blocked=0.2)
    exact, capped = compute_corner_front(costs), compute_corner_front(costs, **cap)
    assert exact.epsilon == 0
    assert len(exact) > 5
    assert 0 < capped.epsilon < 1
    for length, integral in zip(exact.length, exact.integral, strict=True):
        better = np.maximum(capped.length / length, capped.integral / integral)
        assert better.min() <= 1 + capped.epsilon + 1e-6
    if "max_labels" in cap:
        assert capped.labels <= 100


def front_from_points(length, integral) -> ParetoFront:
    """A front of these points, without paths."""
    length, integral = np.asarray(length, float), np.asarray(integral, float)
    costs = random_costs(0)
    ends = {"start": (0.5, 0.5), "goal": (0.5, 0.5)}
    details = {"objective": "u", "epsilon": 0.0, "labels": 0, "solve_time": 0.0}
    cells = tuple(np.zeros((1, 2), int) for _ in length)
    return ParetoFront(
        costs=costs, length=length, integral=integral, cells=cells, **ends, **details
    )


@pytest.mark.parametrize(
    ("length", "integral", "knee"),
    [
        ([20, 21, 22, 23, 25, 27, 30], [10, 6, 2, 1.8, 1.5, 1.2, 1], 2),  # an elbow
        ([20, 20.1, 26, 33], [10, 1, 0.9, 0.8], 1),  # an L
        ([20, 21, 22, 24, 27], [9, 4, 1, 0.5, 0], 2),  # an elbow before an integral of 0
        ([20, 22, 50], [9, 3, 0], 1),  # 0 at 2.5 times the length
        ([20, 20.5, 30, 40], [9, 8.5, 0.5, 0], 2),  # an elbow on a longer path
        ([20, 21, 22, 23, 24], [8, 6, 4, 2, 0], None),  # a straight line
        ([0.1, 0.2, 0.3, 0.6, 0.7], [0.7, 0.6, 0.5, 0.2, 0.1], None),  # straight but for rounding
        ([20, 22, 24, 26], [9, 8, 5, 0], None),  # concave
        ([20, 21, 25, 26, 27], [9, 5, 4.5, 4.2, 0], 1),  # convex, then concave
        ([20, 30], [9, 0], None),
        ([20, 30], [9, 8], None),
        ([20], [9], None),
        ([20], [0], None),
        ([0], [0], None),
    ],
)
def test_knee_lies_at_bend_of_front(length, integral, knee):
    assert front_from_points(length, integral).knee == knee
    scaled = front_from_points(3 + 1e-3 * np.asarray(length), 1e5 * np.asarray(integral))
    assert scaled.knee == knee  # neither unit counts


def test_front_without_knee_names_trade():
    text = front_from_points([20, 23, 26.2], [9, 8, 0]).report()
    last = "No knee: take the shortest path, or +31% length with no degenerate metres."
    assert text.splitlines()[-1] == last
    assert text.count("knee") == 1
    text = front_from_points([20, 30], [9, 4]).report()
    assert text.endswith("or +50% length with 4 instead of 9 degenerate metres.")
    assert "No knee" not in front_from_points([20, 20.1, 26, 33], [10, 1, 0.9, 0.8]).report()


def test_front_without_knee_saves_none(tmp_path):
    """Users would follow the shortest path as the best balance."""
    front = front_from_points([20, 23, 26.2], [9, 8, 0])
    front.save(tmp_path)
    assert not (tmp_path / "knee.csv").exists()
    assert json.loads((tmp_path / "front.json").read_text())["knee"] is None
    with pytest.raises(ConfigError, match="no knee"):
        front.plan(front.knee)


@pytest.mark.parametrize("angle", [10, 45, 80])
def test_knee_of_quarter_circle_is_middle(angle):
    around = np.deg2rad(np.linspace(0, 90, 91))
    front = front_from_points(21 - np.cos(around), 5 * (1 - np.sin(around)))
    assert front.knee == 45
    bent = np.deg2rad(np.sort([0, angle, 90]))
    assert front_from_points(21 - np.cos(bent), 5 * (1 - np.sin(bent))).knee == 1


@pytest.mark.parametrize("objective", ["u", "e"])
def test_knee_lies_farthest_below_chord(objective):
    front = compute_corner_front(random_costs(5, (40, 40), blocked=0.2), objective=objective)
    assert 0 < front.knee < len(front) - 1
    points = np.column_stack([front.length, front.integral])
    shares = (points - points.min(axis=0)) / np.ptp(points, axis=0)
    # The chord leads from (0, 1) to (1, 0).
    below = (1 - shares.sum(axis=1)) / np.sqrt(2)
    assert below[front.knee] == pytest.approx(below.max())


def test_front_is_empty_if_goal_unreachable():
    costs = costmap_from_u(np.ones((1, 3)), np.array([[True, False, True]]))
    front = pareto_front(costs, (0.5, 0.5), (2.5, 0.5))
    assert len(front) == 0
    assert front.epsilon == 0
    with pytest.raises(ConfigError, match="unreachable"):
        _ = front.knee
    result = plan(costs, (0.5, 0.5), (2.5, 0.5), budget=9.0)
    assert result.status == "unreachable"


def test_front_has_single_path_within_cell():
    costs = costmap_from_u(np.full((2, 2), 0.5), np.ones((2, 2), bool))
    front = pareto_front(costs, (0.5, 0.5), (0.7, 0.5))
    assert len(front) == 1
    assert plan(costs, (0.5, 0.5), (0.7, 0.5), budget=1.0).status == "solved"


def test_bad_options_are_refused():
    costs = random_costs(1)
    with pytest.raises(ConfigError, match="objective"):
        compute_corner_front(costs, objective="length")
    with pytest.raises(ConfigError, match="time_limit"):
        compute_corner_front(costs, time_limit=0)
    with pytest.raises(ConfigError, match="without a field"):
        compute_corner_front(Costmap.blank(costs.grid, robot=0.0))
    with pytest.raises(PoseError, match="goal"):
        pareto_front(costs, (0.5, 0.5), (99.0, 0.5))


@pytest.mark.parametrize("objective", ["u", "e"])
@pytest.mark.parametrize("seed", range(8))
def test_budget_plan_equals_front_path(seed, objective):
    costs = random_costs(seed, (25, 25), blocked=0.12, zeros=0.2 * (seed % 2))
    front = compute_corner_front(costs, objective=objective)
    start, goal = (0.5, 0.5), far_corner(costs)
    for share in (0.0, 0.1, 0.35, 0.6, 0.9, 1.0, 1.5):
        budget = front.integral[-1] + share * (front.integral[0] - front.integral[-1])
        result = plan(costs, start, goal, budget=budget, objective=objective)
        assert result.status == "solved"
        assert get_integral(result.metrics, objective) <= budget + tolerance_of(front)
        expected = front.length[front.integral <= budget + 1e-9][0]
        assert result.metrics.length == pytest.approx(expected, abs=1e-4)
        assert result.bound == pytest.approx(result.metrics.length, abs=1e-4)


def tolerance_of(front: ParetoFront) -> float:
    """How far the docstrings let a path exceed a budget."""
    layer = front.costs.e if front.objective == "e" else front.costs.u
    return 1e-9 * float(layer[front.costs.grid.free].max()) * front.length[-1]


def check_budgets_find_paths(front: ParetoFront, cutting: bool = False, every: int = 1) -> None:
    """Check that a budget of its integral finds each n-th path, and a smaller budget does not."""
    tolerance = tolerance_of(front)
    options = {"objective": front.objective, "allow_corner_cutting": cutting}
    for index in range(len(front) - 1, -1, -every):
        length, integral = front.length[index], front.integral[index]
        metrics = front.plan(index).metrics
        measured = get_integral(metrics, front.objective)
        assert metrics.length == pytest.approx(length, rel=1e-9)
        assert abs(measured - integral) <= tolerance / 4
        for budget in (float(integral), measured):
            result = plan(front.costs, front.start, front.goal, budget=budget, **options)
            assert result.status == "solved", result.note
            assert result.metrics.length == pytest.approx(length, rel=1e-9)
            assert get_integral(result.metrics, front.objective) <= budget + tolerance
        less = max(0.0, integral - 3 * tolerance)
        result = plan(front.costs, front.start, front.goal, budget=less, **options)
        if integral > 3 * tolerance:
            longer = front.length[index + 1 : index + 2]
            assert (result.status == "infeasible") == (longer.size == 0)
            assert longer.size == 0 or result.metrics.length == pytest.approx(longer[0], rel=1e-9)


LAYERS = {
    "noise": lambda rng, shape: rng.random(shape),
    "half of it 0": lambda rng, shape: rng.random(shape) * (rng.random(shape) < 0.5),
    "tenths": lambda rng, shape: rng.integers(0, 10, shape) / 10,
    "one level": lambda rng, shape: np.full(shape, 0.3),
    "0": lambda rng, shape: np.zeros(shape),
    "many magnitudes": lambda rng, shape: 10.0 ** -rng.integers(0, 13, shape),
    "mirrored": lambda rng, shape: mirrored(rng.random(shape)),
    "saturated": lambda rng, shape: np.clip(3 * rng.random(shape) - 1, 0, 1),
}


def mirrored(values):
    """Values that are the same on both sides of the diagonal from corner to corner."""
    return (values + values.T) / 2


@pytest.mark.parametrize("objective", ["u", "e"])
@pytest.mark.parametrize("layer", LAYERS)
def test_budget_finds_all_front_paths(layer, objective):
    paths = 0
    for seed in range(4):
        rng = np.random.default_rng([seed, 19])
        free = rng.random((14, 14)) >= 0.12
        free[0, 0] = free[-1, -1] = True
        if layer == "mirrored":
            free &= free.T
        costs = costmap_from_u(
            LAYERS[layer](rng, free.shape), free, resolution=(1.0, 0.05)[seed % 2]
        )
        origin = ((0.0, 0.0, 0.0), (-31.7, 12.3, 0.7))[seed == 3]
        costs = dataclasses.replace(costs, grid=dataclasses.replace(costs.grid, origin=origin))
        aside = 0.08 * seed * costs.grid.resolution  # within the cell, also where it is turned
        ends = [np.add(costs.grid.position(*cell), (0, aside)) for cell in ((0, 0), (13, 13))]
        ends = [tuple(map(float, xy)) for xy in ends]
        cutting = seed >= 2
        front = pareto_front(costs, *ends, objective=objective, allow_corner_cutting=cutting)
        assert front.epsilon == 0
        if len(front):
            check_budgets_find_paths(front, cutting)
        paths += len(front)
    assert paths >= 2


MAPS = [
    ("two_corridors", None, 4.0),
    ("warehouse", "position_std", 0.0),
    ("two_corridors", "position_std", 0.0),
    ("warehouse", None, 4.0),
]


@pytest.mark.parametrize("case", sample_cases(MAPS, 2), ids=str)
def test_budget_finds_front_paths_on_maps(case):
    name, criterion, weight = case
    grid = environments.make(name, resolution=0.1)
    field = load_or_compute(grid, FieldConfig(Sad(), stride=1.0))
    settings = {"robot": 0.2, "weight": weight, "criterion": criterion}
    marks = environments.place_positions(name)
    front = pareto_front(Costmap.from_field(field, **settings), marks["start"], marks["goal"])
    assert front.epsilon == 0
    check_budgets_find_paths(front, every=max(1, len(front) // 4))


def test_small_budget_note_names_feasible_budget():
    costs = random_costs(2, (15, 15), blocked=0.1)
    ends = (0.5, 0.5), far_corner(costs)
    least = compute_corner_front(costs).integral[-1]
    result = plan(costs, *ends, budget=0.9 * least)
    assert result.status == "infeasible"
    assert result.path is None
    assert result.feasible_from == pytest.approx(least, abs=1e-6)
    assert plan(costs, *ends, budget=result.feasible_from).status == "solved"
    told = float(result.note.split()[-1])
    assert plan(costs, *ends, budget=told).status == "solved"


def test_interrupted_budget_plan_has_bound(monkeypatch):
    monkeypatch.setattr("locplan.planning.pareto.STRETCH", 1)
    costs = random_costs(0, (40, 40), blocked=0.2)
    front = compute_corner_front(costs)
    for index in (2, len(front) // 2, len(front) - 3):
        budget = front.integral[index]
        ends = (0.5, 0.5), far_corner(costs)
        result = plan(costs, *ends, budget=budget, time_limit=1e-9)
        assert result.metrics.integrated_u <= budget + 1e-9
        assert result.bound <= front.length[index] + 1e-4 <= result.metrics.length + 2e-4


def test_budget_rejects_other_planners_and_options():
    costs = random_costs(1)
    ends = (0.5, 0.5), far_corner(costs)
    for options in ({"planner": "any-angle"}, {"via": [(0.5, 0.5)]}, {"max_e": 1.0}):
        with pytest.raises(ConfigError, match="budget is for"):
            plan(costs, *ends, budget=1.0, **options)
    with pytest.raises(ConfigError, match="no option 'patience'"):
        plan(costs, *ends, budget=1.0, patience=1)
    with pytest.raises(ConfigError, match="at least 0"):
        plan(costs, *ends, budget=float("nan"))


@pytest.mark.parametrize("planner", ["grid", "any-angle"])
@pytest.mark.parametrize("seed", range(5))
def test_plan_respects_max_e(seed, planner):
    costs = random_costs(seed, (30, 30), blocked=0.05)
    ends = (0.5, 0.5), far_corner(costs)
    refused = plan(costs, *ends, planner=planner, max_e=0.6)
    assert refused.status == "infeasible"
    least = refused.feasible_from
    result = plan(costs, *ends, planner=planner, max_e=least)
    assert result.status == "solved"
    assert result.metrics.max_e <= least
    told = float(refused.note.split("max_e ")[1].split()[0])
    assert plan(costs, *ends, planner=planner, max_e=told).status == "solved"
    below = plan(costs, *ends, planner=planner, max_e=np.nextafter(least, 0))
    assert below.status == "infeasible"
    assert below.feasible_from == least


def test_curve_note_names_least_max_e():
    """Curves may need a greater max_e than the grid."""
    costs = random_costs(0, (30, 30), blocked=0.05)
    ends = (0.5, 0.5, 0.0), (*far_corner(costs), 0.0)
    curved = {"planner": "RRT", "space": "Dubins", "turning_radius": 1.0, "iterations": 5}
    refused = plan(costs, *ends, max_e=0.6, **curved)
    assert refused.status == "infeasible"
    assert refused.note.endswith("is needed at least")


def test_max_e_keeps_unreachable_goal_unreachable():
    costs = costmap_from_u(np.ones((1, 3)), np.array([[True, False, True]]))
    assert plan(costs, (0.5, 0.5), (2.5, 0.5), max_e=0.1).status == "unreachable"
    with pytest.raises(ConfigError, match="max_e"):
        plan(costs, (0.5, 0.5), (2.5, 0.5), max_e=-1)
    with pytest.raises(ConfigError, match="without a field"):
        plan(Costmap.blank(costs.grid, robot=0.0), (0.5, 0.5), (0.7, 0.5), max_e=1.0)
