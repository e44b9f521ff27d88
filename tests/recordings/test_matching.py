"""Matching of scans with a whole map: the database, the modes and the losses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support import oracles
from support.rooms import GAP_CELLS, LIDAR, ROOM_CELLS, join_rooms, room_cells, two_rooms

from locplan import LocplanError
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from locplan.recordings.matching import Matching, ScanOnMap, make_database, places_every
from locplan.robots import Lidar


def test_scans_of_a_part_of_the_view_have_unseen_beams():
    matching = Matching(lidar=Lidar(range=8.0, field_of_view_deg=90.0, mount_yaw_deg=90.0))
    seen = np.degrees(matching.bearings[matching.seen])
    assert (seen.min(), seen.max()) == pytest.approx((45.0, 135.0))
    database = make_database(join_rooms(room_cells()), matching)
    (scan,) = database.scans_at(np.array([[20.5, 30.5, 0.0]]))
    assert np.isnan(scan[~matching.seen]).all()
    assert not np.isnan(scan[matching.seen]).any()


def test_measured_scans_are_compared_beam_by_beam():
    lidar = Lidar(range=8.0, min_range=0.5, beams=720, field_of_view_deg=180.0)
    measured = 1.0 + lidar.angles + math.pi / 2  # each beam knows its angle
    measured[:3], measured[-3:] = 0.1, 9.0
    (scan,) = Matching(lidar=lidar).compared(measured[None])
    bearings = (Matching(lidar=lidar).bearings + math.pi) % (2 * math.pi) - math.pi
    finite = np.isfinite(scan)
    apart = np.abs(scan[finite] - 1.0 - math.pi / 2 - bearings[finite])
    assert apart.max() <= math.radians(180 / 719)
    assert np.isnan(scan).sum() == 96 - 49
    assert np.isinf(scan).sum() == 2


def test_modes_without_a_home_are_those_of_a_scan():
    database = make_database(two_rooms(), Matching(lidar=LIDAR))
    home = np.array([[15.5, 30.5, 1.1]])
    scans = database.scans_at(home)
    found = ScanOnMap(database, scans[0]).modes()
    assert found.losses[0] <= found.losses[1]
    at = {tuple(np.round(pose[:2] - home[0, :2]).astype(int)) for pose in found.poses[:2]}
    assert at == {(0, 0), (ROOM_CELLS + GAP_CELLS, 0)}
    assert ScanOnMap(database, np.full(96, np.inf)).modes().poses.shape == (0, 3)


def test_places_lie_one_in_each_square_where_the_robot_fits():
    fits = np.zeros((8, 9), bool)
    fits[1, 2] = fits[2, 2] = fits[6, 7] = True
    assert places_every(0.4, fits, 0.1).tolist() == [[2.5, 1.5], [7.5, 6.5]]


def test_places_do_not_depend_on_the_strips_that_are_looked_through(monkeypatch):
    fits = np.random.default_rng(4).random((61, 47)) < 0.3
    monkeypatch.setattr("locplan.recordings.matching.BAND", 10**6)
    whole = places_every(0.5, fits, 0.1)
    expected = {}  # the cell next to the middle of each square, the first one in order of rows
    for row, col in np.argwhere(fits).tolist():
        aside = (row % 5 - 2) ** 2 + (col % 5 - 2) ** 2
        square = expected.setdefault((row // 5, col // 5), (aside, row, col))
        expected[row // 5, col // 5] = min(square, (aside, row, col))
    assert whole.tolist() == [[c + 0.5, r + 0.5] for _, (_, r, c) in sorted(expected.items())]
    monkeypatch.setattr("locplan.recordings.matching.BAND", 600)
    np.testing.assert_array_equal(places_every(0.5, fits, 0.1), whole)


@pytest.mark.parametrize("band", [1, 1000, 10**6])
@pytest.mark.parametrize("settings", [{}, {"sigma_hit": 0.02}, {"z_rand": 0.6, "sigma_hit": 0.3}])
def test_losses_in_strips_are_those_of_the_whole_map(monkeypatch, band, settings):
    monkeypatch.setattr("locplan.recordings.matching.BAND", band)
    cells = np.where(np.random.default_rng(5).random((70, 40)) < 0.004, OCCUPIED, FREE)
    grid = OccupancyGrid(cells.astype(np.uint8), 0.05)
    matching = Matching(lidar=LIDAR, **settings)
    made = make_database(grid, matching).tables
    expected = oracles.matching.loss_tables(
        grid.cells == OCCUPIED, 0.05, matching.sigmas(0.05), matching.z_rand, made.margin
    )
    np.testing.assert_array_equal(made.corners.reshape(expected.shape), expected)


def test_specks_of_free_space_are_not_reachable():
    cells = np.full((60, 60), UNKNOWN, np.uint8)
    cells[2:40, 2:40] = FREE
    cells[50:58, 50:58] = FREE
    cells[0] = OCCUPIED
    grid, matching = OccupancyGrid(cells, 0.1), Matching(lidar=LIDAR, robot_radius=0.0)
    fits = make_database(grid, matching).fits
    assert not fits[54, 54]
    assert fits[20, 20]


def test_matching_refuses_what_makes_no_sense():
    for wrong in ({"z_rand": 1.0}, {"z_rand": 0.0}, {"shortlisted": 0}):
        with pytest.raises(LocplanError, match=next(iter(wrong))):
            Matching(lidar=LIDAR, **wrong)


def test_coarse_maps_are_matched_with_a_cells_deviation():
    assert Matching(lidar=LIDAR).sigmas(0.05).tolist() == [0.4, 0.2, 0.1]
    assert Matching(lidar=LIDAR).sigmas(0.2).tolist() == [0.4, 0.2]
    assert Matching(lidar=LIDAR).sigmas(0.5).tolist() == [0.5]
