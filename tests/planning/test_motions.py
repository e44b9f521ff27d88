"""Curves between poses, and the cost of travel along them."""

import itertools
import math

import numpy as np
import pytest
from ompl import base
from support import oracles
from support.maps import ascii_map

from locplan._support.kernels import search
from locplan.errors import ConfigError, PoseError
from locplan.maps import FREE, OccupancyGrid
from locplan.planning import Costmap, path_metrics
from locplan.planning.kernels import curves, motions
from locplan.planning.ompl.motions import Motions

SHORTEST = {"Dubins": curves.find_dubins_curve, "ReedsShepp": curves.find_reeds_shepp_curve}
SPACES = {"Dubins": base.DubinsStateSpace, "ReedsShepp": base.ReedsSheppStateSpace}


def random_poses(rng, count, extent):
    poses = rng.uniform(-extent, extent, (count, 3))
    poses[:, 2] = rng.uniform(-math.pi, math.pi, count)
    aligned = rng.random(count) < 0.3  # where the cases of a case distinction meet
    poses[aligned, :2] = poses[aligned, :2].round()
    poses[aligned, 2] = (poses[aligned, 2] / (math.pi / 2)).round() * math.pi / 2
    return poses


def random_costs(seed, *, blocked=0.0, size=40, yaw=0.0):
    rng = np.random.default_rng(seed)
    density = rng.uniform(1, 5, (size, size))
    density[rng.random(density.shape) < blocked] = np.inf
    grid = OccupancyGrid(np.full(density.shape, FREE), 0.25, (3.0, -2.0, yaw))
    return Costmap.from_density(grid, density)


@pytest.mark.parametrize("name", SHORTEST)
@pytest.mark.parametrize("extent", [0.5, 2.0, 4.0, 15.0])
def test_curve_lengths_equal_ompl_lengths(name, extent):
    """Each curve also leads exactly to its end."""
    rng = np.random.default_rng(3)
    space = SPACES[name](1.0)
    state, other = space.allocState(), space.allocState()
    for start, end in itertools.pairwise(random_poses(rng, 400, extent)):
        turns, lengths = SHORTEST[name](*start, *end)
        reached = tuple(start)
        for turn, length in zip(turns, lengths, strict=True):
            reached = curves.advance_pose(*reached, turn, length, 1.0)
        assert reached[:2] == pytest.approx(end[:2], abs=1e-9)
        assert math.remainder(reached[2] - end[2], 2 * math.pi) == pytest.approx(0, abs=1e-9)
        for one, pose in ((state, start), (other, end)):
            one.setX(pose[0])
            one.setY(pose[1])
            one.setYaw(pose[2])
        assert np.abs(lengths).sum() == pytest.approx(space.distance(state, other), abs=1e-6)


def test_dubins_curves_never_reverse():
    rng = np.random.default_rng(5)
    for start, end in itertools.pairwise(random_poses(rng, 300, 3.0)):
        turns, lengths = curves.find_dubins_curve(*start, *end)
        assert (lengths >= 0).all()
        assert set(turns) <= {-1, 0, 1}


def test_reeds_shepp_length_ignores_direction():
    rng = np.random.default_rng(5)
    for start, end in itertools.pairwise(random_poses(rng, 300, 3.0)):
        forth, back = (
            np.abs(curves.find_reeds_shepp_curve(*first, *last)[1]).sum()
            for first, last in ((start, end), (end, start))
        )
        assert back == pytest.approx(forth)


@pytest.mark.parametrize("seed", range(12))
def test_arc_crossings_equal_fine_sampling(seed):
    rng = np.random.default_rng(seed)
    center_x, center_y, radius = *rng.uniform(-5, 5, 2), rng.uniform(0.3, 9)
    low = rng.uniform(-7, 7)
    high = low + rng.uniform(0.1, 2 * math.pi)
    angles = curves.find_arc_crossings(center_x, center_y, radius, low, high)
    assert angles[0] == low
    assert angles[-1] == high
    assert (np.diff(angles) >= 0).all()
    inner = [
        angle
        for angle in angles[1:-1]
        if abs(angle / (math.pi / 2) - round(angle / (math.pi / 2))) > 1e-9
    ]
    expected = oracles.curves.arc_crossings(center_x, center_y, radius, low, high)
    assert inner == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("kind", [curves.DUBINS, curves.REEDS_SHEPP])
@pytest.mark.parametrize("blocked", [0.0, 0.01])
def test_curve_cost_equals_fine_integration(kind, blocked):
    rng = np.random.default_rng(7)
    density = random_costs(11, blocked=blocked).density
    half = search.make_bordered_half_density(density, 1)[None]
    columns = density.shape[1] + 2
    outcomes = set()
    for _ in range(12):
        radius = rng.uniform(2, 9)
        start, end = (tuple(rng.uniform([3, 3, -4], [37, 37, 4])) for _ in range(2))
        if math.isinf(density[int(start[1]), int(start[0])]):
            continue
        turns, lengths = motions.find_shortest_word(kind, radius, start, end)
        expected = oracles.curves.motion_cost(density, turns, lengths, radius, start, step=2e-3)
        shifted = [(x + 1, y + 1, heading) for x, y, heading in (start, end)]
        cost = motions.compute_motion_cost(
            motions.MotionCostmap(half, columns, 0.0, True), kind, radius, *shifted
        )
        outcomes.add(math.isinf(cost))
        assert cost == pytest.approx(expected, rel=2e-3)
    assert False in outcomes
    assert (True in outcomes) == (blocked > 0 or kind == curves.DUBINS)  # loops leave the map


@pytest.mark.parametrize("space", ["Dubins", "ReedsShepp"])
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_path_cost_equals_curve_cost(space, yaw):
    rng = np.random.default_rng(2)
    costs = random_costs(4, blocked=0.02, yaw=yaw)
    along = Motions(costs, space, turning_radius=0.9)
    rows, cols = np.nonzero(np.isfinite(costs.density))
    seen = 0
    for _ in range(400):
        chosen = rng.integers(0, len(rows), 2)
        x, y = costs.grid.grid_to_world(rows[chosen] + 0.5, cols[chosen] + 0.5)
        poses = np.column_stack([x, y, rng.uniform(-4, 4, 2)])
        cost = along.cost(*poses)
        path = along.path(poses)
        if math.isfinite(cost):
            assert path_metrics(costs, path).cost == pytest.approx(cost, rel=5e-5)
        assert path.xy[[0, -1]] == pytest.approx(poses[:, :2])
        turned = np.diff(np.unwrap(path.heading))
        travelled = np.hypot(*np.diff(path.xy, axis=0).T)
        assert (np.abs(turned) <= travelled / 0.9 + 1e-3).all()
        seen += math.isfinite(cost)
    assert seen > 20


def test_straight_motion_cost_equals_path_cost():
    rng = np.random.default_rng(2)
    costs = random_costs(4, blocked=0.05, yaw=-1.2)
    x, y = costs.grid.grid_to_world(*rng.uniform(0, 40, (2, 60)))
    poses = np.column_stack([x, y, np.zeros(60)])
    pairs = np.array(list(itertools.combinations(range(60), 2)))
    straight = Motions(costs)
    found = straight.compute_motion_costs(poses, pairs)
    for (i, j), cost in zip(pairs, found, strict=True):
        expected = path_metrics(costs, straight.path(poses[[i, j]])).cost
        if straight.is_free(*poses[i, :2]):
            assert cost == pytest.approx(expected, rel=1e-9)
        else:
            assert math.isinf(cost)
    assert np.isfinite(found).any()


def test_only_crossed_cells_block_curve():
    # A quarter turn about the lower left corner that passes exactly the cells it must.
    grid = ascii_map("....", "....", "....", "....")
    free = np.ones((4, 4))
    start, end = (3.1, 0.0, math.pi / 2), (0.0, 3.1, math.pi)
    assert Motions(Costmap.from_density(grid, free), "Dubins", 3.1).cost(start, end) == (
        pytest.approx(1.55 * math.pi)
    )
    for row, col in itertools.product(range(4), range(4)):
        density = free.copy()
        density[row, col] = np.inf
        cost = Motions(Costmap.from_density(grid, density), "Dubins", 3.1).cost(start, end)
        near, far = math.hypot(row, col), math.hypot(row + 1, col + 1)
        assert math.isinf(cost) == (near < 3.1 < far)


def test_motion_cost_is_at_least_length():
    costs = Costmap.blank(OccupancyGrid(np.full((50, 50), FREE), 0.05), robot=0.0)
    rng = np.random.default_rng(0)
    straight = Motions(costs)
    for _ in range(500):
        start, end = rng.uniform(0.01, 2.49, (2, 2))
        assert straight.cost(start, end) >= math.hypot(*(end - start)) * (1 - 1e-12)


@pytest.mark.parametrize(
    ("space", "radius", "message"),
    [
        ("R3", None, "space must be one of"),
        ("Dubins", None, "needs a turning radius"),
        ("Dubins", 0.0, "turning_radius must be a positive number"),
        ("ReedsShepp", math.nan, "turning_radius must be a positive number"),
        ("ReedsShepp", "1", "turning_radius must be a positive number"),
        ("SE2", 1.0, "a turning radius is for the spaces"),
        ("Dubins", 1e-5, r"turning_radius must lie in 0.0025..141.4 m"),
        ("Dubins", 1e6, r"turning_radius must lie in 0.0025..141.4 m"),
        ("Dubins", True, "turning_radius must be a positive number"),
    ],
)
def test_impossible_spaces_are_refused(space, radius, message):
    with pytest.raises(ConfigError, match=message):
        Motions(random_costs(0), space, radius)


def test_motion_to_invalid_pose_costs_infinity():
    costs = random_costs(0)
    here = costs.grid.position(20, 20)
    for space, radius in (("R2", None), ("SE2", None), ("Dubins", 0.5), ("ReedsShepp", 0.5)):
        motions = Motions(costs, space, radius)
        for bad in ((math.inf, 0, 0), (math.nan, 0, 0), (1e9, 0, 0), (*here, math.nan)):
            assert motions.cost((*here, 0.0), bad) == math.inf
            assert motions.cost(bad, (*here, 0.0)) == math.inf


@pytest.mark.parametrize("radius", [0.003, 0.5, 140.0])
def test_curve_cost_ignores_full_turns(radius):
    """A full Dubins loop is blocked if it leaves the map."""
    costs = Costmap.blank(OccupancyGrid(np.full((40, 40), FREE), 0.25), robot=0.0)
    motions = Motions(costs, "ReedsShepp", radius)
    for n in range(20860, 20890):
        start, end = (5.0, 5.0, n * math.pi / 2 - 0.3), (5.0, 5.9, n * math.pi / 2 + 2.7)
        usual = [(*pose[:2], math.remainder(pose[2], 2 * math.pi)) for pose in (start, end)]
        assert motions.cost(start, end) == pytest.approx(motions.cost(*usual), rel=1e-6)
    full_loop = Motions(costs, "Dubins", radius).cost((5.0, 5.0, 0.0), (4.9, 5.0, 0.0))
    assert math.isinf(full_loop) == (radius > 5)


def test_validate_pose_enforces_space():
    costs = random_costs(0)
    here = costs.grid.position(5, 5)
    with pytest.raises(PoseError, match="have a heading"):
        Motions(costs).validate_pose((*here, 0.0), "start")
    for pose in (here, (*here, math.nan), (*here, "north"), (*here, 0.0, 1.0)):
        with pytest.raises(PoseError, match=r"x, y \[m\] and a heading"):
            Motions(costs, "SE2").validate_pose(pose, "goal")
    assert Motions(costs, "SE2").validate_pose([*here, 1], "goal") == (*here, 1.0)
