"""Compare grid planners with scipy, scikit-image and each other, on rooms with a quarter blocked.

pytest tests/benchmarks/bench_planners.py --benchmark-only -s
"""

import dataclasses
import time

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from skimage.graph import MCP_Geometric
from support.movingai import find_map_file, find_scenario_files, read_all_scenarios, read_map

from locplan._support.kernels.search import (
    compute_shortest_costs,
    make_bordered_half_density,
    measure_cost_scale,
    search_grid,
)
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.planning import Costmap, pareto_front, plan


def rooms(size: int, seed: int = 0, *, blocked: float = 0.25) -> np.ndarray:
    """Smooth density in 1..11, and rooms with doors and boxes in them."""
    rng = np.random.default_rng(seed)
    smooth = gaussian_filter(rng.standard_normal((size, size)), size / 25, mode="wrap")
    density = 1 + 10 * (smooth - smooth.min()) / np.ptp(smooth)
    wall, room = np.zeros((size, size), bool), size // 10
    for line in range(room, size, room):
        wall[line : line + 3, :] = wall[:, line : line + 3] = True
    for line in range(room, size, room):
        for beside in range(0, size, room):
            row, col = beside + rng.integers(5, room - 12, 2)
            wall[row : row + 10, line : line + 3] = wall[line : line + 3, col : col + 10] = False
    while wall.mean() < blocked:
        row, col = rng.integers(0, size, 2)
        height, width = rng.integers(2, max(3, size // 40), 2)
        wall[row : row + height, col : col + width] = True
    wall[:6, :6] = wall[-6:, -6:] = False
    return np.where(wall, np.inf, density)


def graph_of(density: np.ndarray) -> csr_matrix:
    """The 8-connected grid, no corners cut, for scipy."""
    rows, cols = density.shape
    index, free = np.arange(density.size).reshape(density.shape), np.isfinite(density)
    parts = []
    for drow, dcol in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = slice(0, rows - drow), slice(max(0, -dcol), cols - max(0, dcol))
        there = slice(drow, rows), slice(max(0, dcol), cols - max(0, -dcol))
        joined = free[here] & free[there]
        if drow and dcol:
            joined &= free[here[0], there[1]] & free[there[0], here[1]]
        steps = np.hypot(drow, dcol) * (density[here] + density[there])[joined] / 2
        parts.append((steps, index[here][joined], index[there][joined]))
    steps, low, high = (np.concatenate(part) for part in zip(*parts, strict=True))
    half = csr_matrix((steps, (low, high)), shape=(density.size, density.size))
    return half + half.T


def costs_of(density: np.ndarray) -> Costmap:
    grid = OccupancyGrid(np.where(np.isinf(density), OCCUPIED, FREE), 0.05)
    u = np.where(np.isinf(density), np.nan, (density - 1) / 10)
    return dataclasses.replace(Costmap.from_density(grid, density), u=u, e=u, weight=10.0)


def ends_of(costs: Costmap):
    return [costs.grid.position(*cell) for cell in ((0, 0), np.subtract(costs.grid.shape, 1))]


def best_of(times: int, call):
    seconds = []
    for _ in range(times):
        began = time.perf_counter()
        result = call()
        seconds.append(time.perf_counter() - began)
    return min(seconds), result


@pytest.mark.parametrize("size", [1000, 2000])
def test_single_objective(benchmark, size):
    density, columns = rooms(size), size + 2
    first, last = columns + 1, size * columns + size

    def ours(corner_cutting=False):
        half = make_bordered_half_density(density, 1)
        return compute_shortest_costs(half, columns, first, last, corner_cutting)

    cost = benchmark.pedantic(ours, rounds=9, warmup_rounds=1)
    seconds = benchmark.stats.stats.min
    graph = graph_of(density)
    scipy_seconds, expected = best_of(3, lambda: dijkstra(graph, indices=0))
    assert cost[last] == pytest.approx(expected[-1])
    search = MCP_Geometric(np.where(np.isinf(density), -1, density))
    skimage_seconds, (skimage, _) = best_of(
        3, lambda: search.find_costs([(0, 0)], [(size - 1, size - 1)])
    )
    cut_seconds, cut = best_of(5, lambda: ours(True))
    assert cut[last] == pytest.approx(skimage[-1, -1])
    reached = np.isfinite(cost).sum()
    benchmark.extra_info.update(
        ratio_to_scipy=scipy_seconds / seconds,
        ratio_to_MCP_Geometric=skimage_seconds / cut_seconds,
        nanoseconds_a_cell=1e9 * seconds / reached,
    )
    print(
        f"\n{size}^2: {seconds * 1e3:.0f} ms, {seconds / reached * 1e9:.0f} ns a cell reached;"
        f" scipy takes {scipy_seconds / seconds:.1f} times as long,"
        f" MCP_Geometric (corners cut) {skimage_seconds / cut_seconds:.1f} times"
    )


def cpu_of(call) -> float:
    """CPU seconds of a call, without what its result is freed in."""
    began = time.process_time()
    result = call()
    seconds = time.process_time() - began
    del result
    return seconds


def test_large_maps_cost_no_more_a_cell(benchmark):
    maps = {}
    for size in (4000, 8000):
        small = rooms(500)
        maps[size] = np.kron(small, np.ones((size // 500, size // 500)))
    turns = {size: [] for size in maps}

    def all_sizes():
        for size, density in maps.items():
            columns, free = size + 2, np.isfinite(density).sum()

            def solve(density=density, columns=columns, size=size):
                half = make_bordered_half_density(density, 1)
                return compute_shortest_costs(
                    half, columns, columns + 1, size * columns + size, False
                )

            turns[size].append(cpu_of(solve) / free)

    benchmark.pedantic(all_sizes, rounds=4, warmup_rounds=1)
    least = {size: min(seconds[1:]) for size, seconds in turns.items()}
    benchmark.extra_info["share_of_the_speed_at_4000"] = least[4000] / least[8000]
    print(
        f"\n{least[4000] * 1e9:.0f} ns a cell at 4000^2, {least[8000] * 1e9:.0f} at 8000^2:"
        f" {least[8000] / least[4000]:.2f} times"
    )


@pytest.mark.parametrize("span", [0.0, 0.5, 2.0, 10.0])
def test_astar_beside_dijkstra(benchmark, span):
    density = rooms(1000)
    density = np.where(np.isinf(density), np.inf, 1 + (np.minimum(density, 11) - 1) / 10 * span)
    half, columns = make_bordered_half_density(density, 1), 1002
    scale = measure_cost_scale(half)
    free = np.argwhere(np.isfinite(density)) + 1
    pairs = np.random.default_rng(0).choice(free, (8, 2)) @ (columns, 1)

    def solve(guided):
        ends = [(int(one), int(other)) for one, other in pairs]
        return [search_grid(half, columns, *pair, False, scale, guided=guided) for pair in ends]

    by_dijkstra, expected = best_of(3, lambda: solve(False))
    found = benchmark.pedantic(lambda: solve(True), rounds=3, warmup_rounds=1)
    for one, other, (_, goal) in zip(found, expected, pairs, strict=True):
        assert one.cost[goal] == other.cost[goal]
    cells = [sum(one.expanded for one in made) for made in (found, expected)]
    benchmark.extra_info["ratio_to_dijkstra"] = by_dijkstra / benchmark.stats.stats.min
    print(
        f"\ncontrast {scale.mean / scale.cheapest:.2f}: A* takes"
        f" {benchmark.stats.stats.min / by_dijkstra:.2f} of the time of Dijkstra's algorithm,"
        f" {cells[0] / cells[1]:.2f} of its expansions"
    )


@pytest.mark.parametrize("size", [1000, 2000])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_any_angle(benchmark, size, seed, monkeypatch):
    costs = costs_of(rooms(size, seed))
    ends = ends_of(costs)
    grid_seconds, grid = best_of(7, lambda: plan(costs, *ends, planner="grid"))
    with monkeypatch.context() as patch:  # 32 neighbours and dynamic programming at all scales
        patch.setattr("locplan.planning.any_angle.SHIFTS", ())
        best = plan(costs, *ends, planner="any-angle", accuracy="high")
    high = plan(costs, *ends, planner="any-angle", accuracy="high")
    result = benchmark.pedantic(lambda: plan(costs, *ends, planner="any-angle"), rounds=7)
    benchmark.extra_info["share_of_the_grid_planner"] = grid_seconds / benchmark.stats.stats.min
    print(
        f"\n{size}^2, seed {seed}: grid {grid.metrics.cost / best.metrics.cost - 1:.2%} above"
        f" 32 neighbours + dynamic programming, any-angle"
        f" {result.metrics.cost / best.metrics.cost - 1:+.3%}"
        f" in {benchmark.stats.stats.min / grid_seconds:.2f} times the grid's time,"
        f" high {high.metrics.cost / best.metrics.cost - 1:+.3%}"
    )


def test_all_movingai_scenarios(benchmark):
    def solve_all():
        count = worst = 0
        for path in find_scenario_files():
            density = read_map(find_map_file(path))
            half, columns = make_bordered_half_density(density, 1), density.shape[1] + 2
            for start, goal, optimal in read_all_scenarios(path):
                source, target = ((row + 1) * columns + col + 1 for row, col in (start, goal))
                length = compute_shortest_costs(half, columns, source, target, False)[target]
                worst = max(worst, abs(length - optimal))
                count += 1
        return count, worst

    count, worst = benchmark.pedantic(solve_all)
    assert worst < 0.005
    benchmark.extra_info["milliseconds_a_scenario"] = 1e3 * benchmark.stats.stats.min / count
    print(f"\n{count} scenarios solved, none further than {worst:.1e} from its optimal length")


@pytest.mark.parametrize(("size", "seed"), [(500, 0), (500, 1), (1000, 0), (1000, 1)])
def test_fronts_and_budgets(benchmark, size, seed):
    costs = costs_of(rooms(size, seed))
    ends = ends_of(costs)
    pareto_front(costs, *ends, time_limit=0.1)
    front = benchmark.pedantic(lambda: pareto_front(costs, *ends), rounds=3)
    assert front.epsilon == 0
    seconds = []
    for index in np.linspace(0, len(front) - 1, 7).astype(int):
        result = plan(costs, *ends, budget=front.integral[index])
        seconds.append(result.solve_time)
        assert result.metrics.length == pytest.approx(front.length[index], rel=1e-5)
    benchmark.extra_info["ratio_to_seven_budgets"] = sum(seconds) / front.solve_time
    print(
        f"\n{size}^2, seed {seed}: front of {len(front)} in {front.solve_time:.2f} s"
        f" ({front.labels:,} labels); budgets {min(seconds):.2f}-{max(seconds):.2f} s"
    )


def test_a_hard_front_keeps_its_caps(benchmark):
    rng = np.random.default_rng(0)
    costs = costs_of(rng.uniform(1, 11, (1000, 1000)))
    ends = ends_of(costs)
    front = benchmark.pedantic(lambda: pareto_front(costs, *ends, time_limit=20.0), rounds=1)
    benchmark.extra_info["no_peer"] = f"ends at its limit of 20 s, within {front.epsilon:.2%}"
    print(
        f"\nnoise, 1000^2: {len(front)} paths in {front.solve_time:.1f} s with"
        f" {front.labels:,} labels, within {front.epsilon:.2%}"
    )
