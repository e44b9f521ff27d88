"""Ambiguous places: those that one scan cannot tell from another, and safe starts."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from support.maps import corridor
from support.rooms import LIDAR, join_rooms, room_cells, two_rooms

import locplan
from locplan import Lidar, LocplanError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, save_map
from locplan.recordings.ambiguous_places import AmbiguousPlaces, find_ambiguous_places
from locplan.robots import Robot


@pytest.fixture(scope="module")
def equal_rooms():
    return find_ambiguous_places(two_rooms(), Robot(LIDAR))


def test_places_in_twin_rooms_are_ambiguous(equal_rooms):
    assert len(equal_rooms.places) > 10
    np.testing.assert_allclose(equal_rooms.excess, 0.0, atol=0.1)
    np.testing.assert_allclose(equal_rooms.elsewhere, 0.5, atol=0.1)
    assert equal_rooms.share == 1.0
    assert equal_rooms.is_ambiguous.all()
    assert equal_rooms.starts.shape == (0, 2)
    assert equal_rooms.sentence == (
        "100 % of the places are ambiguous to one scan, and no start is safe: set the initial pose"
    )


def test_places_in_single_room_are_unambiguous():
    found = find_ambiguous_places(join_rooms(room_cells()), Robot(LIDAR))
    assert found.share == 0.0
    assert found.elsewhere.max() < 0.05
    assert found.sentence.startswith("0 % of the places are ambiguous to one scan; safe starts: ")


def test_places_along_corridor_are_ambiguous():
    grid = corridor(30.0, 2.0, resolution=0.1)
    found = find_ambiguous_places(grid, Robot(Lidar(range=5.0)))
    inner = np.abs(found.places[:, 0]) < 9.0
    assert found.is_ambiguous[inner].all()
    assert (found.elsewhere[inner] > 0.5).all()


def test_safe_starts_lie_in_unique_room():
    other = room_cells((1, 5, 1, 20), (30, 33, 20, 36))
    grid = join_rooms(room_cells(), other, room_cells())
    found = find_ambiguous_places(grid, Robot(LIDAR), spacing=0.8)
    assert 0.3 < found.share < 0.9
    assert len(found.starts) >= 1
    assert ((found.starts[:, 0] > 5.4) & (found.starts[:, 0] < 9.8)).all()


def test_safe_starts_avoid_ambiguous_neighbours():
    places = np.column_stack([np.arange(12.0), np.zeros(12)])
    excess = np.array([9.0, 9, 9, 1, 20, 8, 8, 8, 7, 7, 7, 2.9])
    row = AmbiguousPlaces(places, excess, np.exp(-excess), 1.0)
    assert row.starts[:, 0].tolist() == [0.0, 5.0, 8.0]  # 20 stands beside 1
    assert row.share == pytest.approx(2 / 12)
    low = dataclasses.replace(row, excess=np.minimum(excess, 3.0))
    assert low.starts.shape == (0, 2)


def test_places_rotate_with_map_yaw(equal_rooms):
    yaw = 0.7
    found = find_ambiguous_places(two_rooms(origin=(3.0, -2.0, yaw)), Robot(LIDAR))
    np.testing.assert_array_equal(found.excess, equal_rooms.excess)
    cos, sin = math.cos(yaw), math.sin(yaw)
    turned = equal_rooms.places @ np.array([[cos, sin], [-sin, cos]]) + (3.0, -2.0)
    np.testing.assert_allclose(found.places, turned, atol=1e-9)


def test_narrow_lidar_counts_worst_heading():
    cells = two_rooms().cells.copy()
    cells[10:20, 80:97] = OCCUPIED  # only one end of the second room differs
    ahead = Lidar(range=8.0, field_of_view_deg=90.0)
    found = find_ambiguous_places(OccupancyGrid(cells, 0.1), Robot(ahead))
    around = find_ambiguous_places(OccupancyGrid(cells, 0.1), Robot(LIDAR))
    assert found.excess.shape == around.excess.shape
    assert found.share > around.share


def test_thread_count_does_not_change_results(equal_rooms):
    told = []
    again = find_ambiguous_places(
        two_rooms(), Robot(LIDAR), threads=3, progress=lambda *done: told.append(done)
    )
    np.testing.assert_array_equal(again.excess, equal_rooms.excess)
    assert told == sorted(told)
    assert told[-1] == (len(again.places),) * 2


def test_places_without_returns_are_ambiguous():
    found = find_ambiguous_places(two_rooms(), Robot(Lidar(range=0.05)))
    assert (found.elsewhere == 1.0).all()
    assert found.share == 1.0


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"spacing": 0.0}, "spacing must be"),
        ({"spacing": math.nan}, "spacing must be"),
        ({"spacing": 0.09}, "spacing must be at least a cell of the map"),
        ({"robot": Robot(LIDAR, footprint=9.0)}, "fits nowhere"),
        ({"robot": "rplidar-a1"}, "robot must be a Robot"),
        ({"threads": 0}, "threads"),
        ({"grid": OccupancyGrid(np.full((20, 20), FREE), 0.1)}, "no walls"),
    ],
)
def test_bad_arguments_are_refused(settings, says):
    with pytest.raises(LocplanError, match=says):
        find_ambiguous_places(
            **({"grid": join_rooms(room_cells()), "robot": Robot(LIDAR)} | settings)
        )


def test_info_reports_ambiguous_places(run, tmp_path):
    save_map(join_rooms(room_cells()), tmp_path / "room.yaml")
    lidar = "--set", "range=8"
    code, out, err = run("info", tmp_path / "room.yaml", *lidar)
    assert code == 0, err
    found = find_ambiguous_places(locplan.load_map(tmp_path / "room.yaml"), Robot(LIDAR))
    assert found.sentence in out
    _, out, _ = run("info", tmp_path / "room.yaml", *lidar, "--json")
    assert json.loads(out)["ambiguous"] == {"share": found.share, "starts": found.starts.tolist()}
    _, out, _ = run("info", tmp_path / "room.yaml")
    assert "ambiguous to one scan" not in out


def test_info_explains_unknown_ambiguous_places(run, tmp_path):
    save_map(OccupancyGrid(np.full((40, 40), FREE, np.uint8), 0.1), tmp_path / "open.yaml")
    code, out, _ = run("info", tmp_path / "open.yaml", "--set", "range=8")
    assert code == 0
    assert "ambiguous places: unknown (open has no walls" in out
