"""Recorded drives from bags that PyPI's rosbags wrote."""

from __future__ import annotations

import math
import pickle
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest
from support.bag_files import (
    BEGIN,
    KINDS,
    compose,
    invert,
    message_times,
    open_bag,
    read_with,
    write_drive,
)
from support.cases import sample_cases
from support.machine import SHARED_DATA
from support.small_drive import FILE

from locplan._support import poses
from locplan.errors import LocplanError, RecordingError
from locplan.recordings import Recording, read_recording
from locplan.robots import Lidar

LIDAR = Lidar(
    range=9.0, min_range=0.1, field_of_view_deg=180.0, beams=7, mount_x=0.2, mount_yaw_deg=30.0
)
CIRCLE = Lidar(range=9.0, field_of_view_deg=360.0, beams=8, mount_x=-0.1, mount_yaw_deg=10.0)


def make_drive(lidar=LIDAR, count=8) -> Recording:
    random = np.random.default_rng(5)
    turn = np.linspace(3.0, 3.5, count)  # past pi
    poses = np.column_stack([np.linspace(0, 2, count), np.linspace(1, 1.5, count), turn])
    odometry = [compose((0.3, 0.2, 0.1 + 0.01 * n), pose) for n, pose in enumerate(poses)]
    ranges = random.uniform(0.5, 8.5, (count, lidar.beams)).astype(np.float32)
    ranges[2, 1] = np.inf
    return Recording(ranges, lidar, poses, BEGIN + 0.1 * np.arange(count), odometry)


def check_equal_recordings(read: Recording, wanted: Recording, tolerance: float = 1e-9) -> None:
    np.testing.assert_array_equal(read.ranges, wanted.ranges)
    np.testing.assert_array_equal(read.times, message_times(wanted))
    for ours, theirs in ((read.poses, wanted.poses), (read.odometry, wanted.odometry)):
        if theirs is None:
            assert ours is None
            continue
        np.testing.assert_allclose(ours[:, :2], theirs[:, :2], rtol=0, atol=tolerance)
        off = (ours[:, 2] - theirs[:, 2] + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(off).max() < tolerance
    np.testing.assert_allclose(read.ends(), wanted.ends(), rtol=0, atol=1e-4)


def test_bag_reader_accepts_repeated_yaml_anchors(tmp_path):
    """The library ruamel.yaml warns of repeated anchors."""
    path = write_drive(tmp_path, make_drive(), "mcap")
    about = path / "metadata.yaml"
    first, second, rest = about.read_text().split(": ", 2)
    about.write_text(f"{first}: &a {second}: &a {rest}")  # an anchor twice
    check_equal_recordings(read_recording(path), make_drive())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lidar", [LIDAR, CIRCLE], ids=["part", "circle"])
def test_loaded_bag_equals_written_drive(tmp_path, kind, lidar):
    wanted = make_drive(lidar)
    path = write_drive(tmp_path, wanted, kind)
    read = read_recording(path)
    check_equal_recordings(read, wanted)
    lidar = replace(lidar, range_sigma=read.lidar.range_sigma)
    assert replace(read.lidar, mount_x=round(read.lidar.mount_x, 5)) == lidar
    assert read.source.scans == "/scan"
    assert read.source.poses == "TF map -> base_link"
    assert read.source.odometry == "TF odom -> base_link"
    assert (read.source.lidar_frame, read.source.notes) == ("laser", ())
    check_equal_recordings(read_recording(path, every=3), wanted.subsample(3))
    if kind != "ros1":  # the file in the folder is a bag, too
        (file,) = (each for each in path.iterdir() if each.suffix != ".yaml")
        check_equal_recordings(read_recording(file), wanted)
        (path / "metadata.yaml").unlink()
        check_equal_recordings(read_recording(path), wanted)


@pytest.mark.parametrize(
    ("kind", "packed"),
    [
        *(("mcap", mode) for mode in ("STORAGE", "MESSAGE", "FILE")),
        *(("sqlite3", mode) for mode in ("MESSAGE", "FILE")),
        *(("ros1", mode) for mode in ("BZ2", "LZ4")),
    ],
)
def test_compressed_bag_equals_written_drive(tmp_path, kind, packed):
    check_equal_recordings(
        read_recording(write_drive(tmp_path, make_drive(), kind, packed)), make_drive()
    )


@pytest.mark.parametrize(
    ("kind", "packed", "limit"),
    [
        *(("mcap", mode, "MAX_CHUNK_BYTES") for mode in ("STORAGE", "MESSAGE")),
        ("sqlite3", "FILE", "MAX_RATIO"),
        *(("ros1", mode, "MAX_CHUNK_BYTES") for mode in ("BZ2", "LZ4")),
    ],
)
def test_bag_reader_limits_unpacked_size(tmp_path, monkeypatch, kind, packed, limit):
    path = write_drive(tmp_path, make_drive(), kind, packed)
    monkeypatch.setattr(f"locplan.recordings.bags.{limit}", 1)
    with pytest.raises(RecordingError, match="unpacks to over"):
        read_recording(path)


@pytest.mark.parametrize("kind", KINDS)
def test_small_drive_survives_bag_conversion(tmp_path, kind):
    small = Recording.load(FILE)
    small = replace(small, times=small.times + BEGIN)
    check_equal_recordings(read_recording(write_drive(tmp_path, small, kind)), small)


@pytest.mark.parametrize(
    "name", sample_cases(("orebro", "aces", "csail", "fhw", "intel", "seattle"))
)
@pytest.mark.parametrize("kind", KINDS)
def test_real_logs_survive_bag_conversion(tmp_path, kind, name):
    if not (SHARED_DATA / "carmen").is_dir():
        pytest.skip("the logs of real lasers (../shared/data/carmen) are not here")
    log = read_recording(SHARED_DATA / "carmen" / f"{name}-corrected.log.gz")
    path = write_drive(tmp_path, log, kind)
    check_equal_recordings(read_recording(path), log)
    assert read_recording(path).lidar == log.lidar


def test_poses_are_interpolated_at_scan_stamps(tmp_path):
    with open_bag(tmp_path, "mcap") as (path, bag):
        bag.tf(BEGIN, bag.transform(BEGIN, "map", "odom", (1.0, 2.0, math.pi / 2)))  # sent once
        for n in range(6):  # turns through pi
            time = BEGIN + 0.4 * n
            bag.tf(time, bag.transform(time, "odom", "base_link", (n, 0.0, 3.0 + 0.1 * n)))
        bag.tf(BEGIN, bag.transform(BEGIN, "base_link", "laser", (0, 0, 0)), topic="/tf_static")
        for time in (-1.0, 0.1, 0.6, 1.0, 9.0):
            bag.scan(BEGIN + time, LIDAR, np.ones(7))
    read = read_recording(path)
    np.testing.assert_allclose(read.times - BEGIN, [0.1, 0.6, 1.0], atol=1e-6)
    at = np.array([0.25, 1.5, 2.5])
    np.testing.assert_allclose(read.poses[:, :2], np.column_stack([[1.0] * 3, 2.0 + at]), atol=1e-6)
    turned = 3.0 + 0.1 * at + math.pi / 2 - 2 * math.pi
    np.testing.assert_allclose(read.poses[:, 2], turned, atol=1e-6)
    assert read.source.notes == ("2 of 5 scans have no pose",)


def test_interpolation_skips_gaps_with_motion(tmp_path):
    with open_bag(tmp_path, "mcap") as (path, bag):
        for time, x in ((0.0, 0.0), (10.0, 0.01), (20.0, 5.0)):
            bag.plain_pose(BEGIN + time, (x, 0.0, 0.0))
        for time in (5.0, 15.0):
            bag.scan(BEGIN + time, LIDAR, np.ones(7))
    read = read_recording(path)
    assert len(read) == 1
    assert read.poses[0].tolist() == pytest.approx([0.005, 0, 0])


@pytest.mark.parametrize("kind", KINDS)
def test_upside_down_lidar_has_reversed_beams(tmp_path, kind):
    wanted = make_drive()
    lidar = wanted.lidar
    with open_bag(tmp_path, kind) as (path, bag):
        mount = (lidar.mount_x, 0.0, lidar.mount_yaw)
        fixed = bag.transform(BEGIN, "base_link", "laser", mount, roll=math.pi)
        bag.tf(BEGIN, fixed, topic="/tf_static")
        for time, pose, ranges in zip(wanted.times, wanted.poses, wanted.ranges, strict=True):
            bag.tf(time, bag.transform(time, "map", "base_link", pose))
            bag.scan(time, lidar, ranges[::-1])
    check_equal_recordings(read_recording(path), replace(wanted, odometry=None))


def test_bag_reader_normalizes_scan_angles(tmp_path):
    """Clockwise scans are reversed, and scans with other angles are resampled."""
    wanted, lidar = make_drive(), LIDAR
    first, last = float(lidar.angles[0]), float(lidar.angles[-1])
    with open_bag(tmp_path, "mcap") as (path, bag):
        mount = (lidar.mount_x, 0.0, lidar.mount_yaw)
        bag.tf(BEGIN, bag.transform(BEGIN, "base_link", "laser", mount), topic="/tf_static")
        for n, time in enumerate(wanted.times):
            bag.tf(time, bag.transform(time, "map", "base_link", wanted.poses[n]))
            changes = {"angle_min": last, "angle_increment": (first - last) / 6, "angle_max": first}
            ranges = wanted.ranges[n][::-1]
            if n == 3:  # one beam fewer
                ranges = ranges[:-1]
            bag.scan(time, lidar, ranges, **changes)
    read = read_recording(path)
    ranges = wanted.ranges.copy()
    ranges[3, 0] = np.inf
    check_equal_recordings(read, replace(wanted, ranges=ranges, odometry=None))
    assert read.source.notes == ("1 of 8 scans were resampled to the angles of the first one",)


def test_full_circle_drops_repeated_beam(tmp_path):
    with open_bag(tmp_path, "mcap") as (path, bag):
        bag.plain_pose(BEGIN, (0.0, 0.0, 0.0))
        step = 2 * math.pi / 8
        ends = {"angle_min": 0.0, "angle_max": 2 * math.pi, "angle_increment": step}
        bag.scan(BEGIN, CIRCLE, [1, 2, 3, 4, 5, 6, 7, 8, 1], **ends)
    read = read_recording(path)
    assert read.ranges.tolist() == [[1, 2, 3, 4, 5, 6, 7, 8]]
    np.testing.assert_allclose(read.ends()[0, 0], [1.0, 0.0], atol=1e-5)
    np.testing.assert_allclose(read.ends()[0, 2], [0.0, 3.0], atol=1e-5)


def write_poses_without_tf(folder, *topics, scan="/scan"):
    """A bag with some topics of poses and no TF."""
    wanted = make_drive()
    with open_bag(folder, "mcap") as (path, bag):
        for n, time in enumerate(wanted.times):
            for topic in topics:
                pose = wanted.poses[n]
                if "odom" in topic:
                    frame = "map" if "global" in topic else "odom"
                    bag.odometry(time, wanted.odometry[n], topic=topic, frame=frame)
                elif "mocap" in topic or "goal" in topic:
                    bag.plain_pose(time, pose, topic=topic)
                else:
                    bag.amcl_pose(time, pose, topic=topic)
            bag.scan(time, LIDAR, wanted.ranges[n], topic=scan)
    return path, wanted


@pytest.mark.parametrize(
    ("topics", "options", "pose_topic"),
    [
        (("/amcl_pose", "/odom"), {}, "/amcl_pose"),
        (("/amcl_pose", "/initialpose", "/mocap", "/odom"), {}, "/amcl_pose"),
        (("/mocap", "/goal_pose", "/odom"), {}, "/mocap"),
        (("/amcl_pose", "/mocap"), {"pose_topic": "/mocap"}, "/mocap"),
        (("/global/odom", "/odom"), {}, "/global/odom"),
        (("/odom",), {"pose_topic": "/odom"}, "/odom"),
    ],
)
def test_pose_topics_replace_missing_tf(tmp_path, topics, options, pose_topic):
    path, wanted = write_poses_without_tf(tmp_path, *topics)
    read = read_with(path, **options)
    assert read.source.poses == pose_topic
    poses = wanted.odometry if "odom" in pose_topic else wanted.poses
    np.testing.assert_allclose(read.poses[:, :2], poses[:, :2], atol=1e-9)
    assert (read.odometry is None) == ("/odom" not in topics or pose_topic == "/odom")
    assert "there is no TF: the lidar is assumed at the robot's centre" in read.source.notes[0]
    assert (read.lidar.mount_x, read.lidar.mount_y) == (0.0, 0.0)
    mounted = read_with(path, **options, mount=(0.2, 0.0, math.radians(30.0)))
    assert mounted.lidar.mount_x == 0.2
    assert mounted.lidar.mount_yaw_deg == pytest.approx(30.0, abs=1e-4)


def test_odometry_carries_amcl_poses_to_scans(tmp_path):
    """AMCL publishes few poses, and between them the robot drives there and back."""
    count = 31
    along = np.abs(np.linspace(-1.5, 1.5, count))
    poses = np.column_stack([along, 0.1 * np.arange(count), np.linspace(2.5, 4.0, count)])
    drift = [(0.02 * n, 0.0, 0.3 + 0.001 * n) for n in range(count)]
    with open_bag(tmp_path, "sqlite3") as (path, bag):
        for n, pose in enumerate(poses):
            time = BEGIN + 0.5 * n
            bag.odometry(time, compose(drift[n], pose))
            if n % 6 == 3:  # half way to the next scan
                bag.amcl_pose(time + 0.25, (pose + poses[n + 1]) / 2)
            bag.scan(time, LIDAR, np.ones(7))
    read = read_recording(path)
    index = np.rint((read.times - BEGIN) / 0.5).astype(int)
    assert set(range(28)) <= set(index.tolist())
    turned = np.abs(np.angle(np.exp(1j * (read.poses[:, 2] - poses[index, 2]))))
    assert turned.max() < 0.01
    assert np.abs(read.poses[:, :2] - poses[index, :2]).max() < 0.15  # the drift of 5 to 10 scans
    reported = np.array([compose(drift[n], poses[n]) for n in index])
    np.testing.assert_allclose(read.odometry[:, :2], reported[:, :2], atol=1e-9)
    between = (index > 3) & (index < 27)
    assert np.abs(read.poses[between, :2] - poses[index[between], :2]).max() < 0.005


def test_bag_reader_names_competing_topics(tmp_path):
    path, _ = write_poses_without_tf(tmp_path, "/a/mocap", "/b/mocap")
    with pytest.raises(
        RecordingError, match="poses on /a/mocap and /b/mocap; choose one with pose"
    ):
        read_recording(path)
    assert read_with(path, pose_topic="/b/mocap").source.poses == "/b/mocap"
    with pytest.raises(RecordingError, match="no poses on /c; set pose_topic= to one of: /a/mocap"):
        read_with(path, pose_topic="/c")
    with pytest.raises(RecordingError, match="no scans on /c; set scan_topic= to one of: /scan"):
        read_with(path, scan_topic="/c")
    with open_bag(tmp_path, "ros1") as (path, bag):
        for topic in ("/front", "/rear"):
            bag.scan(BEGIN, LIDAR, np.ones(7), topic=topic)
    with pytest.raises(
        RecordingError, match="scans on /front and /rear; choose one with scan_topic"
    ):
        read_recording(path)


@pytest.mark.parametrize("source", ["topic", "TF"])
def test_odometry_replaces_missing_poses(tmp_path, source):
    """A drive without localization is what `trajectory` is for."""
    with open_bag(tmp_path, "mcap") as (path, bag):
        for n in range(3):
            time, pose = BEGIN + 0.1 * n, (0.1 * n, 0.0, 0.0)
            bag.scan(time, LIDAR, np.ones(7), frame="tb1/laser")
            if source == "TF":
                bag.tf(time, bag.transform(time, "tb1/odom", "tb1/base_link", pose))
            else:
                bag.odometry(time, pose, topic="/tb1/odom")
        if source == "TF":
            mount = bag.transform(BEGIN, "tb1/base_link", "tb1/laser", (0.2, 0, 0))
            bag.tf(BEGIN, mount, topic="/tf_static")
    drive = read_with(path)
    assert drive.poses[:, 0].tolist() == pytest.approx([0.0, 0.1, 0.2])
    np.testing.assert_array_equal(drive.odometry, drive.poses)
    assert any("no poses on the map: poses by odometry" in note for note in drive.source.notes)
    assert drive.lidar.mount_x == pytest.approx(0.2 if source == "TF" else 0.0)
    unplaced = read_with(path, needs_poses=False)
    assert len(unplaced) == 3
    assert not unplaced.has_poses


def test_bag_reader_accepts_bag_without_poses(tmp_path):
    with open_bag(tmp_path, "mcap") as (path, bag):
        bag.scan(BEGIN, LIDAR, np.ones(7))
    drive = read_with(path, needs_poses=False)
    assert repr(drive).endswith("1 scans of 7 beams, no poses)")
    assert np.isnan(drive.poses).all()


def test_bag_errors_name_missing_data(tmp_path):
    def check_refusal(words, kind="mcap", write=lambda bag: None, **options):
        shutil.rmtree(tmp_path / "drive_mcap", ignore_errors=True)
        with open_bag(tmp_path, kind) as (path, bag):
            write(bag)
        with pytest.raises(RecordingError, match=words):
            read_with(path, **options)

    def with_frames(*frames, base="base_link"):
        def write(bag):
            for parent, child in frames:
                for n in range(2):
                    time = BEGIN + 0.1 * n
                    bag.tf(time, bag.transform(time, parent, child, (n, 0, 0)))
            bag.tf(BEGIN, bag.transform(BEGIN, base, "laser", (0, 0, 0)), topic="/tf_static")
            bag.scan(BEGIN, LIDAR, np.ones(7))

        return write

    check_refusal(r"has no scans \(sensor_msgs/LaserScan\); its topics are none")
    check_refusal(
        r"has no scans .* are /mocap \(geometry_msgs/PoseStamped\); record the lidar",
        write=lambda bag: bag.plain_pose(BEGIN, (0, 0, 0)),
    )
    check_refusal(
        "has no poses: neither TF nor", write=lambda bag: bag.scan(BEGIN, LIDAR, np.ones(7))
    )
    check_refusal(
        "TF does not connect 'map' with 'base_link'; connected are: .*base_link - laser - odom",
        write=with_frames(("odom", "base_link"), ("map", "dock")),
    )
    check_refusal(
        "TF does not connect 'world' with 'base_link'; connected are: base_link - laser - odom;",
        write=with_frames(("odom", "base_link")),
        map_frame="world",
    )
    check_refusal(
        "not connect the lidar's frame 'laser' with the robot's 'base_link'; connected at some",
        write=with_frames(("map", "base_link"), base="other"),
    )
    moves = with_frames(("map", "base_link"), ("base_link", "turret"), base="turret")

    def turning(bag):
        moves(bag)
        bag.scan(BEGIN + 0.1, LIDAR, np.ones(7))

    check_refusal("the lidar 'laser' moves relative to 'base_link'", write=turning)
    check_refusal(
        "has no frame 'robot'; set base_frame= to one of: base_link, laser, map",
        write=with_frames(("map", "base_link")),
        base_frame="robot",
    )
    check_refusal(
        r"has no scan on /scan in the window",
        write=with_frames(("map", "base_link")),
        window=(5.0, 6.0),
    )

    def other_clock(bag):
        with_frames(("map", "base_link"))(bag)

    def late(bag):
        bag.scan(BEGIN + 500, LIDAR, np.ones(7))
        for n in range(2):
            bag.plain_pose(BEGIN + n, (n, 0, 0))

    check_refusal(
        "no scan has a pose: /mocap covers .* check that both use the same clock", write=late
    )

    def not_numbers(bag):
        bag.scan(BEGIN, LIDAR, np.ones(7))
        bag.plain_pose(BEGIN, (math.nan, 0, 0))

    check_refusal("all poses of /mocap are invalid", write=not_numbers)

    def out_of_range(bag):
        bag.scan(BEGIN, LIDAR, np.full(7, 2000.0))
        bag.plain_pose(BEGIN, (0, 0, 0))

    check_refusal("no beam of 1 scans ends within 0.1 to 9 m", write=out_of_range)

    def tilted(bag):
        fixed = bag.transform(BEGIN, "base_link", "laser", (0, 0, 0), pitch=math.radians(30))
        bag.tf(BEGIN, fixed, topic="/tf_static")
        bag.scan(BEGIN, LIDAR, np.ones(7))

    check_refusal("the lidar 'laser' is tilted by 30 deg", write=tilted)


def test_bag_reader_rejects_backward_clock(tmp_path):
    with open_bag(tmp_path, "mcap") as (path, bag):
        for n in range(6):
            time = BEGIN + 0.1 * n
            bag.plain_pose(time, (n, 0.0, 0.0))
            stamp = bag.header(time - (3.0 if n > 3 else 0.0), "laser")
            bag.scan(time, LIDAR, np.ones(7), header=stamp)
    with pytest.raises(
        RecordingError, match=r"the clock of /scan runs backwards by 2.9 s at 0.4 s"
    ):
        read_recording(path)
    assert len(read_recording(path, window=(0.0, 0.35))) == 4


def test_bag_reader_sorts_scans_by_stamp(tmp_path):
    wanted = make_drive()
    with open_bag(tmp_path, "mcap") as (path, bag):
        for n in (0, 2, 1, 3, 3, 4, 5, 6, 7):
            time = wanted.times[n]
            bag.plain_pose(time, wanted.poses[n])
            logged = BEGIN + 1.0
            bag.scan(logged, LIDAR, wanted.ranges[n], header=bag.header(time, "laser"))
    read = read_recording(path)
    np.testing.assert_array_equal(read.ranges, wanted.ranges)
    np.testing.assert_allclose(read.poses[:, 0], wanted.poses[:, 0])


def test_bag_reader_finds_namespaced_frames(tmp_path):
    wanted = make_drive()
    with open_bag(tmp_path, "ros1") as (path, bag):
        for name, shift in (("r1", 0.0), ("r2", 50.0)):
            fixed = bag.transform(BEGIN, f"/{name}/base_link", f"/{name}/laser", (0.2, 0, 0))
            bag.tf(BEGIN, fixed, topic=f"/{name}/tf_static")
            for time, pose, ranges in zip(wanted.times, wanted.poses, wanted.ranges, strict=True):
                moved = (pose[0] + shift, pose[1], pose[2])
                bag.tf(
                    time,
                    bag.transform(time, "/map", f"/{name}/base_link", moved),
                    topic=f"/{name}/tf",
                )
                bag.scan(time, LIDAR, ranges, topic=f"/{name}/scan", frame=f"/{name}/laser")
    read = read_with(path, scan_topic="/r2/scan")
    assert (read.source.base_frame, read.source.lidar_frame) == ("r2/base_link", "r2/laser")
    np.testing.assert_allclose(read.poses[:, 0], wanted.poses[:, 0] + 50.0)
    assert read.lidar.mount_x == pytest.approx(0.2)


def test_bag_reader_rejects_damaged_bags(tmp_path):
    for kind, remedy in (("mcap", "mcap recover"), ("sqlite3", ".recover"), ("ros1", "reindex")):
        path = write_drive(tmp_path, make_drive(), kind)
        if path.is_dir():
            (path / "metadata.yaml").unlink()
            (path,) = path.iterdir()
        content = path.read_bytes()
        for size in (0, 10, len(content) // 2, len(content) - 2000):
            path.write_bytes(content[:size])
            with pytest.raises(RecordingError, match=r"cannot be read as a bag|has no") as caught:
                read_recording(path)
            assert str(caught.value).count("\n") == 0
        assert remedy in str(caught.value)


def test_bag_error_names_missing_rosbags(tmp_path, monkeypatch):
    path = write_drive(tmp_path, make_drive(), "mcap")
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(LocplanError, match=r"needs rosbags: pip install 'locplan\[ros\]'"):
        read_recording(path)


def test_progress_counts_messages_in_two_passes(tmp_path):
    path, seen = write_drive(tmp_path, make_drive(), "mcap"), []
    read_recording(path, progress=lambda *each: seen.append(each))
    assert seen == [(0, 8), (8, 8), (0, 24), (24, 24)]


def test_bag_poses_drop_unrelated_frames():
    from locplan.recordings.bags import BagPoses
    from locplan.recordings.logs import ReadOptions

    tree = poses.FrameTree([1.0])
    tree.add_static("base_link", "laser", poses.IDENTITY)
    edges = (("odom", "base_link"), ("base_link", "wheel"), ("world", "camera"))
    for parent, child in edges:
        tree.add(1.0, parent, child, poses.IDENTITY)
    heard = BagPoses(tree, [1.0], "laser", ReadOptions(), "")
    heard.drop_unrelated_frames()
    assert "wheel" in tree.frames  # nothing leads to the map yet
    tree.add(1.0, "map", "odom", poses.IDENTITY)
    heard.drop_unrelated_frames()
    tree.add(1.0, "base_link", "wheel", poses.IDENTITY)
    assert tree.frames == ("base_link", "laser", "map", "odom")


def test_transform_track_keeps_nearest_samples():
    """A track keeps two samples for each scan, however many samples a bag has."""
    track, sizes = poses.TransformTrack([1.0, 2.0, 3.0]), set()
    for n in range(4000):
        track.add((n + 0.5) / 1000, (n + 0.5, *poses.IDENTITY[1:]))
        if n in (1, 3999):
            sizes.add(len(pickle.dumps(track)))
    before, after = track.samples()
    np.testing.assert_allclose(before[:, 0], [0.9995, 1.9995, 2.9995])
    np.testing.assert_allclose(after[:, 0], [1.0005, 2.0005, 3.0005])
    np.testing.assert_allclose(track.interpolate()[:, 0], [1000, 2000, 3000])
    assert len(sizes) == 1


def test_transform_track_uses_late_samples():
    times = [1.0, 2.0, 3.0, 4.0]
    samples = [0.5, 0.9, 1.2, 1.95, 2.1, 2.9, 3.3, 3.6, 4.2]
    wanted = np.array(times) * 10
    for seed in range(20):
        track = poses.TransformTrack(times)
        for time in np.random.default_rng(seed).permutation(samples):
            track.add(float(time), (10 * float(time), *poses.IDENTITY[1:]))
        np.testing.assert_allclose(track.interpolate()[:, 0], wanted)


def test_transform_track_accepts_negated_quaternion():
    track = poses.TransformTrack([1.0])
    for time, yaw, sign in ((0.9, 0.4, 1.0), (1.1, 0.6, -1.0)):
        turn = (sign * math.sin(yaw / 2), sign * math.cos(yaw / 2))
        track.add(time, (yaw, 0.0, 0.0, 0.0, 0.0, *turn))
    np.testing.assert_allclose(
        poses.project_to_plane(track.interpolate()), [[0.5, 0.0, 0.5]], atol=1e-12
    )


def test_transform_times_inverse_is_identity():
    random = np.random.default_rng(2)
    pose = np.concatenate([random.normal(size=(9, 3)), random.normal(size=(9, 4))], axis=1)
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    identity = poses.compose_transforms(pose, poses.invert_transforms(pose))
    np.testing.assert_allclose(identity[:, :6], 0.0, atol=1e-12)
    plane = np.array([[1.0, 2.0, 0.0, 0.0, 0.0, math.sin(0.35), math.cos(0.35)]])
    twice = poses.project_to_plane(poses.compose_transforms(plane, plane))[0]
    np.testing.assert_allclose(twice, compose((1, 2, 0.7), (1, 2, 0.7)))
    np.testing.assert_allclose(
        poses.project_to_plane(poses.invert_transforms(plane))[0], invert((1, 2, 0.7))
    )


@pytest.mark.parametrize("kind", KINDS)
def test_bag_has_speeds_of_odometry(tmp_path, kind):
    """The speed at a scan is interpolated between the messages before and after it."""
    lidar, times = LIDAR, [BEGIN, BEGIN + 0.2, BEGIN + 0.4]
    with open_bag(tmp_path, kind) as (path, bag):
        fixed = bag.transform(BEGIN, "base_link", "laser", (0.0, 0.0, 0.0))
        bag.tf(BEGIN, fixed, topic="/tf_static")
        for n, time in enumerate(times):
            bag.odometry(time, (0.1 * n, 0.0, 0.0), speed=0.5 - n)
            bag.tf(time, bag.transform(time, "map", "base_link", (0.1 * n, 0.0, 0.0)))
        bag.scan(times[0], lidar, np.full(7, 3.0))
        bag.scan(times[2], lidar, np.full(7, 3.0))
        late = bag.header(times[0] + 0.1, "laser")
        bag.scan(times[2] + 0.1, lidar, np.full(7, 3.0), header=late)
    read = read_recording(path)
    np.testing.assert_allclose(read.speeds, [0.5, 0.0, -1.5], atol=1e-6)
    assert read.source.stamps_back == 1
