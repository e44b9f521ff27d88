"""The kernels that thin a route graph to lanes, against plain loops."""

from __future__ import annotations

import naive
import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components
from test_route_kernels import (
    WORLDS,
    density_from,
    random_pairs,
    space_of,
    symmetric,
    to_world,
)

from locplan._kernels import route as kernels

COUNTS = (1, 2, 3, 5, 9, 12, 14, 14)


def pairs_in_order(seed: int, kind: str) -> tuple[np.ndarray, np.ndarray, int]:
    rng = np.random.default_rng(seed)
    count = COUNTS[seed]
    pairs = random_pairs(count, rng.uniform(0.2, 1), rng)
    xy = rng.uniform(0, 9, (count, 2))
    cost = np.hypot(*(xy[pairs[:, 0]] - xy[pairs[:, 1]]).T)
    if kind == "equal":
        cost[:] = 3.0
    elif kind == "few levels":
        cost = np.ceil(cost)
    elif kind == "some infinite":
        cost[rng.random(len(cost)) < 0.4] = np.inf
    elif kind == "zeros":
        cost[rng.random(len(cost)) < 0.4] = 0.0
    order = np.argsort(cost, kind="stable")
    return pairs[order], cost[order], count


@pytest.mark.parametrize("sure", [0, 4, 1000])
@pytest.mark.parametrize("detour", [1.0, 1.2, 2.0])
@pytest.mark.parametrize("kind", ["distances", "equal", "few levels", "some infinite", "zeros"])
def test_spanner_keeps_what_no_way_kept_before_replaces(
    kind: str, detour: float, sure: int
) -> None:
    for seed in range(sure % 3, len(COUNTS), 2):  # each count with one of two numbers of sure ones
        pairs, cost, count = pairs_in_order(seed, kind)
        if sure:  # the sure ones come first, whatever they cost
            order = np.random.default_rng(seed).permutation(len(pairs))
            pairs, cost = pairs[order], cost[order]
        kept = kernels.spanner(pairs, cost, count, detour, sure)
        assert kept.tolist() == naive.spanner(pairs.tolist(), cost.tolist(), detour, sure)
        finite = np.isfinite(cost)
        assert not kept[~finite].any()
        assert kept[:sure][finite[:sure]].all()
        assert (
            connected_components(symmetric(pairs[kept], np.ones(kept.sum()), count))[0]
            == connected_components(symmetric(pairs[finite], np.ones(finite.sum()), count))[0]
        )


def test_a_way_that_costs_exactly_the_detour_replaces_a_pair() -> None:
    pairs = np.array([[0, 1], [1, 2], [2, 3], [0, 3]])
    for longest, kept in ((3.0, False), (2.9, True)):
        cost = np.array([1.0, 1.0, 1.0, longest])
        assert kernels.spanner(pairs, cost, 4, 1.0, 0).tolist() == [True, True, True, kept]


@pytest.mark.parametrize("size", [0.4, 3.0, 100.0])
@pytest.mark.parametrize("whole", [True, False])
def test_lines_cross_none_kept_before_them(whole: bool, size: float) -> None:
    for seed in range(12):
        rng = np.random.default_rng(seed)
        xy = rng.uniform(-4, 9, (12, 2))
        if whole:  # often parallel, through each other's ends, or on one line
            xy = np.round(xy / 3)
        pairs = rng.permutation(random_pairs(12, 0.5, rng))
        kept = kernels.uncrossed(xy, pairs, size)
        assert kept.tolist() == naive.uncrossed(xy.tolist(), pairs.tolist())
        assert 0 < kept.sum() < len(kept)


def test_no_lines_cross_nothing() -> None:
    assert kernels.uncrossed(np.zeros((0, 2)), np.zeros((0, 2), np.int64), 1.0).shape == (0,)


@pytest.mark.parametrize(("resolution", "origin"), WORLDS)
@pytest.mark.parametrize("within", [1.4, 3.0, 50.0])
def test_points_see_what_is_near_and_not_hidden(
    within: float, resolution: float, origin: tuple
) -> None:
    density = density_from((11, 13), 3, blocked=0.05)
    rng = np.random.default_rng(4)
    points = to_world(rng.uniform(-1, 13, (40, 2)), resolution, origin)
    xy = to_world(rng.uniform(0, 11, (25, 2)), resolution, origin)
    reach = within * resolution
    space = space_of(density, resolution, origin)
    pairs = kernels.sights(*space, points, xy, reach, len(xy))
    expected = naive.sights(density, resolution, origin, points, xy, reach)
    assert sorted(map(tuple, pairs.tolist())) == expected
    assert len(expected) > 3
    for most in (0, 1, 2):
        some = kernels.sights(*space, points, xy, reach, most)
        assert set(map(tuple, some.tolist())) <= set(expected)
        seen = np.bincount(np.array(expected)[:, 0], minlength=len(points))
        found = np.bincount(some[:, 0], minlength=len(points))
        assert (found == np.minimum(seen, most)).all()


def test_nothing_is_seen_where_there_is_nothing() -> None:
    space = space_of(np.ones((4, 6)), *WORLDS[0])
    none, one = np.zeros((0, 2)), np.array([[1.5, 1.5]])
    assert kernels.sights(*space, one, none, 1.0, 9).shape == (0, 2)
    assert kernels.sights(*space, none, one, 1.0, 9).shape == (0, 2)
