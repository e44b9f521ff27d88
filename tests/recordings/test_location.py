"""Global localization: where on a map a single scan was taken."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from support import oracles
from support.cases import sample_cases
from support.command_line import check_refusal
from support.machine import SHARED_DATA
from support.small_drive import FILE, MAP

import locplan
from locplan import Lidar, LocplanError, Path, load_map, locate
from locplan.errors import ConfigError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.recordings import Recording
from locplan.recordings.evaluation import match_scans
from locplan.recordings.figures import locate_figure, located_drive_figure
from locplan.recordings.kernels.scan_losses import (
    can_robot_stand_at,
    compute_loss_at_pose,
    refine_on_lattice,
    refine_pose,
)
from locplan.recordings.location import locate_drive
from locplan.recordings.matching import (
    MatchingSettings,
    ScanDatabase,
    ScanOnMap,
    make_range_database,
)

pytestmark = pytest.mark.usefixtures("undrawn")

CARMEN = SHARED_DATA / "carmen"
LIDAR = Lidar(range=10.0, beams=240)
NEAR, TURNED = 0.05, math.radians(1.0)


def rooms(*, differ: bool = False) -> OccupancyGrid:
    """Two rooms of 5.9 m x 4 m, 6.2 m apart, each with a column and a step in a wall.

    They are alike but for a box in the second one, if they differ.
    """
    cells = np.full((88, 250), OCCUPIED, np.uint8)
    for left in (4, 128):
        cells[4:84, left : left + 118] = FREE
        cells[40:48, left + 30 : left + 40] = OCCUPIED
        cells[4:14, left + 80 : left + 100] = OCCUPIED
    if differ:
        cells[64:84, 128 + 40 : 128 + 62] = OCCUPIED
    # A likelihood field does not know which face of a thin wall a beam meets.
    cells = np.pad(cells, 12, constant_values=OCCUPIED)
    return OccupancyGrid(cells, 0.05, (-3.6, 1.4, 0.0), name="rooms")


def scan_at(grid: OccupancyGrid, lidar: Lidar, *pose: float) -> np.ndarray:
    """Ranges of the lidar's beams at a pose in the world, without noise [m]."""
    from locplan._support.kernels.lidar import (
        LidarBeams as Beams,
        compute_lidar_offset,
        write_scan_ends,
    )
    from locplan._support.kernels.rays import compute_empty_squares

    beams = Beams(
        angles=lidar.angles,
        forward=lidar.mount_x,
        left=lidar.mount_y,
        yaw=lidar.mount_yaw,
        sigma=0.03,
        min_range=lidar.min_range,
        max_range=lidar.range,
    )
    row, col = grid.world_to_grid(pose[0], pose[1])
    heading = pose[2] - grid.origin[2]
    ends = np.empty((lidar.beams, 2))
    squares = compute_empty_squares(grid.cells == OCCUPIED)
    write_scan_ends(squares, grid.resolution, float(row), float(col), heading, beams, ends)
    away = ends - np.array(compute_lidar_offset(beams, heading, grid.resolution))
    ranges = np.hypot(*away.T) * grid.resolution
    return np.where(np.isnan(ranges), np.inf, ranges)


def is_at(mode, x, y, heading) -> bool:
    turn = abs((mode.pose[2] - heading + math.pi) % (2 * math.pi) - math.pi)
    return math.hypot(mode.pose[0] - x, mode.pose[1] - y) < NEAR and turn < TURNED


POSES = ((1.5, 3.4, 0.3), (5.0, 3.3, -2.0), (0.3, 5.3, 1.2), (7.31, 4.84, 3.0))


@pytest.fixture(scope="module")
def alike():
    return rooms()


@pytest.fixture(scope="module")
def different():
    return rooms(differ=True)


@pytest.mark.parametrize("kind", sample_cases(["places", "office"]))
def test_locate_finds_simulated_scans(kind):
    grid = locplan.maps.environments.make(kind, resolution=0.05)
    random = np.random.default_rng(4)
    places = np.argwhere(grid.free & (grid.clearance > 0.4))
    wrong, certain = [], 0
    for row, col in places[random.integers(len(places), size=8)]:
        pose = *grid.position(row, col), random.uniform(-3, 3)
        ranges = scan_at(grid, LIDAR, *pose) + 0.02 * random.standard_normal(LIDAR.beams)
        found = locate(grid, ranges, LIDAR)
        certain += found.is_certain
        if not is_at(found.best, *pose) and found.is_certain:
            wrong.append((pose, found))
    assert not wrong
    assert certain >= 3


@pytest.mark.parametrize("pose", POSES[:2])
def test_twin_rooms_give_equal_modes(alike, pose):
    found = locate(alike, scan_at(alike, LIDAR, *pose), LIDAR)
    first, second = found.modes[:2]
    other = pose[0] + (6.2 if pose[0] < 3.2 else -6.2), *pose[1:]
    assert {is_at(first, *pose), is_at(first, *other)} == {True, False}
    assert {is_at(second, *pose), is_at(second, *other)} == {True, False}
    assert first.weight == pytest.approx(0.5, abs=0.12)
    assert second.weight == pytest.approx(0.5, abs=0.12)
    assert not found.is_certain
    assert found.sentence.startswith("Two places look alike: ")
    assert sum(mode.weight for mode in found.modes) <= 1 + 1e-9


def test_near_path_distinguishes_twin_rooms(alike):
    pose = POSES[0]
    ranges = scan_at(alike, LIDAR, *pose)
    for aside in (0.0, 6.2):
        route = np.array([[aside - 1.0, 4.0], [aside + 2.0, 4.0]])
        for near in (Path(route), np.linspace(*route, 8)):
            found = locate(alike, ranges, LIDAR, near=near, within=1.0)
            assert is_at(found.best, pose[0] + aside, *pose[1:])
            assert found.is_certain
            assert "no other place near the route" in found.sentence


def test_modes_lie_within_distance_of_path(alike):
    route = Path([[8.0, 4.0], [9.0, 4.0]])
    found = locate(alike, scan_at(alike, LIDAR, *POSES[0]), LIDAR, near=route, within=0.6)
    for mode in found.modes:
        x, y, _ = mode.pose
        assert math.hypot(x - min(max(x, 8.0), 9.0), y - 4.0) < 0.6 + alike.resolution


@pytest.mark.parametrize("pose", POSES)
def test_locate_distinguishes_different_rooms(different, pose):
    found = locate(different, scan_at(different, LIDAR, *pose), LIDAR)
    assert is_at(found.best, *pose)
    assert found.explained_share > 0.95


@pytest.mark.parametrize(
    "lidar",
    [
        replace(LIDAR, mount_x=0.3, mount_y=-0.2),
        replace(LIDAR, mount_x=-0.2, mount_yaw_deg=130.0),
        replace(LIDAR, field_of_view_deg=180.0, beams=181, mount_yaw_deg=-90.0, mount_x=0.25),
        replace(LIDAR, field_of_view_deg=220.0, beams=700, min_range=0.2),
    ],
)
def test_locate_uses_lidar_mount_and_view(different, lidar):
    for pose in POSES[1:3]:
        found = locate(different, scan_at(different, lidar, *pose), lidar)
        alike = [mode for mode in found.modes if mode.excess < 0.5]
        assert any(is_at(mode, *pose) for mode in alike)
    aside = locate(different, scan_at(different, lidar, *POSES[1]), replace(lidar, mount_x=1.0))
    assert not any(is_at(mode, *POSES[1]) for mode in aside.modes)


def test_modes_rotate_with_map_yaw(different):
    turn, at = 0.7, (4.0, -5.0)
    turned = OccupancyGrid(different.cells, different.resolution, (*at, turn))
    cos, sin = math.cos(turn), math.sin(turn)
    x, y, heading = POSES[0]
    ahead, left = x + 3.6, y - 1.4
    pose = at[0] + cos * ahead - sin * left, at[1] + sin * ahead + cos * left, heading + turn
    straight = locate(different, scan_at(different, LIDAR, *POSES[0]), LIDAR)
    found = locate(turned, scan_at(turned, LIDAR, *pose), LIDAR)
    assert is_at(found.best, *pose)
    rotation = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    expected = rotation @ straight.best.covariance @ rotation.T
    np.testing.assert_allclose(found.best.covariance, expected, rtol=0.05, atol=1e-5)


def test_mode_covariance_equals_match_covariance(different):
    ranges = scan_at(different, LIDAR, *POSES[0])
    found = locate(different, ranges, LIDAR)
    drive = Recording(ranges[None], LIDAR, [found.best.pose])
    matched = match_scans(drive, different)
    np.testing.assert_allclose(found.best.covariance, matched.covariance[0], rtol=1e-5)
    assert found.best.position_std == pytest.approx(matched.position_std[0], rel=1e-5)


def test_database_serves_only_its_map(different, alike):
    database = ScanDatabase(different, LIDAR)
    ranges = scan_at(different, LIDAR, *POSES[0])
    with_it = locate(different, ranges, LIDAR, database=database)
    assert with_it.best.pose == locate(different, ranges, LIDAR).best.pose
    with pytest.raises(ConfigError, match="for another map or lidar"):
        locate(alike, ranges, LIDAR, database=database)
    assert repr(database) == "ScanDatabase(rooms, lidar, 10 m, 360°)"


def test_mode_weights_follow_excess(different):
    found = locate(different, scan_at(different, LIDAR, *POSES[1]), LIDAR, count=50)
    weights = np.array([mode.weight for mode in found.modes])
    excess = np.array([mode.excess for mode in found.modes])
    assert len(weights) >= 2
    np.testing.assert_allclose(weights, np.exp(-excess) / np.exp(-excess).sum())
    assert found.second_excess == excess[1] > excess[0] == 0
    few = locate(different, scan_at(different, LIDAR, *POSES[1]), LIDAR, count=1)
    assert [few.best.weight, few.second_excess] == [weights[0], excess[1]]


def test_locate_reports_poorly_fitting_scan(different):
    ranges = np.random.default_rng(0).uniform(0.5, 6.0, LIDAR.beams)
    found = locate(different, ranges, LIDAR)
    assert not found.fits
    assert "Only 33% of the returns" in found.sentence


def test_locate_counts_similar_places():
    cells = np.full((30, 400), FREE, np.uint8)
    cells[:3] = cells[-3:] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1)
    found = locate(grid, scan_at(grid, LIDAR, 20.0, 1.5, 0.0), LIDAR, count=4)
    assert len(found.modes) == 4
    assert found.second_excess <= 3.0
    assert found.sentence.startswith("4 or more places look alike; the best, ")
    every = locate(grid, scan_at(grid, LIDAR, 20.0, 1.5, 0.0), LIDAR, count=200)
    assert every.sentence.startswith(f"{len(every.modes)} places look alike; the best, ")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"scan": np.ones(7)}, r"the lidar's 240 beams, not an array of shape \(7,\)"),
        ({"scan": np.full(240, np.nan)}, "beam 0 is NaN; use inf"),
        ({"scan": np.full(240, np.inf)}, "no beam of the scan ends within 0 to 10 m"),
        (
            {"scan": np.where(np.arange(240) < 3, 1.0, np.inf)},
            r"too few returns \(3\) to locate it",
        ),
        ({"scan": "scan"}, "a scan must be an array of ranges"),
        ({"scan": [1.0, [2.0]]}, "a scan must be an array of ranges"),
        ({"lidar": None}, "needs a lidar; pass lidar="),
        ({"lidar": "rplidar-a1"}, "lidar must be a Lidar"),
        ({"near": [[500.0, 500.0]]}, "the robot fits nowhere within 3 m of the 1 positions"),
        ({"near": [1.0, 2.0]}, "a path needs an"),
        ({"near": [[1.0, 2.0]], "within": 0.1}, "within must be"),
        ({"count": 0}, "count must be"),
        ({"clearance": -1.0}, "clearance must be"),
        ({"clearance": 50.0}, "fits nowhere"),
        ({"database": 3}, "database must be a ScanDatabase"),
    ],
)
def test_locate_rejects_bad_arguments(alike, given, said):
    scan = given.pop("scan", scan_at(alike, LIDAR, *POSES[0]))
    with pytest.raises(LocplanError, match=said) as caught:
        locate(alike, scan, **{"lidar": LIDAR, **given})
    assert "\n" not in str(caught.value)


def test_locate_takes_lidar_from_recording(alike):
    ranges = np.array([scan_at(alike, LIDAR, *pose) for pose in POSES[:2]])
    drive = Recording(ranges, LIDAR, POSES[:2])
    found = locate(alike, drive[1:], near=[POSES[1][:2]])
    assert is_at(found.best, *POSES[1])
    with pytest.raises(ConfigError, match="one scan is located at a time, not 2"):
        locate(alike, drive)
    with pytest.raises(ConfigError, match="has another lidar"):
        locate(alike, drive[:1], replace(LIDAR, range=5.0))


def test_lattice_refinement_equals_plain_loops(different):
    database = make_range_database(different, MatchingSettings(lidar=LIDAR))
    ranges = scan_at(different, LIDAR, *POSES[0])
    compared = database.matching.select_ranges(ranges[None])[0]
    scan = ScanOnMap(database, compared)
    ends, compute_lidar_offset = scan.ends, scan.turn_lever
    tables, last = database.tables, len(database.tables.corners) - 1

    def refined(pose):
        moved = np.array(pose)
        refine_pose(tables, last, ends, compute_lidar_offset, moved)
        return tuple(moved.tolist())

    x, y, heading = POSES[0]
    row, col = different.world_to_grid(x, y)
    at = np.array([col, row, heading - different.origin[2]])
    gains = []
    for shift in ((4.0, -3.0, 0.15), (11.0, -9.0, 0.3), (-9.0, 8.0, -0.4), (30.0, 0.0, 0.0)):
        expected, least = oracles.matching.settle(
            lambda pose: compute_loss_at_pose(tables, last, ends, *pose),
            lambda pose: can_robot_stand_at(tables, *pose[:2]),
            refined,
            *(4, 2.0, 3, 0.1),
            tuple((at + shift).tolist()),
        )
        pose = at + shift
        assert refine_on_lattice(tables, ends, compute_lidar_offset, 4, 2.0, 3, 0.1, pose) == least
        np.testing.assert_array_equal(pose, expected)
        gains.append(
            compute_loss_at_pose(tables, last, ends, *refined(tuple((at + shift).tolist()))) - least
        )
    assert max(gains) > 0


def test_scan_database_limits_compared_beams(different):
    """The compared beams are evenly spaced over the whole circle."""
    lidar = replace(LIDAR, beams=1000)
    on_robot = lidar.compute_ends_on_robot(np.full((1, 1000), 2.0, np.float32))
    ends = ScanDatabase(different, lidar).select_compared_ends(on_robot[0])
    assert ends.shape == (2, 360)
    np.testing.assert_allclose(np.hypot(*ends), 2.0 / different.resolution, rtol=1e-5)
    directions = np.degrees(np.arctan2(ends[1], ends[0]))
    np.testing.assert_allclose(directions, np.arange(-179.5, 180), atol=0.36)  # a beam's spacing


@pytest.fixture(scope="module")
def office():
    return load_map(MAP)


@pytest.fixture(scope="module")
def located(office):
    return locate_drive(Recording.load(FILE).subsample(25), office, threads=1)


def test_locate_drive_finds_recorded_poses(located, office):
    drive = located.recording
    assert len(located) == len(drive)
    assert located.is_right[located.is_certain].mean() > 0.9
    alone = locate(office, drive[3:4])
    assert alone.best.pose == located.locations[3].best.pose
    assert "located within 0.3 m and 3° of the recorded pose" in located.sentence
    assert located.summary()["right"] == located.is_right.mean()


def test_thread_count_does_not_change_poses(located, office):
    again = locate_drive(located.recording.subsample(3), office, threads=2)
    np.testing.assert_array_equal(again.poses, located.poses[::3])


def test_locate_drive_skips_scans_lacking_returns(located, office):
    ranges = located.recording.ranges[:3].copy()
    ranges[1, 5:] = np.inf
    found = locate_drive(replace(located.recording[:3], ranges=ranges), office)
    assert found.locations[1] is None
    assert np.isnan(found.poses[1]).all()
    assert found.is_certain[1] == found.is_right[1] == False  # noqa: E712
    assert "1 scans have too few returns" in found.report()


def test_locate_reports_poses_of_another_frame(located, office):
    found = replace(located, recording=located.recording.move(3.0, 1.0, 0.5))
    assert "do not agree with the map" in found.sentence


def test_locate_reports_returns_off_walls(located):
    strange = [replace(each, explained_share=0.3, second_excess=0.0) for each in located.locations]
    found = replace(located, locations=tuple(strange))
    assert f"Only 0 of {len(located)} scans have most of their returns at walls" in found.sentence
    assert located.fits.mean() > 0.5
    assert "Only" not in located.sentence


def test_location_table_has_recorded_poses(located):
    times = located.recording.times + 5.0
    recording = replace(located.recording, times=times)
    unknown = replace(located, recording=recording, locations=(None, *located.locations[1:]))
    first, second, *_ = unknown.table().records()
    assert (first["x"], first["explained"], first["distance"]) == (None, None, None)
    assert (first["scan"], first["recorded_x"]) == (0, located.recording.poses[0, 0])
    best = located.locations[1].best
    assert [second[name] for name in ("x", "y", "heading")] == list(best.pose)
    assert second["heading_std"] == best.heading_std
    assert second["second"] == located.locations[1].second_excess or math.isinf(
        located.locations[1].second_excess
    )
    assert second["turn"] == located.turn[1]
    assert second["time"] == times[1] - times[0]
    assert located.summary()["median_turn"] == np.median(located.turn[located.is_right])


def test_mode_table_has_covariance(located):
    location = located.locations[1]
    record = location.table().records()[0]
    covariance = location.best.covariance
    assert (record["covariance_xh"], record["covariance_yy"]) == (
        covariance[0, 2],
        covariance[1, 1],
    )


def test_scans_without_poses_are_located(located, office):
    recording = located.recording[:3]
    unplaced = replace(recording, poses=np.full((3, 3), np.nan))
    found = locate_drive(unplaced, office, threads=1)
    np.testing.assert_array_equal(found.poses, located.poses[:3])
    certain = int(found.is_certain.sum())
    assert found.sentence.startswith(
        f"{certain} of 3 scans have no alternative place within 3 nats."
    )
    assert found.summary()["right"] is None
    assert "certain" in found.figure().axes[0].get_legend_handles_labels()[1][0]
    assert "recorded" not in locate_drive(unplaced[:1], office, threads=1).report()


def test_single_scan_report_lists_places(located, office):
    found = locate_drive(located.recording[2:3], office)
    text, about = found.report(), found.summary()
    assert "recorded" in text
    assert f" {math.degrees(found.single_location.best.heading_std):.1f}\n" in text
    assert found.figure().get_suptitle() == locate_figure(found.single_location).get_suptitle()
    assert "from the recorded pose." in text.splitlines()[-1]
    assert about["modes"][0]["weight"] <= 1
    assert about["recorded"]["distance"] == pytest.approx(found.distance[0])
    json.dumps(about, allow_nan=False)


def test_locate_figure_numbers_places(alike):
    found = locate(alike, scan_at(alike, LIDAR, *POSES[0]), LIDAR)
    figure = locate_figure(found, recorded=POSES[0])
    texts = {text.get_text() for text in figure.axes[0].texts}
    assert {"1", "2"} <= texts
    assert "look alike" in figure.get_suptitle()
    assert len(figure.axes) == 1
    assert [patch.angle for patch in figure.axes[0].patches]


def test_large_map_figure_has_detail_view(located):
    figure = locate_figure(located.locations[0])
    assert len(figure.axes) == 2
    figure = located_drive_figure(located)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert any(label.startswith("right, certain: ") for label in labels)


def test_command_locates_single_scan_and_drive(run, tmp_path):
    ask = "locate", MAP, "--recording", FILE
    code, out, err = run(*ask, "--scan", 40, "--json", "-o", tmp_path / "one")
    about = json.loads(out)
    assert code == 0
    assert about["modes"][0]["excess"] == 0
    assert about["recorded"]["distance"] < 0.3 or not about["certain"]
    assert err.splitlines()[0] == f"wrote {tmp_path / 'one' / 'located.png'}: the picture"
    with (tmp_path / "one" / "modes.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["x"]) for row in rows] == pytest.approx(
        [mode["x"] for mode in about["modes"]]
    )
    code, out, err = run(*ask, "--every", 60, "-o", tmp_path / "all")
    assert code == 0
    assert "Errors of the correct locations: median" in out
    with (tmp_path / "all" / "scans.csv").open(encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) == math.ceil(len(Recording.load(FILE)) / 60)
    assert not (tmp_path / "all" / "modes.csv").exists()


def test_command_selects_scan_by_time(run, tmp_path):
    drive = Recording.load(FILE)
    timed = replace(drive, times=np.arange(len(drive)) * 0.5)
    timed.save(tmp_path / "timed.npz")
    Path(drive.poses[35:45, :2]).save(tmp_path / "route.csv")
    ask = "locate", MAP, "--recording", tmp_path / "timed.npz"
    near = "--near-path", tmp_path / "route.csv", "--within", 1
    code, out, _ = run(*ask, "--at", 20.1, "--json", *near)
    about = json.loads(out)
    assert code == 0
    assert about["recorded"]["x"] == pytest.approx(drive.poses[40, 0])
    assert about["recorded"]["distance"] < 0.3
    assert "--at must be from 0 to" in check_refusal(run(*ask, "--at", 1e6))
    assert "--every has no effect with --scan" in check_refusal(
        run(*ask, "--scan", 1, "--every", 2)
    )
    assert "--every has no effect with --at" in check_refusal(run(*ask, "--at", 1, "--every", 2))
    assert "--at has no effect with --scan" in check_refusal(run(*ask, "--scan", 1, "--at", 2))
    assert "--within has no effect without --near-path" in check_refusal(run(*ask, "--within", 2))
    assert "--scan must be from 0 to" in check_refusal(run(*ask, "--scan", 99999))
    assert "name a recording with --recording" in check_refusal(run("locate", MAP))
    replace(drive, times=None).save(tmp_path / "untimed.npz")
    untimed = "locate", MAP, "--recording", tmp_path / "untimed.npz", "--at", 3
    assert "the recording has no times; use --scan instead of --at" in check_refusal(run(*untimed))


@pytest.mark.long
@pytest.mark.skipif(not CARMEN.exists(), reason="the recorded logs are not here")
@pytest.mark.parametrize("name", ["csail", "intel", "orebro"])
def test_scans_of_real_lasers_are_located(name):
    """Odd scans on the map of the even ones."""
    from locplan.recordings import read_recording

    with (CARMEN / f"localizability_{name}.csv").open(encoding="utf-8", newline="") as file:
        scans = np.array([int(float(row["scan"])) for row in csv.DictReader(file)])
    grid = load_map(SHARED_DATA / "rosmaps_carmen" / f"{name}_even")
    limits = (0.05, 30.0 if name in ("intel", "orebro") else 40.0)
    drive = read_recording(CARMEN / f"{name}-corrected.log.gz", range_limits=limits)
    some = scans[np.linspace(0, len(scans) - 1, 100).round().astype(int)]
    found = locate_drive(drive[some], grid)
    assert found.is_right.mean() >= 0.94
    assert found.is_certain.mean() >= 0.65
    assert found.is_right[found.is_certain].mean() >= 0.97
