"""Twins: places that look alike, symmetries of maps, starts, and the command."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math

import naive
import numpy as np
import pytest
from conftest import corridor, refused
from figure_looks import check_looks
from locplan._util.code_digest import code_digest
from scipy.ndimage import affine_transform

import locplan
from locplan import Lidar, LocplanError, ScanDatabase, find_twins
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, save_map
from locplan.matching import Matching, ScanOnMap, find_all_modes, make_database, places_every
from locplan.robots import Disturbances, Robot
from locplan.twins import LAYERS, GlobalMatches, twins_figure

LIDAR = Lidar(range=8.0)
QUIET = Disturbances(boundary_noise=0.0, outliers=0.0, occlusion=0.0, worlds=1)
ROOM = 44
"""Edge of a room [cells of 0.1 m]."""
GAP = 10
"""Cells between rooms."""


def room(*boxes: tuple[int, int, int, int]) -> np.ndarray:
    """A room with walls all round and boxes (rows, columns) in it, alike under no turn."""
    cells = np.full((ROOM, ROOM), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    for top, bottom, left, right in boxes or ((1, 9, 1, 5), (20, 26, 34, 43), (36, 43, 8, 14)):
        cells[top:bottom, left:right] = OCCUPIED
    return cells


def side_by_side(*parts: np.ndarray, origin=(0.0, 0.0, 0.0)) -> OccupancyGrid:
    """Rooms with a metre of unknown space between them, so that walls have nothing behind them."""
    between = np.full((ROOM, GAP), UNKNOWN, np.uint8)
    every = [each for part in parts for each in (between, part)][1:]
    return OccupancyGrid(np.concatenate(every, axis=1), 0.1, origin, "rooms")


def two_rooms(origin=(0.0, 0.0, 0.0)) -> OccupancyGrid:
    return side_by_side(room(), room(), origin=origin)


@pytest.fixture(scope="module")
def equal_rooms():
    return find_twins(two_rooms(), robot=Robot(LIDAR))


@pytest.fixture(scope="module")
def one_room():
    return find_twins(side_by_side(room()), robot=Robot(LIDAR))


def test_rooms_three_metres_apart_are_twins():
    narrow = np.full((ROOM, 24), FREE, np.uint8)
    narrow[[0, -1]] = narrow[:, [0, -1]] = OCCUPIED
    narrow[1:9, 1:5] = narrow[30:36, 14:23] = OCCUPIED
    between = np.full((ROOM, 6), UNKNOWN, np.uint8)
    grid = OccupancyGrid(np.concatenate([narrow, between, narrow], axis=1), 0.1)
    found = find_twins(grid, robot=Robot(LIDAR), places=[(1.2, 2.2)])
    twin = found.of(0)[0]
    assert (twin.x, twin.y) == pytest.approx((4.2, 2.2), abs=0.05)
    assert twin.excess == pytest.approx(0.0, abs=0.1)
    assert found.elsewhere[0] == pytest.approx(0.5, abs=0.05)


def test_a_match_fails_from_two_metres_on():
    poses, scores = np.zeros((3, 3)), np.zeros(3)
    matched = np.array([(1.9, 0.0, 0.0), (0.0, 2.1, 0.0), (3.9, 0.0, 0.0)])
    made = GlobalMatches(poses, matched, scores, scores, np.zeros(3, bool))
    assert made.failed.tolist() == [False, True, True]


def test_each_place_of_two_equal_rooms_has_its_twin_in_the_other(equal_rooms):
    width = (ROOM + GAP) * 0.1
    assert len(equal_rooms) > 20
    for n, (x, y) in enumerate(equal_rooms.places):
        twin = equal_rooms.of(n)[0]
        there = x + (width if x < width else -width)
        assert (twin.x, twin.y) == pytest.approx((there, y), abs=0.05)
        assert twin.heading == pytest.approx(0.0, abs=0.03)
        assert twin.excess == pytest.approx(0.0, abs=0.1)
    np.testing.assert_allclose(equal_rooms.elsewhere, 0.5, atol=0.1)
    assert equal_rooms.share == 1.0
    moves = [each.shift for each in equal_rooms.symmetries]
    assert sorted(moves) == pytest.approx(np.array([(-5.4, 0.0), (5.4, 0.0)]), abs=0.05)
    assert [each.turn_deg for each in equal_rooms.symmetries] == [0, 0]
    assert [each.share for each in equal_rooms.symmetries] == pytest.approx([0.5, 0.5], abs=0.05)
    assert equal_rooms.covered.shape == (2, len(equal_rooms))


def test_a_room_alone_has_no_twin_and_no_symmetry(one_room):
    assert one_room.symmetries == ()
    assert one_room.share == 0.0
    assert one_room.elsewhere.max() < 0.05
    assert "no symmetry" in one_room.report()


def test_a_map_that_repeats_under_turns_has_three_symmetries():
    quarter = room()
    quarter[:, -1] = FREE  # it is open to its neighbours
    quarter[-1, :] = FREE
    lower = np.concatenate([quarter, np.rot90(quarter, 3)], axis=1)
    cells = np.concatenate([lower, np.rot90(lower, 2)], axis=0)
    assert (cells == np.rot90(cells)).all()
    found = find_twins(OccupancyGrid(cells, 0.1), robot=Robot(LIDAR))
    first = found.symmetries[:3]
    assert sorted(each.turn_deg for each in first) == [-90, 90, 180]
    for each in first:
        assert each.share > 0.9
        assert each.distance < 0.3
    assert all(each.share < 0.3 for each in found.symmetries[3:])


def turned(cells: np.ndarray, angle: float) -> np.ndarray:
    """A room in the middle of unknown space, turned by an angle [rad]."""
    size = np.array([64, 64])
    cos, sin = math.cos(angle), math.sin(angle)
    back = np.array([[cos, sin], [-sin, cos]])
    first = (np.array(cells.shape) - 1) / 2 - back @ ((size - 1) / 2)
    return affine_transform(cells, back, first, output_shape=size, order=0, cval=UNKNOWN)


def test_a_move_takes_no_place_to_a_twin_that_is_turned_otherwise():
    pairs = []
    for boxes, angle in (((), 0.0), (((5, 18, 20, 25), (30, 42, 3, 9), (28, 34, 30, 44)), 0.3)):
        alone = room(*boxes)
        alone[:2] = alone[-2:] = alone[:, :2] = alone[:, -2:] = OCCUPIED  # no gap when turned
        pairs.append(np.concatenate([turned(alone, 0.0), turned(alone, angle)], axis=1))
    found = find_twins(OccupancyGrid(np.concatenate(pairs), 0.1), robot=Robot(LIDAR))
    assert [each.turn_deg for each in found.symmetries] == [0, 0, 17, -17]
    assert max(each.share for each in found.symmetries) < 0.3


def test_twins_turn_with_the_map(equal_rooms):
    grid = equal_rooms.grid
    turned = OccupancyGrid(np.ascontiguousarray(np.rot90(grid.cells)), 0.1)
    # A turn of the array by 90 deg takes (row, col) to (cols - 1 - col, row).
    x, y = equal_rooms.places.T
    places = np.column_stack([y, grid.shape[1] * 0.1 - x])
    found = find_twins(turned, robot=Robot(LIDAR), places=places)
    np.testing.assert_allclose(found.elsewhere, equal_rooms.elsewhere, atol=0.1)
    np.testing.assert_allclose(found.excess, equal_rooms.excess, atol=0.3)
    for n in range(len(places)):
        a, b = equal_rooms.of(n)[0], found.of(n)[0]
        assert (b.x, b.y) == pytest.approx((a.y, grid.shape[1] * 0.1 - a.x), abs=0.06)


def test_the_origins_yaw_turns_all_but_the_numbers(equal_rooms):
    yaw = 0.7
    found = find_twins(two_rooms(origin=(3.0, -2.0, yaw)), robot=Robot(LIDAR))
    np.testing.assert_array_equal(found.excess, equal_rooms.excess)
    cos, sin = math.cos(yaw), math.sin(yaw)
    turned = equal_rooms.places @ np.array([[cos, sin], [-sin, cos]]) + (3.0, -2.0)
    np.testing.assert_allclose(found.places, turned, atol=1e-9)
    assert found.headings == pytest.approx([yaw])
    assert found.of(0)[0].heading == pytest.approx(equal_rooms.of(0)[0].heading + yaw)
    assert found.symmetries[0].distance == pytest.approx(5.4, abs=0.05)
    same = np.isclose(found.layer("excess"), equal_rooms.layer("excess"), equal_nan=True)
    assert same.mean() > 0.9  # some cells are as near to one place as to another


def test_a_corridor_is_a_stretch_and_no_twin():
    grid = corridor(30.0, 2.0, resolution=0.1)
    found = find_twins(grid, robot=Robot(Lidar(range=5.0)), places=[(0.0, 0.0)])
    assert found.stretch[0] > 5.0
    assert found.excess[0] == pytest.approx(0.0, abs=0.3)
    assert all(abs(twin.heading) > 3.0 for twin in found.of(0))  # those that face the other way
    assert found.turned[0] > 0
    assert found.elsewhere[0] > 0.5


def test_a_match_without_returns_tells_nothing():
    cells = np.full((300, 300), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1)
    found = find_twins(grid, robot=Robot(Lidar(range=3.0)), places=[(15.0, 15.0), (28.5, 28.5)])
    assert found.elsewhere[0] == 1.0
    assert found.excess[0] == 0.0
    assert found.of(0) == []
    assert len(found.of(1)) >= 3  # the other corners


def test_a_lidar_that_looks_ahead_has_eight_headings_and_finds_the_other_room():
    ahead = Lidar(range=8.0, field_of_view_deg=180.0, mount_x=0.3, mount_yaw_deg=20.0)
    found = find_twins(two_rooms(), robot=Robot(ahead), places=[(1.2, 3.0), (6.6, 3.0)])
    assert found.headings.shape == (8,)
    assert found.values["excess"].shape == (2, 8)
    for here in range(8):
        twins = found.twins[0, here]
        best = twins[0]
        assert best[:2] == pytest.approx((6.6, 3.0), abs=0.05)
        assert math.remainder(best[2] - found.headings[here], 2 * math.pi) == pytest.approx(
            0.0, abs=0.03
        )


def test_scans_of_a_part_of_the_view_have_unseen_beams():
    matching = Matching(lidar=Lidar(range=8.0, field_of_view_deg=90.0, mount_yaw_deg=90.0))
    seen = np.degrees(matching.bearings[matching.seen])
    assert (seen.min(), seen.max()) == pytest.approx((45.0, 135.0))
    database = make_database(side_by_side(room()), matching)
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


def test_missing_returns_count_where_they_are_asked_to():
    """One room has a far wall; a beam without a return tells it from the other."""
    near, far = room(), room()
    opened = np.concatenate([near, far, np.full((ROOM, 60), FREE, np.uint8)], axis=1)
    opened[10:20, 2 * ROOM - 1] = FREE
    opened[[0, -1], 2 * ROOM :] = OCCUPIED
    opened[:, -1] = OCCUPIED
    grid = OccupancyGrid(opened, 0.1)
    short = Lidar(range=4.0)
    ignored, counted = (
        find_twins(grid, robot=Robot(short), places=[(6.0, 1.5)], count_missing=count)
        for count in (False, True)
    )
    assert counted.excess[0] > ignored.excess[0] + 1.0


def test_the_result_does_not_depend_on_the_number_of_threads(equal_rooms):
    for threads in (1, 3):
        again = find_twins(two_rooms(), robot=Robot(LIDAR), threads=threads)
        assert again.symmetries == equal_rooms.symmetries
        np.testing.assert_array_equal(again.excess, equal_rooms.excess)
        np.testing.assert_array_equal(again.twins, equal_rooms.twins)


def test_progress_ends_once_symmetries_are_tried_too():
    for grid in (two_rooms(), side_by_side(room())):
        told = []
        find_twins(
            grid,
            robot=Robot(LIDAR),
            spacing=1.5,
            progress=lambda *done, told=told: told.append(done),
        )
        assert told == sorted(told)
        assert {total for _, total in told} == {told[-1][0]}


def test_modes_without_a_home_are_those_of_a_scan():
    database = make_database(two_rooms(), Matching(lidar=LIDAR))
    home = np.array([[15.5, 30.5, 1.1]])
    scans = database.scans_at(home)
    found = ScanOnMap(database, scans[0]).modes()
    assert found.losses[0] <= found.losses[1]
    at = {tuple(np.round(pose[:2] - home[0, :2]).astype(int)) for pose in found.poses[:2]}
    assert at == {(0, 0), (ROOM + GAP, 0)}
    (again,) = find_all_modes(database, scans)
    np.testing.assert_array_equal(again.poses, found.poses)
    assert ScanOnMap(database, np.full(96, np.inf)).modes().poses.shape == (0, 3)


def test_few_effective_beams_find_many_more_twins(equal_rooms):
    database = ScanDatabase(equal_rooms.grid, LIDAR, clearance=0.25)
    seen = database.everywhere
    few = find_twins(
        equal_rooms.grid, robot=Robot(LIDAR), global_effective_beams=3, database=database
    )
    assert np.isfinite(few.twins).sum() > 2 * np.isfinite(equal_rooms.twins).sum()
    assert database.everywhere is seen


def test_a_place_in_a_small_region_is_found_with_a_database_too():
    cells = two_rooms().cells.copy()
    cells[20:28, 46:52] = FREE  # between the rooms
    cells[[19, 28], 46:52] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1)
    place = [(4.9, 2.4)]
    database = ScanDatabase(grid, LIDAR, clearance=0.25)
    assert not database.everywhere.fits[24, 49]
    found = find_twins(grid, robot=Robot(LIDAR), places=place, database=database)
    assert found.elsewhere[0] < 1
    np.testing.assert_array_equal(
        found.twins, find_twins(grid, robot=Robot(LIDAR), places=place).twins
    )
    near = dataclasses.replace(found, spacing=0.2)  # matches are verified around the place alone
    assert near.verify(10, disturbances=QUIET).failed.mean() < 0.3


def test_layers_are_those_of_the_nearest_place(equal_rooms):
    layer = equal_rooms.layer("elsewhere")
    fits = ScanDatabase(equal_rooms.grid, LIDAR, 0.25).everywhere.fits
    assert np.isfinite(layer[fits]).all()
    assert np.isnan(layer[~equal_rooms.grid.free]).all()
    n = equal_rooms.nearest(*equal_rooms.places[7])
    assert n == 7
    assert layer[equal_rooms.grid.world_to_cell(*equal_rooms.places[7])] == pytest.approx(
        equal_rooms.elsewhere[7]
    )
    costs = locplan.Costmap.from_density(equal_rooms.grid, equal_rooms.density(3.0))
    assert np.nanmax(costs.density[np.isfinite(costs.density)]) == pytest.approx(
        1 + 3 * equal_rooms.elsewhere.max()
    )
    blank = locplan.Costmap.blank(equal_rooms.grid)
    np.testing.assert_array_equal(np.isfinite(costs.density), np.isfinite(blank.density))
    with pytest.raises(LocplanError, match="layer must be one of"):
        equal_rooms.layer("colour")
    with pytest.raises(LocplanError, match="stride"):
        equal_rooms.layer("excess", stride=0)


@pytest.mark.parametrize("stride", [2, 3, 7])
def test_a_layer_of_a_stride_has_the_values_of_every_so_many_th_cell(equal_rooms, stride):
    for name in ("excess", "modes"):
        own, every = equal_rooms.layer(name, stride=stride), equal_rooms.layer(name)
        np.testing.assert_array_equal(own, every[::stride, ::stride])
    assert np.isfinite(own).any()


def test_starts_are_the_safest_places_apart(equal_rooms):
    places = np.array([[x, 0.0] for x in range(10)], float)
    excess = np.array([9.0, 9, 9, 1, 20, 8, 8, 8, 7, 7])
    row = dataclasses.replace(
        equal_rooms,
        places=places,
        spacing=1.0,
        values={"excess": excess[:, None], "elsewhere": np.exp(-excess)[:, None]},
    )
    starts = row.best_starts(3, apart=2.0)
    assert [start.x for start in starts] == [0.0, 5.0, 7.0]  # 20 stands beside 1
    assert [start.excess for start in starts] == [9.0, 8.0, 7.0]
    assert starts[0].elsewhere == math.exp(-9)


def test_rooms_that_differ_are_safe_to_start_in():
    other = room((1, 5, 1, 20), (30, 33, 20, 36))
    grid = side_by_side(room(), other, room())
    found = find_twins(grid, robot=Robot(LIDAR))
    for start in found.best_starts(2, apart=1.0):
        assert 5.4 < start.x < 9.8
        assert start.elsewhere < 0.1


def test_matches_of_noisy_scans_fail_as_often_as_foreseen(equal_rooms, one_room):
    sure = one_room.verify(60, disturbances=QUIET)
    assert not sure.failed.any()
    assert math.isnan(sure.auc)
    assert "no match was wrong" in one_room.report(matches=sure)
    halves = equal_rooms.verify(200, disturbances=QUIET, seed=3)
    assert halves.failure_rate.low < halves.elsewhere.mean() < halves.failure_rate.high
    assert halves.named_share > 0.95
    again = equal_rooms.verify(200, disturbances=QUIET, seed=3, threads=1)
    np.testing.assert_array_equal(again.matched, halves.matched)
    assert sum(count for count, _, _ in halves.reliability()) == 200


@pytest.mark.long
def test_failed_matches_in_a_warehouse_are_foreseen_and_named():
    grid = locplan.maps.environments.make("warehouse", resolution=0.05)
    found = find_twins(grid, robot=Robot(Lidar.preset("rplidar-a1")))
    matches = found.verify(500)
    assert matches.auc > 0.9
    assert matches.named_share > 0.8
    low, high = matches.failure_rate.low, matches.failure_rate.high
    assert low < matches.elsewhere.mean() < high


@pytest.mark.long
@pytest.mark.parametrize(("beams", "holds"), [(36, True), (9, False)], ids=["fitted", "few"])
def test_nats_are_those_of_noisy_matches_with_the_fitted_number_of_beams(beams, holds):
    """Matches fail as often as the share elsewhere says, in each range of it.

    Twins of these maps are nearly equal, so that more beams would be right, too.
    """
    every = []
    for name in ("warehouse", "office"):
        grid = locplan.maps.environments.make(name, resolution=0.05)
        lidar = Lidar.preset("rplidar-a1")
        found = find_twins(grid, robot=Robot(lidar), spacing=1.2, global_effective_beams=beams)
        every.append(found.verify(1200, seed=7))
    names = [field.name for field in dataclasses.fields(GlobalMatches)]
    arrays = [np.concatenate([getattr(each, name) for each in every]) for name in names]
    said = np.concatenate([each.elsewhere for each in every])
    apart = []
    for low, high in itertools.pairwise((0.0, 0.02, 0.15, 0.45, 0.75, 1.01)):
        own = (said >= low) & (said < high)
        if own.sum() < 20:
            continue
        around = GlobalMatches(*(each[own] for each in arrays)).failure_rate
        apart.append(max(around.low - said[own].mean(), said[own].mean() - around.high))
    assert (max(apart) < 0.06) == holds


def test_the_area_under_the_curve_counts_pairs():
    scores, positive = np.array([3.0, 1.0, 2.0, 2.0]), np.array([True, False, True, False])
    poses = np.zeros((4, 3))
    matched = np.where(positive[:, None], 5.0, 0.0) * np.ones(3)
    made = GlobalMatches(poses, matched, scores, scores, positive)
    assert made.failed.tolist() == positive.tolist()
    assert made.auc == pytest.approx((2 + 1.5) / 4)


def test_places_lie_one_in_each_square_where_the_robot_fits():
    fits = np.zeros((8, 9), bool)
    fits[1, 2] = fits[2, 2] = fits[6, 7] = True
    assert places_every(0.4, fits, 0.1).tolist() == [[2.5, 1.5], [7.5, 6.5]]


def test_places_do_not_depend_on_the_strips_that_are_looked_through(monkeypatch):
    fits = np.random.default_rng(4).random((61, 47)) < 0.3
    monkeypatch.setattr("locplan.matching._database.BAND", 10**6)
    whole = places_every(0.5, fits, 0.1)
    expected = {}  # the cell next to the middle of each square, the first one in order of rows
    for row, col in np.argwhere(fits).tolist():
        aside = (row % 5 - 2) ** 2 + (col % 5 - 2) ** 2
        square = expected.setdefault((row // 5, col // 5), (aside, row, col))
        expected[row // 5, col // 5] = min(square, (aside, row, col))
    assert whole.tolist() == [[c + 0.5, r + 0.5] for _, (_, r, c) in sorted(expected.items())]
    monkeypatch.setattr("locplan.matching._database.BAND", 600)
    np.testing.assert_array_equal(places_every(0.5, fits, 0.1), whole)


@pytest.mark.parametrize("band", [1, 1000, 10**6])
@pytest.mark.parametrize("settings", [{}, {"sigma_hit": 0.02}, {"z_rand": 0.6, "sigma_hit": 0.3}])
def test_losses_in_strips_are_those_of_the_whole_map(monkeypatch, band, settings):
    monkeypatch.setattr("locplan.matching._matching.BAND", band)
    cells = np.where(np.random.default_rng(5).random((70, 40)) < 0.004, OCCUPIED, FREE)
    grid = OccupancyGrid(cells.astype(np.uint8), 0.05)
    matching, steps = Matching(lidar=LIDAR, **settings), []
    made = make_database(grid, matching, progress=lambda *step: steps.append(step)).tables
    assert steps == sorted(steps)
    assert steps[-1][0] == steps[-1][1]
    expected = naive.loss_tables(
        grid.cells == OCCUPIED, 0.05, matching.sigmas(0.05), matching.z_rand, made.margin
    )
    np.testing.assert_array_equal(made.corners.reshape(expected.shape), expected)


def test_a_database_that_is_prepared_tells_how_far_it_is_and_can_be_ended():
    grid = side_by_side(room())
    told: list[tuple[int, int]] = []
    database = ScanDatabase(grid, LIDAR, 0.15)
    before = code_digest(database, [])

    def stop(done, total):
        told.append((done, total))
        if len(told) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        database.prepare(stop)
    assert len(told) == 2
    told.clear()
    database.prepare(lambda *step: told.append(step))
    assert told == sorted(told)
    assert told[-1][0] == told[-1][1]
    everywhere = database.everywhere
    database.prepare(stop)  # there is nothing left to do
    assert database.everywhere is everywhere
    assert code_digest(database, []) == before  # a user's estimator may hold it
    np.testing.assert_array_equal(
        everywhere.codes, ScanDatabase(grid, LIDAR, 0.15).everywhere.codes
    )


def test_specks_of_free_space_are_not_reachable_unless_asked_for():
    cells = np.full((60, 60), UNKNOWN, np.uint8)
    cells[2:40, 2:40] = FREE
    cells[50:58, 50:58] = FREE
    cells[0] = OCCUPIED
    grid, matching = OccupancyGrid(cells, 0.1), Matching(lidar=LIDAR, robot_radius=0.0)
    fits = make_database(grid, matching).fits
    assert not fits[54, 54]
    assert fits[20, 20]
    assert make_database(grid, matching, [(54, 54)]).fits[54, 54]


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"places": [(-3.0, 1.0)]}, "lies outside the map"),
        ({"places": [(0.05, 0.05)]}, "lies in a wall"),
        ({"places": [(math.nan, 1.0)]}, "must be finite"),
        ({"places": [(1.0, "x")]}, "two numbers"),
        ({"places": []}, "at least one place"),
        ({"places": 3}, "places must be positions"),
        ({"spacing": 0.0}, "spacing must be"),
        ({"spacing": math.nan}, "spacing must be"),
        ({"spacing": 0.09}, "spacing must be at least a cell of the map"),
        ({"global_effective_beams": -1.0}, "global_effective_beams must be"),
        ({"robot": Robot(LIDAR, footprint=9.0)}, "fits nowhere"),
        ({"robot": "rplidar-a1"}, "robot must be a Robot"),
        ({"threads": 0}, "threads"),
    ],
)
def test_bad_arguments_are_refused(settings, says):
    with pytest.raises(LocplanError, match=says):
        find_twins(**({"grid": side_by_side(room()), "robot": Robot(LIDAR)} | settings))


def test_a_database_serves_many_searches(monkeypatch):
    grid = side_by_side(room())
    cells = grid.cells.copy()
    cells[-8:, -8:] = OCCUPIED
    cells[-6:-1, -6:-1] = FREE  # a closet, too small to be looked at unasked
    grid = OccupancyGrid(cells, grid.resolution)
    closet = grid.cell_to_world(grid.shape[0] - 4, grid.shape[1] - 4)
    asked = [
        {"places": [(1.2, 3.0)], "count_missing": True},
        {"places": [(1.2, 3.0), closet], "global_effective_beams": 20.0},
        {"spacing": 2.0},
    ]
    robot = Robot(LIDAR, footprint=0.15, margin=0.0)
    expected = [find_twins(grid, robot, **each) for each in asked]
    database = ScanDatabase(grid, LIDAR, 0.15)
    assert not database.everywhere.fits[grid.world_to_cell(*closet)]
    made = []
    making = "locplan.twins._find.make_database"
    monkeypatch.setattr(making, lambda *given: made.append(given) or make_database(*given))
    for each, twins in zip(asked, expected, strict=True):
        found = find_twins(grid, robot, database=database, **each)
        np.testing.assert_array_equal(found.places, twins.places)
        np.testing.assert_array_equal(found.twins, twins.twins)
        for name in twins.values:
            np.testing.assert_array_equal(found.values[name], twins.values[name])
        assert found.matching == twins.matching
    assert len(made) == 1  # for the closet
    for other, says in (
        ({"robot": dataclasses.replace(robot, lidar=Lidar(range=5.0))}, "of another map or lidar"),
        ({"grid": two_rooms()}, "of another map or lidar"),
        ({"robot": robot.changed({"footprint": 0.2})}, r"clearance of 0\.15 m, not the robot"),
    ):
        given = {"grid": grid, "robot": robot, **other}
        with pytest.raises(LocplanError, match=says):
            find_twins(**given, database=database)


def test_a_map_without_walls_is_refused():
    with pytest.raises(LocplanError, match="no occupied cell"):
        find_twins(OccupancyGrid(np.full((20, 20), FREE), 0.1), robot=Robot(LIDAR))


def test_a_lidar_of_hardly_any_range_tells_nothing():
    found = find_twins(two_rooms(), robot=Robot(Lidar(range=0.05)))
    assert (found.elsewhere == 1.0).all()
    assert found.unseen == 1.0
    assert "too few beams return" in found.report()
    assert found.symmetries == ()


def test_matching_refuses_what_makes_no_sense():
    for wrong in ({"z_rand": 1.0}, {"z_rand": 0.0}, {"shortlisted": 0}, {"count_missing": 1}):
        with pytest.raises(LocplanError, match=next(iter(wrong))):
            Matching(lidar=LIDAR, **wrong)


def test_coarse_maps_are_matched_with_a_cells_deviation():
    assert Matching(lidar=LIDAR).sigmas(0.05).tolist() == [0.4, 0.2, 0.1]
    assert Matching(lidar=LIDAR).sigmas(0.2).tolist() == [0.4, 0.2]
    assert Matching(lidar=LIDAR).sigmas(0.5).tolist() == [0.5]


@pytest.fixture
def map_file(tmp_path):
    save_map(two_rooms(), tmp_path / "rooms.yaml")
    return tmp_path / "rooms.yaml"


@pytest.mark.draws
def test_the_command_writes_layers_starts_and_a_picture(run, map_file, tmp_path):
    folder = tmp_path / "alike"
    options = "--set", "range=8", "--starts", 2, "--matches", 20, "-o", folder
    code, said, err = run("twins", map_file, *options)
    assert (code, err) == (0, f"wrote {folder}\n")
    assert "100% of" in said
    assert "+5.4" in said
    assert "no start is safe" in said
    assert "20 noisy scans" in said
    assert {file.name for file in folder.iterdir()} >= {"twins.json", "twins.png", "starts.csv"}
    about = json.loads((folder / "twins.json").read_text())
    assert about["share_with_twin"] == 1.0
    assert about["matches"]["matches"] == 20
    assert len(about["starts"]) == 2
    rows = np.genfromtxt(folder / "twins.csv", delimiter=",", names=True)
    layers = np.load(folder / "twins.npz")
    assert rows.size == about["places"] == len(layers["places"])
    assert all(layers[name].shape == two_rooms().shape for name in LAYERS)
    assert rows["twin_excess"].max() < 0.2


def test_the_command_tells_the_twins_of_a_place(run, map_file):
    code, said, _ = run("twins", map_file, "--set", "range=8", "--at", "1.2,3.0")
    assert code == 0
    assert "of the posterior lies more than 2 m away" in said
    assert "6.60" in said
    code, said, _ = run("twins", map_file, "--set", "range=8", "--at", "1.2,3.0", "--json")
    best = json.loads(said)["at"]["twins"][0]
    assert best["x"] == pytest.approx(6.6, abs=0.05)


@pytest.mark.parametrize(
    "options",
    [
        ("--at", "0,0"),
        ("--at", "1"),
        ("--at", "1.2,3.0", "--starts", 3),
        ("--at", "1.2,3.0", "--matches", 30),
        ("--spacing", 0),
        ("--matches", 1),
        ("--seed", 3),
        ("--lidar", "none-such"),
        ("--set", "footprint=40"),
    ],
)
def test_the_command_refuses_in_one_line(run, map_file, options):
    refused(run("twins", map_file, *options))


def test_the_figure_joins_places_with_their_twins(equal_rooms):
    figure = twins_figure(equal_rooms, equal_rooms.best_starts(3, apart=2.0))
    axes = figure.axes[0]
    check_looks(figure, "twins")
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[0] == "twins by symmetry 1"
    assert "best starts, at most" in labels[-1]
    (lines, *_) = axes.collections
    assert 0 < len(lines.get_segments()) <= 24
    assert {text.get_text() for text in axes.texts} == {"1", "2", "3"}
    assert "100% of" in axes.get_title(loc="left")


def test_the_figure_of_a_place_numbers_its_twins(equal_rooms):
    alone = find_twins(equal_rooms.grid, robot=Robot(LIDAR), places=equal_rooms.places[3:4])
    axes = alone.figure().axes[0]
    assert {text.get_text() for text in axes.texts} == {
        str(n) for n, _ in enumerate(alone.of(0), 1)
    }
    ends = {tuple(line.get_xydata()[-1]) for line in axes.lines}
    twins, place = {(x, y) for x, y, *_ in alone.of(0)}, tuple(alone.places[0])
    assert ends == twins | {place}
    ways = {tuple(map(tuple, line.get_xydata())) for line in axes.lines}
    assert {(place, twin) for twin in twins} <= ways  # each is joined with the place
    assert "50% of the posterior" in axes.get_title(loc="left")


def test_one_place_has_its_twins_in_text_and_figure(equal_rooms):
    alone = find_twins(equal_rooms.grid, robot=Robot(LIDAR), places=[(1.2, 3.0)])
    about = alone.summary()["at"]
    assert [each["x"] for each in about["twins"]] == [twin.x for twin in alone.of(0)]
    assert (about["x"], about["elsewhere"]) == (alone.places[0, 0], alone.elsewhere[0])
    assert "heading here [deg]" in alone.report()
    assert "start" not in alone.report()
    assert "% of the posterior" in alone.figure().axes[0].get_title(loc="left")


def test_a_figure_without_twins_has_no_lines(one_room):
    axes = twins_figure(one_room, []).axes[0]
    assert not axes.collections
    assert axes.get_legend() is None


def test_the_repr_and_the_summary_say_what_was_found(equal_rooms):
    assert repr(equal_rooms) == (
        f"Twins({len(equal_rooms)} places of rooms, 100% with a twin, 2 symmetries)"
    )
    about = equal_rooms.summary()
    assert about["places"] == len(equal_rooms)
    assert json.dumps(about, allow_nan=False)
    assert about["matching"]["lidar"]["range"] == 8.0
    first, record = equal_rooms.symmetries[0], about["symmetries"][0]
    assert (record["turn"], record["share"]) == (first.turn, first.share)
    assert (record["shift_x"], record["shift_y"]) == first.shift
    assert first.shift == tuple(np.subtract(first.moved, first.middle))
    assert (record["middle_x"], record["middle_y"]) == first.middle
    assert "at" not in about
    assert about["starts"][0]["x"] == equal_rooms.best_starts()[0].x


def test_the_table_has_the_layers_and_the_best_twin_of_each_place(equal_rooms):
    for n, record in enumerate(equal_rooms.table().records()):
        best = equal_rooms.of(n)[0]
        assert [record["x"], record["y"]] == equal_rooms.places[n].tolist()
        assert (record["stretch"], record["excess"]) == (
            equal_rooms.stretch[n],
            equal_rooms.excess[n],
        )
        assert (record["twin_x"], record["twin_excess"]) == (best.x, best.excess)
        assert record["here"] == best.here


def test_places_without_a_twin_have_none_in_the_table(one_room):
    alone = [n for n in range(len(one_room)) if not one_room.of(n)]
    assert alone
    assert one_room.table().records()[alone[0]]["twin_x"] is None
