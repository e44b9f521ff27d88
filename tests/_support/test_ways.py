"""Searches that are kept in a byte a cell: the same paths as a planner's, from either end."""

import numpy as np
import pytest
from support import oracles

from locplan._support.kernels import ways
from locplan._support.kernels.search import (
    make_bordered_half_density,
    measure_cost_scale,
    search_grid,
)
from locplan._support.kernels.ways import trace_path

SIZE = 22


def tied(seed: int) -> np.ndarray:
    """A density of walls and floor, on which many paths cost the same, or nearly so."""
    rng = np.random.default_rng(seed)
    u = rng.integers(0, 3, (SIZE, SIZE)) / 2 * rng.integers(2) + 0.1 * (seed % 3)
    density = 1 + rng.choice([1e-6, 0.1, 4.0, 1000.0]) * u
    density[rng.random(density.shape) < rng.uniform(0, 0.35)] = np.inf
    return density


def searched(half, source):
    return search_grid(half, SIZE + 2, source, -1, False, measure_cost_scale(half)).cost


def steps_from(half, source):
    cost = searched(half, source)
    tolerance = ways.compute_tolerance(cost, measure_cost_scale(half).cheapest)
    return ways.find_backward_steps(half, SIZE + 2, cost, tolerance)


@pytest.mark.parametrize("tolerance", [0.0, 0.3])
def test_backward_steps_equal_reference_steps(tolerance):
    ambiguous = 0
    for seed in range(8):
        density = tied(seed)
        density[0, 0] = 1.0
        half, columns = make_bordered_half_density(density, 1), SIZE + 2
        cost = searched(half, columns + 1)
        found = ways.find_backward_steps(half, columns, cost, tolerance).reshape(-1, columns)
        costs = np.abs(cost).reshape(-1, columns)[1:-1, 1:-1]
        expected = oracles.search.steps_back(density, costs, tolerance)
        np.testing.assert_array_equal(found[1:-1, 1:-1], expected)
        assert not found[[0, -1]].any()
        assert not found[:, [0, -1]].any()
        ambiguous += sum(int(bits).bit_count() > 1 for bits in expected.flat)
    assert ambiguous > 300


def test_traced_path_equals_searched_path():
    """The path may start at either end of the stored search."""
    rng, solved, differ = np.random.default_rng(4), 0, 0
    for seed in range(300):
        density, columns = tied(seed), SIZE + 2
        cells = rng.integers(SIZE, size=(2, 2))
        density[tuple(cells.T)] = 1.0
        half = make_bordered_half_density(density, 1)
        root, tip = ((cells + 1) @ (columns, 1)).tolist()
        steps = steps_from(half, root)
        there, back = searched(half, root), searched(half, tip)
        assert (steps[tip] > 0 or tip == root) == np.isfinite(there[tip])
        if not np.isfinite(there[tip]):
            continue
        solved += 1
        expected = (
            trace_path(half, columns, there, tip, False),
            trace_path(half, columns, back, root, False),
        )
        for from_root, path in zip((True, False), expected, strict=True):
            found = ways.trace_cheapest_path(half, columns, steps, root, tip, from_root)
            np.testing.assert_array_equal(found, path)
        differ += expected[0].tolist() != expected[1][::-1].tolist()
    assert solved > 200
    assert differ > 50


def test_traced_path_breaks_ties_like_search():
    columns = 402
    half = make_bordered_half_density(np.ones((400, 400)), 1)
    root, tip = 5 * columns + 7, 390 * columns + 201
    cost = search_grid(half, columns, root, -1, False, measure_cost_scale(half)).cost
    steps = ways.find_backward_steps(half, columns, cost, ways.compute_tolerance(cost, 1.0))
    found = ways.trace_cheapest_path(half, columns, steps, root, tip, True)
    np.testing.assert_array_equal(found, trace_path(half, columns, cost, tip, False))


def test_path_within_cell_is_single_cell():
    half = make_bordered_half_density(np.ones((SIZE, SIZE)), 1)
    for from_root in (True, False):
        cells = ways.trace_cheapest_path(half, SIZE + 2, steps_from(half, 50), 50, 50, from_root)
        assert cells.tolist() == [50]


def test_tolerance_follows_greatest_finite_cost():
    cost = np.array([-3.0, np.inf, 0.0, 2.0, -1e4, np.inf, 5.0])
    assert ways.find_greatest_cost(cost) == 1e4
    assert ways.compute_tolerance(cost, 1.0) == pytest.approx(4 * 2.0**-53 * 1e8)
    assert ways.compute_tolerance(cost, 1e-6) == pytest.approx(5e-7)
    assert ways.compute_tolerance(100 * cost, 1e-1) == pytest.approx(1e-4)
    assert ways.compute_tolerance(np.array([0.0, np.inf]), 1.0) == 0.0
