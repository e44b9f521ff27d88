"""Landmarks: objects, their places and information, the search, and its verification."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import math

import numpy as np
import pytest
from support import oracles
from support.cases import sample_cases
from support.command_line import check_refusal
from support.maps import ascii_map, corridor

import locplan
from locplan import LocplanError, Path, place_landmarks, save_map
from locplan._support import checks
from locplan._support.kernels.rays import cast_ray, compute_empty_squares
from locplan.advice import Box, Pole, verify_landmarks
from locplan.advice.figures import landmarks_figure
from locplan.advice.kernels import landmarks as kernels, objectives as ways
from locplan.advice.landmark_objects import find_covered_cells, mark_objects, parse_object
from locplan.advice.landmarks import Verification, VerificationDrives
from locplan.errors import ConfigError
from locplan.field.beams import find_surface_normals
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, Zone, Zones
from locplan.robots import Amcl, Lidar, Robot
from locplan.simulation import Drives
from locplan.simulation.verdict import DriveSet, compare_drives

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
    scene = compute_empty_squares(occupied), find_surface_normals(occupied), grid.resolution
    kernels.cast_map_hits(kernels.MapSurfaces(*scene), rays, hits)
    return hits


def search_positions(landmarks):
    """Return world x and y of all places of the search, (n, 2) [m]."""
    places = landmarks.search.places
    return np.column_stack(landmarks.setting.grid.grid_to_world(*places[:, :2].T))


@pytest.fixture(scope="module")
def hallway() -> OccupancyGrid:
    return corridor(16.0, 2.4, resolution=0.1)


@pytest.fixture(scope="module")
def hallway_landmarks(hallway):
    return place_landmarks(hallway, Pole(0.2), 3, robot=DRIVEN, paths=ROUTE)


def test_place_landmarks_rejects_insufficient_memory(hallway, monkeypatch):
    monkeypatch.setattr(checks, "get_usable_memory", lambda: 1000)
    with pytest.raises(ConfigError, match=r"poses with \d+ rays take .* take shorter routes"):
        place_landmarks(hallway, Pole(0.2), 3, robot=DRIVEN, paths=ROUTE)


# Objects


@pytest.mark.parametrize("kind", [Pole(0.5), Box(0.9, 0.4)])
def test_object_covers_cells_by_centre(kind):
    row, col, heading, edge = 20.3, 17.8, 0.5, 0.1
    grid = OccupancyGrid(np.full((40, 40), FREE, np.uint8), edge)
    rows, cols = find_covered_cells(grid, kind, np.array([col * edge, row * edge, heading]))
    outline = kernels.ObjectOutline(*kind.shape)
    expected = {
        (i, j)
        for i, j in itertools.product(range(40), range(40))
        if oracles.landmarks.within_object(
            outline, heading, (j + 0.5 - col) * edge, (i + 0.5 - row) * edge
        )
    }
    assert set(zip(rows.tolist(), cols.tolist(), strict=True)) == expected


@pytest.mark.parametrize("heading", [0.0, 0.4, 1.2, 2.5])
def test_thin_board_blocks_all_rays(heading):
    grid = mark_objects(open_floor(), Box(2.0, 0.02), [(6.0, 4.0, heading)])
    squares = compute_empty_squares(grid.cells == OCCUPIED)
    for share in np.linspace(-0.9, 0.9, 37):
        x, y = 6 + share * math.cos(heading), 4 + share * math.sin(heading)
        dx, dy = -math.sin(heading), math.cos(heading)
        at, _, _ = cast_ray(squares, (y - dy) / 0.1, (x - dx) / 0.1, dy, dx, 20.0)
        assert 0.8 < at * 0.1 < 1.05


def test_object_poses_are_in_world_frame():
    """The map is turned."""
    grid = dataclasses.replace(open_floor(), origin=(3.0, -2.0, 0.7))
    marked = mark_objects(grid, Box(1.0, 0.4), [(*grid.position(30, 50), 0.7)])
    rows, cols = np.nonzero((marked.cells == OCCUPIED) & grid.free)
    assert (np.ptp(rows) + 1, np.ptp(cols) + 1) in ((4, 10), (5, 11), (5, 10), (4, 11))
    assert (rows.mean(), cols.mean()) == pytest.approx((30, 50), abs=0.5)


def test_objects_are_clipped_at_map_edge():
    assert (mark_objects(open_floor(), Pole(2.0), [(0.0, 0.0), (-50, 3)]).cells == OCCUPIED).any()


def test_parse_object_has_default_size():
    assert parse_object("pole:") == Pole()


@pytest.mark.parametrize("text", ["pole:x", "pole:0.1,0.2", "box:1", "cone:2", "box:1,-1"])
def test_parse_object_rejects_bad_text(text):
    with pytest.raises(LocplanError):
        parse_object(text)


# Candidates and passages


def no_go(*rectangles):
    """Zones of rectangles x0, y0, x1, y1."""
    outlines = [[(a, b), (c, b), (c, d), (a, d)] for a, b, c, d in rectangles]
    return Zones([Zone("no-go", outline) for outline in outlines])


def place_one(grid, kind, route, robot=DRIVEN, zones=None):
    """Return the landmarks of a search for one place."""
    return place_landmarks(grid, kind, 1, paths={"a": route}, robot=robot, zones=zones)


@pytest.mark.parametrize(
    ("angle", "kind"),
    sample_cases(
        [(0.6, Box(0.8, 0.3)), (0.0, Box(0.8, 0.3)), (0.0, Pole(0.3)), (0.6, Pole(0.3))],
        are_rows=True,
    ),
)
def test_wall_places_align_with_walls(angle, kind):
    """They also keep a small clearance."""
    grid = corridor(12.0, 3.0, angle=angle)
    ends = np.outer([-5.0, 5.0], [math.cos(angle), math.sin(angle)])
    kept = place_one(grid, kind, ends).search.places
    assert 25 < len(kept) < 55
    for row, col, heading in kept:
        cells = find_covered_cells(grid, kind, np.array([*grid.grid_to_world(row, col), heading]))
        assert grid.clearance[cells].min() >= 0.05 + grid.resolution / 2 - 1e-9
        assert grid.clearance[cells].min() < 0.2
        if isinstance(kind, Box):
            assert abs(math.sin(heading - angle)) < 0.15
    first = kept[np.argsort(kept[:, 0])]
    apart = np.hypot(*np.diff(first[:, :2], axis=0).T) * grid.resolution
    assert apart.min() > 0.3


def test_free_places_try_both_orientations():
    """A pole needs one orientation only."""
    cells = open_floor().cells.copy()
    cells[30:34, 50:54] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1)
    route = np.array([[1.0, 2.0], [11.0, 2.0]])

    def free_places(kind):
        places = place_one(grid, kind, route).search.places
        clearance = grid.clearance[tuple(places[:, :2].astype(int).T)]
        assert not ((clearance > 0.7) & (clearance <= 1.2)).any()
        return places[clearance > 1.2]

    places, poles = free_places(Box(0.6, 0.3)), free_places(Pole(0.2))
    assert set(places[:, 2].round(6)) == {0.0, round(math.pi / 2, 6)}
    assert 40 < len(poles) <= len(places) <= 2 * len(poles)


@pytest.mark.parametrize(("turn", "corners"), [(0.0, 2), (0.8, 500)])
def test_route_places_keep_smallest_clearance(turn, corners):
    grid = dataclasses.replace(open_floor(), origin=(1.0, 2.0, turn))
    cols = np.linspace(20.0, 100.0, corners)
    line = np.column_stack(grid.grid_to_world(np.full(corners, 40.0), cols))
    kind = Box(0.8, 0.2)
    places = place_one(grid, kind, line).search.places
    aside = np.abs(places[:, 0] - 40) * 0.1
    along = np.abs(np.sin(places[:, 2])) < 1e-6
    near = np.where(along, 0.45 + 0.1 + 0.1, 0.45 + 0.4 + 0.1)  # the robot's, the object's
    beside = np.isclose(aside, near)
    assert (beside & along).sum() == (beside & ~along).sum() == 34
    on_the_way = np.abs(places[:, 1] - 60) < 40
    assert (aside[on_the_way] >= near[on_the_way] - 0.11).all()


DOOR = ascii_map(
    "####################",
    *["#.........#........#"] * 4,
    *["#..................#"] * 2,
    *["#.........#........#"] * 4,
    "####################",
    resolution=0.5,
)


def passages_of(grid, kind, radius, route=((1.0, 1.0), (1.5, 1.0))):
    """Space of a robot, as a search has it."""
    robot = Robot(SHORT, footprint=radius, margin=0.0, filter=PRODUCT)
    return place_one(grid, kind, np.array(route), robot).search.robot_space


def test_search_rejects_object_closing_door():
    passages = passages_of(DOOR, Pole(0.3), 0.25)
    assert passages.is_cut_by(np.array([6.0, 10.5, 0.0]))
    assert not passages.is_cut_by(np.array([3.0, 4.0, 0.0]))


def test_narrow_door_needs_no_clearance():
    # with the clearance the door is closed anyway
    narrow = passages_of(DOOR, Pole(0.2), 0.25, ((1.25, 1.25), (1.5, 1.25)))
    assert narrow.is_cut_by(np.array([6.0, 10.5, 0.0]))
    assert not narrow.is_cut_by(np.array([6.0, 15.0, 0.0]))


def test_two_objects_close_passage_together():
    grid = open_floor(30, 120)  # 2.8 m wide
    low, high = np.array([9.0, 60.0, 0.0]), np.array([21.0, 60.0, 0.0])
    passages = passages_of(grid, Pole(0.4), 0.3)
    assert not passages.is_cut_by(low)
    assert not passages.is_cut_by(high)
    other = passages.copy()
    passages.close_around(low)
    assert passages.is_cut_by(high)
    assert not other.is_cut_by(high)


def test_pocket_is_no_passage():
    passages = passages_of(open_floor(60, 60), Pole(0.4), 0.3)
    assert not passages.is_cut_by(np.array([8.8, 8.8, 0.0]))


@pytest.mark.parametrize("unknown", [False, True])
def test_objects_stay_within_known_map(unknown):
    cells = np.full((80, 100), FREE, np.uint8)
    cells[:, 60:] = UNKNOWN if unknown else FREE
    grid, edge = OccupancyGrid(cells, 0.1), 6.0 if unknown else 10.0
    seeing, route = Robot(Lidar(range=9.0), filter=PRODUCT), np.array([[3.0, 4.0], [3.2, 4.0]])
    landmarks = place_one(grid, Box(2.2, 0.4), route, seeing)
    (x, y), heading = search_positions(landmarks).T, landmarks.search.places[:, 2]
    along = np.abs(np.sin(heading)) < 0.5
    wide, high = np.where(along, 1.1, 0.2), np.where(along, 0.2, 1.1)
    assert len(x) > 10
    assert ((wide <= x) & (x <= edge - wide) & (high <= y) & (y <= 8.0 - high)).all()


def test_object_across_view_gap_is_seen():
    """Rays at both ends of the field of view meet it."""
    grid, kind = open_floor(), Box(1.0, 0.1)
    lidar = Lidar(range=3.0, field_of_view_deg=300.0)
    landmarks = place_one(
        grid, kind, np.array([[6.0, 4.0], [6.5, 4.0]]), Robot(lidar, filter=PRODUCT)
    )
    rays = landmarks.search.sight.route_views.rays
    assert not rays.all_round
    hits = hits_on(grid, rays)
    before = hits.copy()
    behind = 5.4, 4.0, math.pi / 2
    touched = np.zeros(len(hits), bool)
    kernels.add_object_to_hits(hits, rays, kernels.ObjectOutline(*kind.shape), *behind, touched)
    met = np.flatnonzero(hits[0, :, 0] < before[0, :, 0])
    assert met[0] == 0
    assert met[-1] == rays.beams - 1
    bearings = np.abs(rays.first[0] + met * rays.step)
    assert bearings.min() == pytest.approx(math.pi - math.atan2(0.5, 0.55), abs=0.02)
    assert (met < rays.beams / 2).sum() == (met > rays.beams / 2).sum()


def test_boxes_are_apart_by_their_outlines(hallway):
    landmarks = place_one(hallway, Box(1.0, 0.2), ROUTE["middle"])
    search, at = landmarks.search, search_positions(landmarks)
    one = int(np.argmin(np.hypot(*(at - (0.0, 0.9)).T)))
    apart = np.hypot(*(at - at[one]).T)
    along = (np.abs(at[:, 1] - at[one, 1]) < 0.05) & (apart > 0.5)
    for n in np.flatnonzero(along & (apart < 1.6)):
        assert search.is_allowed(int(n), [one], search.robot_space) == (apart[n] >= 1.05 - 1e-9)
    assert (apart[along] < 1.05).any()
    assert (apart[along] > 1.05).any()


def test_objects_avoid_no_go_zones(hallway):
    grid = dataclasses.replace(open_floor(), origin=(0.0, 0.0, math.pi / 2))
    route = np.array([[-2.5, 2.0], [-2.5, 7.0]])
    everywhere = search_positions(place_one(grid, Pole(0.1), route))
    zones = no_go((-2.0, 3.0, -1.0, 5.0))
    landmarks = place_one(grid, Pole(0.1), route, zones=zones)
    apart = np.hypot(*(everywhere[:, None] - search_positions(landmarks)[None]).transpose(2, 0, 1))
    kept_out = everywhere[apart.min(axis=1) > 0]
    assert len(kept_out) > 1
    assert (np.abs(kept_out - (-1.5, 4.0)) <= (0.56, 1.06)).all()
    assert not (np.abs(search_positions(landmarks) - (-1.5, 4.0)) < (0.5, 1.0)).all(axis=1).any()
    with pytest.raises(LocplanError, match="path a crosses a no-go zone; change"):
        place_one(hallway, Pole(0.2), ROUTE["middle"], zones=no_go((0, -1, 0.1, 1)))


def test_routes_avoid_no_go_zones():
    zones = no_go((2.0, 1.0, 4.0, 5.2))
    places = {"a": (1.0, 5.0), "b": (5.0, 5.0)}
    landmarks = place_landmarks(
        open_floor(), Pole(0.1), 1, places=places, robot=DRIVEN, zones=zones
    )
    for routes in (landmarks.setting.routes, landmarks.setting.replan_routes(landmarks.grid)):
        (path,) = routes.values()
        assert path.length > 4.01
        fine = path.resample(0.01).xy
        assert not zones.cells(landmarks.grid, "no-go")[landmarks.grid.cell(fine)].any()


# Kernels


def small_scene(least=0.0, view=360.0):
    """A small map with poses, and an object kind; few rays, so that the oracle takes no time."""
    grid = ascii_map(
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
    return grid, kernels.RouteRays(
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


OUTLINES = [kernels.ObjectOutline(0.15, 0.15, True), kernels.ObjectOutline(0.4, 0.1, False)]


@pytest.mark.parametrize("outline", OUTLINES)
@pytest.mark.parametrize(("least", "view"), [(0.0, 360.0), (0.6, 200.0), (0.0, 90.0)])
def test_object_information_equals_plain_loop(outline, least, view):
    grid, rays = small_scene(least, view)
    occupied = grid.cells == OCCUPIED
    normals = find_surface_normals(occupied)
    hits = hits_on(grid, rays)
    sums = kernels.sum_hits(hits, rays)
    objects = [(3.0, 2.6, 0.7), (1.9, 2.1, 2.0)]
    changed = np.empty(7)
    for n in (1, 2):
        for place in objects:
            wanted = oracles.landmarks.landmark_information(
                occupied, normals, 0.5, rays, n, outline, [place]
            )
            begin, count = kernels.find_shortened_rays(hits, rays, n, outline, *place)
            scene = kernels.LandmarkScene(hits, sums, rays, outline)
            meets = count > 0 and kernels.write_object_sums(scene, n, place, begin, count, changed)
            information = as_matrix(changed if meets else sums[n])
            np.testing.assert_allclose(information, wanted, atol=2e-4)
    touched = np.zeros(len(hits), bool)
    for place in objects:
        kernels.add_object_to_hits(hits, rays, outline, *place, touched)
    sums = kernels.sum_hits(hits, rays)
    for n in (1, 2):
        wanted = oracles.landmarks.landmark_information(
            occupied, normals, 0.5, rays, n, outline, objects
        )
        np.testing.assert_allclose(as_matrix(sums[n]), wanted, atol=2e-4)


def find_object_sightings(hits, rays, outline, places):
    counts, starts = np.zeros(len(places), np.int64), np.zeros(len(places) + 1, np.int64)
    for _ in range(2):  # the first time without room
        room = starts[-1]
        buffers = np.empty(room, np.int32), np.empty((room, 2), np.int16)
        seen = kernels.ObjectSightings(starts, *buffers)
        kernels.find_sightings(places, 0, len(places), hits, rays, outline, seen, counts)
        starts = np.concatenate([[0], np.cumsum(counts)])
    return seen


@pytest.mark.parametrize("outline", OUTLINES)
def test_objective_equals_plain_matrices(outline):
    grid, rays = small_scene()
    normals = find_surface_normals(grid.cells == OCCUPIED)
    routes, told = np.array([0, 3, 4]), ways.BeamSensing(2.0, 0.03)
    motion = ways.MotionNoise(0.05, 0.003, 0.1, 0.02, 0.01)
    hits = hits_on(grid, rays)
    sums = kernels.sum_hits(hits, rays)
    places = np.array([(3.0, 2.6, 0.7), (1.9, 2.1, 2.0), (40.0, 1.0, 0.0)])
    seen, every = find_object_sightings(hits, rays, outline, places), np.arange(3)
    scene = kernels.LandmarkScene(hits, sums, rays, outline)
    variances = ways.compute_mean_variances(places, every, seen, scene, routes, told, motion)
    for place, value in zip(places, variances, strict=True):
        information = [
            oracles.landmarks.landmark_information(
                grid.cells == OCCUPIED, normals, 0.5, rays, n, outline, [place]
            )
            * (told.share / (1 + told.hit_coefficient * sums[n, kernels.HITS]))
            for n in range(4)
        ]
        wanted = oracles.landmarks.covariances(information, rays.poses, routes, motion)
        assert value == pytest.approx((wanted[:, 0, 0] + wanted[:, 1, 1]).mean(), rel=1e-4)


def test_ray_inside_object_meets_nothing():
    for outline in OUTLINES:
        assert (
            kernels.intersect_object(outline, np.cos(0.3), np.sin(0.3), 0.01, 0.02, 1.0, 0.0)[0]
            == np.inf
        )


def route_views(robot):
    """Return the views of a robot along a short route."""
    hall = corridor(8.0, 2.4, resolution=0.05)
    landmarks = place_one(hall, Pole(0.2), np.array([[-1.0, 0.0], [1.0, 0.0]]), robot)
    return landmarks.search.sight.route_views


def test_likelihood_field_discounts_many_hits():
    """A hit counts about 22 times less if all beams hit."""
    six = Lidar(range=6.0)
    product, summed = route_views(Robot(six, filter=PRODUCT)), route_views(Robot(six))
    rays = product.rays.beams
    assert rays == summed.rays.beams
    ratio = product.sensing_model.share / (
        summed.sensing_model.share / (1 + summed.sensing_model.hit_coefficient * rays)
    )
    assert 20 < ratio < 24


def test_heading_error_discounts_far_beams():
    swing = [route_views(Robot(SHORT, filter=amcl)).rays.swing for amcl in (PRODUCT, Amcl())]
    assert swing[0] == pytest.approx(2 * 0.2 * 0.25**2 / 0.4**2)
    assert swing[1] == pytest.approx(3 * swing[0])
    assert route_views(Robot(SHORT, filter=Amcl(alpha2=0.0))).rays.swing == 0


def test_rays_are_dense_enough_for_objects():
    """Two rays meet a pole at the lidar's full range."""
    rays = route_views(Robot(Lidar(range=25.0))).rays
    assert rays.beams > 360
    assert 25.0 * rays.step <= 0.2 / 2  # a pole of 0.2 m


def test_motion_noise_equals_filter_settings():
    slow = Robot(SHORT).with_settings({"alpha3": 0.1, "update_min_d": 0.5, "distance_drift": 0.0})
    assert route_views(slow).motion.along == pytest.approx(0.05)
    assert route_views(Robot(SHORT, filter=Amcl(alpha2=0.4))).motion.turn == pytest.approx(
        2 * 0.4 * 0.25 + math.radians(1) ** 2
    )


# The search


def test_objective_predicts_value_of_placed_object(hallway_landmarks):
    objective = hallway_landmarks.search.sight
    objective.place_objects(np.arange(0))
    values = objective.compute_objectives(np.arange(5))
    for n in range(5):
        objective.place_objects(np.array([n]))
        assert objective.compute_objective() == pytest.approx(values[n], rel=1e-6)


def test_greedy_search_picks_best_places(hallway_landmarks):
    search, chosen = hallway_landmarks.search, []
    for n in range(3):
        search.sight.place_objects(np.array(chosen, np.int64))
        values = search.sight.compute_objectives(np.arange(len(search.places)))
        lazy = dataclasses.replace(search, n_lazy=5).select_places(n + 1)[0][-1]
        chosen.append(search.find_best_place(chosen))
        assert lazy == chosen[-1]
        assert (
            search_positions(hallway_landmarks)[chosen[-1]] == hallway_landmarks.positions[n]
        ).all()
        assert hallway_landmarks.curve[n + 1] == pytest.approx(values[chosen[-1]])
        assert hallway_landmarks.curve[n + 1] == pytest.approx(
            values.min(), rel=0.02
        )  # or it is too close
    assert (np.diff(hallway_landmarks.curve) < 0).all()
    assert (hallway_landmarks.gains == -np.diff(hallway_landmarks.curve)).all()
    assert 1 <= hallway_landmarks.n_useful <= 3


def test_landmarks_ignore_thread_count(hallway, hallway_landmarks):
    again = place_landmarks(hallway, Pole(0.2), 3, robot=DRIVEN, paths=ROUTE, threads=3)
    assert (again.poses == hallway_landmarks.poses).all()


def test_landmarks_keep_clear_of_route(hallway_landmarks):
    assert (np.abs(hallway_landmarks.poses[:, 1]) - 0.1 >= 0.25 + 0.2).all()
    apart = np.hypot(
        *(hallway_landmarks.positions[:, None] - hallway_landmarks.positions[None]).transpose(
            2, 0, 1
        )
    )
    assert (apart[~np.eye(3, dtype=bool)] > 0.25).all()
    assert (hallway_landmarks.grid.cells == OCCUPIED).sum() > (
        hallway_landmarks.setting.grid.cells == OCCUPIED
    ).sum()


def test_landmarks_turn_with_map_yaw(hallway):
    yaw, lidar = 0.7, Lidar(range=3.0, field_of_view_deg=200.0, mount_x=0.2, mount_yaw_deg=17.0)
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([(cos, sin), (-sin, cos)])  # rows times this are turned counter-clockwise
    x, y = np.array(hallway.origin[:2]) @ turn
    turned = dataclasses.replace(hallway, origin=(x, y, hallway.origin[2] + yaw))
    robot = Robot(lidar, filter=PRODUCT)
    results = []
    for grid, frame in ((hallway, np.eye(2)), (turned, turn)):
        route = {"middle": ROUTE["middle"] @ frame}
        results.append(place_landmarks(grid, Box(0.4, 0.2), 2, paths=route, robot=robot))
    plain, other = results
    np.testing.assert_allclose(other.positions, plain.positions @ turn, atol=1e-6)
    np.testing.assert_allclose(other.poses[:, 2], plain.poses[:, 2] + yaw, atol=1e-6)
    np.testing.assert_allclose(other.curve, plain.curve, rtol=1e-4)
    assert (other.grid.cells == plain.grid.cells).all()


def test_search_rejects_pair_closing_passage(hallway):
    route, kind = {"left": np.array([[-6.0, 0.0], [-3.0, 0.0]])}, Box(0.6, 0.9)
    landmarks = place_landmarks(hallway, kind, 2, paths=route, robot=DRIVEN)
    search, at = landmarks.search, search_positions(landmarks)
    one = int(np.argmin(np.hypot(at[:, 0] + 1, at[:, 1] + 1)))
    opposite = int(np.argmin(np.hypot(at[:, 0] - at[one, 0], at[:, 1] - 1)))
    beside = int(np.argsort(np.hypot(*(at - at[one]).T))[1])
    assert search.is_allowed(opposite, [], search.make_robot_space([]))
    assert not search.is_allowed(opposite, [one], search.make_robot_space([one]))
    assert not search.is_allowed(beside, [one], search.make_robot_space([one]))
    costs = locplan.Costmap.blank(landmarks.grid, robot=0.35)
    assert locplan.plan(costs, (-6, 0), (6, 0)).path


def test_random_places_keep_passages_open(hallway):
    landmarks = place_one(hallway, Box(0.6, 0.5), ROUTE["middle"])
    search, costs = landmarks.search, []
    for seed in range(5):
        chosen = search.draw_random_places(30, np.random.default_rng(seed))
        poses = np.column_stack([search_positions(landmarks), search.places[:, 2]])[chosen]
        marked = mark_objects(hallway, Box(0.6, 0.5), poses)
        costs.append(locplan.Costmap.blank(marked, robot=0.35))
        passages = search.robot_space.copy()
        for n in chosen:
            assert not passages.is_cut_by(search.places[n])
            passages.close_around(search.places[n])
    assert all(locplan.plan(each, (-6, 0), (6, 0)).path for each in costs)


def test_places_are_joined_by_shortest_paths(hallway):
    ends = {"a": (-6.0, 0.0), "b": (6.0, 0.0), "c": (0.0, 0.3)}
    landmarks = place_landmarks(hallway, Pole(0.2), 1, robot=DRIVEN, places=ends)
    assert list(landmarks.setting.routes) == ["a to b", "a to c", "b to c"]
    assert verify_landmarks(landmarks, 2, random_sets=1).after.n_drives == 6


def test_error_explains_lack_of_places(hallway):
    with pytest.raises(LocplanError, match="in a no-go zone"):
        place_landmarks(
            hallway,
            Pole(0.2),
            1,
            robot=Robot(SHORT),
            paths=ROUTE,
            zones=no_go((-99, 0.2, 99, 99), (-99, -99, 99, -0.2)),
        )


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"count": 0}, "count"),
        ({"kind": "pole"}, "Pole or a Box"),
        ({"paths": None}, "either paths or places"),
        ({"places": [(0, 0), (1, 0)]}, "either paths or places"),
        ({"zones": "zones.geojson"}, "zones must be a Zones"),
        ({"robot": 0}, "robot must be a Robot"),
        ({"paths": {"out": np.array([[0.0, 0.0], [50.0, 0.0]])}}, "path out: leaves"),
        ({"paths": {}}, "at least one"),
    ],
)
def test_bad_arguments_are_refused(hallway, wrong, said):
    arguments = {"kind": Pole(), "count": 1, "paths": ROUTE} | wrong
    with pytest.raises(LocplanError, match=said):
        place_landmarks(hallway, arguments.pop("kind"), arguments.pop("count"), **arguments)


# Verification


@pytest.fixture(scope="module")
def verification(hallway_landmarks):
    return verify_landmarks(hallway_landmarks, 6, random_sets=2)


def test_landmarks_are_verified_by_drives(hallway_landmarks, verification):
    assert (verification.before.n_drives, verification.after.n_drives) == (6, 6)
    assert verification.random.n_drives == 6
    assert verification.after.rmse.value < verification.before.rmse.value
    again = verify_landmarks(hallway_landmarks, 6, random_sets=2, threads=1)
    assert again.table() == verification.table()


def test_verification_reports_route_without_losses():
    grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    route = {"room": np.array([[2.0, 3.0], [5.0, 3.0]])}
    landmarks = place_landmarks(grid, Pole(0.2), 1, paths=route)
    driven = verify_landmarks(landmarks, 4, random_sets=1)
    assert driven.word in ("no difference", "undecided")
    assert driven.verdict.startswith(f"{driven.word}: no drive was lost to begin with; error 0.")


def driven_with(lost: float, error: float, spread: float, count: int = 40) -> VerificationDrives:
    """Drives of which a share is lost at the last pose, and all err about as much."""
    errors = np.zeros((count, 50, 3))
    errors[:, :, 0] = error * np.linspace(1 - spread, 1 + spread, count)[:, None]
    errors[: round(lost * count), -1, 0] = 1.5
    return VerificationDrives((Drives(np.zeros((50, 3)), errors),))


SOME = "of the drives lost before,"
NONE = "no drive was lost to begin with"


@pytest.mark.parametrize(
    ("before", "after", "verdict"),
    [
        ((0.5, 0.3), (0.1, 0.3), f"better: 50% {SOME} 10% after"),
        ((0.0, 0.15), (0.0, 0.04), f"better: {NONE}; error 0.15"),
        ((0.0, 0.15), (0.0, 0.147), f"no difference: {NONE}"),
        ((0.0, 0.04), (0.0, 0.15), f"worse: {NONE}"),
        ((0.0, 0.15), (0.1, 0.04), f"better: 0% {SOME} 10%"),
        ((0.0, 0.15), (0.3, 0.04), f"undecided: 0% {SOME} 30%"),
        ((0.1, 0.3), (0.5, 0.3), f"worse: 10% {SOME} 50% after"),
        ((0.5, 0.3), (0.4, 0.3), f"no difference: 50% {SOME} 40% after"),
    ],
)
def test_verification_equals_verdict_of_pairs(before, after, verdict):
    sets = driven_with(*before, 0.1), driven_with(*after, -0.1)
    driven = Verification(*sets, None, {}, 1)
    assert driven.verdict.startswith(verdict)
    assert driven.word == verdict.partition(":")[0]
    pairs = (DriveSet.from_drives(each.drives) for each in sets)
    assert driven.comparison == compare_drives(*pairs)


def test_sightings_equal_shortened_rays():
    grid, rays = small_scene()
    hits = hits_on(grid, rays)
    rows, cols = np.nonzero(grid.free)
    places = np.column_stack([cols * 0.5 + 0.2, rows * 0.5 + 0.3, np.full(len(rows), 0.4)])
    for outline in OUTLINES:
        seen = find_object_sightings(hits, rays, outline, places)
        for m, place in enumerate(places):
            after, touched = hits.copy(), np.zeros(len(hits), bool)
            kernels.add_object_to_hits(after, rays, outline, *place, touched)
            at = slice(seen.starts[m], seen.starts[m + 1])
            assert seen.poses[at].tolist() == np.flatnonzero(touched).tolist()
            for n, (begin, count) in zip(seen.poses[at], seen.rays[at], strict=True):
                shorter = np.flatnonzero(after[n, :, 0] < hits[n, :, 0])
                within = (begin + np.arange(count)) % rays.beams
                assert set(shorter) <= set(within)
                assert {within[0], within[-1]} <= set(shorter)


def test_replanning_keeps_user_paths(hallway):
    """Only shortest paths between places are planned again."""
    bent = np.array([[-6.0, 0.0], [-3.0, 0.5], [0.0, -0.5], [6.0, 0.0]])
    landmarks = place_landmarks(hallway, Pole(0.2), 1, paths={"bent": bent}, robot=DRIVEN)
    assert not landmarks.setting.is_planned
    assert (landmarks.setting.replan_routes(landmarks.grid)["bent"].xy == bent).all()
    ends = {"a": (-6.0, 0.0), "b": (6.0, 0.0)}
    landmarks = place_landmarks(hallway, Pole(0.2), 1, places=ends, robot=DRIVEN)
    beside = mark_objects(landmarks.setting.grid, Box(0.4, 0.4), [(0.0, 0.0)])
    around = landmarks.setting.replan_routes(beside)["a to b"].length
    assert around > landmarks.setting.routes["a to b"].length + 0.02


# Reports and the command


def test_figure_title_states_verdict(hallway_landmarks, verification, tmp_path):
    for name, drives in (("without", None), ("with", verification)):
        file = tmp_path / f"{name}.png"
        figure = landmarks_figure(hallway_landmarks, drives)
        locplan._support.drawing.save_figure(figure, file)
        assert file.stat().st_size > 10_000
        answer = drives.verdict if drives else "not verified by drives"
        title = figure.get_suptitle().replace("\n", " ")
        assert title.startswith(f"{hallway_landmarks.setting.grid.name or 'map'}: {answer}")


@pytest.mark.parametrize(("rows", "cols"), [(30, 200), (90, 100), (100, 100), (300, 30)])
def test_maps_fill_figure(hallway_landmarks, rows, cols):
    grid = open_floor(rows, cols)
    route = {"middle": Path([(0.5, 0.5), (0.1 * cols - 0.5, 0.1 * rows - 0.5)])}
    setting = dataclasses.replace(hallway_landmarks.setting, grid=grid, routes=route)
    figure = landmarks_figure(dataclasses.replace(hallway_landmarks, setting=setting))
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


def test_report_shows_positions_of_poles_first(hallway_landmarks, verification):
    text = hallway_landmarks.report(verification)
    assert text.splitlines()[0].split()[:5] == ["landmark", "x", "[m]", "y", "[m]"]
    assert "heading" not in text
    assert "heading" in hallway_landmarks.table().names


def test_report_names_useful_landmark_count(hallway_landmarks):
    few = dataclasses.replace(hallway_landmarks, curve=np.array([1.0, 0.5, 0.25, 0.249]))
    advice = "From number 3 on, each lowers the expected deviation by less than 5 %: 2 may do."
    assert advice in few.report()
    none = dataclasses.replace(hallway_landmarks, curve=np.array([1.0, 0.98, 0.96, 0.94]))
    assert "Each landmark lowers the expected deviation by less than 5 %." in none.report()
    all_pay = dataclasses.replace(hallway_landmarks, curve=np.array([1.0, 0.5, 0.25, 0.1]))
    assert "less than 5 %" not in all_pay.report()


@pytest.mark.usefixtures("undrawn")
def test_saved_landmarks_have_outlines_and_sizes(hallway_landmarks, tmp_path):
    hallway_landmarks.save(tmp_path)
    features = json.loads((tmp_path / "landmarks.geojson").read_text())["features"]
    about = [feature["properties"] for feature in features]
    assert [each["number"] for each in about] == [1, 2, 3]
    assert {(each["kind"], each["length"], each["frame"]) for each in about} == {
        ("pole", 0.2, "map")
    }
    ring = np.array(features[0]["geometry"]["coordinates"][0])
    assert (ring[0] == ring[-1]).all()
    assert np.hypot(*(ring - hallway_landmarks.positions[0]).T) == pytest.approx(0.1, abs=1e-3)
    summary = json.loads((tmp_path / "landmarks.json").read_text())
    assert summary["landmarks"] == hallway_landmarks.table().records()
    assert not (tmp_path / "verification.csv").exists()


def test_table_lists_poses_and_gains(hallway_landmarks):
    before, after = (f"{hallway_landmarks.expected_deviations[n]:.3g}" for n in (0, 3))
    assert f"3 x {hallway_landmarks.setting.kind.title} in " in repr(hallway_landmarks)
    assert f"expected deviation {before} -> {after})" in repr(hallway_landmarks)
    for record, pose, gain, expected in zip(
        hallway_landmarks.table().records(),
        hallway_landmarks.poses,
        hallway_landmarks.gains,
        hallway_landmarks.expected_deviations[1:],
        strict=True,
    ):
        assert [record[name] for name in ("x", "y", "heading")] == pose.tolist()
        assert (record["gain"], record["expected_deviation"]) == (gain, expected)


def test_verification_table_lists_worlds(verification):
    none, proposed, random = verification.table().records()
    assert (none["world"], proposed["world"]) == ("none", "proposed")
    assert proposed["rmse_low"] == verification.after.rmse.low
    assert random["kept_rmse"] == verification.random.kept_rmse.value
    alone = dataclasses.replace(verification, random=None)
    assert len(alone.table()) == 2


@pytest.fixture
def map_file(tmp_path, hallway):
    save_map(hallway, tmp_path / "hallway.yaml")
    return tmp_path / "hallway.yaml"


@pytest.mark.usefixtures("undrawn")
def test_landmarks_command_writes_places_and_map(run, map_file, tmp_path):
    out = tmp_path / "marked"
    options = [
        "--object",
        "box:0.4,0.2",
        "--count",
        2,
        "--drives",
        2,
        "--set",
        "range=3",
        "-o",
        out,
    ]
    more = ["--set", "max_particles=100", "--set", "min_particles=100"]
    no_go((-9, 0.5, 0, 2), (-9, -2, 0, -0.5)).save(tmp_path / "zones.geojson")
    more += ["--zones", tmp_path / "zones.geojson"]
    ends = ["--start", "-6,0", "--goal", "6,0"]
    code, said, err = run("landmarks", map_file, *ends, *options, *more)
    assert code == 0, err
    assert said.index("landmark   x [m]") < said.index("lost")
    assert "heading" in said
    with (out / "landmarks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["number"] for row in rows] == ["1", "2"]
    assert all(float(row["x"]) > 0 and row["length"] == "0.4" for row in rows)
    marked = locplan.load_map(out / "map_with_landmarks.yaml")
    about = json.loads((out / "landmarks.json").read_text())
    assert marked.digest == about["map_with_landmarks"]["digest"]
    assert about["verification"]["drives"][0]["drives"] == 2
    assert {file.name for file in out.iterdir()} >= {
        "landmarks.png",
        "landmarks.geojson",
        "verification.csv",
    }


def test_landmarks_command_reads_places_file(run, map_file, tmp_path):
    (tmp_path / "places.csv").write_text("name,x,y\na,-5,0\nb,5,0\n")
    options = ["--places", tmp_path / "places.csv", "--drives", 0]
    code, said, err = run(
        "landmarks", map_file, *options, "--count", 1, "--set", "range=3", "--json"
    )
    assert code == 0, err
    about = json.loads(said)
    assert len(about["landmarks"]) == 1
    assert about["verification"] is None


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--start", "1,2"],
        ["--start", "-6,0", "--goal", "6,0", "--object", "cone"],
        ["--start", "-6,0", "--goal", "6,0", "--drives", "1"],
        ["--start", "-6,0", "--goal", "6,0", "--count", "0"],
        ["--start", "-6,0", "--goal", "6,0", "--zones", "none.geojson"],
        ["--start", "-60,0", "--goal", "6,0"],
    ],
)
def test_landmarks_command_rejects_bad_options(run, map_file, options):
    check_refusal(run("landmarks", map_file, *options))


@pytest.mark.long
@pytest.mark.parametrize("count", sample_cases([3]))
def test_three_poles_help_in_bare_corridor(count):
    grid = locplan.maps.environments.make("two_corridors")
    route = {"straight": np.array([[2.0, 3.0], [38.0, 3.0]])}
    amcl = Amcl(laser_model_type="likelihood_field_prob")
    landmarks = place_landmarks(grid, Pole(0.2), count, robot=Robot(filter=amcl), paths=route)
    driven = verify_landmarks(landmarks, 100)
    assert driven.word == "better"
    assert driven.after.lost_rate.value <= 0.02
    assert driven.before.lost_rate.value >= 0.7
    assert driven.random.lost_rate.value >= 0.25
