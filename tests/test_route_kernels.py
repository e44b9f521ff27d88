"""The kernels of route graphs against plain loops."""

from __future__ import annotations

import math

import naive
import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from locplan._kernels import route as kernels
from locplan._kernels.search import bordered_half
from locplan.maps import FREE, OCCUPIED, OccupancyGrid

SHAPES = [(1, 1), (1, 9), (9, 1), (2, 2), (6, 8), (9, 7), (10, 10)]
WORLDS = [(1.0, (0.0, 0.0, 0.0)), (0.05, (-3.0, 7.0, 0.7)), (0.1, (5.0, -2.0, -2.5))]


def space_from(shape, seed, *, blocked=0.3):
    """Free cells (H, W), often in several pieces, of which at least one is free."""
    rng = np.random.default_rng(seed)
    inside = rng.random(shape) >= blocked
    inside[tuple(rng.integers(0, shape))] = True
    return inside


def flat(cells, shape):
    """Indices into the bordered grid of (row, col) in the grid itself."""
    rows, cols = np.array(cells, np.int64).reshape(-1, 2).T + 1
    return rows * (shape[1] + 2) + cols


def unflat(cells, shape):
    rows, cols = np.divmod(np.asarray(cells), shape[1] + 2)
    return list(zip((rows - 1).tolist(), (cols - 1).tolist(), strict=True))


def shuffled_cells(inside, seed):
    cells = [tuple(cell) for cell in np.argwhere(inside).tolist()]
    return [cells[n] for n in np.random.default_rng(seed).permutation(len(cells))]


def density_from(shape, seed, *, blocked=0.1):
    rng = np.random.default_rng(seed)
    density = rng.uniform(1.0, 9.0, shape)
    density[~space_from(shape, seed, blocked=blocked)] = np.inf
    return density


def space_of(density, resolution, origin):
    """What the kernels take first: half the density, columns and frame."""
    x, y, yaw = origin
    frame = math.cos(yaw) / resolution, math.sin(yaw) / resolution, x, y
    return bordered_half(density, 1), density.shape[1] + 2, frame


def to_world(cells, resolution, origin):
    """Positions (x, y) in the world of continuous (row, col)."""
    x, y, yaw = origin
    rows, cols = np.reshape(cells, (-1, 2)).T * resolution
    return np.column_stack(
        [
            x + math.cos(yaw) * cols - math.sin(yaw) * rows,
            y + math.sin(yaw) * cols + math.cos(yaw) * rows,
        ]
    )


def symmetric(pairs, values, count):
    """Compressed rows with each pair both ways."""
    ends = np.vstack([pairs, pairs[:, ::-1]]).T
    return csr_array((np.tile(values, 2), tuple(ends)), shape=(count, count))


def random_pairs(count, share, rng):
    """Distinct pairs (m, 2) of so many nodes, the lower one first."""
    return np.argwhere(np.triu(rng.random((count, count)) < share, 1))


@pytest.mark.parametrize("reach", [0.5, 1.0, 1.5, 3.0, 4.7, 100.0])
@pytest.mark.parametrize("shape", SHAPES)
def test_spread_takes_what_the_plain_floods_leave(shape, reach):
    for seed in range(2):
        inside = space_from(shape, seed)
        cells = shuffled_cells(inside, seed)
        nodes = kernels.cover(
            np.pad(inside, 1).reshape(-1), shape[1] + 2, flat(cells, shape), reach
        )
        assert unflat(nodes, shape) == naive.cover(inside, cells, reach)


def test_spread_within_reach_of_all_takes_one_cell_in_each_piece():
    inside = np.ones((5, 7), bool)
    inside[:, 3] = False
    cells = shuffled_cells(inside, 0)
    nodes = kernels.cover(np.pad(inside, 1).reshape(-1), 9, flat(cells, inside.shape), 99.0)
    assert len(nodes) == 2


def test_spread_does_not_join_across_a_wall_or_a_corner():
    inside = np.array([[True, False], [False, True]])
    cells = flat([(0, 0), (1, 1)], inside.shape)
    nodes = kernels.cover(np.pad(inside, 1).reshape(-1), 4, cells, 9.0)
    np.testing.assert_array_equal(nodes, cells)


def test_spread_over_nothing_takes_nothing():
    assert len(kernels.cover(np.zeros(9, bool), 3, np.empty(0, np.int64), 2.0)) == 0


@pytest.mark.parametrize("blocked", [0.0, 0.3])
@pytest.mark.parametrize("shape", SHAPES)
def test_owners_are_among_the_nodes_that_come_first(shape, blocked):
    for seed in range(3):
        inside = space_from(shape, seed, blocked=blocked)
        nodes = shuffled_cells(inside, seed)[: 1 + 3 * seed]
        owner = kernels.owners(
            np.pad(inside, 1).reshape(-1), shape[1] + 2, flat(nodes, shape)
        ).reshape(shape[0] + 2, shape[1] + 2)
        for cell, first in naive.owners(inside, nodes).items():
            assert owner[cell[0] + 1, cell[1] + 1] in (first or {-1})
        bordered = owner.copy()
        bordered[1:-1, 1:-1] = -1
        assert (bordered == -1).all()


def test_without_nodes_no_cell_is_owned():
    inside = np.pad(np.ones((3, 3), bool), 1).reshape(-1)
    assert (kernels.owners(inside, 5, np.empty(0, np.int64)) == -1).all()


@pytest.mark.parametrize(("resolution", "origin"), WORLDS)
@pytest.mark.parametrize("shape", SHAPES)
def test_lines_cost_their_exact_integral_or_are_blocked(shape, resolution, origin):
    for seed in range(2):
        rng = np.random.default_rng(seed)
        density = density_from(shape, seed)
        ends = rng.uniform(0, 1, (15, 2)) * shape
        ends[::2] = np.floor(ends[::2]) + 0.5  # from centre to centre, often over corners
        xy = to_world(ends, resolution, origin)
        pairs = np.array([(i, j) for i in range(15) for j in range(15) if i != j])
        pairs = pairs[np.hypot(*(ends[pairs[:, 0]] - ends[pairs[:, 1]]).T) > 0]
        costs = kernels.line_costs(*space_of(density, resolution, origin), xy, pairs)
        expected = naive.line_costs(density, resolution, origin, xy, pairs)
        np.testing.assert_allclose(costs, expected, rtol=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("reach", [0, 1, 3, 20])
def test_clearances_are_those_to_the_nearest_edge_within_reach(shape, reach):
    occupied = ~space_from(shape, 11, blocked=0.06)
    rows, cols = (each.ravel() for each in np.indices(shape))
    found = kernels.clearances(occupied, rows, cols, reach)
    np.testing.assert_allclose(found, naive.clearances(occupied, rows, cols, reach), rtol=1e-12)
    if reach == 20:
        cells = np.where(occupied, OCCUPIED, FREE).astype(np.uint8)
        clearance = OccupancyGrid(cells, 0.05).clearance.ravel()
        np.testing.assert_array_equal(found * 0.05, clearance)


def test_a_wall_straight_ahead_may_be_nearer_than_one_aslant_in_a_nearer_ring():
    occupied = np.zeros((20, 20), bool)
    occupied[5, 5] = occupied[10, 16] = True
    at = np.array([10])
    assert kernels.clearances(occupied, at, at, 20).tolist() == [5.5]
    assert kernels.clearances(occupied, at, at, 5).tolist() == [math.hypot(4.5, 4.5)]


def test_lines_cost_the_same_both_ways_and_one_by_one():
    space = space_of(density_from((9, 9), 1), *WORLDS[1])
    xy = to_world(np.random.default_rng(1).uniform(0, 9, (30, 2)), *WORLDS[1])
    pairs = random_pairs(30, 1.0, np.random.default_rng(2))
    costs = kernels.line_costs(*space, xy, pairs)
    np.testing.assert_array_equal(costs, kernels.line_costs(*space, xy, pairs[:, ::-1].copy()))
    np.testing.assert_array_equal(
        costs, [kernels.line_cost(*space, xy[i], xy[j]) for i, j in pairs]
    )
    assert 0 < np.isinf(costs).sum() < len(costs)
    assert kernels.line_costs(*space, xy, pairs[:0]).shape == (0,)


@pytest.mark.parametrize("start", [(-0.5, 2.0), (2.0, -7.5), (4.2, 2.0), (2.0, 900.0)])
def test_a_line_from_outside_the_grid_is_blocked(start):
    space = space_of(np.ones((4, 6)), *WORLDS[0])
    xy = to_world([start, (1.5, 1.5)], *WORLDS[0])
    assert kernels.line_cost(*space, xy[0], xy[1]) == np.inf


@pytest.mark.parametrize("levels", [1, 3, 1000])
@pytest.mark.parametrize("share", [0.0, 0.08, 0.3, 1.0])
def test_usage_counts_the_routes_one_by_one(share, levels):
    for seed, count in enumerate((1, 2, 3, 8, 15, 20)):
        rng = np.random.default_rng(seed)
        pairs = random_pairs(count, share, rng)
        graph = symmetric(pairs, rng.integers(1, 1 + levels, len(pairs)).astype(float), count)
        starts = np.unique(rng.integers(0, count, 5))
        away, before = dijkstra(graph, indices=starts, return_predecessors=True)
        order = np.argsort(away, kind="stable")
        use = kernels.usage(order, before, graph.indptr, graph.indices)
        expected = naive.usage(starts, before, graph.indptr, graph.indices)
        np.testing.assert_array_equal(use, expected)


def test_usage_of_a_chain_from_its_end():
    graph = symmetric(np.array([[0, 1], [1, 2]]), np.ones(2), 3)
    use = kernels.usage(
        np.array([[0, 1, 2]]), np.array([[-9999, 0, 1]], np.int32), graph.indptr, graph.indices
    )
    # Of the routes from 0 to 1 and to 2, which count at no end, only the second passes a node.
    assert use.tolist() == [0.0, 1.0, 1.0, 0.0]


def random_graph(density, resolution, origin, seed):
    """Free positions as in single precision, free edges between them, and how they are used."""
    rng = np.random.default_rng(seed)
    cells = rng.permutation(np.argwhere(np.isfinite(density)))[:7] + rng.uniform(0.2, 0.8, 2)
    xy = to_world(cells, resolution, origin).astype(np.float32).astype(float)
    pairs = random_pairs(len(xy), 0.6, rng)
    cost = kernels.line_costs(*space_of(density, resolution, origin), xy, pairs)
    graph = symmetric(pairs[np.isfinite(cost)], np.ones(np.isfinite(cost).sum()), len(xy))
    return xy, graph, rng.integers(0, 4, graph.nnz).astype(float)


@pytest.mark.parametrize(("resolution", "origin"), WORLDS)
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (8, 1), (7, 8), (9, 7)])
def test_nodes_move_as_in_the_plain_loops(shape, resolution, origin):
    for seed in range(2):
        density = density_from(shape, seed, blocked=0.05)
        xy, graph, use = random_graph(density, resolution, origin, seed)
        given = xy.copy()
        limits = (3.3, 1.9)
        result = kernels.moved(
            *space_of(density, resolution, origin), xy, graph.indptr, graph.indices, use, *limits
        )
        expected = naive.moved(
            density, resolution, origin, xy, graph.indptr, graph.indices, use, *limits
        )
        np.testing.assert_allclose(result, expected, rtol=0, atol=1e-5 * resolution)
        np.testing.assert_array_equal(xy, given)


@pytest.mark.parametrize(("resolution", "origin"), WORLDS)
@pytest.mark.parametrize("seed", range(10))
def test_moved_nodes_keep_their_limits_and_cost_less(resolution, origin, seed):
    shift, apart = 4.3, 2.6
    density = density_from((14, 17), seed, blocked=0.04)
    xy, graph, use = random_graph(density, resolution, origin, seed)
    use = use + 1
    ends = np.column_stack([np.repeat(np.arange(len(xy)), np.diff(graph.indptr)), graph.indices])
    weight = np.zeros((len(xy), len(xy)))  # the same both ways, so that all in all it is less
    weight[tuple(ends.T)] = use
    use = (weight + weight.T)[tuple(ends.T)]
    space = space_of(density, resolution, origin)
    result = kernels.moved(*space, xy, graph.indptr, graph.indices, use, shift, apart)
    assert (result == result.astype(np.float32)).all()
    assert (np.hypot(*(result - xy).T) <= shift * resolution).all()
    costs = [kernels.line_costs(*space, at, ends) for at in (xy, result)]
    assert np.isfinite(costs[1]).all()
    assert use @ costs[1] <= use @ costs[0] * (1 + 1e-12)
    assert (result == xy).all() or use @ costs[1] < use @ costs[0]
    before, after = (np.hypot(*(at[ends[:, 0]] - at[ends[:, 1]]).T) for at in (xy, result))
    assert (after >= np.minimum(before, apart * resolution)).all()


def test_nodes_without_edges_or_routes_stay_where_they_are():
    xy = np.array([[1.5, 1.5], [4.5, 4.5], [7.5, 1.5]])
    space = space_of(density_from((9, 9), 1, blocked=0.0), *WORLDS[0])
    nothing = np.zeros(4, np.int32), np.empty(0, np.int32), np.empty(0)
    np.testing.assert_array_equal(kernels.moved(*space, xy, *nothing, 4.0, 1.0), xy)
    unused = np.array([0, 1, 3, 4]), np.array([1, 0, 2, 1]), np.zeros(4)
    np.testing.assert_array_equal(kernels.moved(*space, xy, *unused, 4.0, 1.0), xy)


def test_edges_without_routes_stay_free_too():
    density = np.ones((9, 9))
    density[:5, 5] = np.inf
    # Node 1 would go down to node 0's and 2's height, and then not see node 3 behind the wall.
    xy = np.array([[0.5, 2.5], [2.5, 5.4], [4.5, 2.5], [8.5, 5.4]])
    indptr, indices = np.array([0, 1, 4, 5, 6]), np.array([1, 0, 2, 3, 1, 1])
    space = space_of(density, *WORLDS[0])
    used = np.array([0, 1.0, 1.0, 0, 0, 0])
    result = kernels.moved(*space, xy, indptr, indices, used, 6.0, 0.5)
    assert np.isfinite(kernels.line_cost(*space, result[1], result[3]))
    without = np.array([0, 1, 3, 4, 4]), np.array([1, 0, 2, 1])
    result = kernels.moved(*space, xy, *without, np.array([0, 1.0, 1.0, 0]), 6.0, 0.5)
    assert np.isinf(kernels.line_cost(*space, result[1], result[3]))


@pytest.mark.parametrize("end", [(-0.5, 1.5), (4.5, 1.5), (50.0, 50.0), (1.5, -500.0)])
def test_a_line_to_outside_the_grid_is_blocked(end):
    space = space_of(np.ones((4, 6)), *WORLDS[0])
    xy = to_world([(1.5, 1.5), end], *WORLDS[0])
    assert kernels.line_cost(*space, xy[0], xy[1]) == np.inf


@pytest.mark.parametrize("at", [(1.5, 1.5), (-0.5, 2.5), (4.5, 2.5), (-9.0, 2.5)])
def test_a_line_of_no_length_is_blocked_where_its_position_is(at):
    density = np.ones((4, 6))
    density[1, 1] = np.inf
    xy = to_world([at], *WORLDS[0])
    assert kernels.line_cost(*space_of(density, *WORLDS[0]), xy[0], xy[0]) == np.inf


def test_lines_between_corners_and_edges_are_blocked_where_they_end_at_a_blocked_cell():
    density = density_from((5, 6), 3)
    ends = np.argwhere(np.ones((11, 13))) / 2
    ends = ends[np.random.default_rng(0).permutation(len(ends))[:50]]
    pairs = random_pairs(len(ends), 1.0, np.random.default_rng(1))
    xy = to_world(ends, *WORLDS[0])
    costs = kernels.line_costs(*space_of(density, *WORLDS[0]), xy, pairs)
    np.testing.assert_allclose(costs, naive.line_costs(density, *WORLDS[0], xy, pairs), rtol=1e-6)
