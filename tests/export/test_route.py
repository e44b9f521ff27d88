"""The kernels of route graphs against plain loops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support import oracles

from locplan._support.kernels.search import make_bordered_half_density
from locplan.export.kernels import route as kernels

SHAPES = [(1, 1), (1, 9), (9, 1), (2, 2), (6, 8), (9, 7), (10, 10)]
WORLDS = [(1.0, (0.0, 0.0, 0.0)), (0.05, (-3.0, 7.0, 0.7)), (0.1, (5.0, -2.0, -2.5))]


def make_free_cells(shape, seed, *, blocked=0.3):
    """Free cells (H, W), often in several pieces, of which at least one is free."""
    rng = np.random.default_rng(seed)
    inside = rng.random(shape) >= blocked
    inside[tuple(rng.integers(0, shape))] = True
    return inside


def make_density(shape, seed, *, blocked=0.1):
    rng = np.random.default_rng(seed)
    density = rng.uniform(1.0, 9.0, shape)
    density[~make_free_cells(shape, seed, blocked=blocked)] = np.inf
    return density


def make_kernel_arguments(density, resolution, origin):
    """What the kernels take first: half the density, columns and frame."""
    x, y, yaw = origin
    frame = math.cos(yaw) / resolution, math.sin(yaw) / resolution, x, y
    return make_bordered_half_density(density, 1), density.shape[1] + 2, frame


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


def random_pairs(count, share, rng):
    """Distinct pairs (m, 2) of so many nodes, the lower one first."""
    return np.argwhere(np.triu(rng.random((count, count)) < share, 1))


@pytest.mark.parametrize(("resolution", "origin"), WORLDS)
@pytest.mark.parametrize("shape", SHAPES)
def test_line_costs_equal_exact_integral(shape, resolution, origin):
    rng = np.random.default_rng(1)
    density = make_density(shape, 1)
    ends = rng.uniform(0, 1, (15, 2)) * shape
    ends[::2] = np.floor(ends[::2]) + 0.5  # from centre to centre, often over corners
    xy = to_world(ends, resolution, origin)
    pairs = np.array([(i, j) for i in range(15) for j in range(15) if i != j])
    pairs = pairs[np.hypot(*(ends[pairs[:, 0]] - ends[pairs[:, 1]]).T) > 0]
    costs = kernels.integrate_line_costs(
        *make_kernel_arguments(density, resolution, origin), xy, pairs
    )
    expected = oracles.lines.line_costs(density, resolution, origin, xy, pairs)
    np.testing.assert_allclose(costs, expected, rtol=1e-6)


def test_line_cost_is_symmetric():
    """A single line costs as much as in a batch."""
    space = make_kernel_arguments(make_density((9, 9), 1), *WORLDS[1])
    xy = to_world(np.random.default_rng(1).uniform(0, 9, (30, 2)), *WORLDS[1])
    pairs = random_pairs(30, 1.0, np.random.default_rng(2))
    costs = kernels.integrate_line_costs(*space, xy, pairs)
    np.testing.assert_array_equal(
        costs, kernels.integrate_line_costs(*space, xy, pairs[:, ::-1].copy())
    )
    np.testing.assert_array_equal(
        costs, [kernels.integrate_line_cost(*space, xy[i], xy[j]) for i, j in pairs]
    )
    assert 0 < np.isinf(costs).sum() < len(costs)
    assert kernels.integrate_line_costs(*space, xy, pairs[:0]).shape == (0,)


@pytest.mark.parametrize("start", [(-0.5, 2.0), (2.0, -7.5), (4.2, 2.0), (2.0, 900.0)])
def test_line_starting_outside_grid_is_blocked(start):
    space = make_kernel_arguments(np.ones((4, 6)), *WORLDS[0])
    xy = to_world([start, (1.5, 1.5)], *WORLDS[0])
    assert kernels.integrate_line_cost(*space, xy[0], xy[1]) == np.inf


@pytest.mark.parametrize("end", [(-0.5, 1.5), (4.5, 1.5), (50.0, 50.0), (1.5, -500.0)])
def test_line_ending_outside_grid_is_blocked(end):
    space = make_kernel_arguments(np.ones((4, 6)), *WORLDS[0])
    xy = to_world([(1.5, 1.5), end], *WORLDS[0])
    assert kernels.integrate_line_cost(*space, xy[0], xy[1]) == np.inf


@pytest.mark.parametrize("at", [(1.5, 1.5), (-0.5, 2.5), (4.5, 2.5), (-9.0, 2.5)])
def test_blocked_position_blocks_zero_length_line(at):
    density = np.ones((4, 6))
    density[1, 1] = np.inf
    blocked, free = to_world([at, (2.5, 3.5)], *WORLDS[0])
    space = make_kernel_arguments(density, *WORLDS[0])
    assert kernels.integrate_line_cost(*space, blocked, blocked) == np.inf
    assert kernels.integrate_line_cost(*space, free, free) == 0


def test_border_line_costs_equal_exact_integral():
    """Lines that end at a corner or edge of a blocked cell are blocked."""
    density = make_density((5, 6), 3)
    ends = np.argwhere(np.ones((11, 13))) / 2
    ends = ends[np.random.default_rng(0).permutation(len(ends))[:50]]
    pairs = random_pairs(len(ends), 1.0, np.random.default_rng(1))
    xy = to_world(ends, *WORLDS[0])
    costs = kernels.integrate_line_costs(*make_kernel_arguments(density, *WORLDS[0]), xy, pairs)
    np.testing.assert_allclose(
        costs, oracles.lines.line_costs(density, *WORLDS[0], xy, pairs), rtol=1e-6
    )
