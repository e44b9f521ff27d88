"""The steps that draw lanes from a net, each alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra
from test_route_kernels import WORLDS, random_pairs, space_of, symmetric

from locplan.export import _lanes as lanes
from locplan.export._net import Net, merged, spanned

SPACE = space_of(np.ones((30, 30)), *WORLDS[0])


def net_of(xy: list[tuple[float, float]], edges: list[tuple[int, int]]) -> Net:
    """A net whose edges cost their lengths."""
    at, pairs = np.array(xy, float), np.array(edges)
    return Net(at, pairs, np.hypot(*(at[pairs[:, 0]] - at[pairs[:, 1]]).T))


RING = net_of(
    [(5, 5), (15, 5), (25, 5), (25, 15), (15, 25), (5, 15)],
    [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (0, 5)],
)


def test_a_gap_with_a_long_detour_is_closed_over_nodes_between() -> None:
    chosen = np.array([True, True, True, True, False, False])
    lanes._close_gaps(RING, chosen)
    assert chosen.all()  # 4-5-0 is 24 m, and 46 m the other way
    one, other = RING.xy[0], RING.xy[4]
    short = Net(
        RING.xy,
        np.vstack([RING.edges, [(0, 4)]]),
        np.append(RING.cost, 0.7 * math.dist(one, other)),
    )
    chosen = np.array([True, True, True, True, False, False, True])
    lanes._close_gaps(short, chosen)
    assert not chosen[4:6].any()


@pytest.mark.parametrize("detour", [1.0, 1.2, 1.6])
@pytest.mark.parametrize("seed", range(5))
def test_places_are_a_detour_apart_at_most(seed: int, detour: float) -> None:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(1, 29, (40, 2))
    net = spanned(SPACE, xy, random_pairs(40, 1.0, rng), 1.02, 5.0)
    places = np.arange(0, 40, 3)
    chosen = lanes._routes(net, places, detour, lambda done, total: None)
    best, over = (
        dijkstra(symmetric(net.edges[use], net.cost[use], 40), indices=places)[:, places]
        for use in (np.ones(len(net.edges), bool), chosen)
    )
    assert (over <= detour * best * (1 + 1e-6)).all()
    assert chosen.sum() < len(chosen)


def test_lanes_lead_to_nodes_that_hidden_points_see() -> None:
    density = np.ones((30, 30))
    density[10:12, :25] = np.inf
    space = space_of(density, *WORLDS[0])
    net = net_of([(2, 5), (27, 5), (27, 20), (2, 20), (2, 28)], [(0, 1), (1, 2), (2, 3), (3, 4)])
    chosen = np.array([True, False, False, False])
    points = np.array([(3.5, 6.5), (4.5, 20.5)])
    lanes._look_everywhere(space, net, chosen, points, 8.0)
    assert chosen.tolist() == [True, True, True, False]


def test_a_node_leaves_unless_a_point_sees_no_other() -> None:
    points = np.array([(4.5, 5.5), (9.5, 5.5), (15.5, 5.5)])
    xy = np.array([(5.0, 5.0), (10.0, 5.0), (16.0, 5.0)])
    view = lanes.View(SPACE, points, xy, 5.2)
    assert not view.leave(2)
    assert view.leave(1)
    assert not view.leave(0)


def test_straight_chains_become_one_edge_and_bends_stay() -> None:
    chain = net_of([(2, 5), (8, 5), (14, 5), (20, 5), (20, 15)], [(0, 1), (1, 2), (2, 3), (3, 4)])
    density = np.ones((30, 30))
    density[7:14, 8:18] = np.inf
    space = space_of(density, *WORLDS[0])
    none = lanes.View(space, np.zeros((0, 2)), chain.xy, 6.0)
    for longest, edges in ((99.0, [(0, 3), (3, 4)]), (13.0, [(0, 2), (2, 3), (3, 4)])):
        straight = lanes._straightened(space, chain, none, longest)
        assert sorted(map(tuple, straight.edges.tolist())) == edges
    watched = lanes.View(space, np.array([(8.5, 2.5)]), chain.xy, 5.0)
    straight = lanes._straightened(space, chain, watched, 99.0)
    assert sorted(map(tuple, straight.edges.tolist())) == [(0, 1), (1, 3), (3, 4)]


def test_near_nodes_merge_unless_one_may_not_leave() -> None:
    xy = np.array([(2.0, 5.0), (10.0, 5.0), (10.5, 5.5), (20.0, 5.0)])
    pairs = np.array([(0, 1), (1, 2), (2, 3)])
    left, edges = merged(SPACE, xy, pairs, 2.0)
    assert (len(left), len(edges)) == (3, 2)
    assert len(merged(SPACE, xy, pairs, 2.0, lambda node: False)[0]) == 4
    assert len(merged(SPACE, xy, pairs, np.array([1.0, 9.0, 0.1, 9.0]))[0]) == 4


def test_near_nodes_are_joined_if_that_spares_a_detour_and_crosses_nothing() -> None:
    far = [edge for edge in RING.edges.tolist() if edge != [0, 5]]
    ring = net_of(list(map(tuple, RING.xy)), far)
    joined = lanes._joined(SPACE, ring, 12.0, 5.0)
    assert [0, 5] in joined.edges.tolist()
    assert len(joined.edges) == len(far) + 1
    assert len(lanes._joined(SPACE, ring, 9.0, 5.0).edges) == len(far)
    across = net_of([(10, 12), (10, 14), (2, 13), (18, 13)], [(2, 3)])
    assert lanes._joined(SPACE, across, 3.0, 5.0).edges.tolist() == [[2, 3]]
    apart = net_of([(10, 12), (10, 14), (2, 15), (18, 15)], [(2, 3)])
    assert lanes._joined(SPACE, apart, 3.0, 5.0).edges.tolist() == [[2, 3], [0, 1]]


def test_points_that_see_no_node_get_an_end_that_they_see() -> None:
    density = np.ones((30, 30))
    density[10:12, :25] = np.inf
    space = space_of(density, *WORLDS[0])
    drawn = net_of([(2, 5), (27, 5), (27, 15)], [(0, 1), (1, 2)])
    ends = np.array([(20.0, 15.0), (4.0, 5.0), (8.0, 20.0)])
    for point, edges in (((14.5, 18.5), [(0, 1), (1, 2), (2, 3)]), ((9.5, 5.5), [(0, 1), (1, 2)])):
        net = lanes._with_spurs(space, drawn, ends, np.array([point]), 10.0)
        assert sorted(map(tuple, np.sort(net.edges, axis=1).tolist())) == edges
    assert net.xy.tolist() == drawn.xy.tolist()
