"""Compare the lattice planner with scipy's Dijkstra over all states, on rooms with boxes.

pytest tests/benchmarks/bench_lattice.py --benchmark-only -s
"""

import math

import numpy as np
import pytest
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from benchmarks.bench_planners import best_of, rooms
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.planning import Costmap, plan
from locplan.planning.lattice import Lattice
from locplan.planning.lattice_search import LatticeSearch, MotionPrices
from locplan.robots import Footprint, Kinematics, Robot

LONG = Footprint([(0.3, 0.15), (0.3, -0.15), (-0.3, -0.15), (-0.3, 0.15)])
DRIVES = {
    "on the spot": Kinematics(),
    "car, forward": Kinematics(drive="car-like", turning_radius=0.4, reverse=False),
}


def graph_of(search: LatticeSearch) -> csr_array:
    """All states (heading, row, col) and motions ahead of a search, for scipy."""
    ground, moves, _ = search.graph
    bits = np.unpackbits(ground.masks.view(np.uint8).reshape(*ground.masks.shape, 8), axis=-1)
    bits = bits.reshape(*ground.masks.shape, 8, 8)[..., ::-1].reshape(*ground.masks.shape, 64)
    size, parts = ground.rows * ground.columns, []
    for n in np.flatnonzero(moves.at_end == 0):
        shut = bits[moves.mask_heading[n], :, :, moves.slot[n]].reshape(ground.rows, -1)
        free = np.flatnonzero(shut[:, : ground.columns] == 0)
        cost = np.full(len(free), moves.extra[n])
        for k in range(moves.cells[n]):
            cost += moves.lengths[n, k] * ground.half[free + moves.crossed[n, k]]
        to = free + moves.row[n] * ground.columns + moves.col[n] + moves.target[n] * size
        parts.append((cost, free + moves.source[n] * size, to))
    cost, source, target = (np.concatenate(part) for part in zip(*parts, strict=True))
    states = size * (len(moves.begin) - 1)
    return coo_array((cost, (source, target)), shape=(states, states)).tocsr()


@pytest.mark.parametrize("drive", DRIVES)
def test_beside_dijkstra_over_all_states(benchmark, drive):
    wall = np.isinf(rooms(400, blocked=0.1))
    grid = OccupancyGrid(np.where(wall, OCCUPIED, FREE), 0.05)
    robot = Robot(footprint=LONG, margin=0.0, kinematics=DRIVES[drive], goal_tolerance=0.0)
    costs = Costmap.from_density(grid, 1 + 8 * np.exp(-2 * grid.clearance), robot=robot)
    planner = Lattice(smooth=False, gear_change=0.0, reverse=100.0)
    search = LatticeSearch(costs, 16, 1, MotionPrices(100.0, 0.0, planner.turn_cost))
    graph = graph_of(search)
    free = np.argwhere(grid.clearance > 0.5)
    begin, *others = np.random.default_rng(0).permutation(free).tolist()
    first = begin[0] * grid.shape[1] + begin[1]
    seconds, cost = best_of(1, lambda: dijkstra(graph, indices=first))
    reached = cost.reshape(16, *grid.shape).min(axis=0)
    far = [at for at in others if np.isfinite(reached[*at]) and math.dist(at, begin) > 150][:4]
    ends = [((*grid.position(*begin), 0.0), grid.position(*at)) for at in far]
    made = benchmark.pedantic(
        lambda: [plan(costs, *each, planner=planner) for each in ends], rounds=3, warmup_rounds=1
    )
    for at, each in zip(far, made, strict=True):
        assert each.expanded < graph.shape[0] / 10
        assert each.metrics.cost <= reached[*at] * grid.resolution * (1 + 1e-5)
    ours = benchmark.stats.stats.min / len(ends)
    benchmark.extra_info["ratio_to_scipy"] = seconds / ours
    print(
        f"\n{drive}: {ours * 1e3:.0f} ms a query, {np.mean([one.expanded for one in made]):.0f}"
        f" states; scipy takes {seconds / ours:.0f} times as long over {graph.shape[0]:,} states"
    )
