"""The lattice planner: exact over its motions, with the outline, the radius and the drive."""

import dataclasses
import itertools
import math
import re
from collections import defaultdict

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order
from support import oracles
from support.cases import sample_cases
from support.maps import ascii_map

from locplan import load_map
from locplan._support.kernels.outlines import (
    find_first_hit,
    find_swept_cells,
    sum_occupied_along_rows,
)
from locplan._support.kernels.rays import compute_segment_cost
from locplan._support.kernels.search import make_bordered_half_density
from locplan.errors import ConfigError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.planning import Costmap, Path, check_path, path_cost, plan
from locplan.planning.kernels import bit_masks, lattice, motions, smoothing
from locplan.planning.kernels.curves import DUBINS, REEDS_SHEPP
from locplan.planning.lattice import Lattice
from locplan.planning.lattice_search import (
    LatticeSearch,
    MotionPrices,
    compute_heading_angles,
    find_centre_cells,
    make_outline_masks,
    make_primitives,
)
from locplan.planning.ompl.motions import Motions
from locplan.planning.smoothing import smooth_path
from locplan.robots import Footprint, Kinematics, Robot

LONG = Footprint([(0.21, 0.08), (0.21, -0.08), (-0.13, -0.08), (-0.13, 0.08)])
CAR = Kinematics(drive="car-like", turning_radius=0.3)
FORWARD = Kinematics(drive="car-like", turning_radius=0.2, reverse=False)
FORWARD_08 = Kinematics(drive="car-like", turning_radius=0.8, reverse=False)
SIDEWAYS = Kinematics(drive="omnidirectional")
DRIVES = [Kinematics(), CAR, FORWARD, SIDEWAYS]
NAMES = ["on the spot", "car", "forward", "sideways"]


def cluttered(seed: int, kinematics: Kinematics, shape=(10, 12)) -> Costmap:
    """A small map with walls here and there, and a density that differs from cell to cell."""
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random(shape) < 0.06, OCCUPIED, FREE).astype(np.uint8)
    grid = OccupancyGrid(cells, 0.1, (-1.0, 0.5, 0.4))
    robot = Robot(footprint=LONG, margin=0.0, kinematics=kinematics, goal_tolerance=0.0)
    return Costmap.from_density(grid, rng.uniform(1.0, 9.0, shape), robot=robot)


def list_lattice_edges(costs: Costmap, planner: Lattice) -> dict:
    """All motions of the lattice by brute force: {(row, col, heading, gear): [(state, cost)]}."""
    grid, kinematics = costs.grid, costs.robot.kinematics
    radius = kinematics.turning_radius / grid.resolution
    half = make_bordered_half_density(costs.density, 1)
    edges = defaultdict(list)
    primitives = make_primitives(planner.headings, radius, kinematics is SIDEWAYS, planner.span)
    for each, row, col in itertools.product(primitives, *map(range, grid.shape)):
        local = np.array(each.poses) + np.array([col + 0.5, row + 0.5, 0.0])
        at = local[:, :2] + 1
        touching = (
            compute_segment_cost(half, grid.shape[1] + 2, *a[::-1], *b[::-1], False)
            for a, b in itertools.pairwise(at)
        )
        if not (
            grid.contains(row + each.end[0], col + each.end[1])
            and np.isfinite(costs.density[row, col])
        ):
            continue
        if not np.isfinite(sum(touching)):
            continue
        x, y = grid.grid_to_world(local[:, 1], local[:, 0])
        path = Path(np.column_stack([x, y]), local[:, 2] + grid.origin[2])
        if LONG.find_first_collision(grid, path) is not None:
            continue
        cost = path_cost(costs, path) * (planner.reverse if each.sideways else 1)
        cost += planner.turn_cost * each.turn
        here, there = (row, col, each.source), (row + each.end[0], col + each.end[1], each.target)
        neutral = each.sideways or each.turn
        for gear in (0, 1):
            to_gear = gear if neutral else 0
            change = planner.gear_change * (to_gear != gear)
            edges[(*here, gear)].append(((*there, to_gear), cost + change))
            if kinematics.reverse and not neutral:
                change = planner.gear_change * (gear != 1)
                edges[(*there, gear)].append(((*here, 1), planner.reverse * cost + change))
    return edges


@pytest.mark.parametrize("kinematics", sample_cases(DRIVES), ids=NAMES)
@pytest.mark.parametrize("seed", sample_cases([1, 0]))
def test_lattice_path_cost_equals_brute_force(kinematics, seed):
    costs = cluttered(seed, kinematics)
    planner = Lattice(
        headings=8 if seed else 16, reverse=1.7, gear_change=0.2, turn_cost=0.15, smooth=False
    )
    edges = list_lattice_edges(costs, planner)
    rng = np.random.default_rng(seed)
    cells = rng.permutation(np.argwhere(np.isfinite(costs.density)))[:6]
    outcomes = set()
    for start, goal in itertools.permutations(map(tuple, cells.tolist()), 2):
        ends = [costs.grid.position(*cell) for cell in (start, goal)]
        starts = [(*start, h, g) for h in range(planner.headings) for g in (0, 1)]
        reached = oracles.search.costs_between_states(edges, starts)
        least = min(
            (cost for state, cost in reached.items() if state[:2] == goal), default=math.inf
        )
        result = planner.solve(costs, *ends)
        outcomes.add(result.status)
        assert (result.path is None) == (least == math.inf)
        if result.path is None:
            assert result.status in ("infeasible", "unreachable")
            continue
        assert compute_path_price(costs, result.path, planner) == pytest.approx(least, rel=1e-6)
        assert LONG.find_first_collision(costs.grid, result.path) is None
        for pose, cell in zip(result.path.xy[[0, -1]], (start, goal), strict=True):
            assert costs.grid.cell(pose) == cell
    assert "solved" in outcomes


def compute_path_price(costs: Costmap, path: Path, planner: Lattice) -> float:
    """Compute the cost of a path with the prices of the planner [m]."""
    total, gear = 0.0, None
    for pose, after in itertools.pairwise(path.poses):
        step, turn = after[:2] - pose[:2], math.remainder(after[2] - pose[2], 2 * math.pi)
        if np.hypot(*step) < 1e-9:
            total += planner.turn_cost * abs(turn)
            continue
        ahead = step @ (math.cos(pose[2] + turn / 2), math.sin(pose[2] + turn / 2))
        share = ahead / np.hypot(*step)
        length = path_cost(costs, Path([pose[:2], after[:2]], [pose[2], after[2]]))
        total += length * (1.0 if share > 0.5 else planner.reverse)
        if abs(share) > 0.5:
            total += planner.gear_change * (gear is not None and gear != (share > 0))
            gear = share > 0
    return total


@pytest.mark.parametrize("kinematics", sample_cases(DRIVES, 2), ids=NAMES)
def test_lattice_bound_never_exceeds_cost(kinematics):
    costs = cluttered(3, kinematics)
    planner = Lattice(turn_cost=0.2, gear_change=0.1, reverse=1.3)
    backward = defaultdict(list)
    for state, steps in list_lattice_edges(costs, planner).items():
        for other, cost in steps:
            backward[other].append((state, cost))
    goal = tuple(np.argwhere(np.isfinite(costs.density))[20].tolist())
    ends = [(*goal, h, g) for h in range(16) for g in (0, 1)]
    reached = oracles.search.costs_between_states(backward, ends)
    prices = MotionPrices(planner.reverse, planner.gear_change, planner.turn_cost)
    search = LatticeSearch(costs, planner.headings, planner.span, prices)
    target = goal[0] * costs.grid.shape[1] + goal[1]
    bound = search.compute_bounds([target], -1).reshape(costs.grid.shape) * costs.grid.resolution
    of_cell = np.full(costs.grid.shape, np.inf)
    for (row, col, *_), cost in reached.items():
        of_cell[row, col] = min(of_cell[row, col], cost)
    assert (bound <= of_cell * (1 + 1e-6)).all()
    assert np.isfinite(of_cell).sum() > 10
    assert (bound[np.isfinite(of_cell)] > 0.5 * of_cell[np.isfinite(of_cell)]).mean() > 0.5


def test_swept_cells_equal_plain_loops():
    rng = np.random.default_rng(4)
    for _ in range(3):
        outline = Footprint(rng.normal(size=(3, 2)) / 2 + np.array([(3, 0), (-2, 2), (-2, -2)]))
        poses = rng.uniform(-1, 1, (3, 3))
        reach = 6
        met = find_swept_cells(outline.vertices, poses, reach)
        assert np.array_equal(met, oracles.outlines.swept(outline.vertices, poses, reach))
        occupied = rng.random((20, 22)) < 0.01
        poses[:, :2] += 9
        hit = find_first_hit(sum_occupied_along_rows(occupied), outline.vertices, poses)
        assert hit == oracles.outlines.find_first_hit(occupied, outline.vertices, poses)


def test_collision_is_independent_of_pose_density():
    rng = np.random.default_rng(5)
    grid = OccupancyGrid(np.where(rng.random((60, 60)) < 0.01, OCCUPIED, FREE).astype("u1"), 0.1)
    outcomes = []
    for _ in range(40):
        x, y, start = rng.uniform((2, 2, -3), (4, 4, 3))
        arcs = []
        for count in (80, 400):
            angle = start + np.linspace(0, 1.5, count)
            xy = np.column_stack([x + 0.8 * np.cos(angle), y + 0.8 * np.sin(angle)])
            arcs.append(Path(xy, angle + math.pi / 2))
        hits = [LONG.find_first_collision(grid, arc) is None for arc in arcs]
        outcomes.append(hits[0] == hits[1])
    assert np.mean(outcomes) > 0.97


@pytest.mark.parametrize(("headings", "span"), [(8, 1), (16, 1), (16, 2), (32, 3)])
@pytest.mark.parametrize("radius", [0.0, 3.3, 8.0])
def test_primitives_keep_radius_between_cell_centres(headings, span, radius):
    """They end in a heading of the lattice."""
    angles, counts = compute_heading_angles(headings), defaultdict(int)
    for each in make_primitives(headings, radius, False, span):
        poses = np.array(each.poses)
        assert np.allclose(poses[-1, :2], np.round(poses[-1, :2]), atol=1e-9)
        assert math.remainder(poses[-1, 2] - angles[each.target], 2 * math.pi) == pytest.approx(0)
        step, turn = np.hypot(*np.diff(poses[:, :2], axis=0).T), np.abs(np.diff(poses[:, 2]))
        assert (turn * radius <= step * (1 + 1e-3) + 1e-9).all()
        middle = (poses[1:, 2] + poses[:-1, 2]) / 2
        along = np.column_stack([np.cos(middle), np.sin(middle)])
        assert np.allclose(np.diff(poses[:, :2], axis=0), along * step[:, None], atol=1e-6)
        counts[each.source, each.target] += 1
    if span == 1 and headings == 16:
        assert set(counts.values()) == {1}
        assert len(counts) == 3 * headings


def test_lattice_drives_long_robot_through_gap():
    """The gap is narrower than the circle around the outline."""
    wall, gap, room = "#" * 20, "#" * 8 + "...." + "#" * 8, "#" + "." * 18 + "#"
    grid = ascii_map(wall, *[room] * 13, *[gap] * 4, *[room] * 13, wall, resolution=0.1)
    outline = Footprint([(0.5, 0.12), (0.5, -0.12), (-0.5, -0.12), (-0.5, 0.12)])
    costs = Costmap.blank(grid, robot=Robot(footprint=outline, margin=0.0))
    ends = (0.75, 0.65), (1.35, 2.45)
    result = plan(costs, *ends, planner="lattice")
    assert result.status == "solved"
    assert outline.find_first_collision(grid, result.path) is None
    assert np.isinf(Costmap.blank(grid, robot=outline.circumscribed_radius).density[14:18]).all()


def test_narrow_gap_is_infeasible_for_lattice():
    """Without a gap, the goal is unreachable instead."""
    wall, rooms = "########", "#..##..#"
    grid = ascii_map(wall, *[rooms, "#......#", rooms], wall, resolution=0.2)
    outline = Footprint([(0.2, 0.12), (0.2, -0.12), (-0.2, -0.12), (-0.2, 0.12)])
    robot = Robot(footprint=outline, margin=0.0)
    costs = dataclasses.replace(Costmap.blank(grid, robot=0.05), robot=robot)
    result = plan(costs, (0.5, 0.5), (1.1, 0.5), planner="lattice")
    assert result.status == "infeasible"
    assert "16 headings" in result.note
    shut = ascii_map(wall, *[rooms] * 3, wall, resolution=0.2)
    blank = dataclasses.replace(Costmap.blank(shut, robot=0.05), robot=robot)
    ends = (0.5, 0.5, 0.0), (1.1, 0.5, 1.0)
    assert plan(blank, *ends, planner="lattice").status == "unreachable"


def test_lattice_legs_keep_heading_at_waypoints():
    costs = Costmap.blank(OccupancyGrid(np.full((60, 60), FREE), 0.1), robot=Robot(kinematics=CAR))
    via = [(3.0, 1.0), (3.0, 3.0)]
    result = plan(costs, (1.0, 1.0), (1.0, 3.0), planner="lattice", via=via)
    step, turn = np.hypot(*np.diff(result.path.xy, axis=0).T), np.abs(np.diff(result.path.heading))
    assert (turn * CAR.turning_radius <= step * (1 + 1e-3) + 1e-9).all()
    assert all(np.hypot(*(result.path.xy - xy).T).min() < 0.1 for xy in via)


def test_lattice_plan_uses_footprint_argument():
    grid, ends = ascii_map(*["." * 30] * 7, resolution=0.1), [(0.75, 0.35), (2.25, 0.35)]
    cells = grid.cells.copy()
    cells[0, 15] = cells[6, 15] = OCCUPIED
    costs = Costmap.blank(OccupancyGrid(cells, 0.1), robot=0.0)
    for half, status in ((0.2, "solved"), (0.3, "infeasible")):
        outline = [(0.4, half), (0.4, -half), (-0.4, -half), (-0.4, half)]
        assert plan(costs, *ends, planner="lattice", footprint=outline).status == status


def corridor_with_a_dead_end(tolerance: float) -> Costmap:
    """A corridor 0.6 m wide, at whose right end a robot 0.8 m long cannot stand."""
    grid = ascii_map("#" * 40, *["." * 39 + "#"] * 6, "#" * 40, resolution=0.1)
    outline = Footprint([(0.4, 0.2), (0.4, -0.2), (-0.4, -0.2), (-0.4, 0.2)])
    return Costmap.blank(grid, robot=Robot(footprint=outline, goal_tolerance=tolerance))


def test_lattice_stops_within_goal_tolerance():
    """The robot is too long to stand at the goal."""
    start, goal = (0.95, 0.35), (3.62, 0.35)
    result = plan(corridor_with_a_dead_end(0.25), start, goal, planner="lattice")
    assert result.status == "solved"
    assert 0.1 < math.dist(result.path.xy[-1], goal) <= 0.25
    assert "goal tolerance" in result.note
    assert result.note.endswith("into its cell if it keeps the robot's margin of 0.05 m")
    ahead = plan(corridor_with_a_dead_end(0.25), (*start, 0.0), (*goal, 0.0), planner="lattice")
    assert ahead.status == "solved"
    back = plan(corridor_with_a_dead_end(0.25), (*start, 0.0), (*goal, np.pi), planner="lattice")
    assert back.status == "infeasible"  # too narrow to turn
    exact = plan(corridor_with_a_dead_end(0.25), start, (2.0, 0.35), planner="lattice")
    assert math.dist(exact.path.xy[-1], (2.0, 0.35)) < 1e-6
    assert not exact.note
    refused = plan(corridor_with_a_dead_end(0.05), start, goal, planner="lattice")
    assert refused.status == "infeasible"


@pytest.mark.parametrize(
    ("half", "tolerance", "start"), [(0.4, 0.25, (0.95, 1.05)), (1.2, 1.0, (2.05, 0.35, 0.0))]
)
def test_lattice_stops_beside_blocked_goal(half, tolerance, start):
    """At the goal itself, the robot would hit the wall."""
    grid = ascii_map(*["." * 40] * 30, "#" * 40, resolution=0.1)
    outline = Footprint([(half, 0.2), (half, -0.2), (-half, -0.2), (-half, 0.2)])
    sideways = Kinematics(drive="omnidirectional")
    robot = Robot(footprint=outline, margin=0.0, kinematics=sideways, goal_tolerance=tolerance)
    goal = (2.05, 0.45, np.pi / 2)
    result = plan(Costmap.blank(grid, robot=robot), start, goal, planner="lattice")
    assert result.status == "solved"
    assert half - 0.35 <= math.dist(result.path.xy[-1], goal[:2]) <= tolerance
    assert abs(math.remainder(result.path.heading[-1] - goal[2], 2 * math.pi)) <= 0.24


def test_outline_masks_are_reused_unchanged():
    costs, planner = cluttered(0, CAR), Lattice()
    primitives = make_primitives(16, CAR.turning_radius / costs.grid.resolution, False)
    masks = make_outline_masks(costs.grid, LONG, primitives)
    before = masks.copy()
    cells = np.argwhere(np.isfinite(costs.density))[[0, -1]].tolist()
    planner.solve(costs, *(costs.grid.position(*cell) for cell in cells))
    same = OccupancyGrid(costs.grid.cells.copy(), costs.grid.resolution, costs.grid.origin)
    assert make_outline_masks(same, Footprint(LONG.vertices.copy()), primitives) is masks
    assert np.array_equal(masks, before)
    assert make_outline_masks(cluttered(1, CAR).grid, LONG, primitives) is not masks


def test_path_ends_keep_requested_headings():
    """The tolerance is half the largest step between the lattice's headings."""
    costs = Costmap.blank(OccupancyGrid(np.full((60, 60), FREE), 0.1), robot=Robot(kinematics=CAR))
    result = plan(costs, (1.0, 1.0, 0.5), (4.0, 4.0, -2.0), planner="lattice")
    ends = np.array([(1.0, 1.0, 0.5), (4.0, 4.0, -2.0)])
    for pose, asked in zip(result.path.poses[[0, -1]], ends, strict=True):
        assert np.hypot(*(pose - asked)[:2]) <= 0.1
        assert abs(math.remainder(pose[2] - asked[2], 2 * math.pi)) <= 0.24


@pytest.mark.parametrize("kinematics", sample_cases(DRIVES, 2), ids=NAMES)
def test_smoothed_paths_cost_no_more(kinematics):
    """They also keep the turning radius and hit no wall."""
    lower = 0
    for seed in range(6):
        costs, planner = cluttered(seed, kinematics, (30, 40)), Lattice(smooth=False)
        cells = np.random.default_rng(seed).permutation(np.argwhere(np.isfinite(costs.density)))[:2]
        ends = [costs.grid.position(*cell) for cell in cells.tolist()]
        rough = planner.solve(costs, *ends).path
        if rough is None:
            continue
        path = smooth_path(costs, rough)
        before, after = (compute_path_price(costs, one, planner) for one in (rough, path))
        assert after <= before * (1 + 1e-4)
        lower += after < 0.995 * before
        assert LONG.find_first_collision(costs.grid, path) is None
        assert np.isfinite(path_cost(costs, path))
        assert np.allclose(path.xy[[0, -1]], rough.xy[[0, -1]])
        step = np.hypot(*np.diff(path.xy, axis=0).T)
        turn = np.abs([math.remainder(one, 2 * math.pi) for one in np.diff(path.heading)])
        assert (turn * kinematics.turning_radius <= step * (1 + 1e-3) + 1e-6).all()
    assert lower >= 1


def test_lattice_matches_dubins_curves_without_obstacles():
    costs = Costmap.blank(
        OccupancyGrid(np.full((300, 300), FREE), 0.1), robot=Robot(kinematics=FORWARD_08)
    )
    rng, excess = np.random.default_rng(2), []
    for _ in range(6):
        start, goal = [(*rng.uniform(9, 21, 2), rng.uniform(-3, 3)) for _ in range(2)]
        result = plan(costs, start, goal, planner="lattice")
        shortest = Motions(costs, "Dubins", 0.8).cost(start, goal)
        assert np.allclose(result.path.poses[[0, -1]] - [start, goal], 0.0)
        excess.append(result.metrics.cost / shortest - 1)
    assert np.mean(excess) < 0.001


def test_smoothing_rounds_corners_to_turning_radius():
    costs = Costmap.blank(OccupancyGrid(np.full((80, 80), FREE), 0.1), robot=Robot(kinematics=CAR))
    path = smooth_path(costs, Path([(1.0, 1.0), (4.0, 1.0), (4.0, 6.0)]))
    step, turn = np.hypot(*np.diff(path.xy, axis=0).T), np.abs(np.diff(path.heading))
    assert path.heading is not None
    assert (turn * CAR.turning_radius <= step * (1 + 1e-3) + 1e-6).all()


def test_timeout_note_names_lower_bound():
    costs = Costmap.blank(
        OccupancyGrid(np.full((400, 400), FREE), 0.1), robot=Robot(kinematics=CAR)
    )
    result = plan(costs, (1.0, 1.0), (38.0, 38.0), planner="lattice", time_limit=1e-6)
    assert result.status == "timeout"
    assert re.search(r"at least [\d.]+ m$", result.note)
    robot = dataclasses.replace(costs.robot, footprint=LONG, margin=0.05)
    costs = dataclasses.replace(costs, robot=robot)
    result = plan(costs, (1.0, 1.0), (38.0, 38.0), planner="lattice", time_limit=1e-6)
    assert result.note.endswith("m if it keeps the robot's margin of 0.05 m")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"headings": 12}, "headings must be 8, 16 or 32, not 12"),
        ({"span": 0}, "span must be a whole number in 1..4, not 0"),
        ({"reverse": 1.0}, "reverse must be at least 1"),
        ({"turn_cost": 0.0}, "turn_cost must be a positive number"),
        ({"gear_change": -1.0}, "gear_change must be at least 0"),
    ],
)
def test_lattice_rejects_options_out_of_range(options, message):
    with pytest.raises(ConfigError, match=message):
        Lattice(**options).check()


def test_lattice_keeps_margin_if_possible():
    """Otherwise the note warns that the path comes nearer to walls."""
    grid = ascii_map("." * 24, *["." * 24] * 14, "#" * 24, resolution=0.1)
    outline = Footprint([(0.25, 0.15), (0.25, -0.15), (-0.25, -0.15), (-0.25, 0.15)])
    robot = Robot(footprint=outline, margin=0.1, goal_tolerance=0.0)
    costs = Costmap.blank(grid, robot=robot)
    result = plan(costs, (0.5, 0.5), (2.0, 0.5), planner="lattice")
    assert not result.note
    assert check_path(grid, result.path, robot).clearance >= 0.1
    ends = (0.5, 0.37, np.pi / 2), (2.0, 0.37, np.pi / 2)  # its front is 0.02 m off the wall
    tight = plan(costs, *ends, planner="lattice")
    assert tight.note.startswith("comes nearer to walls than the robot's margin of 0.1 m: no path")
    assert check_path(grid, tight.path, robot).drivable


def test_lattice_solves_start_in_goal_cell():
    costs = Costmap.blank(OccupancyGrid(np.full((60, 60), FREE), 0.1), robot=Robot(kinematics=CAR))
    result = plan(costs, (2.02, 3.0), (2.07, 3.0), planner="lattice")
    assert (result.status, result.note) == ("solved", "")
    assert result.path.length < 0.3


def test_lattice_drives_straight_if_radius_huge():
    """Any goal to the side is infeasible."""
    wide = Kinematics(drive="car-like", turning_radius=500.0)
    costs = Costmap.blank(OccupancyGrid(np.full((30, 60), FREE), 0.1), robot=Robot(kinematics=wide))
    ahead = plan(costs, (1.0, 1.0, 0.0), (5.0, 1.0, 0.0), planner="lattice")
    assert ahead.path.length == pytest.approx(4.0)
    across = plan(costs, (1.0, 1.0, 0.0), (5.0, 2.0, 0.0), planner="lattice")
    assert across.status == "infeasible"


PRICES = MotionPrices(reverse=1.6, gear_change=0.15, turn=0.2)


def pack_bits(plane):
    return np.packbits(plane, axis=1, bitorder="little").view(np.uint64)


def unpack_bits(words):
    return np.unpackbits(words.view(np.uint8), axis=1, bitorder="little").astype(bool)


def test_widened_bits_equal_plain_loops():
    plane = np.random.default_rng(0).random((3, 192)) < 0.02
    plane[1, 63:66] = plane[2, 191] = True
    wide = bit_masks.widen_bits(pack_bits(plane))
    for level in range(7):
        assert np.array_equal(unpack_bits(wide[level]), oracles.lattice.widened(plane, level))


@pytest.mark.parametrize("count", [1, 2, 5, 63, 64, 100])
def test_run_masks_equal_plain_loops(count):
    rng = np.random.default_rng(count)
    shape, margin = (4, 100), 64
    plane = np.zeros((shape[0] + 2 * margin, 64 * 3 + 2 * margin), bool)
    plane[margin : margin + shape[0], margin : margin + shape[1]] = rng.random(shape) < 0.02
    ends = rng.integers(-20, 20, 6), rng.integers(1, count + 1, 6)
    runs = np.column_stack([rng.integers(-3, 4, 6), *ends])
    masks = np.zeros((2, shape[0], 2, 3), np.uint64)
    bit_masks.mark_run_collisions(
        masks, bit_masks.widen_bits(pack_bits(plane)), runs, np.array([1, 2]), margin
    )
    expected = oracles.lattice.add_runs(plane[:, : shape[1] + 2 * margin], runs, shape)
    assert np.array_equal(unpack_bits(masks[1, :, :, 2].copy())[:, : shape[1]], expected)
    assert masks.sum(axis=(1, 2)).nonzero()[1].tolist() == [2]


@pytest.mark.parametrize("kinematics", DRIVES, ids=NAMES)
def test_collision_masks_equal_plain_loops(kinematics):
    """The outline must avoid walls, the centre blocked cells."""
    costs = cluttered(5, kinematics, (9, 70))
    ground = LatticeSearch(costs, 16, 1, PRICES).graph.ground
    rows, columns = costs.grid.shape
    radius = kinematics.turning_radius / costs.grid.resolution
    primitives = make_primitives(16, radius, kinematics is SIDEWAYS)
    margin, slots = 20, np.zeros(16, int)
    walls = np.pad(costs.grid.cells == OCCUPIED, margin)
    shut = np.pad(np.isinf(costs.density), margin, constant_values=True)
    for each in primitives[:: max(1, len(primitives) // 16)]:
        slots[each.source] = primitives.index(each) - [p.source for p in primitives].index(
            each.source
        )
        poses = np.array(each.poses) + np.array([0.5, 0.5, 0.0])
        body = np.argwhere(find_swept_cells(LONG.vertices / costs.grid.resolution, poses, 15)) - 15
        centre = find_centre_cells(each)
        bits = unpack_bits(ground.masks[each.source, :, :, slots[each.source]].copy())
        for row, col in itertools.product(range(rows), range(columns)):
            at = np.array([row, col]) + margin
            met = any(walls[tuple(at + cell)] for cell in body)
            met |= any(shut[tuple(at + cell)] for cell in centre)
            assert bits[row, col] == met


SQUARE = Footprint([(0.12, 0.08), (0.12, -0.08), (-0.12, -0.08), (-0.12, 0.08)])


@pytest.mark.parametrize("outline", [SQUARE, LONG])
def test_lattice_bound_equals_plain_projection(outline):
    """Only an outline that differs front to back needs reverse motions."""
    costs = cluttered(20, DRIVES[1], (14, 16))
    costs = dataclasses.replace(costs, robot=dataclasses.replace(costs.robot, footprint=outline))
    search = LatticeSearch(costs, 16, 1, PRICES)
    goal = tuple(np.argwhere(np.isfinite(costs.density))[20].tolist())
    bound = search.compute_bounds([goal[0] * costs.grid.shape[1] + goal[1]], -1).reshape(
        costs.grid.shape
    )
    expected = oracles.lattice.project(search.graph, goal)
    assert np.isfinite(bound).sum() == len(expected) > 30
    assert all(bound[cell] == pytest.approx(cost, rel=1e-5) for cell, cost in expected.items())


@pytest.mark.parametrize("headings", [8, 16])
@pytest.mark.parametrize("kinematics", DRIVES, ids=NAMES)
def test_lattice_searches_equal_plain_dijkstra(kinematics, headings):
    """The bound is searched over cells, the path over states."""
    costs = cluttered(headings, kinematics)
    search = LatticeSearch(costs, headings, 1, PRICES)
    graph = search.graph
    cells = np.random.default_rng(1).permutation(np.argwhere(np.isfinite(costs.density)))[:2]
    start, goal = map(tuple, cells.tolist())
    bound = search.compute_bounds([goal[0] * costs.grid.shape[1] + goal[1]], -1).reshape(
        costs.grid.shape
    )
    projected = np.full(costs.grid.shape, np.inf)
    for cell, cost in oracles.lattice.project(graph, goal).items():
        projected[cell] = cost
    assert np.allclose(bound, projected, rtol=1e-5)
    cap = float(bound[start]) if np.isfinite(bound[start]) else 1.0
    cap *= 1 - lattice.ROUNDING
    terms = graph.terms._replace(cap=cap, goal_headings=(1 << headings) - 1)
    flat, whole = bound.ravel(), graph._replace(terms=terms)
    at = costs.grid.position(*start)
    cost, last, _ = search.explore_costs(at, flat, whole)
    gears = range(terms.gears)
    starts = [(*start, h, g) for h in range(headings) for g in gears]
    reached = oracles.lattice.explore(graph, starts)
    ends = [(*goal, h, g) for h in range(headings) for g in gears]
    least = min(reached.get(end, math.inf) for end in ends)
    assert (last < 0) == math.isinf(least)
    for n in np.flatnonzero(cost < 0).tolist():
        cell, layer = divmod(n, headings * terms.gears)
        gear, heading = divmod(layer, headings)
        state = (*divmod(cell, costs.grid.shape[1]), heading, gear)
        assert -cost[n] - 1 == pytest.approx(reached[state], rel=1e-5, abs=1e-5)
    if last >= 0:
        assert abs(cost[last]) - 1 == pytest.approx(least, rel=1e-5)
        moves = lattice.trace_motions(whole, cost, last)
        cell = moves[0] // (headings * terms.gears)
        assert cell == start[0] * costs.grid.shape[1] + start[1]


def make_drive(kind, turn, sideways=False):
    return smoothing.MotionModel(kind, 1e-4 if turn else 2.5, sideways, 1.7, 0.8, turn)


def make_ground_and_poses(seed, kind, blocked=0.02):
    """Make a density on a bordered grid, for kernels and for plain loops, and poses on it."""
    rng = np.random.default_rng(seed)
    density = rng.uniform(1, 5, (24, 24))
    density[rng.random(density.shape) < blocked] = np.inf
    half = make_bordered_half_density(density, 1)
    poses = np.column_stack([rng.uniform(6, 20, (8, 2)), rng.uniform(-3, 3, 8)])
    free = [math.isfinite(density[int(y) - 1, int(x) - 1]) for x, y, _ in poses]
    ground = motions.MotionCostmap(half[None], 26, 0.0, True)
    return ground, np.pad(density, 1, constant_values=np.inf), poses[free]


@pytest.mark.parametrize("kind", [DUBINS, REEDS_SHEPP])
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_smoothing_costs_equal_fine_integration(kind, turn):
    compared = 0
    for seed in range(3):
        ground, density, poses = make_ground_and_poses(seed, kind)
        drive = make_drive(kind, turn, sideways=seed % 2 == 0)
        length = np.random.default_rng(seed).uniform(-2.5, 3, len(poses))
        to = poses.copy()  # ahead and back, on the spot, and aside by turns
        to[:, 2] += np.where(np.arange(len(to)) % 3 == 0, 0.6, 0.0)
        middle = (poses[:, 2] + to[:, 2]) / 2 + (np.arange(len(to)) % 4 == 3) * 1.2
        away = length * (np.arange(len(to)) % 5 != 0)
        to[:, :2] += away[:, None] * np.column_stack([np.cos(middle), np.sin(middle)])
        for pair in np.stack([poses, to], axis=1):
            own = smoothing.compute_step_costs(ground, drive, pair)
            expected = oracles.curves.own_costs(density, drive, pair)
            assert own == pytest.approx(expected, rel=5e-3)
        ground = ground._replace(corner_cutting=False)
        for start, end in itertools.pairwise(map(tuple, poses.tolist())):
            cost = smoothing.compute_curve_cost(ground, drive, start, end)
            word = motions.find_shortest_word(kind, drive.radius, start, end)
            expected = oracles.curves.curve_cost(density, drive, *word, start)
            if math.isfinite(cost):
                assert cost == pytest.approx(expected, rel=5e-3)
                compared += 1
            else:
                assert math.isinf(expected)
    assert compared > 10


@pytest.mark.parametrize("kind", [DUBINS, REEDS_SHEPP])
def test_chain_and_knots_equal_plain_loops(kind):
    for seed in range(5):
        ground, _, knots = make_ground_and_poses(seed, kind, blocked=0.0)
        ground, drive = ground._replace(corner_cutting=False), make_drive(kind, 0.0)
        walls = np.random.default_rng(seed).random((24, 24)) < 0.01
        body = smoothing.CollisionMap(sum_occupied_along_rows(walls), LONG.vertices * 5)
        own = np.full(len(knots) - 1, 90.0)

        def cost_of(start, end, drive=drive, body=body, ground=ground):
            if not smoothing.is_curve_clear(drive, body, start, end):
                return math.inf
            return smoothing.compute_curve_cost(ground, drive, start, end)

        posed = [tuple(knot) for knot in knots.tolist()]
        chain = smoothing.find_cheapest_chain(ground, drive, body, knots, own, 3)
        total, at = 0.0, len(knots) - 1
        while at > 0:
            before = chain[at] if chain[at] >= 0 else -2 - chain[at]
            total += own[before] if chain[at] < 0 else cost_of(posed[before], posed[at])
            at = before
        expected = oracles.curves.straightest(
            len(knots), lambda i, j, posed=posed, of=cost_of: of(posed[i], posed[j]), own, 3
        )
        assert total == pytest.approx(expected)
        shifted, costs, curved = knots.copy(), own.copy(), np.zeros(len(own), bool)
        smoothing.shift_knots(ground, drive, body, shifted, costs, curved, (0.7, 0.3))
        expected, least = oracles.curves.shift_knots(knots, own, cost_of, (0.7, 0.3))
        assert np.allclose(shifted, expected)
        assert np.allclose(costs, least)


def test_clear_curve_has_no_colliding_pose():
    rng, outcomes = np.random.default_rng(7), set()
    for _ in range(30):
        walls = rng.random((24, 24)) < 0.004
        start, end = ((*rng.uniform(5, 20, 2), rng.uniform(-3, 3)) for _ in range(2))
        drive, body = (
            make_drive(DUBINS, 0.0),
            smoothing.CollisionMap(sum_occupied_along_rows(walls), LONG.vertices * 5),
        )
        clear = smoothing.is_curve_clear(drive, body, start, end)
        poses = motions.sample_motion_poses(DUBINS, drive.radius, start, end) - np.array([1, 1, 0])
        assert clear == (oracles.outlines.find_first_hit(walls, LONG.vertices * 5, poses) < 0)
        outcomes.add(clear)
    assert outcomes == {True, False}


WIDE = Footprint([(0.5, 0.3), (0.5, -0.3), (-0.5, -0.3), (-0.5, 0.3)])
MAP_DRIVES = {
    "on the spot": Kinematics(),
    "car": Kinematics(drive="car-like", turning_radius=0.4),
    "forward": Kinematics(drive="car-like", turning_radius=0.4, reverse=False),
}


def find_reachable_cells(costs: Costmap, starts: list[tuple[int, int]]) -> list[np.ndarray]:
    """Return the cells that motions with 16 headings reach from each start, by plain map shifts.

    The outline must sweep no occupied cell, and the centre must touch no blocked cell.
    """
    shape, robot = costs.grid.shape, costs.robot
    radius = robot.kinematics.turning_radius / costs.grid.resolution
    primitives = make_primitives(16, radius, False)
    farthest = max(np.abs(np.array(each.poses)[:, :2]).max() for each in primitives)
    body = robot.outline.circumscribed_radius / costs.grid.resolution
    reach = math.ceil(farthest + body) + 2
    walls = np.pad(costs.grid.cells == OCCUPIED, reach)
    blocked = np.pad(np.isinf(costs.density), reach, constant_values=True)
    number, sources, targets = np.arange(costs.density.size).reshape(shape), [], []
    for each in primitives:
        corners = robot.outline.vertices / costs.grid.resolution
        poses = np.array(each.poses) + np.array([0.5, 0.5, 0.0])
        met = np.zeros(shape, bool)
        for row, col in np.argwhere(find_swept_cells(corners, poses, reach)):
            met |= walls[row : row + shape[0], col : col + shape[1]]
        for row, col in find_centre_cells(each) + reach:
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
@pytest.mark.parametrize("drive", MAP_DRIVES)
def test_lattice_solves_every_reachable_query(real_maps, drive):
    solved = 0
    for seed, name in enumerate(["fetch_4_26_15", "aws_small_house"]):
        grid = load_map(next((real_maps / name).glob("*.yaml")))
        robot = Robot(footprint=WIDE, margin=0.0, kinematics=MAP_DRIVES[drive], goal_tolerance=0.0)
        blank = Costmap.blank(grid, robot=robot)
        density = 1 + 8 * np.exp(-2 * grid.clearance)
        costs = Costmap.from_density(grid, density, robot=robot)
        free = np.argwhere(np.isfinite(blank.density))
        rng = np.random.default_rng(seed)
        starts, goals = rng.choice(free, (2, 20)).tolist()
        for start, goal, reached in zip(
            starts, goals, find_reachable_cells(costs, starts), strict=True
        ):
            result = plan(costs, *(grid.position(*at) for at in (start, goal)), planner="lattice")
            assert (result.path is not None) == reached[*goal], (name, start, goal, result.note)
            assert result.status in ("solved", "infeasible", "unreachable")
            if result.path is None:
                continue
            solved += 1
            assert check_path(grid, result.path, robot).drivable
            assert WIDE.find_first_collision(grid, result.path) is None
            assert math.isfinite(result.metrics.cost)
    assert solved >= 26
