"""Key features: what a map is divided into, what is lost without a part, and the drives."""

from __future__ import annotations

import csv
import dataclasses
import json
import math

import naive
import numpy as np
import pytest
from conftest import corridor, drawn, few_of, refused
from figure_looks import check_looks

import locplan
from locplan import LocplanError, Pole, save_map
from locplan._kernels import features as kernels, landmarks, objectives as ways
from locplan._kernels.rays import empty_squares
from locplan.field import surface_normals
from locplan.landmarks import (
    FeatureDrives,
    Outcome,
    key_features,
    key_features_figure,
    with_objects,
)
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.robots import Amcl, Lidar, Robot
from locplan.simulation import Drives, Simulator, drive_paths

OBJECT, CORNER, WALL = "object", "corner", "wall"
PRODUCT = Amcl(laser_model_type="likelihood_field_prob", min_particles=100, max_particles=100)
SHORT = Lidar(range=3.0)
ROUTE = {"middle": np.array([[-6.0, 0.0], [6.0, 0.0]])}


def found_on(grid, route=ROUTE, **settings):
    return key_features(grid, robot=Robot(SHORT, filter=PRODUCT), paths=route, **settings)


@pytest.fixture(scope="module")
def hallway() -> OccupancyGrid:
    return corridor(24.0, 2.4, resolution=0.1)


@pytest.fixture(scope="module")
def with_pole(hallway):
    return with_objects(hallway, Pole(0.3), [(1.0, 0.6)])


@pytest.fixture(scope="module")
def found(with_pole):
    return found_on(with_pole)


# What a map is divided into


def everything(cells, **settings):
    """The features of a map whose cells are all seen from a point in its middle."""
    rows, cols = np.array(cells.shape) * 0.1
    route = {"a": np.array([[cols / 2, rows / 2], [cols / 2 + 0.3, rows / 2]])}
    robot = Robot(Lidar(range=20.0, beams=1440), footprint=0.01, margin=0.0, filter=PRODUCT)
    given = {"largest": 3.0, "gap": 0.0, "count": 1} | settings
    return key_features(OccupancyGrid(cells, 0.1), robot=robot, paths=route, **given).features


def kinds_of(features):
    return [each.kind for each in features]


def at_cell(features, row, col):
    """The feature that a cell belongs to."""
    (found,) = (each for each in features if [row, col] in each.cells.tolist())
    return found


def walled(rows=60, cols=100):
    cells = np.full((rows, cols), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return cells


def test_what_is_joined_is_one_object_and_what_is_large_is_cut_into_pieces():
    cells = walled()
    cells[28:32, 20:26] = cells[40, 60] = cells[41, 61] = OCCUPIED
    features = everything(cells)
    kinds = kinds_of(features)
    assert (kinds.count(OBJECT), kinds.count(CORNER)) == (2, 4)
    assert kinds.count(WALL) > 15
    for each in features:
        assert np.hypot(*np.ptp(each.cells * 0.1, axis=0)) < 1.6
    block = at_cell(features, 28, 20)
    assert len(block.cells) == 24
    assert np.ptp(block.corners(), axis=0) == pytest.approx((0.6, 0.4))
    assert len(at_cell(features, 40, 60).cells) == 2
    taken = np.concatenate([each.cells for each in features])
    assert len(np.unique(taken, axis=0)) == len(taken)
    shadow = (cells == OCCUPIED).sum() - len(taken)  # what the objects hide
    assert 0 <= shadow < 40


def test_a_corner_is_the_middle_of_its_piece():
    features = everything(walled())
    for row, col in ((0, 0), (0, 99), (59, 0), (59, 99)):
        corner = at_cell(features, row, col)
        assert corner.kind == CORNER
        assert len(corner.cells) >= 8


def test_the_ends_of_a_gap_in_a_wall_are_corners():
    cells = np.full((60, 100), FREE, np.uint8)
    cells[10:12] = OCCUPIED
    cells[10:12, 45:54] = FREE
    features = everything(cells)
    left, right = at_cell(features, 10, 44), at_cell(features, 10, 54)
    assert left is not right
    assert left.kind == right.kind == CORNER


@pytest.mark.parametrize(("gap", "count"), [(0.0, 3), (0.2, 1)])
def test_parts_of_a_broken_outline_are_one_object(gap, count):
    cells = np.full((20, 20), FREE, np.uint8)
    cells[2, 5:7] = cells[3, 5] = cells[2, 9:11] = cells[4, 10:12] = OCCUPIED
    assert kinds_of(everything(cells, gap=gap)) == [OBJECT] * count


def test_objects_that_are_too_large_together_stay_apart():
    cells = np.full((40, 80), FREE, np.uint8)
    for col in range(2, 72, 8):
        cells[8:12, col : col + 6] = OCCUPIED  # 0.6 m long, with gaps of 0.2 m
    assert len(everything(cells, gap=0.2)) == 9
    assert len(everything(cells, gap=0.2, largest=8.0)) == 1


def test_what_no_ray_meets_is_no_feature(found, with_pole):
    assert not any(each.seen == 0 for each in found.features)
    far = with_objects(with_pole, Pole(0.3), [(11.0, 0.6)])  # 5 m beyond the route's end
    assert len(found_on(far)) == len(found)


# Kernels


def small_scene(least=0.0):
    grid = drawn(
        "############",
        "#..........#",
        "#...#..#...#",
        "#..........#",
        "#.......#..#",
        "#..........#",
        "############",
        resolution=0.5,
    )
    poses = np.array([[1.1, 1.3], [2.2, 1.25], [3.3, 1.9], [4.6, 1.6]])
    return grid, landmarks.Rays(
        poses,
        np.array([[0.1, 0.05], [0.1, -0.02], [0.08, 0.0], [0.0, 0.1]]),
        np.array([0.3, -2.0, 4.0, 11.0]),
        2 * math.pi / 41,
        41,
        True,
        least,
        3.5,
        0.2,
    )


def hits_on(grid, rays):
    occupied = grid.cells == OCCUPIED
    hits = np.zeros((len(rays.first), rays.beams, 4), np.float32)
    scene = empty_squares(occupied), surface_normals(occupied), grid.resolution
    landmarks.hits_of_map(landmarks.Surfaces(*scene), rays, hits)
    return hits


@pytest.mark.parametrize("least", [0.0, 0.9])
def test_rays_see_what_plain_loops_find(least):
    grid, rays = small_scene(least)
    occupied = grid.cells == OCCUPIED
    normals = surface_normals(occupied)
    labels = np.full(occupied.shape, -1, np.int32)
    labels[4, 4], labels[2, 8], labels[0] = 0, 1, 2
    silent = np.array([False, True, True])
    squares = empty_squares(occupied)
    squares[:, 4 + 1, 4 + 1] = 1  # feature 0 is away
    wanted = np.arange(0, 4 * 41, 3)
    hits, cells = np.zeros((len(wanted), 4), np.float32), np.empty(len(wanted), np.int64)
    scene = landmarks.Surfaces(squares, normals, 0.5)
    kernels.look(scene, labels, silent, rays, wanted, hits, cells)
    stands = occupied.copy()
    stands[4, 4] = False
    quiet = (labels > 0) & silent[labels]
    kinds = set()
    for k, ray in enumerate(wanted.tolist()):
        hit, met = naive.look(stands, normals, quiet, 0.5, rays, ray)
        np.testing.assert_allclose(hits[k], hit, atol=2e-5)
        assert cells[k] == (-1 if met is None else met[0] * 12 + met[1])
        kinds.add((hit[0] < least, met is not None and bool(quiet[met]), math.isinf(hit[0])))
    assert len(kinds) >= 3  # too near, silent, and seen


def test_all_rays_see_what_landmarks_are_placed_by():
    grid, rays = small_scene(0.6)
    occupied = grid.cells == OCCUPIED
    labels = np.full(occupied.shape, -1, np.int32)
    wanted = np.arange(4 * 41)
    hits, cells = np.zeros((len(wanted), 4), np.float32), np.empty(len(wanted), np.int64)
    normals, none = surface_normals(occupied), np.zeros(1, bool)
    scene = landmarks.Surfaces(empty_squares(occupied), normals, 0.5)
    kernels.look(scene, labels, none, rays, wanted, hits, cells)
    assert (hits.reshape(4, 41, 4) == hits_on(grid, rays)).all()


def test_errors_by_a_moved_feature_are_those_of_plain_matrices():
    random = np.random.default_rng(3)
    poses, routes = np.cumsum(random.uniform(0.1, 0.4, (9, 2)), axis=0), np.array([0, 5, 9])
    half = random.normal(size=(9, 3, 3))
    information = half @ half.transpose(0, 2, 1)
    pulls = random.normal(size=(9, 3, 2))
    motion = ways.Motion(0.05, 0.003, 0.1, 0.02, 0.01)
    upper = information[:, [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    sums = np.column_stack([upper, np.zeros(9)])
    _, after = ways.covariances(sums, poses, routes, ways.Sensing(1.0, 0.0), motion)
    got = ways.biases(pulls, upper, after, poses, routes)
    wanted = naive.biases(pulls, information, poses, routes, motion)
    np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-12)


def test_a_world_that_is_moved_as_a_whole_moves_the_pose_by_as_much():
    grid = with_objects(corridor(8.0, 2.4), Pole(0.3), [(0.5, 0.7)])
    route = {"a": np.array([[-2.5, 0.0], [2.5, 0.2]] * 4)}
    (whole,) = found_on(grid, route, largest=50.0, gap=2.0).features
    assert whole.error == pytest.approx(0.3, abs=0.02)


# Taking features away


def crates(resolution=0.1, turned=0):
    cells = np.full((80, 120), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[30:33, 40:44] = cells[28:32, 60:62] = cells[55:60, 48:53] = OCCUPIED
    cells[31:33, 46:48] = OCCUPIED  # behind the first one, seen from the left
    return OccupancyGrid(np.ascontiguousarray(np.rot90(cells, turned)), resolution)


CRATES_ROUTE = np.array([[1.5, 2.0], [6.0, 4.5], [10.0, 4.0]])


def crates_found(grid, **settings):
    return found_on(grid, {"a": CRATES_ROUTE}, **({"gap": 0.0} | settings))


def lacking(grid, *features):
    """The map without some features."""
    cells = grid.cells.copy()
    for each in features:
        cells[tuple(each.cells.T)] = FREE
    return dataclasses.replace(grid, cells=cells)


def objects_of(found):
    return [each for each in found.features if each.kind == OBJECT]


def test_without_an_object_is_as_on_the_map_without_it():
    grid = crates()
    found = crates_found(grid)
    assert len(objects_of(found)) == 4
    for each in objects_of(found):
        anew = crates_found(lacking(grid, each), count=1)
        np.testing.assert_allclose(found.deviations[0] + each.loss, anew.deviations[0], rtol=1e-6)
        rises = np.sqrt(anew.profiles[0]) - np.sqrt(found.profiles[0])
        assert each.worst == pytest.approx(rises.max(), rel=1e-4)
        assert np.abs(rises).max() > 1e-4


def test_without_several_features_is_as_on_the_map_without_all():
    grid = lacking(
        crates(), *(each for each in crates_found(crates()).features if each.kind != OBJECT)
    )
    found = crates_found(grid, count=4)
    assert sorted(found.together) == [1, 2, 3, 4]
    for n in range(1, 4):
        anew = crates_found(lacking(grid, *(found.feature(k) for k in found.together[:n])), count=1)
        assert found.curve[n] == pytest.approx(anew.curve[0], rel=1e-6)
        rises = {(each.x, each.y): each.loss for each in anew.features}
        worst = found.feature(found.together[n])
        assert rises[worst.x, worst.y] == max(rises.values())
        assert found.curve[n + 1] == pytest.approx(anew.curve[1], rel=1e-6)
    np.testing.assert_allclose(found.profiles.mean(axis=1), found.curve[[0, 1, -1]])


def test_what_lies_far_behind_has_the_normals_of_what_stands_there():
    cells = np.full((200, 220), FREE, np.uint8)
    cells[:, 219] = OCCUPIED
    cells[100:104, 213:216] = OCCUPIED  # beside the wall, whose normals it turns
    cells[94:110, 100:103] = OCCUPIED  # hides that from most of the route, 5.5 m away
    grid, far = OccupancyGrid(cells, 0.05), Robot(Lidar(range=12.0), filter=PRODUCT)

    def found_anew(grid):
        route = {"a": np.array([[2.0, 4.9], [3.5, 4.0]])}
        return key_features(grid, robot=far, paths=route, gap=0.0, count=2)

    found = found_anew(grid)
    beside, hiding = at_cell(found.features, 101, 214), at_cell(found.features, 100, 101)
    one, both = found_anew(lacking(grid, hiding)), found_anew(lacking(grid, beside, hiding))
    assert found.deviations[0] + hiding.loss == pytest.approx(one.deviations[0], rel=1e-6)
    assert abs(one.deviations[0] / both.deviations[0] - 1) > 1e-4
    alone = at_cell(found_anew(lacking(grid, beside)).features, 100, 101)
    base = found_anew(lacking(grid, beside)).deviations[0]
    assert base + alone.loss == pytest.approx(both.deviations[0], rel=1e-6)


def test_a_piece_of_wall_is_no_window():
    cells = walled(60, 60)
    cells[:, 20] = OCCUPIED  # a wall, with another one behind it or not
    route = {"a": np.array([[3.5, 2.0], [4.5, 4.0]])}
    lined = cells.copy()
    lined[6:54, 8] = OCCUPIED
    one, other = (found_on(OccupancyGrid(each, 0.1), route, gap=0.0) for each in (cells, lined))
    losses = [[each.loss for each in found.features] for found in (one, other)]
    assert losses[0] == pytest.approx(losses[1], rel=2e-3, abs=1e-6)
    assert one.curve == pytest.approx(other.curve, rel=2e-3)
    assert all(each.loss >= -1e-12 for each in one.features)
    assert max(each.loss for each in one.features) > 1e-4


def test_without_all_features_there_is_what_an_empty_map_has():
    few = Robot(Lidar(range=8.0), filter=PRODUCT)
    given = {"paths": {"a": CRATES_ROUTE[:2]}, "robot": few, "gap": 0.0}
    found = key_features(crates(), piece=4.0, count=50, **given)
    assert len(found.together) == len(found)
    cells = np.full((80, 120), FREE, np.uint8)
    empty = key_features(OccupancyGrid(cells, 0.1), **given)
    assert found.curve[-1] == pytest.approx(empty.curve[0], rel=1e-5)
    assert (np.diff(found.curve) > -1e-9).all()


# The features that matter


def test_the_only_pillar_of_a_bare_corridor_matters_most(found):
    first = found.features[0]
    assert first.kind == OBJECT
    assert (first.x, first.y) == pytest.approx((1.0, 0.6), abs=0.06)
    assert found.mattering == (first,)
    assert first.loss > 5 * found.features[1].loss
    assert found.together[0] == 1
    assert "depends on 1 feature" in found.verdict
    assert abs(first.worst_at[0] - 1) < 3.5
    rises = np.sqrt(found.profiles[1]) - np.sqrt(found.profiles[0])
    assert first.worst == pytest.approx(rises.max())
    assert first.worst_at == pytest.approx(tuple(found.positions[rises.argmax()]))
    assert first.worst_share == pytest.approx(
        rises.max() / math.sqrt(found.profiles[0][rises.argmax()])
    )


def test_the_loss_is_that_of_the_map_without_it(hallway, found):
    bare = found_on(hallway)
    without = math.sqrt(found.features[0].loss ** 2 * 0 + found.curve[1])
    assert without == pytest.approx(bare.deviations[0], rel=0.02)  # the number of hits stays
    assert found.deviations[0] + found.features[0].loss == pytest.approx(found.deviations[1])
    np.testing.assert_allclose(found.profiles.mean(axis=1), found.curve[[0, 1, -1]])


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_map_that_is_turned_has_the_same_losses(turns):
    route = CRATES_ROUTE - (6.0, 4.0)
    upright = dataclasses.replace(crates(), origin=(-6.0, -4.0, 0.0))
    at = np.array([[6.0, 4.0], [4.0, 6.0]][turns % 2])
    # rot90 turns rows into columns: from above, the axis of the rows is that of y
    turned = dataclasses.replace(crates(turned=turns), origin=(*-at, 0.0))
    angle = -turns * math.pi / 2
    spin = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    one = found_on(upright, {"a": route})
    other = found_on(turned, {"a": route @ spin.T})
    losses = [
        sorted(each.loss for each in found.features if each.kind == OBJECT)
        for found in (one, other)
    ]
    np.testing.assert_allclose(losses[1], losses[0], rtol=1e-3, atol=1e-6)
    assert other.deviations[0] == pytest.approx(one.deviations[0], rel=1e-6)


def test_a_map_with_a_yaw_has_the_same_losses_and_places_in_the_world():
    grid, yaw = crates(), 0.7
    spin = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    turned = dataclasses.replace(grid, origin=(3.0, -2.0, yaw))
    one = found_on(grid, {"a": CRATES_ROUTE})
    other = found_on(turned, {"a": CRATES_ROUTE @ spin.T + (3.0, -2.0)})
    for own, theirs in zip(one.features[:4], other.features[:4], strict=True):
        assert theirs.loss == pytest.approx(own.loss, rel=1e-3)
        at = spin @ (own.x, own.y) + np.array([3.0, -2.0])
        assert (theirs.x, theirs.y) == pytest.approx(tuple(at), abs=1e-6)
        assert theirs.worst_at == pytest.approx(
            tuple(spin @ own.worst_at + np.array([3.0, -2.0])), abs=1e-6
        )
        assert math.sin(theirs.heading - own.heading - yaw) == pytest.approx(0, abs=1e-6)


def test_features_that_stand_in_for_each_other_matter_together(hallway):
    pair = with_objects(hallway, Pole(0.3), [(1.0, 0.6), (1.0, -0.6)])
    found, alone = found_on(pair, count=2), found_on(hallway)
    assert {(round(found.feature(n).x), found.feature(n).kind) for n in found.together} == {
        (1, OBJECT)
    }
    rise = found.deviations[-1] - found.deviations[0]
    assert rise > 2 * sum(found.feature(n).loss for n in found.together)
    assert found.stand_in
    assert "stand in for each other" in found.verdict
    assert found.deviations[-1] == pytest.approx(alone.deviations[0], rel=0.03)


def test_in_a_furnished_place_no_single_feature_matters(hallway):
    poles = [(x, y) for x in np.arange(-8, 9, 0.8) for y in (0.8, -0.8)]
    found = found_on(with_objects(hallway, Pole(0.3), poles))
    assert not found.mattering
    assert found.verdict.startswith("no single feature matters: the largest loss is ")


def test_of_a_moved_feature_the_pose_follows_a_part(found):
    first = found.features[0]
    assert 0.02 < first.error < 0.3
    twice = found_on(found.grid, shift=0.6)
    assert twice.features[0].error == pytest.approx(2 * first.error)


def test_without_walls_in_sight_there_is_no_feature():
    empty = OccupancyGrid(np.full((200, 200), FREE, np.uint8), 0.1)
    found = key_features(empty, robot=Robot(SHORT), paths=np.array([[[8.0, 10.0], [12.0, 10.0]]]))
    assert len(found) == 0
    assert found.verdict.startswith("no feature is seen")
    assert found.together == ()
    assert json.dumps(found.summary())
    assert found.verdict in found.report()
    with pytest.raises(LocplanError, match="no feature"):
        found.verify(2)
    assert found._repr_png_()


def test_progress_ends_with_all(with_pole):
    calls = []
    found = found_on(with_pole, count=2, progress=lambda *done: calls.append(done))
    assert calls[-1][0] == calls[-1][1] == 2 * len(found)
    assert [done for done, _ in calls] == list(range(1, len(calls) + 1))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"count": 0}, "count"),
        ({"count": 51}, "count"),
        ({"piece": 0.0}, "piece"),
        ({"piece": 1000.0}, "piece"),
        ({"gap": 50.0}, "gap"),
        ({"largest": -1.0}, "largest"),
        ({"gap": -0.1}, "gap"),
        ({"shift": math.nan}, "shift"),
        ({"robot": "rplidar-a1"}, "robot must be a Robot"),
        ({"paths": None}, "not both"),
        ({"places": [(0, 0), (1, 0)]}, "not both"),
        ({"paths": {"out": np.array([[0.0, 0.0], [50.0, 0.0]])}}, "path out: leaves"),
        ({"paths": {}}, "at least one"),
    ],
)
def test_bad_arguments_are_refused(hallway, wrong, said):
    with pytest.raises(LocplanError, match=said):
        key_features(hallway, **({"paths": ROUTE} | wrong))
    with pytest.raises(LocplanError):
        key_features("map.yaml", paths=ROUTE)


# Drives


@pytest.fixture(scope="module")
def drives(found):
    return found.verify(6, random_sets=2)


def test_features_are_verified_by_drives_in_a_world_that_lacks_them(found, drives):
    assert (drives.before.number, drives.after.number, drives.random.number) == (6, 6, 6)
    assert drives.after.rmse.value > drives.before.rmse.value
    assert {n: each.number for n, each in drives.alone.items()} == dict.fromkeys(found.together, 2)
    assert drives.alone[1].rmse.value > drives.before.rmse.value
    again = found.verify(6, random_sets=2, threads=1)
    assert again.summary() == drives.summary()


def test_the_world_lacks_what_the_map_still_shows(found, drives):
    gone = lacking(found.grid, *(found.feature(n) for n in found.together))
    simulator = Simulator(gone, robot=found.robot, filter_map=found.grid, seed=1)
    (driven,) = drive_paths(simulator, found.routes, 6).values()
    np.testing.assert_array_equal(driven.errors, drives.profiles["middle"][1].errors)


# Reports and the command


@pytest.mark.draws
def test_the_figure_is_drawn(found, drives, tmp_path):
    for name, given in (("without", None), ("with", drives)):
        file = tmp_path / f"{name}.png"
        figure = key_features_figure(found, given)
        check_looks(figure, f"key features {name} drives")
        locplan.plotting.save_figure(figure, file)
        assert file.stat().st_size > 10_000


def test_features_are_saved_with_rectangles_and_losses(found, drives, tmp_path):
    found.save(tmp_path, drives)
    made = json.loads((tmp_path / "features.geojson").read_text())["features"]
    about = [each["properties"] for each in made]
    assert [each["number"] for each in about] == [n + 1 for n in range(len(found))]
    order = {each["together"]: each["number"] for each in about if each["together"]}
    assert tuple(order[n] for n in (1, 2, 3)) == found.together
    assert [each["loss"] for each in about] == [each.loss for each in found.features]
    assert (about[0]["worst_x"], about[0]["worst_y"]) == found.features[0].worst_at
    with (tmp_path / "verification.csv").open() as file:
        worlds = [row["world"] for row in csv.DictReader(file)]
    few = [f"without {number}" for number in found.together]
    assert worlds == ["all features", *few, "without the 3", "without random ones"]
    ring = np.array(made[0]["geometry"]["coordinates"][0])
    assert (ring[0] == ring[-1]).all()
    assert ring[:4].mean(axis=0) == pytest.approx((found.features[0].x, found.features[0].y))
    first = found.features[0]
    sides = np.sort(np.hypot(*np.diff(ring[:3], axis=0).T))
    assert sides == pytest.approx((first.width, first.length), abs=1e-3)


def test_people_see_the_worst_features_and_those_that_count_together(found, drives):
    ten = [str(n) for n in range(1, 11)]
    late = dataclasses.replace(found, together=(1, 2, len(found)))
    said = [line.split() for line in late.report().splitlines()]
    numbers = [line[0] for line in said if len(line) == 10 and line[0].isdigit()]
    assert numbers == [*ten, str(len(found))]
    assert drives.verdict[:40] in found.report(drives)
    assert "not verified" in found.report()


@pytest.fixture
def map_file(tmp_path, with_pole):
    save_map(with_pole, tmp_path / "hallway.yaml")
    return tmp_path / "hallway.yaml"


FEW = ["--set", "max_particles=100", "--set", "min_particles=100"]
ENDS = ["--start", "-6,0", "--goal", "6,0"]


def test_the_command_writes_features(run, map_file, tmp_path):
    out = tmp_path / "found"
    options = ["--drives", 2, "--set", "range=3", "--count", 2, "-o", out]
    code, said, err = run("features", map_file, *ENDS, *FEW, *options)
    assert code == 0, err
    assert said.index("off by") < said.index("depends on 1 feature") < said.index("object")
    with (out / "features.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[0]["kind"] == "object"
    assert [row["together"] for row in rows].count("") == len(rows) - 2
    losses = [float(row["loss"]) for row in rows]
    assert losses == sorted(losses, reverse=True)
    about = json.loads((out / "features.json").read_text())
    assert about["verification"]["before"]["drives"] == 2
    assert len(about["features"]) == len(rows)
    names = {file.name for file in out.iterdir()}
    assert names >= {"features.png", "features.geojson", "verification.csv"}


def test_the_command_takes_places_and_its_options(run, map_file, tmp_path):
    (tmp_path / "places.csv").write_text("name,x,y\na,-5,0\nb,5,0\n")
    given = ["--places", tmp_path / "places.csv", "--drives", 0, "--set", "range=3", "--json"]
    given += ["--count"]
    code, said, err = run("features", map_file, *given, 1, *FEW)
    assert code == 0, err
    usual = json.loads(said)
    assert usual["verification"] is None
    assert len(usual["together"]) == 1
    more = ["--piece", 3, "--largest", 50, "--shift", 0.6]
    code, said, err = run("features", map_file, *given, 1, *FEW, *more)
    changed = json.loads(said)
    assert code == 0, err
    assert changed["shift"] == 0.6
    assert {each["kind"] for each in changed["features"]} == {"object"}
    assert len(changed["features"]) < len(usual["features"])


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--start", "1,2"],
        [*ENDS, "--drives", "1"],
        [*ENDS, "--count", "0"],
        [*ENDS, "--count", "99"],
        [*ENDS, "--piece", "0"],
        [*ENDS, "--shift", "nan"],
        ["--start", "-60,0", "--goal", "6,0"],
    ],
)
def test_the_command_refuses_in_one_line(run, map_file, options):
    refused(run("features", map_file, *options))


@pytest.mark.long
@pytest.mark.parametrize("name", few_of(["tb4_depot"]))
def test_a_hall_is_lost_without_three_objects(real_maps, name):
    grid = locplan.load_map(real_maps / name)
    route = {"across": np.array([[0.9, 5.1], [-1.8, 5.4], [-14.0, -6.8]])}
    amcl = Amcl(laser_model_type="likelihood_field_prob")
    found = key_features(grid, robot=Robot(filter=amcl), paths=route)
    assert [each.kind for each in found.features[:2]] == ["object", "object"]
    driven = found.verify(40)
    assert driven.hurts
    assert driven.before.lost_rate.value <= 0.05
    assert driven.after.lost_rate.value >= 0.5
    assert driven.random.lost_rate.value <= 0.1


@pytest.mark.parametrize(
    ("number", "error", "said"),
    [
        (
            4,
            0.1,
            "too few drives to know (0% to 49% off by more than 1 m, with 95 %): 0% of the",
        ),
        (
            40,
            0.1,
            "their absence is not shown to hurt: 0% of the drives off by more than 1 m with",
        ),
        (
            4,
            1.5,
            "their absence hurts: 0% of the drives off by more than 1 m with all, 100%",
        ),
    ],
)
def test_few_drives_without_a_difference_tell_nothing(number, error, said):
    before, without = (
        Outcome((Drives(np.zeros((5, 3)), np.full((number, 5, 3), each)),)) for each in (0.1, error)
    )
    assert FeatureDrives(before, without, None, {}, 1, {}, 2).verdict.startswith(said)
