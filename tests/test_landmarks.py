"""Landmarks: objects, places for them, what they tell, the search, and its verification."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import math

import naive
import numpy as np
import pytest
from conftest import corridor, drawn, few_of, refused
from figure_looks import check_looks

import locplan
from locplan import Box, LocplanError, Path, Pole, place_landmarks, save_map
from locplan._kernels import features as sightings, landmarks as kernels, objectives as ways
from locplan._kernels.rays import cast, empty_squares
from locplan.errors import ConfigError
from locplan.field import FieldConfig, Fused, covariances_along, scalar, surface_normals
from locplan.landmarks import (
    Outcome,
    Sites,
    Verification,
    best_of_trials,
    cells_under,
    landmarks_figure,
    parsed_object,
    with_objects,
)
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from locplan.robots import Amcl, Lidar, Robot
from locplan.simulation import Drives

PRODUCT = Amcl(laser_model_type="likelihood_field_prob", min_particles=100, max_particles=100)
SHORT = Lidar(range=3.0)
DRIVEN = Robot(SHORT, filter=PRODUCT)
ROUTE = {"middle": np.array([[-6.0, 0.0], [6.0, 0.0]])}


def open_floor(rows=80, cols=120, resolution=0.1) -> OccupancyGrid:
    cells = np.full((rows, cols), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return OccupancyGrid(cells, resolution)


def hits_on(grid, rays):
    occupied = grid.cells == OCCUPIED
    hits = np.zeros((len(rays.first), rays.beams, 4), np.float32)
    scene = empty_squares(occupied), surface_normals(occupied), grid.resolution
    kernels.hits_of_map(kernels.Surfaces(*scene), rays, hits)
    return hits


def with_values(made, **values):
    """A placement with other values of what it makes by itself."""
    other = dataclasses.replace(made)
    vars(other).update(values)
    return other


def positions_of(made):
    """World x and y of all places that were searched among, (n, 2) [m]."""
    places = made.search.places
    return np.column_stack(made.setting.grid.grid_to_world(*places[:, :2].T))


@pytest.fixture(scope="module")
def hallway() -> OccupancyGrid:
    return corridor(16.0, 2.4, resolution=0.1)


@pytest.fixture(scope="module")
def placed(hallway):
    return place_landmarks(hallway, Pole(0.2), 3, robot=DRIVEN, paths=ROUTE)


def test_poses_that_no_memory_holds_are_refused(hallway, monkeypatch):
    monkeypatch.setattr("locplan._util.checks.usable_memory", lambda: 1000)
    with pytest.raises(ConfigError, match=r"poses with \d+ rays take .* take shorter routes"):
        place_landmarks(hallway, Pole(0.2), 3, robot=DRIVEN, paths=ROUTE)


# Objects


@pytest.mark.parametrize("kind", [Pole(0.5), Box(0.9, 0.4)])
def test_an_object_fills_the_cells_whose_centre_lies_within_it(kind):
    row, col, heading, edge = 20.3, 17.8, 0.5, 0.1
    grid = OccupancyGrid(np.full((40, 40), FREE, np.uint8), edge)
    rows, cols = cells_under(grid, kind, np.array([col * edge, row * edge, heading]))
    outline = kernels.Outline(*kind.shape)
    expected = {
        (i, j)
        for i, j in itertools.product(range(40), range(40))
        if naive.within_object(outline, heading, (j + 0.5 - col) * edge, (i + 0.5 - row) * edge)
    }
    assert set(zip(rows.tolist(), cols.tolist(), strict=True)) == expected


@pytest.mark.parametrize("heading", [0.0, 0.4, 1.2, 2.5])
def test_a_thin_board_lets_no_ray_through(heading):
    grid = with_objects(open_floor(), Box(2.0, 0.02), [(6.0, 4.0, heading)])
    squares = empty_squares(grid.cells == OCCUPIED)
    for share in np.linspace(-0.9, 0.9, 37):
        x, y = 6 + share * math.cos(heading), 4 + share * math.sin(heading)
        dx, dy = -math.sin(heading), math.cos(heading)
        at, _, _ = cast(squares, (y - dy) / 0.1, (x - dx) / 0.1, dy, dx, 20.0)
        assert 0.8 < at * 0.1 < 1.05


def test_objects_stand_in_the_world_also_where_the_map_is_turned():
    grid = dataclasses.replace(open_floor(), origin=(3.0, -2.0, 0.7))
    marked = with_objects(grid, Box(1.0, 0.4), [(*grid.cell_to_world(30, 50), 0.7)])
    rows, cols = np.nonzero((marked.cells == OCCUPIED) & grid.free)
    assert (np.ptp(rows) + 1, np.ptp(cols) + 1) in ((4, 10), (5, 11), (5, 10), (4, 11))
    assert (rows.mean(), cols.mean()) == pytest.approx((30, 50), abs=0.5)


def test_objects_at_the_edge_of_the_map_are_cut_off():
    assert (with_objects(open_floor(), Pole(2.0), [(0.0, 0.0), (-50, 3)]).cells == OCCUPIED).any()


@pytest.mark.parametrize("text", ["pole:", "pole:x", "pole:0.1,0.2", "box:1", "cone:2", "box:1,-1"])
def test_what_is_no_object_is_refused(text):
    if text == "pole:":
        assert parsed_object(text) == Pole()
        return
    with pytest.raises(LocplanError):
        parsed_object(text)


# Candidates and passages


def tried(grid, kind, route, robot=DRIVEN, **sites):
    """A search for one place, and why the others were refused."""
    return place_landmarks(grid, kind, 1, paths={"a": route}, robot=robot, sites=Sites(**sites))


def reason_at(made, x, y):
    """Why no object may stand at the place next to a position, or "" if one may."""
    refused = np.array([(each.x, each.y) for each in made.rejected]).reshape(-1, 2)
    apart = np.hypot(*(np.concatenate([positions_of(made), refused]) - (x, y)).T)
    n = int(np.argmin(apart)) - len(made.search.places)
    return "" if n < 0 else made.rejected[n].reason


@pytest.mark.parametrize("angle", [0.0, 0.6])
@pytest.mark.parametrize("kind", [Pole(0.3), Box(0.8, 0.3)])
def test_places_along_walls_are_clear_of_them_and_turned_as_they_are(angle, kind):
    grid = corridor(12.0, 3.0, angle=angle)
    ends = np.outer([-5.0, 5.0], [math.cos(angle), math.sin(angle)])
    kept = tried(grid, kind, ends, where="walls", clearance=0.1).search.places
    assert 25 < len(kept) < 55
    for row, col, heading in kept:
        cells = cells_under(grid, kind, np.array([*grid.grid_to_world(row, col), heading]))
        assert grid.clearance[cells].min() >= 0.05 + grid.resolution / 2 - 1e-9
        assert grid.clearance[cells].min() < 0.2
        if isinstance(kind, Box):
            assert abs(math.sin(heading - angle)) < 0.15
    first = kept[np.argsort(kept[:, 0])]
    apart = np.hypot(*np.diff(first[:, :2], axis=0).T) * grid.resolution
    assert apart.min() > 0.3


def test_free_places_have_clearance_and_a_long_object_is_tried_both_ways():
    cells = open_floor().cells.copy()
    cells[30:34, 50:54] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1)
    region, free = [(0.0, 0.0, 12.0, 8.0)], Sites(where="free")
    given = {"region": region, "robot": DRIVEN, "sites": free}
    places = place_landmarks(grid, Box(0.6, 0.3), 1, **given).search.places
    rows, cols = places[:, :2].astype(int).T
    assert (grid.clearance[rows, cols] > 1.2).all()
    assert set(places[:, 2]) == {0.0, math.pi / 2}
    poles = place_landmarks(grid, Pole(0.2), 1, **given).search.places
    assert 40 < len(poles) <= len(places) <= 2 * len(poles)


@pytest.mark.parametrize(("turn", "corners"), [(0.0, 2), (0.8, 500)])
def test_places_beside_routes_are_as_near_as_allowed(turn, corners):
    grid = dataclasses.replace(open_floor(), origin=(1.0, 2.0, turn))
    cols = np.linspace(20.0, 100.0, corners)
    line = np.column_stack(grid.grid_to_world(np.full(corners, 40.0), cols))
    kind = Box(0.8, 0.2)
    places = tried(grid, kind, line, where="free", spacing=0.4, clearance=0.25).search.places
    aside = np.abs(places[:, 0] - 40) * 0.1
    along = np.abs(np.sin(places[:, 2])) < 1e-6
    near = np.where(along, 0.5 + 0.1 + 0.1, 0.5 + 0.4 + 0.1)  # radius, clearance, half the object
    beside = np.isclose(aside, near)
    assert (beside & along).sum() == (beside & ~along).sum() == 42
    assert (aside >= near - 0.11).all()


DOOR = drawn(
    "####################",
    *["#.........#........#"] * 4,
    *["#..................#"] * 2,
    *["#.........#........#"] * 4,
    "####################",
    resolution=0.5,
)


def passages_of(grid, kind, radius, clearance, route=((1.0, 1.0), (1.5, 1.0))):
    """Space of a robot, as a search has it."""
    robot = Robot(SHORT, footprint=radius, margin=0.0, filter=PRODUCT)
    return tried(grid, kind, np.array(route), robot, clearance=clearance).search.passages


def test_what_would_close_a_door_is_refused():
    passages = passages_of(DOOR, Pole(0.3), 0.25, 0.1)
    assert passages.cuts(np.array([6.0, 10.5, 0.0]))
    assert not passages.cuts(np.array([3.0, 4.0, 0.0]))


def test_the_clearance_counts_only_where_the_robot_had_it():
    # with the clearance the door is closed anyway
    narrow = passages_of(DOOR, Pole(0.2), 0.25, 0.5, ((1.25, 1.25), (1.5, 1.25)))
    assert narrow.cuts(np.array([6.0, 10.5, 0.0]))
    assert not narrow.cuts(np.array([6.0, 15.0, 0.0]))


def test_two_objects_may_close_what_one_leaves_open():
    grid = open_floor(30, 120)  # 2.8 m wide
    low, high = np.array([9.0, 60.0, 0.0]), np.array([21.0, 60.0, 0.0])
    passages = passages_of(grid, Pole(0.4), 0.3, 0.1)
    assert not passages.cuts(low)
    assert not passages.cuts(high)
    other = passages.copy()
    passages.place(low)
    assert passages.cuts(high)
    assert not other.cuts(high)


def test_a_pocket_is_no_passage():
    passages = passages_of(open_floor(60, 60), Pole(0.4), 0.3, 0.0)
    assert not passages.cuts(np.array([8.8, 8.8, 0.0]))


def test_each_refusal_has_its_reason():
    grid = open_floor()
    route, robot = np.array([[4.0, 4.2], [8.0, 4.2]]), Robot(SHORT, filter=PRODUCT)
    given = {"spacing": 0.2, "clearance": 0.05, "keep_out": [(1.5, 3.5, 2.5, 4.5)]}
    made = tried(grid, Pole(1.2), route, robot, **given)
    assert reason_at(made, 6.5, 3.5) == "in the way of a route"
    assert reason_at(made, 2.5, 4.5) == "in an area that is kept out"
    assert reason_at(made, 4.5, 2.5) == ""
    marked = with_objects(grid, Pole(0.4), [(4.5, 2.5)])
    said = "less than 5 cm from a wall or another object"
    assert reason_at(tried(marked, Pole(3.0), route, robot, **given), 4.5, 1.5) == said
    before_door, walls = (
        np.array([[1.25, 4.0], [1.25, 1.25]]),
        {"where": "walls", "clearance": 0.05},
    )
    door = tried(DOOR, Box(0.6, 0.3), before_door, **walls)
    assert door.reasons()["cuts a passage for the robot"] == 2


@pytest.mark.parametrize("unknown", [False, True])
def test_no_object_reaches_beyond_the_map_or_into_what_is_unknown(unknown):
    cells = np.full((80, 100), FREE, np.uint8)
    cells[:, 60:] = UNKNOWN if unknown else FREE
    grid, edge = OccupancyGrid(cells, 0.1), 6.0 if unknown else 10.0
    seeing, route = Robot(Lidar(range=9.0), filter=PRODUCT), np.array([[3.0, 4.0], [3.2, 4.0]])
    made = tried(grid, Box(2.2, 0.4), route, seeing, where="free")
    stands = [*zip(*positions_of(made).T, made.search.places[:, 2], strict=True)]
    refused = [(each.x, each.y, each.heading, each.reason) for each in made.rejected]
    beyond = [pose for *pose, reason in refused if reason.startswith("reaches beyond the map")]
    stands += [pose for *pose, reason in refused if not reason.startswith("reaches beyond the map")]
    for poses, inside in ((stands, True), (beyond, False)):
        assert len(poses) > 10
        for x, y, heading in poses:
            wide, high = (1.1, 0.2) if abs(math.sin(heading)) < 0.5 else (0.2, 1.1)
            assert (wide <= x <= edge - wide and high <= y <= 8.0 - high) == inside


def test_an_object_that_closes_the_gap_of_a_view_is_seen_on_both_sides():
    grid, kind = open_floor(), Box(1.0, 0.1)
    lidar = Lidar(range=3.0, field_of_view_deg=300.0)
    made = tried(grid, kind, np.array([[6.0, 4.0], [6.5, 4.0]]), Robot(lidar, filter=PRODUCT))
    rays = made.search.objective.sight.seen.rays
    assert not rays.all_round
    hits = hits_on(grid, rays)
    before = hits.copy()
    behind = 5.4, 4.0, math.pi / 2
    touched = np.zeros(len(hits), bool)
    kernels.add_object(hits, rays, kernels.Outline(*kind.shape), *behind, touched)
    met = np.flatnonzero(hits[0, :, 0] < before[0, :, 0])
    assert met[0] == 0
    assert met[-1] == rays.beams - 1
    bearings = np.abs(rays.first[0] + met * rays.step)
    assert bearings.min() == pytest.approx(math.pi - math.atan2(0.5, 0.55), abs=0.02)
    assert (met < rays.beams / 2).sum() == (met > rays.beams / 2).sum()


def test_boxes_are_apart_by_their_outlines(hallway):
    made = tried(hallway, Box(1.0, 0.2), ROUTE["middle"], spacing=0.1, where="walls")
    search, at = made.search, positions_of(made)
    one = int(np.argmin(np.hypot(*(at - (0.0, 0.9)).T)))
    apart = np.hypot(*(at - at[one]).T)
    along = (np.abs(at[:, 1] - at[one, 1]) < 0.05) & (apart > 0.5)
    for n in np.flatnonzero(along & (apart < 1.6)):
        near = search.fault(int(n), [one], search.passages) == "too close to another landmark"
        assert near == (apart[n] < 1.05 - 1e-9)
    assert (apart[along] < 1.05).any()


def test_rectangles_that_are_kept_out_lie_in_the_world(hallway):
    grid = dataclasses.replace(open_floor(), origin=(0.0, 0.0, math.pi / 2))
    route = np.array([[-2.5, 2.0], [-2.5, 7.0]])
    made = tried(grid, Pole(0.1), route, spacing=0.2, keep_out=[(-2.0, 3.0, -1.0, 5.0)])
    kept_out = np.array([(e.x, e.y) for e in made.rejected if e.reason.endswith("is kept out")])
    within = (np.abs(kept_out - (-1.5, 4.0)) <= (0.56, 1.06)).all(axis=1)
    assert len(kept_out) > 1
    assert within.all()
    assert not (np.abs(positions_of(made) - (-1.5, 4.0)) < (0.5, 1.0)).all(axis=1).any()
    for wrong in ([(1, 2, 3)], "abc", np.ones((3, 3), bool)):
        with pytest.raises(LocplanError, match="keep_out"):
            tried(hallway, Pole(0.2), ROUTE["middle"], keep_out=wrong)


# Kernels


def small_scene(least=0.0, view=360.0):
    """A small map with poses, and an object kind; few rays, so that the oracle takes no time."""
    grid = drawn(
        "############",
        "#..........#",
        "#...#......#",
        "#..........#",
        "#.......#..#",
        "#..........#",
        "############",
        resolution=0.5,
    )
    width, beams = math.radians(view), 41
    poses = np.array([[1.1, 1.3], [2.2, 1.25], [3.3, 1.9], [4.6, 1.6]])
    return grid, kernels.Rays(
        poses,
        np.array([[0.1, 0.05], [0.1, -0.02], [0.08, 0.0], [0.0, 0.1]]),
        np.array([0.3, -2.0, 4.0, 11.0]) - width / 2,
        width / beams,
        beams,
        view == 360,
        least,
        3.5,
        0.2,
    )


def as_matrix(sums):
    xx, xy, yy, xt, yt, tt = sums[:6]
    return np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])


OUTLINES = [kernels.Outline(0.15, 0.15, True), kernels.Outline(0.4, 0.1, False)]


@pytest.mark.parametrize("outline", OUTLINES)
@pytest.mark.parametrize(("least", "view"), [(0.0, 360.0), (0.6, 200.0), (0.0, 90.0)])
def test_what_objects_tell_is_that_of_plain_loops(outline, least, view):
    grid, rays = small_scene(least, view)
    occupied = grid.cells == OCCUPIED
    normals = surface_normals(occupied)
    hits = hits_on(grid, rays)
    sums = kernels.sums_of(hits, rays)
    objects = [(3.0, 2.6, 0.7), (1.9, 2.1, 2.0)]
    changed = np.empty(7)
    for n in (1, 2):
        for place in objects:
            wanted = naive.landmark_information(occupied, normals, 0.5, rays, n, outline, [place])
            begin, count = sightings.seeing_rays(hits, rays, n, outline, *place)
            scene = kernels.Scene(hits, sums, rays, outline)
            meets = count > 0 and kernels.with_object(scene, n, place, begin, count, changed)
            found = as_matrix(changed if meets else sums[n])
            np.testing.assert_allclose(found, wanted, atol=2e-4)
    touched = np.zeros(len(hits), bool)
    for place in objects:
        kernels.add_object(hits, rays, outline, *place, touched)
    sums = kernels.sums_of(hits, rays)
    for n in (1, 2):
        wanted = naive.landmark_information(occupied, normals, 0.5, rays, n, outline, objects)
        np.testing.assert_allclose(as_matrix(sums[n]), wanted, atol=2e-4)


def sightings_of(hits, rays, outline, places):
    counts, starts = np.zeros(len(places), np.int64), np.zeros(len(places) + 1, np.int64)
    for _ in range(2):  # the first time without room
        room = starts[-1]
        made = np.empty(room, np.int32), np.empty((room, 2), np.int16)
        seen = sightings.Sightings(starts, *made)
        sightings.find_sightings(places, 0, len(places), hits, rays, outline, seen, counts)
        starts = np.concatenate([[0], np.cumsum(counts)])
    return seen


@pytest.mark.parametrize("outline", OUTLINES)
def test_the_objective_is_that_of_plain_matrices(outline):
    grid, rays = small_scene()
    normals = surface_normals(grid.cells == OCCUPIED)
    routes, told = np.array([0, 3, 4]), ways.Sensing(2.0, 0.03)
    motion = ways.Motion(0.05, 0.003, 0.1, 0.02, 0.01)
    hits = hits_on(grid, rays)
    sums = kernels.sums_of(hits, rays)
    places = np.array([(3.0, 2.6, 0.7), (1.9, 2.1, 2.0), (40.0, 1.0, 0.0)])
    seen, every = sightings_of(hits, rays, outline, places), np.arange(3)
    scene = kernels.Scene(hits, sums, rays, outline)
    found = ways.uncertainties(places, every, seen, scene, routes, told, motion)
    for place, value in zip(places, found, strict=True):
        information = [
            naive.landmark_information(
                grid.cells == OCCUPIED, normals, 0.5, rays, n, outline, [place]
            )
            * (told.share / (1 + told.other * sums[n, kernels.HITS]))
            for n in range(4)
        ]
        wanted = naive.covariances(information, rays.poses, routes, motion)
        assert value == pytest.approx((wanted[:, 0, 0] + wanted[:, 1, 1]).mean(), rel=1e-4)


def test_a_ray_from_within_an_object_meets_nothing():
    for outline in OUTLINES:
        assert kernels.entry(outline, np.cos(0.3), np.sin(0.3), 0.01, 0.02, 1.0, 0.0)[0] == np.inf


def seen_by(robot):
    """What a robot sees on a short way, and the models of its filter."""
    hall = corridor(8.0, 2.4, resolution=0.05)
    made = tried(hall, Pole(0.2), np.array([[-1.0, 0.0], [1.0, 0.0]]), robot, where="walls")
    return made.search.objective.sight.seen


def test_a_hit_counts_some_22_times_less_for_a_likelihood_field_where_all_beams_hit():
    six = Lidar(range=6.0)
    product, summed = seen_by(Robot(six, filter=PRODUCT)), seen_by(Robot(six))
    rays = product.rays.beams
    assert rays == summed.rays.beams
    ratio = product.a_metre.share / (summed.a_metre.share / (1 + summed.a_metre.other * rays))
    assert 20 < ratio < 24


def test_far_beams_count_less_the_more_the_filters_heading_errs():
    swing = [seen_by(Robot(SHORT, filter=amcl)).rays.swing for amcl in (PRODUCT, Amcl())]
    assert swing[0] == pytest.approx(2 * 0.2 * 0.25**2 / 0.4**2)
    assert swing[1] == pytest.approx(3 * swing[0])
    assert seen_by(Robot(SHORT, filter=Amcl(alpha2=0.0))).rays.swing == 0


def test_two_rays_meet_an_object_at_the_lidars_full_range():
    rays = seen_by(Robot(Lidar(range=25.0))).rays
    assert rays.beams > 360
    assert 25.0 * rays.step <= 0.2 / 2  # a pole of 0.2 m


def test_the_motion_is_the_filters():
    slow = Robot(SHORT).changed({"alpha3": 0.1, "update_min_d": 0.5, "distance_drift": 0.0})
    assert seen_by(slow).motion.along == pytest.approx(0.05)
    assert seen_by(Robot(SHORT, filter=Amcl(alpha2=0.4))).motion.turn == pytest.approx(
        2 * 0.4 * 0.25 + math.radians(1) ** 2
    )


# The search


def test_an_object_is_worth_the_same_before_and_after_it_stands(placed):
    objective = placed.search.objective
    objective.start(np.arange(0))
    values = objective.values(np.arange(5))
    for n in range(5):
        objective.start(np.array([n]))
        assert objective.value() == pytest.approx(values[n], rel=1e-6)


def test_the_first_place_is_the_best_of_all_and_more_help_more(hallway, placed):
    one = place_landmarks(hallway, Pole(0.2), 1, robot=DRIVEN, paths=ROUTE)
    search = one.search
    search.objective.start(np.arange(0))
    assert one.curve[1] == pytest.approx(search.objective.values(search.among).min())
    search = placed.search
    search.objective.start(np.arange(0))
    alone = search.objective.values(placed.indices)
    assert placed.curve[1] == pytest.approx(alone.min())
    assert alone.max() > alone.min() * 1.01
    assert (np.diff(placed.curve) < 0).all()
    assert (placed.gains == -np.diff(placed.curve)).all()
    assert 1 <= placed.paying <= 3


def test_exchanges_do_not_make_it_worse(placed):
    search = placed.search
    greedy = []
    for _ in range(3):
        greedy.append(search.best(greedy))
    search.objective.start(np.array(greedy))
    assert placed.curve[-1] <= search.objective.value() * (1 + 1e-9)


def test_landmarks_do_not_depend_on_the_threads(hallway, placed):
    again = place_landmarks(hallway, Pole(0.2), 3, robot=DRIVEN, paths=ROUTE, threads=3)
    assert (again.poses == placed.poses).all()


def test_landmarks_leave_the_route_and_each_other_alone(placed):
    assert (np.abs(placed.poses[:, 1]) - 0.1 >= 0.25 + 0.2).all()
    apart = np.hypot(*(placed.positions[:, None] - placed.positions[None]).transpose(2, 0, 1))
    assert (apart[~np.eye(3, dtype=bool)] > 0.25).all()
    assert (placed.grid.cells == OCCUPIED).sum() > (placed.before.cells == OCCUPIED).sum()


def test_a_map_with_a_yaw_has_the_same_places_in_the_world(hallway):
    yaw, lidar = 0.7, Lidar(range=3.0, field_of_view_deg=200.0, mount_x=0.2, mount_yaw_deg=17.0)
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([(cos, sin), (-sin, cos)])  # rows times this are turned counter-clockwise
    x, y = np.array(hallway.origin[:2]) @ turn
    turned = dataclasses.replace(hallway, origin=(x, y, hallway.origin[2] + yaw))
    given = {"robot": Robot(lidar, filter=PRODUCT)}
    stands = np.array([(-3.0, 0.8, math.pi / 2)])
    kind = Box(0.4, 0.2)
    found = []
    for grid, angle, frame in ((hallway, 0.0, np.eye(2)), (turned, yaw, turn)):
        own = np.column_stack([stands[:, :2] @ frame, stands[:, 2] + angle])
        drawn_in = with_objects(grid, kind, own)
        route = {"middle": ROUTE["middle"] @ frame}
        sites = Sites(existing=own)
        found.append(place_landmarks(drawn_in, kind, 2, paths=route, sites=sites, **given))
    plain, other = found
    np.testing.assert_allclose(other.positions, plain.positions @ turn, atol=1e-6)
    np.testing.assert_allclose(other.poses[:, 2], plain.poses[:, 2] + yaw, atol=1e-6)
    np.testing.assert_allclose(other.curve, plain.curve, rtol=1e-4)
    assert (other.grid.cells == plain.grid.cells).all()


def test_what_two_close_together_is_refused_beside_the_first(hallway):
    route, kind = {"left": np.array([[-6.0, 0.0], [-3.0, 0.0]])}, Box(0.6, 0.9)
    given = {"paths": route, "robot": DRIVEN, "sites": Sites(clearance=0.1)}
    made = place_landmarks(hallway, kind, 2, **given)
    search, at = made.search, positions_of(made)
    one = int(np.argmin(np.hypot(at[:, 0] + 1, at[:, 1] + 1)))
    opposite = int(np.argmin(np.hypot(at[:, 0] - at[one, 0], at[:, 1] - 1)))
    beside = int(np.argsort(np.hypot(*(at - at[one]).T))[1])
    assert search.fault(opposite, [], search.around([])) == ""
    assert search.fault(opposite, [one], search.around([one])) == (
        "cuts a passage for the robot beside the others"
    )
    assert search.fault(beside, [one], search.around([one])) == "too close to another landmark"
    costs = locplan.Costmap.blank(made.grid, robot=0.35)
    assert locplan.plan(costs, (-6, 0), (6, 0)).path


def test_places_at_random_close_no_passage_either(hallway):
    made = tried(hallway, Box(0.6, 0.5), ROUTE["middle"], clearance=0.1)
    search, costs = made.search, []
    for seed in range(5):
        chosen = search.at_random(30, np.random.default_rng(seed))
        poses = np.column_stack([positions_of(made), search.places[:, 2]])[chosen]
        marked = with_objects(hallway, Box(0.6, 0.5), poses)
        costs.append(locplan.Costmap.blank(marked, robot=0.35))
        passages = search.passages.copy()
        for n in chosen:
            assert not passages.cuts(search.places[n])
            passages.place(search.places[n])
    assert all(locplan.plan(each, (-6, 0), (6, 0)).path for each in costs)


def test_an_existing_object_may_be_moved(hallway):
    stands = with_objects(hallway, Pole(0.2), [(-6.5, 0.9)])
    made = place_landmarks(
        stands,
        Pole(0.2),
        0,
        robot=DRIVEN,
        paths=ROUTE,
        sites=Sites(existing=[(-6.5, 0.9)]),
    )
    assert len(made) == 1
    assert made.kept == 0
    assert abs(made.poses[0, 0]) < 6
    assert made.grid.free[made.grid.world_to_cell(-6.5, 0.9)]
    stays = place_landmarks(
        made.grid,
        Pole(0.2),
        0,
        robot=DRIVEN,
        paths=ROUTE,
        sites=Sites(existing=made.poses),
    )
    assert stays.kept == 1


def test_places_are_joined_by_shortest_paths(hallway):
    ends = {"a": (-6.0, 0.0), "b": (6.0, 0.0), "c": (0.0, 0.3)}
    made = place_landmarks(hallway, Pole(0.2), 1, robot=DRIVEN, places=ends)
    assert list(made.setting.routes) == ["a to b", "a to c", "b to c"]
    assert made.verify(2, random_sets=1).after.number == 6


def test_nowhere_to_stand_is_said_with_the_reasons(hallway):
    with pytest.raises(LocplanError, match="kept out"):
        place_landmarks(
            hallway,
            Pole(0.2),
            1,
            robot=Robot(SHORT),
            paths=ROUTE,
            sites=Sites(keep_out=np.ones(hallway.shape, bool)),
        )


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"count": 0}, "count"),
        ({"kind": "pole"}, "Pole or a Box"),
        ({"paths": None}, "one of paths, places and region"),
        ({"places": [(0, 0), (1, 0)]}, "one of paths, places and region"),
        ({"sites": "walls"}, "sites must be a Sites"),
        ({"sites": Sites(existing=[(3.0, 0.5)])}, "no pole of 0.2 m is drawn in the map at 3,0.5"),
        (
            {"sites": Sites(existing=[(90.0, 0.5)])},
            "no pole of 0.2 m is drawn in the map at 90,0.5",
        ),
        (
            {"sites": Sites(existing=[(3.0, 1.2), (3.0, 1.25)])},
            "two existing objects are given at one place",
        ),
        ({"sites": Sites(keep_out=[(0, 0, 1, 1), (0, 0, 1)])}, "keep_out must be a mask"),
        ({"sites": Sites(keep_out=[(0, 0, 1, math.nan)])}, "keep_out must be a mask"),
        ({"robot": 0}, "robot must be a Robot"),
        ({"paths": {"out": np.array([[0.0, 0.0], [50.0, 0.0]])}}, "path out: leaves"),
        ({"paths": {}}, "at least one"),
    ],
)
def test_bad_arguments_are_refused(hallway, wrong, said):
    given = {"kind": Pole(), "count": 1, "paths": ROUTE} | wrong
    with pytest.raises(LocplanError, match=said):
        place_landmarks(hallway, given.pop("kind"), given.pop("count"), **given)


@pytest.mark.parametrize(
    "wrong", [{"where": "roof"}, {"clearance": -1}, {"spacing": 0}, {"existing": [(1,)]}]
)
def test_sites_refuse_what_makes_no_sense(wrong):
    with pytest.raises(LocplanError, match=next(iter(wrong))):
        Sites(**wrong)


# Verification


@pytest.fixture(scope="module")
def verification(placed):
    return placed.verify(6, random_sets=2)


def test_landmarks_are_verified_by_drives(placed, verification):
    assert (verification.before.number, verification.after.number) == (6, 6)
    assert verification.random.number == 6
    assert verification.after.rmse.value < verification.before.rmse.value
    again = placed.verify(6, random_sets=2, threads=1)
    assert again.summary() == verification.summary()


def test_where_nothing_is_lost_there_is_nothing_to_gain():
    grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    route = {"room": np.array([[2.0, 3.0], [5.0, 3.0]])}
    made = place_landmarks(grid, Pole(0.2), 1, paths=route)
    driven = made.verify(4, random_sets=1)
    assert driven.nothing_to_gain
    assert driven.verdict.startswith(
        "nothing to gain: no drive was off by more than 1 m to begin with; error 0."
    )


def driven_with(lost: float, error: float, count: int = 40) -> Outcome:
    """Drives of which a share is lost at the last pose, and all err about as much."""
    errors = np.zeros((count, 50, 3))
    errors[:, :, 0] = error * np.linspace(0.9, 1.1, count)[:, None]
    errors[: round(lost * count), -1, 0] = 1.5
    return Outcome((Drives(np.zeros((50, 3)), errors),))


@pytest.mark.parametrize(
    ("before", "after", "verdict"),
    [
        (
            (0.5, 0.3),
            (0.1, 0.3),
            "they help: 50% of the drives off by more than 1 m at some time before, 10% after",
        ),
        (
            (0.0, 0.15),
            (0.0, 0.04),
            "they help: no drive was off by more than 1 m to begin with; error 0.15",
        ),
        (
            (0.0, 0.15),
            (0.0, 0.14),
            "nothing to gain: no drive was off by more than 1 m to begin with",
        ),
        ((0.0, 0.04), (0.0, 0.15), "they hurt: no drive was off by more than 1 m to begin with"),
        (
            (0.0, 0.15),
            (0.1, 0.04),
            "not shown to help: 0% of the drives off by more than 1 m at some time before, 10%",
        ),
        (
            (0.1, 0.3),
            (0.5, 0.3),
            "they hurt: 10% of the drives off by more than 1 m at some time before, 50% after",
        ),
        ((0.5, 0.3), (0.4, 0.3), "not shown to help"),
    ],
)
def test_the_verdict_looks_at_lost_drives_and_at_the_error(before, after, verdict):
    driven = Verification(driven_with(*before), driven_with(*after), None, {}, 1, {})
    assert driven.verdict.startswith(verdict)
    assert driven.helps == verdict.startswith("they help")
    assert driven.hurts == verdict.startswith("they hurt")
    assert driven.nothing_to_gain == verdict.startswith("nothing to gain")


def test_trials_keep_a_placement_of_as_many(placed):
    best = best_of_trials(placed, 2)
    assert len(best) == 3
    assert (positions_of(best)[best.indices] == best.positions).all()
    assert best_of_trials(placed, 1) is placed


def regular(placed, positions):
    """The row among landmarks that stand at some positions."""
    return with_values(placed, poses=np.column_stack([positions, np.zeros(len(positions))])).regular


def test_a_regular_row_is_noticed_and_an_irregular_one_not(placed):
    row = np.column_stack([1.3 * np.arange(6), [0, 0.1, 0, 0, -0.1, 0]])
    found = regular(placed, row[[3, 0, 5, 1, 2, 4]])
    assert found.period == pytest.approx(1.3, abs=0.05)
    assert len(found.landmarks) == 6
    straight = np.column_stack([np.arange(6.0), np.zeros(6)])
    assert regular(placed, straight).period == 1
    assert regular(placed, straight * 3.2) is None
    irregular = np.column_stack([[0, 1.0, 2.6, 3.3, 5.2], np.zeros(5)])
    assert regular(placed, irregular) is None
    assert regular(placed, row[:3]) is None
    closing = np.column_stack([[0, 1.1, 2.02, 2.9], np.zeros(4)])  # 0.22 m from the first step
    assert regular(placed, closing).period == pytest.approx(2.9 / 3)


# A region


FIGURES = ways.Anchors(1.3, 90.0, 0.05, 0.9)


@pytest.mark.parametrize("outline", OUTLINES)
def test_degeneracies_in_a_region_are_those_of_plain_matrices(outline):
    grid, rays = small_scene()
    normals, told = surface_normals(grid.cells == OCCUPIED), ways.Sensing(2.0, 0.03)
    hits = hits_on(grid, rays)
    sums = kernels.sums_of(hits, rays)
    places = np.array([(3.0, 2.6, 0.7), (1.9, 2.1, 2.0), (40.0, 1.0, 0.0)])
    now = ways.degeneracies_at(sums, told, FIGURES)
    seen, every = sightings_of(hits, rays, outline, places), np.arange(3)
    scene = kernels.Scene(hits, sums, rays, outline)
    found = ways.mean_changes(places, every, seen, scene, told, FIGURES, now)
    for place, change in zip(places, found, strict=True):
        wanted = naive.mean_degeneracy(
            grid.cells == OCCUPIED, normals, 0.5, rays, outline, [place], told, FIGURES, sums[:, 6]
        )
        assert now.mean() + change == pytest.approx(wanted, abs=1e-5)
    assert found[2] == 0
    assert found[:2].min() < -1e-3


def test_the_poses_that_see_a_place_are_those_whose_rays_it_shortens():
    grid, rays = small_scene()
    hits = hits_on(grid, rays)
    rows, cols = np.nonzero(grid.free)
    places = np.column_stack([cols * 0.5 + 0.2, rows * 0.5 + 0.3, np.full(len(rows), 0.4)])
    for outline in OUTLINES:
        seen = sightings_of(hits, rays, outline, places)
        for m, place in enumerate(places):
            after, touched = hits.copy(), np.zeros(len(hits), bool)
            kernels.add_object(after, rays, outline, *place, touched)
            at = slice(seen.starts[m], seen.starts[m + 1])
            assert seen.poses[at].tolist() == np.flatnonzero(touched).tolist()
            for n, (begin, count) in zip(seen.poses[at], seen.rays[at], strict=True):
                shorter = np.flatnonzero(after[n, :, 0] < hits[n, :, 0])
                within = (begin + np.arange(count)) % rays.beams
                assert set(shorter) <= set(within)
                assert {within[0], within[-1]} <= set(shorter)


@pytest.fixture(scope="module")
def in_region(hallway):
    region = [(-6.0, -1.2, 6.0, 1.2)]
    return place_landmarks(hallway, Pole(0.2), 3, robot=DRIVEN, region=region)


def test_a_region_is_marked_where_it_is_degenerate(hallway, in_region):
    assert in_region.setting.planned
    assert in_region.curve[0] > 0.5
    assert (np.diff(in_region.curve) < 0).all()
    assert (np.abs(in_region.poses[:, 0]) < 6).all()
    mask = np.zeros(hallway.shape, bool)
    rows, cols = np.indices(hallway.shape) + 0.5
    x, y = hallway.grid_to_world(rows, cols)
    mask[(np.abs(x) <= 6.0) & (np.abs(y) <= 1.2)] = True
    again = place_landmarks(hallway, Pole(0.2), 3, robot=DRIVEN, region=mask)
    np.testing.assert_allclose(again.curve, in_region.curve, rtol=0.02)


def test_a_lazy_search_finds_what_a_full_one_does(in_region, placed):
    for made in (in_region, placed):
        search = dataclasses.replace(made.search, lazy=5)
        bounds, chosen = np.full(len(search.places), np.inf), []
        for _ in range(3):
            lazy = search.best(chosen, bounds=bounds)
            assert lazy == search.best(chosen)
            chosen.append(lazy)


def test_what_is_kept_of_earlier_looks_is_as_if_it_were_found_anew(in_region):
    objective, every = in_region.search.objective, in_region.search.among
    for chosen in ([3], [3, 40], [40], [], [40, 7]):
        objective.start(np.array(chosen, np.int64))
        kept = objective.values(every)
        fresh = dataclasses.replace(objective)
        fresh.start(np.array(chosen, np.int64))
        np.testing.assert_array_equal(fresh.values(every), kept)
        for n in (11, 60):
            fresh.start(np.array([*chosen, n]))
            assert fresh.value() == pytest.approx(kept[n], rel=1e-6)


def test_a_region_is_verified_by_drives_across_it(in_region):
    ends = np.concatenate([path.xy[[0, -1]] for path in in_region.setting.routes.values()])
    assert (np.abs(ends) <= (6.1, 1.3)).all()
    middles = np.array(in_region.before.world_to_grid(*ends.T)) % 1
    np.testing.assert_allclose(middles, 0.5, atol=1e-6)  # they are centres of cells
    assert max(path.length for path in in_region.setting.routes.values()) > 10
    driven = in_region.verify(2, random_sets=1)
    assert driven.after.number == 2 * len(in_region.setting.routes)


def test_a_robot_is_where_most_of_a_region_is_joined():
    grid = open_floor(40, 100)
    cells = grid.cells.copy()
    cells[:, 60] = OCCUPIED
    walled = OccupancyGrid(cells, 0.1)
    robot = Robot(SHORT, footprint=0.3, margin=0.0, filter=PRODUCT)

    def inside(region):
        made = place_landmarks(walled, Pole(0.2), 1, region=region, robot=robot)
        return made.setting.region

    found = inside(np.ones(walled.shape, bool))
    assert found[:, :60].any()
    assert not found[:, 60:].any()
    assert walled.clearance[found].min() >= 0.3
    few = np.zeros(walled.shape, bool)
    few[0] = True
    with pytest.raises(LocplanError, match="cannot be anywhere"):
        inside(few)


@pytest.mark.parametrize(("view", "headings"), [(360.0, 1), (270.0, 3), (90.0, 8), (30.0, 8)])
def test_a_narrow_view_is_tried_in_several_headings(view, headings):
    grid = open_floor()
    robot = Robot(Lidar(range=3.0, field_of_view_deg=view), footprint=0.01, margin=0.0)
    made = place_landmarks(grid, Pole(1.0), 1, region=grid.free, robot=robot)
    rays = made.search.objective.sight.seen.rays
    poses = np.column_stack([rays.poses, rays.first])
    assert len(np.unique(poses[:, 2].round(6))) == headings
    places = np.unique(poses[:, :2], axis=0)
    assert len(poses) == headings * len(places)
    assert len(poses) <= 1.3 * 1200
    apart = np.sort(np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)), axis=1)[:, 1]
    assert np.median(apart) == pytest.approx(max(0.5, math.sqrt(96 * headings / 1200)), rel=0.25)


# Existing objects, rows, and routes that stay


def without(grid, kind, at):
    """The map without an object that exists at a place, which may be moved."""
    route = {"a": np.array([[2.0, 6.0], [3.0, 6.0]])}
    sites = Sites(existing=[at])
    return place_landmarks(grid, kind, 0, paths=route, robot=DRIVEN, sites=sites).setting.grid


def test_a_wall_beside_an_existing_object_stays():
    grid = open_floor()
    walls = grid.cells == OCCUPIED
    for at in ((6.0, 0.25), (6.03, 0.22), (0.2, 4.0)):
        marked = with_objects(grid, Pole(0.3), [at])
        assert ((marked.cells == OCCUPIED) != walls).any()
        cleared = without(marked, Pole(0.3), at)
        assert ((cleared.cells == OCCUPIED) == walls).all()
        for off in ((0.04, -0.03), (-0.05, 0.05)):
            left = without(marked, Pole(0.3), np.add(at, off)).cells == OCCUPIED
            assert left[walls].all()
            assert (left & ~walls).sum() < 5  # what touches the wall may count as its own


def test_an_existing_object_is_not_sought_where_more_is_drawn():
    grid = with_objects(open_floor(), Box(0.4, 0.4), [(3.07, 2.32)])
    marked = with_objects(grid, Pole(0.2), [(3.07, 2.02)])
    cleared = without(marked, Pole(0.2), (3.07, 2.02))
    assert (cleared.cells == grid.cells).all()


def test_an_object_that_is_drawn_larger_goes_with_its_rim():
    grid = open_floor()
    marked = with_objects(grid, Box(0.9, 0.5), [(6.0, 4.0)])
    cleared = without(marked, Box(0.8, 0.4), (6.0, 4.0))
    assert (cleared.cells == grid.cells).all()


def test_a_regular_row_is_broken_where_that_costs_little(placed):
    search = placed.search
    at = search.places[:, :2] * 0.1
    row = [int(np.argmin(np.hypot(*(at - at.mean(axis=0) - (-0.9, x)).T))) for x in (-3, -1, 1, 3)]
    assert regular(placed, at[row]) is not None
    broken, shifts = search.without_rows(row)
    assert regular(placed, at[broken]) is None
    assert len(shifts) >= 1
    assert 0 < shifts[0].distance <= 1.5
    search.objective.start(np.array(row))
    before = search.objective.value()
    search.objective.start(np.array(broken))
    assert search.objective.value() <= before * 1.05 ** len(shifts)
    assert search.without_rows(row[:3])[1] == ()


def lengths(made, grid):
    """Length of the way that is driven before, and among objects, by route [m]."""
    driven = with_values(made, grid=grid).verify(2, random_sets=1)
    return {name: (before[-1, 0], after[-1, 0]) for name, (before, after) in driven.fields.items()}


def test_paths_stay_and_shortest_paths_are_planned_again(hallway):
    bent = np.array([[-6.0, 0.0], [-3.0, 0.5], [0.0, -0.5], [6.0, 0.0]])
    made = place_landmarks(hallway, Pole(0.2), 1, paths={"bent": bent}, robot=DRIVEN)
    assert not made.setting.planned
    length = Path(bent).length
    assert lengths(made, made.grid)["bent"] == pytest.approx((length, length), rel=0.003)
    ends = {"a": (-6.0, 0.0), "b": (6.0, 0.0)}
    made = place_landmarks(hallway, Pole(0.2), 1, places=ends, robot=DRIVEN)
    beside = with_objects(made.setting.grid, Box(0.4, 0.4), [(0.0, 0.0)])
    before, after = lengths(made, beside)["a to b"]
    assert before == pytest.approx(made.setting.routes["a to b"].length)
    assert after > before + 0.02


def test_an_existing_object_on_a_path_is_refused(hallway):
    stands = with_objects(hallway, Pole(0.3), [(1.0, 0.0)])
    given = {"robot": DRIVEN, "sites": Sites(existing=[(1.0, 0.0)])}
    with pytest.raises(LocplanError, match="path middle"):
        place_landmarks(stands, Pole(0.3), 1, paths=ROUTE, **given)


def test_matches_on_the_way_are_better_beside_landmarks(verification, placed):
    before, after = verification.fields["middle"]
    assert before[-1, 0] == pytest.approx(12.0)
    assert len(before) == len(after)
    nearest = int(np.argmin(np.abs(before[:, 0] - 6 - placed.poses[0, 0])))
    assert after[nearest, 1] < 0.8 * before[nearest, 1]
    (median, high), (median_after, _) = verification.match_deviations
    assert median_after < median <= high


def test_matches_on_the_way_are_those_of_fused():
    room = drawn("#" * 40, *["#" + "." * 38 + "#"] * 38, "#" * 40, resolution=0.1)
    made = tried(room, Pole(0.2), np.array([[1.0, 1.0], [3.0, 1.0]]))
    before, after = made.verify(2, random_sets=1).fields["a"]
    poses = np.column_stack([1.0 + before[:, 0], np.ones(5), np.zeros(5)])
    for grid, profile in ((room, before), (made.grid, after)):
        found = covariances_along(grid, FieldConfig(Fused(SHORT)), poses)
        assert profile[:, 1] == pytest.approx(scalar(found, "position_std"))


def test_both_objectives_are_driven(placed):
    best = best_of_trials(placed, 3)
    chosen = [each.chosen_by for each in best.trials]
    assert sorted(chosen)[0] == "degeneracy"
    assert any(each.endswith("half of the places") for each in chosen)
    assert "deviation along the routes" in chosen
    assert best.chosen_by == chosen[0]
    assert [each.drives for each in best.trials] == [120, 120, 40]
    assert best.trials[0][2:] <= best.trials[1][2:]


# Reports and the command


@pytest.mark.draws
def test_the_figure_is_drawn(placed, verification, tmp_path):
    for name, given in (("without", None), ("with", verification)):
        file = tmp_path / f"{name}.png"
        figure = landmarks_figure(placed, given)
        check_looks(figure, f"landmarks {name} drives")
        locplan.plotting.save_figure(figure, file)
        assert file.stat().st_size > 10_000


@pytest.mark.draws
@pytest.mark.parametrize(("rows", "cols"), [(30, 200), (90, 100), (100, 100), (300, 30)])
def test_maps_fill_their_part_of_a_figure(placed, rows, cols):
    grid = open_floor(rows, cols)
    route = {"middle": Path([(0.5, 0.5), (0.1 * cols - 0.5, 0.1 * rows - 0.5)])}
    setting = dataclasses.replace(placed.setting, grid=grid, routes=route)
    figure = landmarks_figure(with_values(placed, setting=setting, before=grid, grid=grid))
    assert figure.get_figwidth() < 14
    figure.draw_without_rendering()
    first, second = (own for own in figure.axes if own.images)
    (plot,) = (own for own in figure.axes if own.get_xlabel() == "number of landmarks")
    assert all(own.images or own.has_data() for own in figure.axes)  # no empty ones
    beside = plot.get_window_extent().x0 > second.get_window_extent().x1
    assert beside == (rows > 3 * cols)
    widths = [own.get_window_extent().width / figure.dpi for own in (first, second)]
    side_by_side = second.get_window_extent().x0 > first.get_window_extent().x1
    assert side_by_side == (rows > 0.9 * cols)
    used = sum(widths) if side_by_side else widths[0]
    width = figure.get_figwidth() - (4.6 if beside else 0.0)
    assert width - used < 3.0 or used > 0.6 * width


def test_the_table_tells_how_many_landmarks_pay(placed, verification):
    few = with_values(placed, curve=np.array([1.0, 0.5, 0.25, 0.249]))
    assert "from number 3 on each lowers it by less than 5%: 2 may do" in few.report()
    none = with_values(placed, curve=np.array([1.0, 0.98, 0.96, 0.94]))
    assert "each lowers it by less than 5%: drive them to know" in none.report()
    assert "5%: whether they help is what the drives say" in none.report(verification)
    all_pay = with_values(placed, curve=np.array([1.0, 0.5, 0.25, 0.1]))
    assert "less than 5%" not in all_pay.report()


def test_a_placement_is_saved_with_outlines_and_sizes(placed, tmp_path):
    placed.save(tmp_path)
    made = json.loads((tmp_path / "landmarks.geojson").read_text())["features"]
    about = [each["properties"] for each in made]
    assert [each["number"] for each in about] == [1, 2, 3]
    assert {(each["kind"], each["length"], each["frame"]) for each in about} == {
        ("pole", 0.2, "map")
    }
    ring = np.array(made[0]["geometry"]["coordinates"][0])
    assert (ring[0] == ring[-1]).all()
    assert np.hypot(*(ring - placed.positions[0]).T) == pytest.approx(0.1, abs=1e-3)
    summary = json.loads((tmp_path / "landmarks.json").read_text())
    assert summary["landmarks"] == placed.table().records()
    assert not (tmp_path / "verification.csv").exists()


def test_the_table_has_the_pose_and_what_is_expected_of_each(placed):
    before, after = (f"{placed.expected[n]:.3g}" for n in (0, 3))
    assert f"3 x {placed.setting.kind.title} in " in repr(placed)
    assert f"{placed.measure.title} {before} -> {after})" in repr(placed)
    for record, pose, gain, expected in zip(
        placed.table().records(), placed.poses, placed.gains, placed.expected[1:], strict=True
    ):
        assert [record[name] for name in ("x", "y", "heading")] == pose.tolist()
        assert (record["gain"], record["expected_deviation"]) == (gain, expected)


def test_the_table_of_drives_has_a_row_for_each_map(verification):
    none, proposed, random = verification.table().records()
    assert (none["world"], proposed["world"]) == ("none", "proposed")
    assert proposed["rmse_low"] == verification.after.rmse.low
    assert random["kept_rmse"] == verification.random.kept_rmse.value
    assert verification.summary()["before"] == {
        name: value for name, value in none.items() if name != "world"
    }
    alone = dataclasses.replace(verification, random=None)
    assert len(alone.table()) == 2


@pytest.fixture
def map_file(tmp_path, hallway):
    save_map(hallway, tmp_path / "hallway.yaml")
    return tmp_path / "hallway.yaml"


def test_the_command_writes_places_and_the_map(run, map_file, tmp_path):
    out = tmp_path / "marked"
    options = [
        "--object",
        "box:0.4,0.2",
        "--count",
        2,
        "--drives",
        2,
        "--trials",
        1,
        "--set",
        "range=3",
        "-o",
        out,
    ]
    more = ["--set", "max_particles=100", "--set", "min_particles=100", "--keep-out", "-9,-2,0,2"]
    ends = ["--start", "-6,0", "--goal", "6,0"]
    code, said, err = run("landmarks", map_file, *ends, *options, *more)
    assert code == 0, err
    assert said.index("off by") < said.index("landmark   x [m]")
    with (out / "landmarks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["number"] for row in rows] == ["1", "2"]
    assert all(float(row["x"]) > 0 and row["length"] == "0.4" for row in rows)
    marked = locplan.load_map(out / "map_with_landmarks.yaml")
    about = json.loads((out / "landmarks.json").read_text())
    assert marked.digest == about["map_with_landmarks"]["digest"]
    assert about["verification"]["before"]["drives"] == 2
    assert {file.name for file in out.iterdir()} >= {
        "landmarks.png",
        "landmarks.geojson",
        "rejected.csv",
        "verification.csv",
    }


def test_the_command_takes_places_and_existing_objects(run, map_file, hallway, tmp_path):
    save_map(with_objects(hallway, Pole(0.2), [(-6, 0.9)]), map_file)
    (tmp_path / "places.csv").write_text("name,x,y\na,-5,0\nb,5,0\n")
    given = ["--places", tmp_path / "places.csv", "--existing", "-6,0.9,10", "--drives", 0]
    code, said, err = run("landmarks", map_file, *given, "--count", 1, "--set", "range=3", "--json")
    assert code == 0, err
    about = json.loads(said)
    assert len(about["landmarks"]) == 2
    assert about["verification"] is None


def test_the_command_takes_a_region(run, map_file, tmp_path):
    given = ["--region", "all", "--count", 1, "--set", "range=3", "--drives", 2, "--trials", 1]
    fast = ["--set", "max_particles=100", "--set", "min_particles=100", "-o", tmp_path / "out"]
    code, said, err = run("landmarks", map_file, *given, *fast)
    assert code == 0, err
    assert "mean degeneracy u" in said
    about = json.loads((tmp_path / "out" / "landmarks.json").read_text())
    assert about["region_area"] > 20
    assert about["mean_degeneracy"][1] < about["mean_degeneracy"][0]


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--start", "1,2"],
        ["--start", "-6,0", "--goal", "6,0", "--object", "cone"],
        ["--start", "-6,0", "--goal", "6,0", "--drives", "1"],
        ["--start", "-6,0", "--goal", "6,0", "--count", "0"],
        ["--start", "-6,0", "--goal", "6,0", "--existing", "1"],
        ["--start", "-6,0", "--goal", "6,0", "--keep-out", "1,2"],
        ["--start", "-60,0", "--goal", "6,0"],
    ],
)
def test_the_command_refuses_in_one_line(run, map_file, options):
    refused(run("landmarks", map_file, *options))


@pytest.mark.long
@pytest.mark.parametrize("count", few_of([3]))
def test_three_poles_keep_the_robot_in_a_bare_corridor(count):
    grid = locplan.maps.environments.make("two_corridors")
    route = {"straight": np.array([[2.0, 3.0], [38.0, 3.0]])}
    amcl = Amcl(laser_model_type="likelihood_field_prob")
    driven = place_landmarks(grid, Pole(0.2), count, robot=Robot(filter=amcl), paths=route).verify(
        100
    )
    assert driven.helps
    assert driven.after.lost_rate.value <= 0.02
    assert driven.before.lost_rate.value >= 0.7
    assert driven.random.lost_rate.value >= 0.25
