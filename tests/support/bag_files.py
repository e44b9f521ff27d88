"""Recorded drives written as bags by PyPI's rosbags, which shares nothing with locplan."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from locplan.recordings import Recording, read_recording
from locplan.recordings.logs import LogTopics

KINDS = ("mcap", "sqlite3", "ros1")
SCAN, TF = "sensor_msgs/msg/LaserScan", "tf2_msgs/msg/TFMessage"
ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"
COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
BEGIN = 1_700_000_000
"""Time of the first scan of a drive without times [s]."""


class BagWriter:
    """A bag that is being written, of whichever kind."""

    def __init__(self, writer, store, ros1: bool) -> None:
        self.writer, self.store, self.ros1 = writer, store, ros1
        self.topics: dict[str, Any] = {}

    def type(self, name: str):
        return self.store.types[name]

    def header(self, stamp: float, frame: str):
        seconds = math.floor(stamp)
        time = self.type("builtin_interfaces/msg/Time")(seconds, round((stamp - seconds) * 1e9))
        extra = {"seq": 0} if self.ros1 else {}
        return self.type("std_msgs/msg/Header")(stamp=time, frame_id=frame, **extra)

    def write(self, topic: str, kind: str, time: float, message) -> None:
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        to_bytes = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        self.writer.write(self.topics[topic], round(time * 1e9), to_bytes(message, kind))

    def turn(self, yaw: float, roll: float = 0.0, pitch: float = 0.0):
        """Quaternion of a yaw after a pitch after a roll [rad]."""
        (cr, sr), (cp, sp), (cy, sy) = (
            (math.cos(a / 2), math.sin(a / 2)) for a in (roll, pitch, yaw)
        )
        return self.type("geometry_msgs/msg/Quaternion")(
            x=sr * cp * cy - cr * sp * sy,
            y=cr * sp * cy + sr * cp * sy,
            z=cr * cp * sy - sr * sp * cy,
            w=cr * cp * cy + sr * sp * sy,
        )

    def pose(self, pose):
        point = self.type("geometry_msgs/msg/Point")(float(pose[0]), float(pose[1]), 0.0)
        return self.type("geometry_msgs/msg/Pose")(point, self.turn(pose[2]))

    def transform(self, stamp, parent, child, pose, **turns):
        place = self.type("geometry_msgs/msg/Vector3")(float(pose[0]), float(pose[1]), 0.2)
        inner = self.type("geometry_msgs/msg/Transform")(place, self.turn(pose[2], **turns))
        kind = self.type("geometry_msgs/msg/TransformStamped")
        return kind(self.header(stamp, parent), child, inner)

    def tf(self, time: float, *transforms, topic: str = "/tf") -> None:
        self.write(topic, TF, time, self.type(TF)(list(transforms)))

    def scan(self, time, lidar, ranges, *, topic="/scan", frame="laser", **changes) -> None:
        width = math.radians(lidar.field_of_view_deg)
        step = width / (lidar.beams if lidar.sees_all_round else lidar.beams - 1)
        values = {
            "header": self.header(time, frame),
            "angle_min": float(lidar.angles[0]),
            "angle_max": float(lidar.angles[-1]),
            "angle_increment": step,
            "time_increment": 0.0,
            "scan_time": 0.1,
            "range_min": lidar.min_range,
            "range_max": lidar.range,
            "ranges": np.ascontiguousarray(ranges, np.float32),
            "intensities": np.empty(0, np.float32),
        }
        content = self.type(SCAN)(**values | changes)
        self.write(topic, SCAN, time, content)

    def odometry(
        self, time, pose, *, topic="/odom", frame="odom", child="base_link", speed=0.0
    ) -> None:
        vector = self.type("geometry_msgs/msg/Vector3")
        twist = self.type("geometry_msgs/msg/Twist")(vector(speed, 0.0, 0.0), vector(0.0, 0.0, 0.0))
        content = self.type(ODOMETRY)(
            self.header(time, frame),
            child,
            self.type("geometry_msgs/msg/PoseWithCovariance")(self.pose(pose), np.zeros(36)),
            self.type("geometry_msgs/msg/TwistWithCovariance")(twist, np.zeros(36)),
        )
        self.write(topic, ODOMETRY, time, content)

    def amcl_pose(self, time, pose, *, topic="/amcl_pose", frame="map") -> None:
        inner = self.type("geometry_msgs/msg/PoseWithCovariance")(self.pose(pose), np.zeros(36))
        self.write(topic, COVARIANCE, time, self.type(COVARIANCE)(self.header(time, frame), inner))

    def plain_pose(self, time, pose, *, topic="/mocap", frame="map") -> None:
        content = self.type(POSE)(self.header(time, frame), self.pose(pose))
        self.write(topic, POSE, time, content)


@contextmanager
def open_bag(folder: Path, kind: str, packed: str = "") -> Iterator[tuple[Path, BagWriter]]:
    """A new bag of a kind in a folder, and its path; `packed` names a mode or a format."""
    ros1 = kind == "ros1"
    path = folder / ("drive.bag" if ros1 else f"drive_{kind}")
    if ros1:
        writer, store = Writer1(path), get_typestore(Stores.ROS1_NOETIC)
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        store = get_typestore(Stores.ROS2_JAZZY)
    if packed:
        if ros1:
            writer.set_compression(Writer1.CompressionFormat[packed])
        else:
            writer.set_compression(CompressionMode[packed], CompressionFormat.ZSTD)
    with writer:
        yield path, BagWriter(writer, store, ros1)


def compose(pose, way):
    """The pose to which a way leads from another one."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    x, y, turn = way
    return pose[0] + cos * x - sin * y, pose[1] + sin * x + cos * y, pose[2] + turn


def invert(pose):
    """The way from a pose to the origin."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return -cos * pose[0] - sin * pose[1], sin * pose[0] - cos * pose[1], -pose[2]


def message_times(drive: Recording) -> np.ndarray:
    """The drive's times as a bag holds them, in whole nanoseconds; made up where it has none."""
    times = BEGIN + 0.25 * np.arange(len(drive)) if drive.times is None else drive.times
    whole = np.floor(times)
    return whole + 1e-9 * np.rint((times - whole) * 1e9)


def write_drive(folder: Path, drive: Recording, kind: str, packed: str = "") -> Path:
    """Write a drive as a robot with Nav2 records it: scans, TF, and odometry if it has some."""
    with open_bag(folder, kind, packed) as (path, bag):
        lidar, times = drive.lidar, message_times(drive)
        mount = (lidar.mount_x, lidar.mount_y, lidar.mount_yaw)
        fixed = bag.transform(times[0], "base_link", "laser", mount)
        bag.tf(times[0], fixed, topic="/tf_static")
        for n, time in enumerate(times):
            pose = drive.poses[n]
            if drive.odometry is None:
                bag.tf(time, bag.transform(time, "map", "base_link", pose))
            else:
                reported = drive.odometry[n]
                bag.odometry(time, reported)
                bag.tf(time, bag.transform(time, "odom", "base_link", reported))
                bag.tf(time, bag.transform(time, "map", "odom", compose(pose, invert(reported))))
            bag.scan(time, lidar, drive.ranges[n])
    return path


def read_with(path, **options):
    """The drive in a log, with topics and frames among the options."""
    names = [name for name in options if name in vars(LogTopics())]
    topics = LogTopics(**{name: options.pop(name) for name in names})
    return read_recording(path, topics=topics, **options)
