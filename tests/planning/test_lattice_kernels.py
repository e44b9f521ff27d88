"""The kernels of the lattice planner and of smoothing, beside plain loops."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from planning.test_lattice import DRIVES, LONG, SIDEWAYS, cluttered
from support import oracles as naive

from locplan._support.kernels.outlines import sums_of, swept
from locplan._support.kernels.search import bordered_half
from locplan.maps import OCCUPIED
from locplan.planning.kernels import bit_masks, lattice, motions, smoothing
from locplan.planning.kernels.curves import DUBINS, REEDS_SHEPP
from locplan.planning.lattice_search import LatticeSearch, Prices, centre_cells, primitives
from locplan.robots import Footprint

NAMES = ["on the spot", "car", "forward", "sideways"]
PRICES = Prices(reverse=1.6, gear_change=0.15, turn=0.2)


def packed(plane):
    return np.packbits(plane, axis=1, bitorder="little").view(np.uint64)


def unpacked(words):
    return np.unpackbits(words.view(np.uint8), axis=1, bitorder="little").astype(bool)


def test_widened_bits_are_those_of_plain_loops():
    plane = np.random.default_rng(0).random((3, 192)) < 0.02
    plane[1, 63:66] = plane[2, 191] = True
    wide = bit_masks.widened(packed(plane))
    for level in range(7):
        assert np.array_equal(unpacked(wide[level]), naive.widened(plane, level))


@pytest.mark.parametrize("count", [1, 2, 5, 63, 64, 100])
def test_masks_of_runs_are_those_of_plain_loops(count):
    rng = np.random.default_rng(count)
    shape, margin = (4, 100), 64
    plane = np.zeros((shape[0] + 2 * margin, 64 * 3 + 2 * margin), bool)
    plane[margin : margin + shape[0], margin : margin + shape[1]] = rng.random(shape) < 0.02
    ends = rng.integers(-20, 20, 6), rng.integers(1, count + 1, 6)
    runs = np.column_stack([rng.integers(-3, 4, 6), *ends])
    masks = np.zeros((2, shape[0], 2, 3), np.uint64)
    bit_masks.add_runs(masks, bit_masks.widened(packed(plane)), runs, np.array([1, 2]), margin)
    expected = naive.add_runs(plane[:, : shape[1] + 2 * margin], runs, shape)
    assert np.array_equal(unpacked(masks[1, :, :, 2].copy())[:, : shape[1]], expected)
    assert masks.sum(axis=(1, 2)).nonzero()[1].tolist() == [2]


@pytest.mark.parametrize("kinematics", DRIVES, ids=NAMES)
def test_a_mask_is_set_just_where_the_outline_or_the_centre_meets_something(kinematics):
    costs = cluttered(5, kinematics, (9, 70))
    ground = LatticeSearch(costs, 16, 1, PRICES).graph.ground
    rows, columns = costs.grid.shape
    radius = kinematics.turning_radius / costs.grid.resolution
    found = primitives(16, radius, kinematics is SIDEWAYS)
    margin, slots = 20, np.zeros(16, int)
    walls = np.pad(costs.grid.cells == OCCUPIED, margin)
    shut = np.pad(np.isinf(costs.density), margin, constant_values=True)
    for each in found[:: max(1, len(found) // 16)]:
        slots[each.source] = found.index(each) - [p.source for p in found].index(each.source)
        poses = np.array(each.poses) + np.array([0.5, 0.5, 0.0])
        body = np.argwhere(swept(LONG.vertices / costs.grid.resolution, poses, 15)) - 15
        centre = centre_cells(each)
        bits = unpacked(ground.masks[each.source, :, :, slots[each.source]].copy())
        for row, col in itertools.product(range(rows), range(columns)):
            at = np.array([row, col]) + margin
            met = any(walls[tuple(at + cell)] for cell in body)
            met |= any(shut[tuple(at + cell)] for cell in centre)
            assert bits[row, col] == met


SQUARE = Footprint([(0.12, 0.08), (0.12, -0.08), (-0.12, -0.08), (-0.12, 0.08)])


@pytest.mark.parametrize("outline", [SQUARE, LONG])
def test_the_bound_needs_motions_in_reverse_only_of_robots_that_differ_both_ways(outline):
    costs = cluttered(20, DRIVES[1], (14, 16))
    costs = dataclasses.replace(costs, robot=dataclasses.replace(costs.robot, footprint=outline))
    search = LatticeSearch(costs, 16, 1, PRICES)
    goal = tuple(np.argwhere(np.isfinite(costs.density))[20].tolist())
    bound = search.bound_to([goal[0] * costs.grid.shape[1] + goal[1]], -1).reshape(costs.grid.shape)
    expected = naive.project(search.graph, goal)
    assert np.isfinite(bound).sum() == len(expected) > 30
    assert all(bound[cell] == pytest.approx(cost, rel=1e-5) for cell, cost in expected.items())


@pytest.mark.parametrize("headings", [8, 16])
@pytest.mark.parametrize("kinematics", DRIVES, ids=NAMES)
def test_both_searches_are_those_of_dijkstra_over_all_cells_and_states(kinematics, headings):
    costs = cluttered(headings, kinematics)
    search = LatticeSearch(costs, headings, 1, PRICES)
    graph = search.graph
    cells = np.random.default_rng(1).permutation(np.argwhere(np.isfinite(costs.density)))[:2]
    start, goal = map(tuple, cells.tolist())
    bound = search.bound_to([goal[0] * costs.grid.shape[1] + goal[1]], -1).reshape(costs.grid.shape)
    projected = np.full(costs.grid.shape, np.inf)
    for cell, cost in naive.project(graph, goal).items():
        projected[cell] = cost
    assert np.allclose(bound, projected, rtol=1e-5)
    cap = float(bound[start]) if np.isfinite(bound[start]) else 1.0
    cap *= 1 - lattice.ROUNDING
    terms = graph.terms._replace(cap=cap, goal_headings=(1 << headings) - 1)
    flat, whole = bound.ravel(), graph._replace(terms=terms)
    at = costs.grid.position(*start)
    cost, last, _ = search.costs_from(at, flat, whole)
    gears = range(terms.gears)
    starts = [(*start, h, g) for h in range(headings) for g in gears]
    reached = naive.explore(graph, starts)
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
        moves = lattice.traced(whole, cost, last)
        cell = moves[0] // (headings * terms.gears)
        assert cell == start[0] * costs.grid.shape[1] + start[1]


def made_drive(kind, turn, sideways=False):
    return smoothing.Drive(kind, 1e-4 if turn else 2.5, sideways, 1.7, 0.8, turn)


def ground_and_poses(seed, kind, blocked=0.02):
    """A density on a bordered grid, as the kernels and the loops take it, and poses on it."""
    rng = np.random.default_rng(seed)
    density = rng.uniform(1, 5, (24, 24))
    density[rng.random(density.shape) < blocked] = np.inf
    half = bordered_half(density, 1)
    poses = np.column_stack([rng.uniform(6, 20, (8, 2)), rng.uniform(-3, 3, 8)])
    free = [math.isfinite(density[int(y) - 1, int(x) - 1]) for x, y, _ in poses]
    ground = motions.Ground(half[None], 26, 0.0, True)
    return ground, np.pad(density, 1, constant_values=np.inf), poses[free]


@pytest.mark.parametrize("kind", [DUBINS, REEDS_SHEPP])
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_costs_of_own_lines_and_of_curves_are_those_of_tiny_steps(kind, turn):
    compared = 0
    for seed in range(4):
        ground, density, poses = ground_and_poses(seed, kind)
        drive = made_drive(kind, turn, sideways=seed % 2 == 0)
        length = np.random.default_rng(seed).uniform(-2.5, 3, len(poses))
        to = poses.copy()  # ahead and back, on the spot, and aside by turns
        to[:, 2] += np.where(np.arange(len(to)) % 3 == 0, 0.6, 0.0)
        middle = (poses[:, 2] + to[:, 2]) / 2 + (np.arange(len(to)) % 4 == 3) * 1.2
        away = length * (np.arange(len(to)) % 5 != 0)
        to[:, :2] += away[:, None] * np.column_stack([np.cos(middle), np.sin(middle)])
        for pair in np.stack([poses, to], axis=1):
            own = smoothing.own_costs(ground, drive, pair)
            expected = naive.own_costs(density, drive, pair)
            assert own == pytest.approx(expected, rel=5e-3)
        ground = ground._replace(corner_cutting=False)
        for start, end in itertools.pairwise(map(tuple, poses.tolist())):
            cost = smoothing.curve_cost(ground, drive, start, end)
            word = motions.word_of(kind, drive.radius, start, end)
            expected = naive.curve_cost(density, drive, *word, start)
            if math.isfinite(cost):  # the kernel also refuses what touches a corner
                assert cost == pytest.approx(expected, rel=5e-3)
                compared += 1
            else:
                assert math.isinf(naive.curve_cost(density, drive, *word, start)) or turn
    assert compared > 10


@pytest.mark.parametrize("kind", [DUBINS, REEDS_SHEPP])
def test_the_straightest_chain_and_shifted_knots_are_those_of_plain_loops(kind):
    for seed in range(5):
        ground, _, knots = ground_and_poses(seed, kind, blocked=0.0)
        ground, drive = ground._replace(corner_cutting=False), made_drive(kind, 0.0)
        walls = np.random.default_rng(seed).random((24, 24)) < 0.01
        body = smoothing.Body(sums_of(walls), LONG.vertices * 5)
        own = np.full(len(knots) - 1, 90.0)

        def cost_of(start, end, drive=drive, body=body, ground=ground):
            if not smoothing.is_clear(drive, body, start, end):
                return math.inf
            return smoothing.curve_cost(ground, drive, start, end)

        posed = [tuple(knot) for knot in knots.tolist()]
        chain = smoothing.straightest(ground, drive, body, knots, own, 3)
        total, at = 0.0, len(knots) - 1
        while at > 0:
            before = chain[at] if chain[at] >= 0 else -2 - chain[at]
            total += own[before] if chain[at] < 0 else cost_of(posed[before], posed[at])
            at = before
        expected = naive.straightest(
            len(knots), lambda i, j, posed=posed, of=cost_of: of(posed[i], posed[j]), own, 3
        )
        assert total == pytest.approx(expected)
        shifted, costs, curved = knots.copy(), own.copy(), np.zeros(len(own), bool)
        smoothing.shift_knots(ground, drive, body, shifted, costs, curved, (0.7, 0.3))
        expected, least = naive.shift_knots(knots, own, cost_of, (0.7, 0.3))
        assert np.allclose(shifted, expected)
        assert np.allclose(costs, least)


def test_a_curve_is_clear_where_no_pose_along_it_meets_a_wall():
    rng, outcomes = np.random.default_rng(7), set()
    for _ in range(30):
        walls = rng.random((24, 24)) < 0.004
        start, end = ((*rng.uniform(5, 20, 2), rng.uniform(-3, 3)) for _ in range(2))
        drive, body = made_drive(DUBINS, 0.0), smoothing.Body(sums_of(walls), LONG.vertices * 5)
        clear = smoothing.is_clear(drive, body, start, end)
        poses = motions.motion_poses(DUBINS, drive.radius, start, end) - np.array([1, 1, 0])
        assert clear == (naive.first_hit(walls, LONG.vertices * 5, poses) < 0)
        outcomes.add(clear)
    assert outcomes == {True, False}
