import itertools
import math

import numpy as np
import pytest
from support import oracles
from support.costmaps import costmap_from_density, random_density
from support.maps import ascii_map, random_rooms

from locplan._support.kernels.rays import compute_segment_cost
from locplan._support.kernels.search import make_bordered_half_density
from locplan.errors import ConfigError
from locplan.maps import FREE, OccupancyGrid
from locplan.planning import Costmap, Path, any_angle, path_metrics, plan
from locplan.planning.kernels import any_angle as kernels


def smooth_density(shape, seed, *, blocks=10):
    rng = np.random.default_rng(seed)
    rows, cols = np.mgrid[: shape[0], : shape[1]]
    waves = sum(np.sin(rows * a + cols * b + c) for a, b, c in rng.uniform(-0.3, 0.3, (5, 3)))
    density = 1 + 2 * (waves - waves.min())
    density[random_rooms(shape, seed, blocks=blocks) != FREE] = np.inf
    density[:3, :3] = density[-3:, -3:] = 2.0
    return density


def crossed_blocked_cells(density, path: Path) -> list:
    """By clipping every line at every blocked cell nearby, without the library's traversal."""
    found = []
    for (x0, y0), (x1, y1) in itertools.pairwise(path.xy):
        rows = range(max(0, int(min(y0, y1)) - 1), min(density.shape[0], int(max(y0, y1)) + 2))
        cols = range(max(0, int(min(x0, x1)) - 1), min(density.shape[1], int(max(x0, x1)) + 2))
        for row, col in itertools.product(rows, cols):
            if np.isinf(density[row, col]) and oracles.lines.touches(y0, x0, y1, x1, row, col):
                found.append((row, col))
    return found


@pytest.mark.parametrize("seed", range(6))
def test_segment_costs_are_exact(seed):
    rng = np.random.default_rng(seed)
    density = rng.uniform(1, 9, (20, 25))
    half = make_bordered_half_density(density, 1)
    for _ in range(60):
        line = rng.uniform(0, 1, 4) * (20, 25, 20, 25)
        if rng.random() < 0.3:
            line = np.floor(line) + 0.5
        result = compute_segment_cost(half, 27, *(line + 1), False)
        assert result == pytest.approx(oracles.lines.line_integral(density, *line), rel=1e-9)


@pytest.mark.parametrize("corner_cutting", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_segment_costs_infinity_across_blocked_cells(seed, corner_cutting):
    rng = np.random.default_rng(seed)
    density = random_density((15, 15), seed, blocked=0.1)
    half = make_bordered_half_density(density, 1)
    for _ in range(150):
        line = rng.uniform(0.1, 14.9, 4)
        if rng.random() < 0.5:
            line = np.floor(line) + 0.5  # from centre to centre, often over corners
        margin = 1e-5 if corner_cutting else -1e-9
        blocked = any(
            oracles.lines.touches(*line, row, col, margin)
            for row, col in np.argwhere(np.isinf(density))
        )
        inside = density[int(line[0]), int(line[1])] < np.inf  # a path begins in a free cell
        cost = compute_segment_cost(half, 17, *(line + 1), corner_cutting)
        if inside and np.hypot(line[2] - line[0], line[3] - line[1]) > 0:
            assert np.isinf(cost) == blocked, line


@pytest.mark.parametrize("beside", [1, 2])
def test_segment_touches_blocked_cell_along_edge(beside):
    density = np.ones((4, 6))
    density[beside, 3] = np.inf
    half = make_bordered_half_density(density, 1)
    along = (3.0, 1.5, 3.0, 6.5)  # bordered: between rows 1 and 2
    assert compute_segment_cost(half, 8, *along, False) == np.inf
    expected = np.inf if beside == 2 else 5.0
    assert compute_segment_cost(half, 8, *along, True) == expected


@pytest.mark.parametrize("lookahead", [2, 5])
def test_shortcuts_equal_plain_dynamic_programming(lookahead):
    rng = np.random.default_rng(1)
    density = rng.uniform(1, 5, (20, 20))
    positions = np.cumsum(rng.uniform(-0.5, 1.5, (15, 2)), axis=0) + 2
    kept = kernels.choose_kept_positions(
        make_bordered_half_density(density, 1),
        22,
        positions + 1,
        lookahead,
        False,
        float(density.min()),
    )
    chosen = positions[kept]
    cost = sum(oracles.lines.line_integral(density, *a, *b) for a, b in itertools.pairwise(chosen))
    assert cost == pytest.approx(oracles.search.shortcut(density, positions, lookahead))
    assert np.diff(kept).max() <= lookahead


@pytest.mark.parametrize("seed", range(4))
def test_32_move_search_equals_plain_search(seed):
    density = random_density((12, 14), seed, blocked=0.15, greatest=4.0)
    density[0, 0] = density[-1, -1] = 1.0
    columns = 14 + 6
    half = make_bordered_half_density(density, 3)
    moves = any_angle._make_straight_moves(columns, False)
    goal = (11 + 3) * columns + 13 + 3
    flat = kernels.find_cheapest_move_cells(half, 3 * columns + 3, goal, moves)
    expected = oracles.search.cheapest_moves(density, (0, 0), (11, 13), 3)
    if np.isinf(expected):
        assert flat.size == 0
    else:
        centres = np.column_stack([flat // columns, flat % columns]) - 2.5
        cost = sum(
            oracles.lines.line_integral(density, *a, *b) for a, b in itertools.pairwise(centres)
        )
        assert cost == pytest.approx(expected)


@pytest.mark.parametrize("seed", range(5))
def test_shifting_equals_plain_loops(seed):
    rng = np.random.default_rng(seed)
    density = rng.uniform(1, 9, (20, 40))
    positions = np.column_stack([rng.uniform(8, 12, 9), np.linspace(2.2, 37.7, 9)])
    shifted = kernels.shift_positions(
        make_bordered_half_density(density, 1), 42, positions + 1, 0.7, 6, False
    )
    np.testing.assert_allclose(shifted - 1, oracles.search.shift(density, positions, 0.7, 6))


def test_shifting_moves_path_into_valley():
    rows, _ = np.mgrid[:21, :40]
    density = 1.0 + np.abs(rows - 10)
    half = make_bordered_half_density(density, 1)
    positions = np.column_stack([np.full(9, 4.5), np.linspace(1.5, 40.5, 9)])
    shifted = kernels.shift_positions(half, 42, positions, 1.0, 20, False)
    costs = [
        sum(compute_segment_cost(half, 42, *a, *b, False) for a, b in itertools.pairwise(line))
        for line in (positions, shifted)
    ]
    assert costs[1] < 0.5 * costs[0]
    np.testing.assert_array_equal(shifted[[0, -1]], positions[[0, -1]])
    assert abs(shifted[4, 0] - 11.5) <= 1.0


@pytest.mark.parametrize("accuracy", ["normal", "high"])
@pytest.mark.parametrize("seed", range(8))
def test_any_angle_costs_at_most_grid(seed, accuracy):
    """Paths also cross no blocked cell."""
    density = smooth_density((90, 110), seed)
    costs = costmap_from_density(density)
    ends = (0.7, 1.2), (108.6, 88.9)
    on_grid = plan(costs, *ends, planner="grid")
    result = plan(costs, *ends, planner="any-angle", accuracy=accuracy)
    assert result.status == on_grid.status
    if result.path:
        assert result.metrics.cost <= on_grid.metrics.cost * (1 + 1e-9)
        assert not crossed_blocked_cells(density, result.path)
        np.testing.assert_array_equal(result.path.xy[[0, -1]], ends)


@pytest.mark.parametrize("seed", range(6))
def test_cut_corners_avoid_blocked_cells(seed):
    density = random_density((40, 50), seed, blocked=0.3)
    costs = costmap_from_density(density)
    ends = (0.5, 0.5), (49.5, 39.5)
    options = {"allow_corner_cutting": True}
    on_grid = plan(costs, *ends, planner="grid", **options)
    result = plan(costs, *ends, planner="any-angle", **options)
    assert result.status == on_grid.status
    if result.path:
        assert result.metrics.cost <= on_grid.metrics.cost * (1 + 1e-9)
        assert not crossed_blocked_cells(density, result.path)


def test_path_is_straight_without_obstacles():
    grid = OccupancyGrid(np.full((260, 640), FREE), 0.05, (3.0, -2.0, 0.4))
    costs = Costmap.blank(grid, robot=0.0)
    start, goal = grid.position(3, 5), grid.position(251, 630)
    result = plan(costs, start, goal, planner="any-angle")
    assert result.metrics.length == pytest.approx(math.dist(start, goal), rel=1e-6)


def test_path_around_corner_is_nearly_shortest():
    lines = ["." * 30] * 10 + ["." * 15 + "#" * 15] * 10
    costs = Costmap.blank(ascii_map(*lines), robot=0.0)
    start, goal = (14.5, 0.5), (29.5, 10.5)
    result = plan(costs, start, goal, planner="any-angle")
    around = math.dist(start, (15, 10)) + math.dist((15, 10), goal)
    assert around <= result.metrics.length < around + 0.4
    assert result.metrics.cost == path_metrics(costs, result.path).cost


def test_any_angle_plans_at_extreme_contrast():
    """The costs differ too much for the buckets of the search."""
    density = np.ones((20, 30))
    density[5:15, 10:20] = 1e8
    for accuracy in ("normal", "high"):
        result = plan(
            costmap_from_density(density),
            (0.5, 10.5),
            (29.5, 10.5),
            planner="any-angle",
            accuracy=accuracy,
        )
        assert result.metrics.cost < 40


@pytest.mark.parametrize("accuracy", ["normal", "high"])
def test_any_angle_reports_unreachable_goal(accuracy):
    costs = costmap_from_density(np.array([[1.0, np.inf, 1.0]]))
    result = plan(costs, (0.5, 0.5), (2.5, 0.5), planner="any-angle", accuracy=accuracy)
    assert (result.status, result.path) == ("unreachable", None)


def test_any_angle_rejects_unknown_accuracy():
    costs = costmap_from_density(np.ones((1, 3)))
    with pytest.raises(ConfigError, match="accuracy must be one of"):
        plan(costs, (0.5, 0.5), (0.6, 0.5), planner="any-angle", accuracy="perfect")


def test_any_angle_solves_start_at_goal():
    costs = costmap_from_density(np.ones((3, 3)))
    result = plan(costs, (1.2, 1.2), (1.2, 1.2), planner="any-angle")
    assert result.metrics.length == 0.0
    near = plan(costs, (1.2, 1.2), (1.4, 1.3), planner="any-angle")
    assert near.metrics.length == pytest.approx(math.hypot(0.2, 0.1))


@pytest.mark.parametrize("accuracy", ["normal", "high"])
def test_any_angle_supports_turned_maps(accuracy):
    """With thin walls, paths still cost at most as much as on the grid."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        density = random_density((12, 15), seed, blocked=0.25, greatest=3.0)
        cells = np.where(np.isinf(density), 0, FREE)
        costs = Costmap.from_density(OccupancyGrid(cells, 0.05, (0.3, 0.1, 0.4)), density)
        corners = rng.integers(0, 2, 4) / 2  # on edges and corners of cells, too
        ends = [
            costs.grid.grid_to_world(r, c) for r, c in (corners[:2] + 0.25, corners[2:] + 11.25)
        ]
        ends = [tuple(map(float, xy)) for xy in ends]
        if any(np.isinf(density[costs.grid.cell(xy)]) for xy in ends):
            continue
        on_grid = plan(costs, *ends, planner="grid")
        result = plan(costs, *ends, planner="any-angle", accuracy=accuracy)
        assert result.status == on_grid.status
        if result.path:
            assert result.metrics.cost <= on_grid.metrics.cost


def test_costly_straightening_keeps_grid_path(monkeypatch):
    costs = costmap_from_density(np.ones((20, 20)))
    ends = (0.5, 0.5), (19.5, 9.5)
    on_grid = plan(costs, *ends, planner="grid").path
    around = Path([ends[0], (0.5, 19.5), ends[1]])
    monkeypatch.setattr(any_angle, "_straighten_and_shift", lambda *_: around)
    for accuracy in ("normal", "high"):
        result = plan(costs, *ends, planner="any-angle", accuracy=accuracy)
        np.testing.assert_array_equal(result.path.xy, on_grid.xy)
    assert any_angle.straighten_path(costs, on_grid) is on_grid
