"""Copies of bags with a trajectory's poses, read back by this project and by PyPI's rosbags."""

from __future__ import annotations

import itertools
import math
import re
import sqlite3
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from drive_bags import BEGIN, KINDS, read_with, write_drive, writing
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import locplan
from locplan.errors import LocplanError, RecordingError
from locplan.recordings import BagCopy, Recording, Topics, Trajectory, read_drive
from locplan.robots import Lidar

LIDAR = Lidar(range=9.0, min_range=0.1, field_of_view_deg=180.0, beams=7, mount_x=0.2)
TRUSTED, DOUBTED = "/locplan/pose", "/locplan/pose_not_trusted"
PACKED = [
    *itertools.product(("mcap",), ("STORAGE", "MESSAGE", "FILE")),
    *itertools.product(("sqlite3",), ("MESSAGE", "FILE")),
    *itertools.product(("ros1",), ("BZ2", "LZ4")),
]


def drive(count=8) -> Recording:
    random = np.random.default_rng(5)
    poses = np.column_stack(
        [np.linspace(0, 2, count), np.linspace(1, 1.5, count), np.linspace(3.0, 3.5, count)]
    )
    ranges = random.uniform(0.5, 8.5, (count, LIDAR.beams)).astype(np.float32)
    return Recording(ranges, LIDAR, poses, BEGIN + 0.1 * np.arange(count), poses + 1.0)


def trajectory_on(recording: Recording) -> Trajectory:
    """Made-up poses of a recording, of which the third and the fourth are not to be trusted."""
    count = len(recording)
    doubts = np.zeros(count, np.int64)
    doubts[2:4] = 1
    poses = recording.poses + np.array([0.1, -0.2, 0.05])
    covariances = np.arange(1, 10).reshape(3, 3) * np.linspace(0.001, 0.002, count)[:, None, None]
    about = (), None, recording.poses, recording.times, recording.source.file, "lab"
    return Trajectory(poses, covariances, doubts, np.zeros(count), *about)


def copied(path, folder, **topics):
    """A bag's copy with made-up poses of all its scans, and the trajectory."""
    copy = BagCopy.of(path, Topics(**topics))
    found = trajectory_on(read_with(path, **topics))
    folder.mkdir()
    copy.write(folder, found.times, found.poses, found.covariances, found.trusted)
    return folder / copy.name, found


def contents(path):
    """All messages of a bag but ours as they are, and ours decoded, by topic."""
    theirs, ours = Counter(), {TRUSTED: [], DOUBTED: []}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, logged, raw in reader.messages():
            if connection.topic in ours:
                message = reader.deserialize(raw, connection.msgtype)
                ours[connection.topic].append((logged, message))
            else:
                theirs[connection.topic, connection.msgtype, logged, bytes(raw)] += 1
        qualities = {each.topic: str(each.ext) for each in reader.connections}
    return theirs, ours, qualities


@pytest.mark.parametrize(("kind", "packed"), [*((kind, "") for kind in KINDS), *PACKED])
def test_a_copy_has_all_that_the_bag_has_and_the_poses(tmp_path, kind, packed):
    path = write_drive(tmp_path, drive(), kind, packed)
    before = {each: each.read_bytes() for each in (path.iterdir() if path.is_dir() else [path])}
    copy, found = copied(path, tmp_path / "out")
    assert all(each.read_bytes() == content for each, content in before.items())
    theirs, ours, qualities = contents(copy)
    original, _, qualities_before = contents(path)
    assert theirs == original
    assert qualities.items() >= qualities_before.items()
    for topic, scans in ((TRUSTED, [0, 1, 4, 5, 6, 7]), (DOUBTED, [2, 3])):
        assert len(ours[topic]) == len(scans)
        for scan, (log_time, message) in zip(scans, ours[topic], strict=True):
            assert message.header.frame_id == "map"
            stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            assert stamp == found.times[scan]
            assert log_time == pytest.approx(1e9 * stamp, abs=200)
            pose = message.pose.pose
            turn = 2 * math.atan2(pose.orientation.z, pose.orientation.w)
            assert (pose.position.x, pose.position.y, turn) == pytest.approx(found.poses[scan])
            matrix = message.pose.covariance.reshape(6, 6)
            assert np.array_equal(matrix[np.ix_((0, 1, 5), (0, 1, 5))], found.covariances[scan])
            assert np.count_nonzero(matrix) == 9


@pytest.mark.parametrize("kind", KINDS)
def test_the_copy_is_read_as_the_bag_was_unless_our_topic_is_named(tmp_path, kind):
    copy, found = copied(write_drive(tmp_path, drive(), kind), tmp_path / "out")
    assert np.allclose(read_drive(copy).poses, drive().poses)
    named = read_with(copy, pose_topic=TRUSTED)
    assert np.allclose(named.poses[found.trusted], found.poses[found.trusted])
    again, _ = copied(copy, tmp_path / "again")  # ours are replaced
    assert contents(again)[0] == contents(copy)[0]
    assert [len(each) for each in contents(again)[1].values()] == [6, 2]


def test_poses_of_amcl_stay_the_only_ones_without_tf(tmp_path):
    with writing(tmp_path, "mcap") as (path, bag):
        for n, time in enumerate(BEGIN + 0.1 * np.arange(8)):
            bag.amcl_pose(time, drive().poses[n])
            bag.scan(time, LIDAR, drive().ranges[n], topic="/front")
            bag.scan(time, LIDAR, drive().ranges[n], topic="/rear")
    copy, _ = copied(path, tmp_path / "out", scan_topic="/front")
    assert read_with(copy, scan_topic="/rear").source.poses == "/amcl_pose"


def test_topics_of_types_that_nobody_knows_stay(tmp_path):
    with writing(tmp_path, "sqlite3") as (path, bag):
        bag.store.register(get_types_from_msg("float32 volts", "lab_msgs/msg/Battery"))
        bag.scan(BEGIN, LIDAR, drive().ranges[0])
        bag.plain_pose(BEGIN, drive().poses[0])
        bag.write("/power", "lab_msgs/msg/Battery", BEGIN, bag.type("lab_msgs/msg/Battery")(12.5))
    copy, _ = copied(path, tmp_path / "out")
    with AnyReader([copy]) as reader:
        (power,) = reader.messages([each for each in reader.connections if each.topic == "/power"])
        assert reader.deserialize(power[2], power[0].msgtype).volts == 12.5
    # As ROS 2 wrote them before Iron: without definitions.
    with sqlite3.connect(next(path.glob("*.db3"))) as old:
        old.executescript("DROP TABLE schema; DROP TABLE message_definitions")
    about = path / "metadata.yaml"
    about.write_text(re.sub(r"type_description_hash:\s+\w+", "", about.read_text()))
    copy, _ = copied(path, tmp_path / "old")
    assert contents(copy)[0] == contents(path)[0]


def test_a_copy_of_another_drive_is_refused_and_nothing_is_written(tmp_path):
    path = write_drive(tmp_path, drive(), "mcap")
    other = trajectory_on(replace(drive(), times=drive().times + 100.0))
    with pytest.raises(RecordingError, match="no scan of the trajectory"):
        replace(other, bag=BagCopy.of(path, Topics())).save(tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("kind", "name"), [("mcap", "with_poses/metadata.yaml"), ("ros1", "with_poses.bag")]
)
def test_what_is_there_is_not_overwritten(tmp_path, kind, name):
    path = write_drive(tmp_path, drive(), kind)
    mine = tmp_path / "out" / name
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    found = replace(trajectory_on(read_drive(path)), bag=BagCopy.of(path, Topics()))
    with pytest.raises(LocplanError, match="is no earlier result"):
        found.save(tmp_path / "out")
    assert mine.read_text() == "mine"
    assert [each.name for each in (tmp_path / "out").iterdir()] == [name.split("/")[0]]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("error", [OSError(28, "No space left"), sqlite3.OperationalError("full")])
def test_a_full_disk_leaves_nothing_and_is_not_laid_on_the_bag(tmp_path, monkeypatch, kind, error):
    path, calls = write_drive(tmp_path, drive(), kind), itertools.count()
    found = replace(trajectory_on(read_drive(path)), bag=BagCopy.of(path, Topics()))
    writer = f"rosbags.rosbag{1 if kind == 'ros1' else 2}.Writer.write"

    def full(*_):
        if next(calls) == 5:
            raise error

    monkeypatch.setattr(writer, full)
    with pytest.raises(LocplanError, match=r"cannot be written \((No space left|full)") as caught:
        found.save(tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_other_files_have_no_copy(tmp_path):
    assert BagCopy.of(tmp_path / "drive.npz", Topics()) is None
    assert BagCopy.of(tmp_path / "drive.log.gz", Topics()) is None
    assert locplan.recordings.BagCopy is BagCopy
