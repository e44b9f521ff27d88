"""The lattice planner on real maps: it misses no query that a flood of all its motions solves."""

import math

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

from locplan import load_map
from locplan._support.kernels.outlines import swept
from locplan.maps import OCCUPIED
from locplan.planning import Costmap, check_path, plan
from locplan.planning.lattice_search import centre_cells, primitives
from locplan.robots import Footprint, Kinematics, Robot

LONG = Footprint([(0.5, 0.3), (0.5, -0.3), (-0.5, -0.3), (-0.5, 0.3)])
DRIVES = {
    "on the spot": Kinematics(),
    "car": Kinematics(drive="car-like", turning_radius=0.4),
    "forward": Kinematics(drive="car-like", turning_radius=0.4, reverse=False),
}


def flooded(costs: Costmap, starts: list[tuple[int, int]]) -> list[np.ndarray]:
    """The cells that 16 headings reach from each cell by any motions, from plain shifts of the map.

    The outline must sweep no occupied cell, the centre touch no blocked one.
    """
    shape, robot = costs.grid.shape, costs.robot
    radius = robot.kinematics.turning_radius / costs.grid.resolution
    found = primitives(16, radius, False)
    farthest = max(np.abs(np.array(each.poses)[:, :2]).max() for each in found)
    body = robot.outline.circumscribed_radius / costs.grid.resolution
    reach = math.ceil(farthest + body) + 2
    walls = np.pad(costs.grid.cells == OCCUPIED, reach)
    blocked = np.pad(np.isinf(costs.density), reach, constant_values=True)
    number, sources, targets = np.arange(costs.density.size).reshape(shape), [], []
    for each in found:
        corners = robot.outline.vertices / costs.grid.resolution
        poses = np.array(each.poses) + np.array([0.5, 0.5, 0.0])
        met = np.zeros(shape, bool)
        for row, col in np.argwhere(swept(corners, poses, reach)):
            met |= walls[row : row + shape[0], col : col + shape[1]]
        for row, col in centre_cells(each) + reach:
            met |= blocked[row : row + shape[0], col : col + shape[1]]
        free = number[~met]
        sources.append(free + each.source * number.size)
        row, col = each.end
        targets.append(free + row * shape[1] + col + each.target * number.size)
        if robot.kinematics.reverse and not each.turn:
            sources, targets = [*sources, targets[-1]], [*targets, sources[-1]]
    for n, (row, col) in enumerate(starts):  # a node more leads to all headings of a start
        sources.append(np.full(16, 16 * number.size + n))
        targets.append(np.arange(16) * number.size + number[row, col])
    edges, nodes = (np.concatenate(sources), np.concatenate(targets)), 16 * number.size
    graph = coo_array((np.ones(len(edges[0]), bool), edges), (nodes + len(starts),) * 2).tocsr()
    reached = []
    for n in range(len(starts)):
        states = breadth_first_order(graph, nodes + n, return_predecessors=False)
        cells = np.zeros(number.size, bool)
        cells[states[states < nodes] % number.size] = True
        reached.append(cells.reshape(shape))
    return reached


@pytest.mark.long
@pytest.mark.parametrize("drive", DRIVES)
def test_no_query_is_missed_that_its_motions_solve(real_maps, drive):
    solved = 0
    for seed, name in enumerate(["fetch_4_26_15", "aws_small_house"]):
        grid = load_map(next((real_maps / name).glob("*.yaml")))
        robot = Robot(footprint=LONG, margin=0.0, kinematics=DRIVES[drive], goal_tolerance=0.0)
        blank = Costmap.blank(grid, robot=robot)
        density = 1 + 8 * np.exp(-2 * grid.clearance)
        costs = Costmap.from_density(grid, density, robot=robot)
        free = np.argwhere(np.isfinite(blank.density))
        rng = np.random.default_rng(seed)
        starts, goals = rng.choice(free, (2, 20)).tolist()
        for start, goal, reached in zip(starts, goals, flooded(costs, starts), strict=True):
            made = plan(costs, *(grid.position(*at) for at in (start, goal)), planner="lattice")
            assert (made.path is not None) == reached[*goal], (name, start, goal, made.note)
            assert made.status in ("solved", "infeasible", "unreachable")
            if made.path is None:
                continue
            solved += 1
            assert check_path(grid, made.path, robot).drivable
            assert LONG.first_collision(grid, made.path) is None
            assert math.isfinite(made.metrics.cost)
    assert solved >= 26
