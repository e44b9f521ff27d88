"""Recorded drives: what they hold, their files, and the logs of CARMEN."""

from __future__ import annotations

import csv
import gzip
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from support import built_in_recording
from support.bag_files import read_with
from support.carmen_logs import format_flaser, format_odom
from support.machine import SHARED_DATA
from support.small_drive import FILE, simulate_drive

from locplan.errors import ConfigError, LocplanError, RecordingError
from locplan.recordings import Recording, read_recording
from locplan.robots import Kinematics, Lidar, Robot

LIDAR = Lidar(range=8.0, min_range=0.2, field_of_view_deg=180.0, beams=5, mount_x=0.1)
NAMES = ("aces", "csail", "fhw", "intel", "orebro", "seattle")


def drive(count=6, *, times=True, odometry=True, **changes) -> Recording:
    random = np.random.default_rng(3)
    poses = np.column_stack([np.arange(count) * 0.5, np.zeros(count), np.linspace(0, 4, count)])
    values = {
        "ranges": np.round(random.uniform(0.3, 7.9, (count, 5)), 3),
        "lidar": LIDAR,
        "poses": poses,
        "times": 100.0 + 0.5 * np.arange(count) if times else None,
        "odometry": poses + np.array([0.1, 0.2, 0.05]) if odometry else None,
    }
    values["ranges"][1, 2] = np.inf
    return Recording(**values | changes)


def same(one: Recording, other: Recording, tolerance: float = 0.0) -> None:
    assert one.lidar == other.lidar
    for name in ("ranges", "poses", "times", "odometry"):
        ours, theirs = getattr(one, name), getattr(other, name)
        assert (ours is None) == (theirs is None), name
        if ours is not None:
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance, err_msg=name)


def test_recording_copies_and_freezes_arrays():
    poses = np.zeros((2, 3))
    made_of = Recording([[1.0] * 5, [2.0] * 5], LIDAR, poses)
    poses[0] = 7.0
    assert made_of.poses[0].tolist() == [0, 0, 0]
    for array in (made_of.ranges, made_of.poses, drive().times, drive().odometry):
        assert not array.flags.writeable
    assert made_of.ranges.dtype == np.float32


def test_recording_stores_missing_returns_as_infinity():
    readings = [np.nan, np.inf, -1.0, 0.1, 8.0]
    both = Recording([readings, [0.2, 1.0, 2.0, 3.0, 7.999]], LIDAR, np.zeros((2, 3)))
    assert np.isinf(both.ranges[0]).all()
    assert np.isfinite(both.ranges[1]).all()


def test_headings_are_wrapped():
    turned = Recording([[1.0] * 5], LIDAR, [[0.0, 0.0, 7.0]])
    assert turned.poses[0, 2] == pytest.approx(7.0 - 2 * math.pi)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"poses": [[0.0, 0.0, math.nan]] * 6}, "pose 0 must be finite"),
        ({"poses": [[0.0, 1e9, 0.0]] * 6}, "pose 0 must be finite and within"),
        ({"poses": [[0.0, 0.0]] * 6}, "poses must be rows of x, y, heading"),
        ({"poses": "here"}, "poses must be an array of numbers, not 'here'"),
        ({"odometry": [[0.0, 0.0, 0.0]]}, "odometry must be a pose for each of 6 scans, not 1"),
        ({"times": [0.0, 1, 2, 3, 2, 5]}, "times decrease at scan 4"),
        ({"times": [0.0]}, "times must be 6 finite seconds"),
        ({"ranges": np.ones((6, 4))}, r"ranges must be \(scans, beams\) for 6 poses and 5 beams"),
        ({"ranges": np.full((6, 5), 900.0)}, "no beam of 6 scans ends within 0.2 to 8 m"),
        ({"lidar": "sick"}, "lidar must be a Lidar"),
    ],
)
def test_recording_rejects_inconsistent_arrays(changes, words):
    with pytest.raises(LocplanError, match=words):
        replace(drive(), **changes)


def test_recording_selects_scans():
    whole = drive()
    same(whole[1:4], whole[[1, 2, 3]])
    same(whole.subsample(2), whole[np.arange(6) % 2 == 0])
    same(whole.window(0.5, 1.5), whole[1:3])
    assert len(whole[5:]) == 1
    assert whole[::3].odometry[1].tolist() == whole.odometry[3].tolist()
    for choice, words in (
        (2, "a slice, indices or a mask"),
        ([7], "there are none at these indices"),
        (slice(6, 6), "none of 6 scans"),
        ([0.5], "a slice, indices or a mask"),
    ):
        with pytest.raises(RecordingError, match=words):
            whole[choice]
    with pytest.raises(RecordingError, match="no scan lies 10 to 20 s"):
        whole.window(10, 20)
    with pytest.raises(RecordingError, match="has no times"):
        drive(times=False).window(0, 1)


def test_moved_recording_transforms_beam_ends():
    whole = drive()
    moved = whole.move(1.0, -2.0, 0.7)
    cos, sin = math.cos(0.7), math.sin(0.7)
    ends = whole.ends() @ np.array([[cos, sin], [-sin, cos]]) + (1.0, -2.0)
    np.testing.assert_allclose(moved.ends(), ends, atol=1e-12)
    same(moved.move(*_back((1.0, -2.0, 0.7))), whole, 1e-9)


def _back(move):
    x, y, turn = move
    cos, sin = math.cos(turn), math.sin(turn)
    return -cos * x - sin * y, sin * x - cos * y, -turn


def test_beam_ends_use_lidar_mount():
    lidar = Lidar(
        range=9.0, field_of_view_deg=90.0, beams=3, mount_x=0.5, mount_y=0.1, mount_yaw_deg=90.0
    )
    ends = Recording([[1.0, 2.0, np.inf]], lidar, [[1.0, 1.0, math.pi / 2]]).ends()[0]
    np.testing.assert_allclose(ends[1], [1.0 - 2.1, 1.5], atol=1e-12)
    root = math.sqrt(0.5)
    np.testing.assert_allclose(ends[0], [1.0 - 0.1 - root, 1.5 + root], atol=1e-7)
    assert np.isnan(ends[2]).all()


@pytest.mark.parametrize(("times", "odometry"), [(True, True), (False, False), (False, True)])
def test_loaded_recording_equals_saved_recording(tmp_path, times, odometry):
    whole, path = drive(times=times, odometry=odometry), tmp_path / "a.npz"
    whole.save(path)
    same(Recording.load(path), whole)
    same(read_recording(path, every=2), whole.subsample(2), 1e-6)
    if times:
        same(read_recording(path, window=(0.4, 1.1)), whole.window(0.4, 1.1), 1e-6)
    near = read_recording(path, range_limits=(0.2, 3.0), mount=(1.0, 2.0, math.pi))
    assert (near.lidar.range, near.lidar.mount_x, near.lidar.mount_yaw_deg) == (3.0, 1.0, 180.0)
    np.testing.assert_array_equal(np.isinf(near.ranges), ~(whole.ranges < 3.0))


def test_npz_keeps_exact_ranges(tmp_path):
    """Only ranges of whole millimetres are stored as integers."""
    odd = drive(ranges=np.random.default_rng(1).uniform(0.3, 7.9, (6, 5)))
    odd.save(tmp_path / "odd.npz")
    same(Recording.load(tmp_path / "odd.npz"), odd)
    assert np.load(tmp_path / "odd.npz")["ranges"].dtype == np.float32
    drive().save(tmp_path / "whole.npz")
    assert np.load(tmp_path / "whole.npz")["ranges"].dtype == np.uint16


def test_recording_reads_npz_of_other_programs(tmp_path):
    path = tmp_path / "a.npz"
    lidar = json.dumps({"range": 5.0, "beams": 2})
    np.savez(path, ranges=[[1.0, 2.0]], poses=[[0, 0, 0]], lidar=lidar)
    assert read_recording(path).ranges.tolist() == [[1.0, 2.0]]
    np.savez(path, ranges=np.array([[1500, 65535]], np.uint16), poses=[[0, 0, 0]], lidar=lidar)
    assert read_recording(path).ranges.tolist() == [[1.5, np.inf]]
    for arrays, words in (
        ({"lidar": "{"}, "its lidar must be JSON"),
        ({"lidar": '{"range": -1}'}, "its lidar is invalid: range must be"),
        ({"lidar": '{"reach": 8}'}, "its lidar has no 'reach'; known are range, min_range"),
        ({"poses": [[0, 0, np.nan]]}, "pose 0 must be finite"),
        ({"poses": np.array([{}])}, "is not a valid .npz file"),
    ):
        np.savez(path, **{"ranges": [[1.0, 2.0]], "poses": [[0, 0, 0]], "lidar": lidar} | arrays)
        with pytest.raises(LocplanError, match=f"a.npz: {words}"):
            read_recording(path)
    np.savez(path, ranges=[[1.0]])
    with pytest.raises(RecordingError, match="has no array poses and lidar"):
        read_recording(path)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"every": 0}, "every must be a whole number"),
        ({"window": (2.0, 1.0)}, "window must be a start and a later end"),
        ({"window": 3.0}, "window must be two numbers"),
        ({"range_limits": (3.0, 1.0)}, "range_limits must be a minimum and a maximum"),
        ({"mount": (1.0, 2.0)}, "mount must be x, y"),
        ({"pose_topic": "/pose"}, "pose_topic applies only to bags"),
        ({"scan_topic": "/scan"}, "scan_topic applies only to logs of robots"),
        ({"map_frame": "world"}, "map_frame applies only to logs of robots"),
        ({"scan_topic": ""}, "scan_topic must be a name"),
        ({"map_frame": ""}, "map_frame must be a name"),
    ],
)
def test_read_recording_rejects_wrong_options(tmp_path, options, words):
    path = tmp_path / "a.npz"
    drive().save(path)
    with pytest.raises(ConfigError, match=words):
        read_with(path, **options)


def test_unknown_files_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="there is no such file"):
        read_recording(tmp_path / "a.npz")
    (tmp_path / "a.txt").write_text("x")
    with pytest.raises(RecordingError, match=r"unknown format; use .mcap"):
        read_recording(tmp_path / "a.txt")
    with pytest.raises(RecordingError, match=r"is a folder without metadata.yaml, with no bag"):
        read_recording(tmp_path)
    with pytest.raises(RecordingError, match=r"must end in .npz"):
        drive().save(tmp_path / "a.bag")


def test_recording_has_report_and_summary():
    about = json.loads(json.dumps(drive().summary(), allow_nan=False))
    assert (about["scans"], about["beams"], about["seconds"]) == (6, 5, 2.5)
    assert (about["length"], about["spacing"]) == (2.5, 0.5)
    assert about["turned"] == pytest.approx(4.0)
    assert about["returns"] == pytest.approx(29 / 30)
    assert "2.5 m, 2.5 s" in drive().report()
    assert "no times" in drive(times=False, odometry=False).report()


def test_carmen_log_keeps_line_order(tmp_path):
    path = tmp_path / "a.log"
    path.write_text(
        "# made up\nPARAM robot_length 1 0 host 0\n"
        + format_odom((0.0, 0, 0), 1.0) + format_flaser((5.0, 5, 0), stamp=1.5)
        + format_odom((1.0, 0, 0), 2.0) + format_odom((2.0, 0, 0), 3.0)
        + format_flaser((7.0, 5, 1), stamp=3.0) + "NEFF 3\n"
    )  # fmt: skip
    read = read_recording(path)
    assert read.poses.tolist() == [[5, 5, 0], [7, 5, 1]]
    assert read.odometry[:, 0].tolist() == [0.5, 2.0]  # between the lines, by their stamps
    assert read.times.tolist() == [1.5, 3.0]
    assert (read.lidar.range, read.lidar.beams, read.lidar.field_of_view_deg) == (49.9, 4, 135.0)
    assert read.lidar.mount_yaw_deg == -22.5
    assert read.ranges[0].tolist() == [1.0, 2.0, np.inf, np.inf]
    same(read_recording(path, every=2), read.subsample(2))


def test_carmen_odometry_joins_restarted_segments(tmp_path):
    """In some logs, odometry restarts at each corrected pose."""
    lines, at = "", np.zeros(2)
    for n in range(4):  # a metre ahead from each corrected pose
        lines += format_odom((*at, 0.0)) + format_flaser((at[0] + 0.3, at[1] + 0.1 * n, 0.0))
        at += [0.3, 0.1 * n]
        lines += format_odom((*at, 0.0))
        at += [1.0, 0.0]
    (tmp_path / "a.log").write_text(lines)
    read = read_recording(tmp_path / "a.log")
    np.testing.assert_allclose(read.odometry[:, :2], [[n, 0.0] for n in range(4)], atol=1e-12)
    assert read.times is None
    np.testing.assert_allclose(
        read_recording(tmp_path / "a.log", every=2).odometry, read.odometry[::2]
    )


def test_carmen_odometry_rests_without_lines(tmp_path):
    lines, at = "", np.zeros(2)
    for n in range(5):
        scan = format_flaser((at[0] + 0.3, at[1] + 0.1 * n, 0.0))
        lines += format_odom((*at, 0.0)) + scan * (2 if n == 2 else 1)
        at += [0.3, 0.1 * n]
        lines += format_odom((*at, 0.0))
        at += [1.0, 0.0]
    (tmp_path / "a.log").write_text(lines)
    read = read_recording(tmp_path / "a.log")
    ahead = [0, 1, 2, 2, 3, 4]
    np.testing.assert_allclose(read.odometry[:, :2], [[n, 0.0] for n in ahead], atol=1e-12)


def test_carmen_reader_recognizes_corrected_poses(tmp_path):
    path = tmp_path / "a.log"
    lidar = ((0.2, 0.0, 0.0), (1.0, 0.2, math.pi / 2))
    robot = ((0.0, 0.0, 0.0), (1.0, 0.0, math.pi / 2))
    path.write_text("".join(format_flaser(*each) for each in zip(lidar, robot, strict=True)))
    read = read_recording(path)
    np.testing.assert_allclose(read.poses, robot)
    assert (read.lidar.mount_x, read.lidar.mount_y) == (0.2, 0.0)
    assert read.odometry is None
    drifting = ((0.0, 0.0, 0.0), (4.0, 0.0, 1.0))
    path.write_text("".join(format_flaser(*each) for each in zip(lidar, drifting, strict=True)))
    read = read_recording(path)
    np.testing.assert_allclose(read.poses, lidar)
    np.testing.assert_allclose(read.odometry, drifting)
    assert read.lidar.mount_x == 0.0


def test_robotlaser_line_has_angles_and_range(tmp_path):
    line = (
        "ROBOTLASER1 0 -0.5 1.0 0.25 8.0 0.01 0 5 1 2 3 4 8.1 1 7 0.1 0 0 0 0 0 0 0 1 1 1 {} h 2\n"
    )
    (tmp_path / "a.clf.gz").write_bytes(gzip.compress((line.format(2) + line.format(3)).encode()))
    read = read_recording(tmp_path / "a.clf.gz")
    assert read.ranges[0].tolist() == [1, 2, 3, 4, np.inf]
    assert read.lidar.range == 8.0
    assert read.lidar.field_of_view_deg == pytest.approx(math.degrees(1.0), abs=1e-4)
    assert (read.lidar.mount_x, read.times.tolist()) == (0.1, [2.0, 3.0])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no scans .* it has nothing; pass a log of CARMEN"),
        (format_odom((0, 0, 0)) + "NEFF 3\n", "has no scans .* it has NEFF"),
        (
            format_flaser((0, 0, 0))[:30] + "\n" + format_odom((0, 0, 0)),
            "line 1 is cut off or damaged",
        ),
        (format_flaser((0, 0, math.nan)) + format_odom((0, 0, 0)), "line 1 is cut off or damaged"),
        (format_flaser((0, 0, 0), ranges=(0.0, 0.0)), "no beam of 1 scans"),
    ],
)
def test_carmen_reader_rejects_damaged_logs(tmp_path, text, words):
    (tmp_path / "a.log").write_text(text)
    with pytest.raises(RecordingError, match=f"a.log: {words}"):
        read_recording(tmp_path / "a.log")


def test_carmen_reader_skips_truncated_line(tmp_path):
    (tmp_path / "a.log").write_text(format_flaser((0, 0, 0)) + format_flaser((1, 0, 0))[:20])
    read = read_recording(tmp_path / "a.log")
    assert len(read) == 1
    assert re.search("last line, 2, is cut off", read.source.notes[0])
    packed = gzip.compress(format_flaser((0, 0, 0)).encode() * 50)
    (tmp_path / "b.log.gz").write_bytes(packed[:-12])
    with pytest.raises(RecordingError, match=r"is cut off or damaged \(gzip\)"):
        read_recording(tmp_path / "b.log.gz")


@pytest.mark.parametrize("name", NAMES)
def test_real_logs_are_read(name):
    if not (SHARED_DATA / "carmen").is_dir():
        pytest.skip("the logs of real lasers (../shared/data/carmen) are not here")
    read = read_recording(SHARED_DATA / "carmen" / f"{name}-corrected.log.gz")
    assert len(read) == {"aces": 440, "intel": 910}.get(name, len(read))
    assert (read.times is None) == (name in ("csail", "intel", "orebro"))
    assert 0.96 < np.isfinite(read.ranges).mean() < 1.0
    if name == "orebro":
        assert read.odometry is None  # its lines of odometry are the corrected poses
        return
    ways = [np.hypot(*np.diff(each[:, :2], axis=0).T) for each in (read.odometry, read.poses)]
    assert np.median(np.abs(ways[0] - ways[1])) < 0.06
    assert np.abs(read.odometry - read.poses)[:, :2].max() > 1.0


@pytest.mark.parametrize("name", NAMES)
def test_real_logs_equal_reference(name):
    if not (SHARED_DATA / "carmen").is_dir():
        pytest.skip("the logs of real lasers (../shared/data/carmen) are not here")
    limits = (0.05, 30.0 if name in ("intel", "orebro") else 40.0)
    log = SHARED_DATA / "carmen" / f"{name}-corrected.log.gz"
    with (SHARED_DATA / "carmen" / f"localizability_{name}.csv").open() as file:
        rows = list(csv.DictReader(file))
    reference = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
    read = read_recording(log, range_limits=limits)[reference["scan"].astype(int)]
    assert np.abs(read.poses[:, 0] - reference["x"]).max() < 0.001
    assert np.abs(read.poses[:, 1] - reference["y"]).max() < 0.001
    assert np.abs(np.sin(read.poses[:, 2] - reference["theta"])).max() < 0.001
    returns = np.isfinite(read.ranges)
    assert (returns.sum(1) == reference["n_beams"]).all()
    means = [row[known].mean() for row, known in zip(read.ranges, returns, strict=True)]
    np.testing.assert_allclose(means, reference["mean_range"], atol=1e-4)


def test_small_drive_suits_filter_replay():
    assert FILE.stat().st_size < 250_000
    small = Recording.load(FILE)
    steps = np.hypot(*np.diff(small.poses[:, :2], axis=0).T)
    assert steps.max() <= 0.25
    assert len(small) > 300
    assert small.odometry is not None
    assert (np.diff(small.times) > 0).all()


@pytest.mark.long
def test_small_drive_equals_simulated_drive():
    small, again = Recording.load(FILE), simulate_drive()
    np.testing.assert_allclose(small.poses, again.poses, atol=2e-5)
    np.testing.assert_allclose(small.odometry, again.odometry, atol=2e-5)
    other = ~np.isclose(small.ranges, again.ranges, rtol=0, atol=2e-3)
    assert other.mean() < 0.001  # rounding may let a beam pass a corner


def test_built_in_recording_equals_simulated_recording():
    assert built_in_recording.FILE.stat().st_size < 250_000
    built_in = read_recording(built_in_recording.NAME)
    simulated = built_in_recording.simulate_recording()
    assert (built_in.lidar, built_in.source) == (simulated.lidar, simulated.source)
    np.testing.assert_allclose(built_in.poses, simulated.poses, atol=2e-5)
    np.testing.assert_allclose(built_in.odometry, simulated.odometry, atol=2e-5)
    differs = ~np.isclose(built_in.ranges, simulated.ranges, rtol=0, atol=2e-3)
    assert differs.mean() < 0.001  # rounding may let a beam pass a corner


def test_file_goes_before_built_in_recording(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert len(read_recording("two_corridors", every=100)) == 10
    (tmp_path / "two_corridors").mkdir()
    with pytest.raises(RecordingError, match="two_corridors: is a folder without metadata"):
        read_recording("two_corridors")


def test_missing_recording_lists_built_in_recordings():
    with pytest.raises(
        RecordingError, match=r"office: there is no .*built-in recording: two_corridors"
    ):
        read_recording("office")


def test_recording_robot_has_lidar_and_kinematics():
    lidar = Lidar(range=10.0, field_of_view_deg=180.0, beams=3)
    ahead = np.column_stack([np.arange(6) * 0.3, np.zeros(6), np.zeros(6)])
    ahead[:, 0] = 0.0, 0.3, 0.3, 0.3, 0.3, 0.6  # it stands most of the time
    ranges, times = np.full((6, 3), 2.0), np.arange(6) / 2
    robot = Recording(ranges, lidar, ahead, times, ahead).robot()
    assert robot.lidar == lidar
    assert robot.kinematics == Kinematics(speed=0.6)
    aside = ahead[:, [1, 0, 2]]
    assert Recording(ranges, lidar, aside, times, aside).robot().kinematics.drive == (
        "omnidirectional"
    )
    turning = np.column_stack([aside[:, :2], np.arange(6.0)])
    assert Recording(ranges, lidar, turning, times, turning).robot().kinematics.drive == (
        "differential"
    )
    known = Robot(footprint=0.4, kinematics=Kinematics(speed=1.5))
    own = Recording(ranges, lidar, aside, times, aside).robot(known)
    assert (own.footprint, own.kinematics) == (0.4, known.kinematics)
    assert Recording(ranges, lidar, ahead).robot().kinematics == Kinematics()
