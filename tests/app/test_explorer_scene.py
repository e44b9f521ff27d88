"""Stops that move to where the robot can stand, and the larger cells of drafts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.explorer_sessions import POINT, SAD, rooms
from support.maps import ascii_map

import locplan
from locplan.app.explorer.repairs import make_blank_scene
from locplan.app.explorer.scene import coarsen_costs, snap_stops
from locplan.app.explorer.sites import ExploredSite
from locplan.errors import LocplanError
from locplan.maps import OccupancyGrid, Zone, Zones


def make_parts(grid: OccupancyGrid, robot=POINT):
    return make_blank_scene(ExploredSite(grid, SAD, robot)).parts


def test_stop_snaps_to_connected_part():
    """Otherwise no path would join the stops."""
    parts = make_parts(
        ascii_map("..........", "##########", "##########", "#........#", "##########")
    )
    lower, upper = (1.5, 1.5), (1.5, 4.5)
    in_wall = (5.2, 3.4)  # nearer to the upper part
    assert snap_stops(parts, [upper, in_wall]) == [upper, (5.5, 4.5)]
    assert snap_stops(parts, [lower, in_wall]) == [lower, (5.5, 1.5)]
    assert snap_stops(parts, [in_wall, lower], dragged_index=0) == [(5.5, 1.5), lower]
    assert snap_stops(parts, [upper, in_wall, lower], dragged_index=0)[1] == (5.5, 1.5)
    assert snap_stops(parts, [in_wall, in_wall])[0] == (5.5, 4.5)
    assert snap_stops(parts, [lower, upper]) == [lower, upper]  # free ones stay in any case


def test_stop_snaps_at_most_three_metres():
    parts = make_parts(ascii_map(".....###########"))
    assert snap_stops(parts, [(0.5, 0.5), (7.5, 0.5)])[1] == (4.5, 0.5)
    with pytest.raises(LocplanError, match=r"the goal .* no free cell within 3 m"):
        snap_stops(parts, [(0.5, 0.5), (7.6, 0.5)])
    with pytest.raises(LocplanError, match="the start"):
        snap_stops(parts, [(-1e7, 1e7), (0.5, 0.5)])


@pytest.mark.parametrize("seed", range(3))
def test_nearest_cell_equals_full_search(seed):
    grid, rng = rooms(seed, yaw=0.4), np.random.default_rng(seed)
    parts = make_parts(grid, locplan.Robot(footprint=0.2, margin=0.0))
    x, y = grid.grid_to_world(*rng.uniform(0, (60, 90), (30, 2)).T)
    for xy in zip(x.tolist(), y.tolist(), strict=True):
        for label in (0, 1, int(parts.labels.max())):
            wanted = parts.labels == label if label else parts.labels > 0
            centres = np.column_stack(grid.grid_to_world(*(np.argwhere(wanted) + 0.5).T))
            distance = np.hypot(*(centres - xy).T)
            nearest = parts.find_nearest_position(xy, label)
            if nearest is None:
                assert distance.min() > 3.0
            else:
                assert math.dist(nearest, xy) == pytest.approx(distance.min())


def test_coarse_cells_average_degeneracy_and_zones():
    grid = OccupancyGrid(np.full((8, 12), 254, np.uint8), 0.5)
    u = np.linspace(0, 1, 96).reshape(8, 12)
    prefer = Zones([Zone("prefer", [[0, 0], [2, 0], [2, 2], [0, 2]])])
    fine = locplan.Costmap.from_layers(grid, u=u, robot=0.0, zones=prefer)
    coarse = coarsen_costs(fine)
    assert coarse.grid.shape == (2, 3)
    assert coarse.u[0, 0] == pytest.approx(u[:4, :4].mean())
    extra = coarse.density - (1 + coarse.weight * coarse.u)
    assert extra[0, 0] == pytest.approx(0)
    assert extra[1, 2] == pytest.approx(1)


def test_scene_basis_names_zones_and_map():
    site = ExploredSite(rooms(), SAD, POINT)
    zones = Zones([Zone("no-go", [[0, 0], [2, 0], [2, 2]])])
    scene, other = (
        make_blank_scene(site),
        make_blank_scene(ExploredSite(site.grid, SAD, POINT, zones)),
    )
    assert scene.basis["map"] == other.basis["map"] == site.grid.digest
    assert scene.basis["field"] is None
    assert scene.basis["zones"] != other.basis["zones"]
    assert scene.key != other.key
