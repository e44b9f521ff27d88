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

import locplan
from locplan import LocplanError, Path, Pole, save_map
from locplan._kernels import features as kernels, landmarks, way_covariances as ways
from locplan._kernels.rays import empty_squares
from locplan.field._surfaces import surface_normals
from locplan.landmarks import FeatureDrives, key_features, key_features_figure, with_objects
from locplan.landmarks._feature_drives import simulator_without, without_cells
from locplan.landmarks._feature_sights import Sights, met_cells
from locplan.landmarks._objects import Shape
from locplan.landmarks._outcomes import Outcome
from locplan.landmarks._pieces import CORNER, OBJECT, WALL, Pieces, pieces_of
from locplan.landmarks._surroundings import hits_on, lines_along, step_of, surroundings
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.robots import Amcl, Lidar, Robot
from locplan.simulation import Drives

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


def sights_of(grid, route=ROUTE, *, lidar=SHORT, amcl=PRODUCT, gap=0.0, largest=4.0):
    routes = {name: Path(xy) for name, xy in route.items()}
    half = Shape(grid.resolution, grid.resolution, is_round=True)
    step = step_of(amcl)
    lines = lines_along(grid, routes, step)
    seen = surroundings(grid, lines, step, half, Robot(lidar, filter=amcl))
    occupied = grid.cells == OCCUPIED
    met = met_cells(occupied, grid.resolution, seen.rays)
    pieces = pieces_of(occupied, met, grid.resolution, 1.0, largest, gap)
    return Sights(occupied, grid.resolution, seen, pieces)


# What a map is divided into


def everything(grid, **settings) -> Pieces:
    occupied = grid.cells == OCCUPIED
    given = {"piece": 1.0, "largest": 3.0, "gap": 0.0} | settings
    return pieces_of(occupied, np.flatnonzero(occupied), grid.resolution, **given)


def test_what_hangs_together_is_one_object_and_what_is_large_is_cut_into_pieces():
    cells = np.full((60, 100), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[20:24, 30:36] = cells[40, 50] = cells[41, 51] = OCCUPIED
    pieces = everything(OccupancyGrid(cells, 0.1))
    assert pieces.kinds[:2] == (OBJECT, OBJECT)
    assert OBJECT not in pieces.kinds[2:]
    assert {pieces.kinds.count(CORNER)} == {4}
    assert ((pieces.labels >= 0) == (cells == OCCUPIED)).all()
    for n in range(len(pieces.kinds)):
        at = pieces.cells(n) * 0.1
        assert np.hypot(*np.ptp(at, axis=0)) < 1.6, n
    assert len(pieces.cells(0)) == 24
    assert pieces.kinds.count(WALL) > 15


def test_a_corner_is_the_middle_of_its_piece():
    cells = np.full((60, 100), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    pieces = everything(OccupancyGrid(cells, 0.1))
    for row, col in ((0, 0), (0, 99), (59, 0), (59, 99)):
        number = pieces.labels[row, col]
        assert pieces.kinds[number] == CORNER
        assert len(pieces.cells(number)) >= 8


def test_the_ends_of_a_gap_in_a_wall_are_corners():
    cells = np.full((60, 100), FREE, np.uint8)
    cells[30:32] = OCCUPIED
    cells[30:32, 45:54] = FREE
    pieces = everything(OccupancyGrid(cells, 0.1))
    left, right = pieces.labels[30, 44], pieces.labels[30, 54]
    assert left != right
    assert pieces.kinds[left] == pieces.kinds[right] == CORNER


@pytest.mark.parametrize(("gap", "count"), [(0.0, 3), (0.1, 3), (0.2, 1)])
def test_parts_of_a_broken_outline_are_one_object(gap, count):
    grid = drawn(
        "..........", ".##..##...", ".#........", "......##..", "..........", resolution=0.1
    )
    pieces = everything(grid, gap=gap)
    assert len(pieces.kinds) == {3: 3, 1: 1}[count] or gap == 0.1
    assert set(pieces.kinds) == {OBJECT}


def test_objects_that_are_too_large_together_stay_apart():
    cells = np.full((20, 80), FREE, np.uint8)
    for col in range(2, 72, 8):
        cells[8:12, col : col + 6] = OCCUPIED  # 0.6 m long, with gaps of 0.2 m
    assert len(everything(OccupancyGrid(cells, 0.1), gap=0.2).kinds) == 9
    assert len(everything(OccupancyGrid(cells, 0.1), gap=0.2, largest=8.0).kinds) == 1


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
    kernels.look(squares, normals, labels, silent, 0.5, rays, wanted, hits, cells)
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
    kernels.look(empty_squares(occupied), normals, labels, none, 0.5, rays, wanted, hits, cells)
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
    _, after = ways.covariances(sums, poses, routes, ways.Told(1.0, 0.0), motion)
    got = kernels.biases(pulls, upper, after, poses, routes)
    wanted = naive.biases(pulls, information, poses, routes, motion)
    np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-12)


def test_a_world_that_is_moved_as_a_whole_moves_the_pose_by_as_much():
    sights = sights_of(with_objects(corridor(8.0, 2.4), Pole(0.3), [(0.5, 0.7)]), SHORT_ROUTE)
    total = sum(sights.biases(n) for n in range(len(sights.pieces.kinds)))
    np.testing.assert_allclose(total[-1, :2], np.eye(2), atol=0.05)


SHORT_ROUTE = {"a": np.array([[-2.5, 0.0], [2.5, 0.2]])}


# Taking features away


def crates(resolution=0.1, turned=0):
    cells = np.full((80, 120), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[30:33, 40:44] = cells[28:32, 60:62] = cells[55:60, 48:53] = OCCUPIED
    cells[31:33, 46:48] = OCCUPIED  # behind the first one, seen from the left
    return OccupancyGrid(np.ascontiguousarray(np.rot90(cells, turned)), resolution)


CRATES_ROUTE = np.array([[1.5, 2.0], [6.0, 4.5], [10.0, 4.0]])


def profile_anew(sights, taken, lidar=SHORT):
    """P_xx + P_yy on the edited map with nothing kept but the number of hits."""
    stands = sights.occupied.copy()
    for n in taken:
        stands[tuple(sights.whole(n).T)] = False
    rays, edge = sights.seen.rays, sights.resolution
    edited = OccupancyGrid(np.where(stands, OCCUPIED, FREE).astype(np.uint8), edge)
    sums = landmarks.sums_of(hits_on(edited, rays), rays)
    before = landmarks.sums_of(sights.seen.hits, rays)
    sums[:, landmarks.HITS] = before[:, landmarks.HITS]
    return sights.profile(sums)


@pytest.mark.parametrize("amcl", [PRODUCT, Amcl()])
def test_without_an_object_is_as_on_the_map_without_it(amcl):
    sights = sights_of(crates(), {"a": CRATES_ROUTE}, amcl=amcl)
    assert sights.pieces.kinds.count(OBJECT) == 4
    np.testing.assert_allclose(sights.profile(), profile_anew(sights, []), rtol=1e-9)
    for n in range(4):
        wanted = profile_anew(sights, [n])
        assert np.abs(wanted / sights.profile() - 1).max() > 1e-3
        np.testing.assert_allclose(sights.without(n), wanted, rtol=1e-6)


def test_without_several_objects_is_as_on_the_map_without_all():
    sights = sights_of(crates(), {"a": CRATES_ROUTE})
    for n in range(3):
        for other in range(4):  # what is remembered of them must not be what was
            sights.without(other)
        sights.take(n)
        np.testing.assert_allclose(sights.profile(), profile_anew(sights, range(n + 1)), rtol=1e-6)
    np.testing.assert_allclose(sights.without(3), profile_anew(sights, range(4)), rtol=1e-6)


def test_what_lies_far_behind_has_the_normals_of_what_stands_there():
    cells = np.full((200, 220), FREE, np.uint8)
    cells[:, 219] = OCCUPIED
    cells[100:104, 213:216] = OCCUPIED  # beside the wall, whose normals it turns
    cells[94:110, 100:103] = OCCUPIED  # hides that from most of the route, 5.5 m away
    grid, far = OccupancyGrid(cells, 0.05), Lidar(range=12.0)
    route = {"a": np.array([[2.0, 4.9], [3.5, 4.0]])}
    tried, taken = (sights_of(grid, route, lidar=far) for _ in range(2))
    beside, hiding = tried.pieces.labels[101, 214], tried.pieces.labels[100, 101]
    tried.without(beside)
    np.testing.assert_allclose(tried.without(hiding), profile_anew(tried, [hiding]), rtol=1e-6)
    taken.take(beside)
    both = profile_anew(taken, [beside, hiding])
    np.testing.assert_allclose(taken.without(hiding), both, rtol=1e-6)
    assert np.abs(both / profile_anew(tried, [hiding]) - 1).max() > 1e-4


def test_the_next_of_the_few_is_the_worst_beside_those_before():
    found = found_on(crates(), {"a": CRATES_ROUTE}, gap=0.0, count=3)
    sights = sights_of(crates(), {"a": CRATES_ROUTE})
    for step in range(3):
        values = [sights.without(n).mean() for n in range(len(sights.pieces.kinds))]
        assert found.curve[step + 1] == pytest.approx(max(values))
        sights.take(int(np.argmax(values)))
    np.testing.assert_allclose(found.profiles[2], sights.profile())


def test_trying_a_feature_changes_nothing():
    sights = sights_of(crates(), {"a": CRATES_ROUTE})
    before = sights.profile(), sights.without(1)
    for n in range(len(sights.pieces.kinds)):
        sights.without(n)
    assert (sights.profile() == before[0]).all()
    assert (sights.without(1) == before[1]).all()


def test_a_piece_of_wall_is_no_window():
    sights = sights_of(crates(), {"a": CRATES_ROUTE})
    piece = sights.pieces.kinds.index(WALL)
    rays = sights.rays_of(piece)
    hits = sights.hits.copy()
    hits[rays] = (np.inf, 0, 0, 0)
    own = sights.seen.rays
    sums = landmarks.sums_of(hits.reshape(len(own.first), own.beams, 4), own)
    sums[:, landmarks.HITS] = sights.sums[:, landmarks.HITS]
    np.testing.assert_allclose(sights.without(piece), sights.profile(sums), rtol=1e-9)
    sights.take(piece)
    np.testing.assert_allclose(sights.profile(), sights.profile(sums), rtol=1e-9)
    assert (sights.without(piece) == sights.profile()).all()


def test_pieces_of_walls_lose_nothing_when_they_go_and_never_gain():
    sights = sights_of(crates(), {"a": CRATES_ROUTE})
    base = sights.profile()
    for n, kind in enumerate(sights.pieces.kinds):
        if kind != OBJECT:
            assert (sights.without(n) >= base * (1 - 1e-9)).all()


def test_rays_that_reach_a_silent_wall_behind_an_object_tell_nothing():
    sights = sights_of(crates(), {"a": CRATES_ROUTE}, lidar=Lidar(range=8.0))
    behind = [n for n, kind in enumerate(sights.pieces.kinds) if kind != OBJECT]
    for n in behind:
        sights.take(n)
    assert np.isfinite(sights.hits[:, 0]).any()
    for n in range(4):
        sights.take(n)
    assert np.isinf(sights.hits[:, 0]).all()
    assert np.abs(sights.sums[:, : landmarks.HITS]).max() < 1e-4


# The features that matter


def test_the_only_pillar_of_a_bare_corridor_matters_most(found):
    first = found.features[0]
    assert first.kind == OBJECT
    assert (first.x, first.y) == pytest.approx((1.0, 0.6), abs=0.06)
    assert found.mattering == (first,)
    assert first.loss > 5 * found.features[1].loss
    assert found.together[0] == 1
    assert "hangs on 1 feature" in found.verdict
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
    assert (drives.before.number, drives.without.number, drives.random.number) == (6, 6, 6)
    assert drives.without.rmse.value > drives.before.rmse.value
    assert {n: each.number for n, each in drives.alone.items()} == dict.fromkeys(found.together, 2)
    assert drives.alone[1].rmse.value > drives.before.rmse.value
    again = found.verify(6, random_sets=2, threads=1)
    assert again.summary() == drives.summary()


def test_the_world_lacks_what_the_map_still_shows(found):
    robot = found.robot.changed({"boundary_noise": 0.0})
    cells = found.features[0].cells
    made = simulator_without(found.grid, [cells], robot, 1, 1)
    assert made.grid is found.grid
    gone = without_cells(found.grid, cells)
    assert (made.worlds[0] == empty_squares(gone.cells == OCCUPIED)).all()
    assert (gone.cells != found.grid.cells).sum() == len(cells)


# Reports and the command


@pytest.mark.draws
def test_the_figure_is_drawn(found, drives, tmp_path):
    for name, given in (("without", None), ("with", drives)):
        file = tmp_path / f"{name}.png"
        locplan.plotting.save_figure(key_features_figure(found, given), file)
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
    assert said.index("lost") < said.index("hangs on 1 feature") < said.index("object")
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
    more = ["--piece", 3, "--largest", 50, "--gap", 0, "--shift", 0.6]
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
    assert driven.without.lost_rate.value >= 0.5
    assert driven.random.lost_rate.value <= 0.1


@pytest.mark.parametrize(
    ("number", "error", "said"),
    [
        (
            4,
            0.1,
            "too few drives to tell (lost drives 0% to 49%, with 95 %): 0% of the",
        ),
        (40, 0.1, "their absence is not shown to hurt: 0% of the drives lost with all, 0% without"),
        (4, 1.5, "their absence hurts: 0% of the drives lost with all, 100% without the 2"),
    ],
)
def test_few_drives_without_a_difference_tell_nothing(number, error, said):
    before, without = (
        Outcome((Drives(np.zeros((5, 3)), np.full((number, 5, 3), each)),)) for each in (0.1, error)
    )
    assert FeatureDrives(before, without, {}, None, 2, {}, 1).verdict.startswith(said)
