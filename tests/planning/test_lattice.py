"""The lattice planner: exact over its motions, with the outline, the radius and the drive."""

import dataclasses
import itertools
import math
import re
from collections import defaultdict

import numpy as np
import pytest
from conftest import drawn, few_of
from support import oracles as naive

from locplan._support.kernels.outlines import first_hit, sums_of, swept
from locplan._support.kernels.rays import segment_cost
from locplan._support.kernels.search import bordered_half
from locplan.errors import ConfigError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.planning import Costmap, Path, check_path, path_cost, plan
from locplan.planning.lattice import Lattice
from locplan.planning.lattice_search import (
    LatticeSearch,
    Prices,
    angles_of,
    outline_masks,
    primitives,
)
from locplan.planning.ompl.motions import Motions
from locplan.planning.smoothing import smoothed
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


def states_and_edges(costs: Costmap, planner: Lattice) -> dict:
    """All motions of the lattice by brute force: {(row, col, heading, gear): [(state, cost)]}."""
    grid, kinematics = costs.grid, costs.robot.kinematics
    radius = kinematics.turning_radius / grid.resolution
    half = bordered_half(costs.density, 1)
    edges = defaultdict(list)
    found = primitives(planner.headings, radius, kinematics is SIDEWAYS, planner.span)
    for each, row, col in itertools.product(found, *map(range, grid.shape)):
        local = np.array(each.poses) + np.array([col + 0.5, row + 0.5, 0.0])
        at = local[:, :2] + 1
        touching = (
            segment_cost(half, grid.shape[1] + 2, *a[::-1], *b[::-1], False)
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
        if LONG.first_collision(grid, path) is not None:
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


@pytest.mark.parametrize("kinematics", few_of(DRIVES), ids=NAMES)
@pytest.mark.parametrize("seed", few_of([1, 0]))
def test_no_motions_of_the_lattice_lead_to_the_goal_at_less_cost(kinematics, seed):
    costs = cluttered(seed, kinematics)
    planner = Lattice(
        headings=8 if seed else 16, reverse=1.7, gear_change=0.2, turn_cost=0.15, smooth=False
    )
    edges = states_and_edges(costs, planner)
    rng = np.random.default_rng(seed)
    cells = rng.permutation(np.argwhere(np.isfinite(costs.density)))[:6]
    outcomes = set()
    for start, goal in itertools.permutations(map(tuple, cells.tolist()), 2):
        ends = [costs.grid.position(*cell) for cell in (start, goal)]
        starts = [(*start, h, g) for h in range(planner.headings) for g in (0, 1)]
        reached = naive.costs_between_states(edges, starts)
        least = min(
            (cost for state, cost in reached.items() if state[:2] == goal), default=math.inf
        )
        found = planner.solve(costs, *ends)
        outcomes.add(found.status)
        assert (found.path is None) == (least == math.inf)
        if found.path is None:
            assert found.status in ("infeasible", "unreachable")
            continue
        assert cost_of(costs, found.path, planner) == pytest.approx(least, rel=1e-6)
        assert LONG.first_collision(costs.grid, found.path) is None
        for pose, cell in zip(found.path.xy[[0, -1]], (start, goal), strict=True):
            assert costs.grid.cell(pose) == cell
    assert "solved" in outcomes


def cost_of(costs: Costmap, path: Path, planner: Lattice) -> float:
    """What a path costs with the prices of the planner [m]."""
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


@pytest.mark.parametrize("kinematics", few_of(DRIVES, 2), ids=NAMES)
def test_the_bound_is_below_the_cost_everywhere(kinematics):
    costs = cluttered(3, kinematics)
    planner = Lattice(turn_cost=0.2, gear_change=0.1, reverse=1.3)
    backward = defaultdict(list)
    for state, steps in states_and_edges(costs, planner).items():
        for other, cost in steps:
            backward[other].append((state, cost))
    goal = tuple(np.argwhere(np.isfinite(costs.density))[20].tolist())
    ends = [(*goal, h, g) for h in range(16) for g in (0, 1)]
    reached = naive.costs_between_states(backward, ends)
    prices = Prices(planner.reverse, planner.gear_change, planner.turn_cost)
    search = LatticeSearch(costs, planner.headings, planner.span, prices)
    target = goal[0] * costs.grid.shape[1] + goal[1]
    bound = search.bound_to([target], -1).reshape(costs.grid.shape) * costs.grid.resolution
    of_cell = np.full(costs.grid.shape, np.inf)
    for (row, col, *_), cost in reached.items():
        of_cell[row, col] = min(of_cell[row, col], cost)
    assert (bound <= of_cell * (1 + 1e-6)).all()
    assert np.isfinite(of_cell).sum() > 10
    assert (bound[np.isfinite(of_cell)] > 0.5 * of_cell[np.isfinite(of_cell)]).mean() > 0.5


def test_swept_cells_are_those_of_plain_loops():
    rng = np.random.default_rng(4)
    for _ in range(5):
        outline = Footprint(rng.normal(size=(3, 2)) / 2 + np.array([(3, 0), (-2, 2), (-2, -2)]))
        poses = rng.uniform(-1, 1, (3, 3))
        reach = 6
        met = swept(outline.vertices, poses, reach)
        assert np.array_equal(met, naive.swept(outline.vertices, poses, reach))
        occupied = rng.random((20, 22)) < 0.01
        poses[:, :2] += 9
        hit = first_hit(sums_of(occupied), outline.vertices, poses)
        assert hit == naive.first_hit(occupied, outline.vertices, poses)


def test_a_collision_does_not_depend_on_how_dense_the_poses_are():
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
        hits = [LONG.first_collision(grid, arc) is None for arc in arcs]
        outcomes.append(hits[0] == hits[1])
    assert np.mean(outcomes) > 0.97


@pytest.mark.parametrize(("headings", "span"), [(8, 1), (16, 1), (16, 2), (32, 3)])
@pytest.mark.parametrize("radius", [0.0, 3.3, 8.0])
def test_turns_keep_the_radius_and_end_on_centres_in_their_heading(headings, span, radius):
    angles, counts = angles_of(headings), defaultdict(int)
    for each in primitives(headings, radius, False, span):
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


def test_a_long_robot_passes_where_only_its_length_fits():
    wall, gap, room = "#" * 20, "#" * 8 + "...." + "#" * 8, "#" + "." * 18 + "#"
    grid = drawn(wall, *[room] * 13, *[gap] * 4, *[room] * 13, wall, resolution=0.1)
    outline = Footprint([(0.5, 0.12), (0.5, -0.12), (-0.5, -0.12), (-0.5, 0.12)])
    costs = Costmap.blank(grid, robot=Robot(footprint=outline, margin=0.0))
    ends = (0.75, 0.65), (1.35, 2.45)
    made = plan(costs, *ends, planner="lattice")
    assert made.status == "solved"
    assert outline.first_collision(grid, made.path) is None
    assert np.isinf(Costmap.blank(grid, robot=outline.circumscribed_radius).density[14:18]).all()


def test_a_gap_that_no_heading_passes_makes_it_infeasible_not_unreachable():
    wall, rooms = "########", "#..##..#"
    grid = drawn(wall, *[rooms, "#......#", rooms], wall, resolution=0.2)
    outline = Footprint([(0.2, 0.12), (0.2, -0.12), (-0.2, -0.12), (-0.2, 0.12)])
    robot = Robot(footprint=outline, margin=0.0)
    costs = dataclasses.replace(Costmap.blank(grid, robot=0.05), robot=robot)
    made = plan(costs, (0.5, 0.5), (1.1, 0.5), planner="lattice")
    assert made.status == "infeasible"
    assert "16 headings" in made.note
    shut = drawn(wall, *[rooms] * 3, wall, resolution=0.2)
    blank = dataclasses.replace(Costmap.blank(shut, robot=0.05), robot=robot)
    ends = (0.5, 0.5, 0.0), (1.1, 0.5, 1.0)
    assert plan(blank, *ends, planner="lattice").status == "unreachable"


def test_legs_over_waypoints_go_on_in_the_heading_in_which_they_come():
    costs = Costmap.blank(OccupancyGrid(np.full((60, 60), FREE), 0.1), robot=Robot(kinematics=CAR))
    via = [(3.0, 1.0), (3.0, 3.0)]
    made = plan(costs, (1.0, 1.0), (1.0, 3.0), planner="lattice", via=via)
    step, turn = np.hypot(*np.diff(made.path.xy, axis=0).T), np.abs(np.diff(made.path.heading))
    assert (turn * CAR.turning_radius <= step * (1 + 1e-3) + 1e-9).all()
    assert all(np.hypot(*(made.path.xy - xy).T).min() < 0.1 for xy in via)


def test_a_footprint_of_the_query_counts_for_the_lattice():
    grid, ends = drawn(*["." * 30] * 7, resolution=0.1), [(0.75, 0.35), (2.25, 0.35)]
    cells = grid.cells.copy()
    cells[0, 15] = cells[6, 15] = OCCUPIED
    costs = Costmap.blank(OccupancyGrid(cells, 0.1), robot=0.0)
    for half, status in ((0.2, "solved"), (0.3, "infeasible")):
        outline = [(0.4, half), (0.4, -half), (-0.4, -half), (-0.4, half)]
        assert plan(costs, *ends, planner="lattice", footprint=outline).status == status


def corridor_with_a_dead_end(tolerance: float) -> Costmap:
    """A corridor 0.6 m wide, at whose right end a robot 0.8 m long cannot stand."""
    grid = drawn("#" * 40, *["." * 39 + "#"] * 6, "#" * 40, resolution=0.1)
    outline = Footprint([(0.4, 0.2), (0.4, -0.2), (-0.4, -0.2), (-0.4, 0.2)])
    return Costmap.blank(grid, robot=Robot(footprint=outline, goal_tolerance=tolerance))


def test_where_the_goal_cannot_be_reached_the_path_ends_within_the_goal_tolerance():
    start, goal = (0.95, 0.35), (3.62, 0.35)
    made = plan(corridor_with_a_dead_end(0.25), start, goal, planner="lattice")
    assert made.status == "solved"
    assert 0.1 < math.dist(made.path.xy[-1], goal) <= 0.25
    assert "goal tolerance" in made.note
    assert made.note.endswith("into its cell if it keeps the robot's margin of 0.05 m")
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
def test_a_robot_that_cannot_stand_across_at_the_goal_does_so_beside_it(half, tolerance, start):
    grid = drawn(*["." * 40] * 30, "#" * 40, resolution=0.1)
    outline = Footprint([(half, 0.2), (half, -0.2), (-half, -0.2), (-half, 0.2)])
    sideways = Kinematics(drive="omnidirectional")
    robot = Robot(footprint=outline, margin=0.0, kinematics=sideways, goal_tolerance=tolerance)
    goal = (2.05, 0.45, np.pi / 2)
    made = plan(Costmap.blank(grid, robot=robot), start, goal, planner="lattice")
    assert made.status == "solved"
    assert half - 0.35 <= math.dist(made.path.xy[-1], goal[:2]) <= tolerance


def test_masks_are_kept_for_the_next_query_and_stay_as_they_are():
    costs, planner = cluttered(0, CAR), Lattice()
    found = primitives(16, CAR.turning_radius / costs.grid.resolution, False)
    masks = outline_masks(costs.grid, LONG, found)
    before = masks.copy()
    cells = np.argwhere(np.isfinite(costs.density))[[0, -1]].tolist()
    planner.solve(costs, *(costs.grid.position(*cell) for cell in cells))
    same = OccupancyGrid(costs.grid.cells.copy(), costs.grid.resolution, costs.grid.origin)
    assert outline_masks(same, Footprint(LONG.vertices.copy()), found) is masks
    assert np.array_equal(masks, before)
    assert outline_masks(cluttered(1, CAR).grid, LONG, found) is not masks


def test_ends_keep_their_headings_within_the_lattices():
    costs = Costmap.blank(OccupancyGrid(np.full((60, 60), FREE), 0.1), robot=Robot(kinematics=CAR))
    made = plan(costs, (1.0, 1.0, 0.5), (4.0, 4.0, -2.0), planner="lattice")
    ends = np.array([(1.0, 1.0, 0.5), (4.0, 4.0, -2.0)])
    for pose, asked in zip(made.path.poses[[0, -1]], ends, strict=True):
        assert np.hypot(*(pose - asked)[:2]) <= 0.1
        assert abs(math.remainder(pose[2] - asked[2], 2 * math.pi)) <= 0.24


@pytest.mark.parametrize("kinematics", few_of(DRIVES, 2), ids=NAMES)
def test_smoothed_paths_cost_no_more_keep_the_radius_and_meet_no_wall(kinematics):
    lower = 0
    for seed in range(6):
        costs, planner = cluttered(seed, kinematics, (30, 40)), Lattice(smooth=False)
        cells = np.random.default_rng(seed).permutation(np.argwhere(np.isfinite(costs.density)))[:2]
        ends = [costs.grid.position(*cell) for cell in cells.tolist()]
        rough = planner.solve(costs, *ends).path
        if rough is None:
            continue
        path = smoothed(costs, rough)
        before, after = (cost_of(costs, one, planner) for one in (rough, path))
        assert after <= before * (1 + 1e-4)
        lower += after < 0.995 * before
        assert LONG.first_collision(costs.grid, path) is None
        assert np.isfinite(path_cost(costs, path))
        assert np.allclose(path.xy[[0, -1]], rough.xy[[0, -1]])
        step = np.hypot(*np.diff(path.xy, axis=0).T)
        turn = np.abs([math.remainder(one, 2 * math.pi) for one in np.diff(path.heading)])
        assert (turn * kinematics.turning_radius <= step * (1 + 1e-3) + 1e-6).all()
    assert lower >= 1


def test_in_free_space_it_is_as_short_as_dubins_curves():
    costs = Costmap.blank(
        OccupancyGrid(np.full((300, 300), FREE), 0.1), robot=Robot(kinematics=FORWARD_08)
    )
    rng, excess = np.random.default_rng(2), []
    for _ in range(6):
        start, goal = [(*rng.uniform(9, 21, 2), rng.uniform(-3, 3)) for _ in range(2)]
        made = plan(costs, start, goal, planner="lattice")
        shortest = Motions(costs, "Dubins", 0.8).cost(start, goal)
        assert np.allclose(made.path.poses[[0, -1]] - [start, goal], 0.0)
        excess.append(made.metrics.cost / shortest - 1)
    assert np.mean(excess) < 0.001


def test_a_path_that_the_robot_cannot_drive_is_smoothed_to_one_that_it_can():
    costs = Costmap.blank(OccupancyGrid(np.full((80, 80), FREE), 0.1), robot=Robot(kinematics=CAR))
    path = smoothed(costs, Path([(1.0, 1.0), (4.0, 1.0), (4.0, 6.0)]))
    step, turn = np.hypot(*np.diff(path.xy, axis=0).T), np.abs(np.diff(path.heading))
    assert path.heading is not None
    assert (turn * CAR.turning_radius <= step * (1 + 1e-3) + 1e-6).all()


def test_a_search_out_of_time_says_how_far_it_came():
    costs = Costmap.blank(
        OccupancyGrid(np.full((400, 400), FREE), 0.1), robot=Robot(kinematics=CAR)
    )
    made = plan(costs, (1.0, 1.0), (38.0, 38.0), planner="lattice", time_limit=1e-6)
    assert made.status == "timeout"
    assert re.search(r"at least [\d.]+ m$", made.note)
    robot = dataclasses.replace(costs.robot, footprint=LONG, margin=0.05)
    costs = dataclasses.replace(costs, robot=robot)
    made = plan(costs, (1.0, 1.0), (38.0, 38.0), planner="lattice", time_limit=1e-6)
    assert made.note.endswith("m if it keeps the robot's margin of 0.05 m")


@pytest.mark.parametrize(
    "options",
    [{"headings": 12}, {"span": 0}, {"reverse": 1.0}, {"turn_cost": 0.0}, {"gear_change": -1.0}],
)
def test_options_out_of_their_range_are_refused(options):
    with pytest.raises(ConfigError):
        Lattice(**options).check()


def test_the_outline_keeps_the_margin_where_it_can_and_else_says_that_it_does_not():
    grid = drawn("." * 24, *["." * 24] * 14, "#" * 24, resolution=0.1)
    outline = Footprint([(0.25, 0.15), (0.25, -0.15), (-0.25, -0.15), (-0.25, 0.15)])
    robot = Robot(footprint=outline, margin=0.1, goal_tolerance=0.0)
    costs = Costmap.blank(grid, robot=robot)
    made = plan(costs, (0.5, 0.5), (2.0, 0.5), planner="lattice")
    assert not made.note
    assert check_path(grid, made.path, robot).clearance >= 0.1
    ends = (0.5, 0.37, np.pi / 2), (2.0, 0.37, np.pi / 2)  # its front is 0.02 m off the wall
    tight = plan(costs, *ends, planner="lattice")
    assert tight.note.startswith("comes nearer to walls than the robot's margin of 0.1 m: no path")
    assert check_path(grid, tight.path, robot).drivable


def test_a_start_in_the_goals_cell_is_at_the_goal():
    costs = Costmap.blank(OccupancyGrid(np.full((60, 60), FREE), 0.1), robot=Robot(kinematics=CAR))
    made = plan(costs, (2.02, 3.0), (2.07, 3.0), planner="lattice")
    assert (made.status, made.note) == ("solved", "")
    assert made.path.length < 0.3


def test_a_turning_radius_beyond_the_map_leaves_only_the_way_ahead():
    wide = Kinematics(drive="car-like", turning_radius=500.0)
    costs = Costmap.blank(OccupancyGrid(np.full((30, 60), FREE), 0.1), robot=Robot(kinematics=wide))
    ahead = plan(costs, (1.0, 1.0, 0.0), (5.0, 1.0, 0.0), planner="lattice")
    assert ahead.path.length == pytest.approx(4.0)
    across = plan(costs, (1.0, 1.0, 0.0), (5.0, 2.0, 0.0), planner="lattice")
    assert across.status == "infeasible"
