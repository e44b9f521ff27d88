"""Shortest paths beside the optimal lengths of the MovingAI benchmark grids."""

import numpy as np
import pytest
from conftest import SHARED_DATA

from locplan._support.kernels.search import bordered_half, shortest_costs
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.planning import Costmap, plan

FOLDER = SHARED_DATA / "movingai"
SCENARIOS_A_MAP = 12


def read_map(path) -> np.ndarray:
    """Density 1 on passable cells, inf elsewhere; row 0 is the file's first line."""
    lines = path.read_text().splitlines()
    rows = lines[lines.index("map") + 1 :]
    passable = np.array([[character in ".GS" for character in row] for row in rows if row])
    return np.where(passable, 1.0, np.inf)


def read_all_scenarios(path) -> list[tuple[tuple[int, int], tuple[int, int], float]]:
    """(row, col) of start and goal, and the optimal length."""
    lines = [line.split() for line in path.read_text().splitlines()[1:] if line.strip()]
    return [((int(f[5]), int(f[4])), (int(f[7]), int(f[6])), float(f[8])) for f in lines]


def read_scenarios(path):
    """Some of them, of all lengths."""
    every = read_all_scenarios(path)
    return every[:: max(1, len(every) // SCENARIOS_A_MAP)] + every[-1:]


def scenario_files():
    if not FOLDER.is_dir():
        pytest.skip("the MovingAI grids (../shared/data/movingai) are not here")
    return sorted(FOLDER.glob("*.scen"))


def map_of(path):
    name = path.name.removesuffix(".scen").removesuffix(".map").removesuffix("-even-1")
    return path.with_name(f"{name}.map")


def test_lengths_are_optimal():
    files = scenario_files()
    for path in files:
        density = read_map(map_of(path))
        width, half = density.shape[1] + 2, bordered_half(density, 1)
        for start, goal, optimal in read_scenarios(path):
            source, target = ((row + 1) * width + col + 1 for row, col in (start, goal))
            cost = shortest_costs(half, width, source, target, False)[target]
            assert cost == pytest.approx(optimal, abs=0.005), (path.name, start, goal)
    assert files


def test_plans_have_the_optimal_length():
    path = scenario_files()[0]
    density = read_map(map_of(path))
    cells = np.where(np.isfinite(density), FREE, OCCUPIED)
    costs = Costmap.blank(OccupancyGrid(cells, 1.0), robot=0.0)
    for start, goal, optimal in read_scenarios(path):
        ends = [costs.grid.position(*cell) for cell in (start, goal)]
        result = plan(costs, *ends, planner="grid")
        assert result.metrics.length == pytest.approx(optimal, abs=0.005)
        assert result.metrics.cost == pytest.approx(optimal, abs=0.005)
