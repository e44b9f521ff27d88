"""Reader of bags of ROS 1 and ROS 2 (.bag, .db3, .mcap, or a folder of rosbag2).

Scans are read in a first pass; transforms, poses and odometry in the following passes. Odometry
carries rare poses to the scans in between.
"""

from __future__ import annotations

import math
import os
import warnings
from bz2 import BZ2Decompressor
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache, cached_property, partial
from io import BufferedReader
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support import reading
from locplan._support.files import protect_input
from locplan._support.kernels.arrays import Floats
from locplan._support.poses import (
    IDENTITY,
    FrameTree,
    Transform,
    TransformTrack,
    apply_motions,
    compute_motions,
    compute_uprightness,
    normalize_frame_name,
    project_to_plane,
    wrap_angles,
)
from locplan._support.progress import ProgressCallback
from locplan._support.public import require_extra
from locplan.errors import LocplanError, RecordingError
from locplan.recordings.logs import ReadOptions, RecordingSource, ScanRows
from locplan.recordings.recording import Recording

MAX_CHUNK_BYTES = 2**26
"""Maximum unpacked size of a chunk, or of a single packed message."""
MAX_RATIO = 100
"""Maximum ratio of unpacked to packed size of a packed file."""
MENDERS = {".mcap": "mcap recover", ".db3": "sqlite3 FILE .recover", ".bag": "rosbag reindex"}
"""Command that repairs a damaged bag, by the suffix of the file."""
SUFFIXES: tuple[str, ...] = (*MENDERS,)
BASES = ("base_footprint", "base_link", "base")
"""Usual names of a robot's frame, without a prefix."""


def read_bag(
    path: Path, options: ReadOptions, progress: ProgressCallback | None = None
) -> Recording:
    """Read a recorded drive from a bag.

    Raises
    ------
    RecordingError
        If the bag is damaged, has no scans or poses, has unconnected frames, or its clock runs
        backwards.
    """
    with _open_bag(path) as bag:
        topic = _choose_scan_topic(bag, options.scan_topic)
        scans = _read_scans(bag, topic, options, progress)
        bag_poses = _collect_poses(bag, topic, options, scans, progress)
    scan_poses, notes = bag_poses.find_scan_poses(), bag_poses.notes
    usable_scans: list[int] = np.flatnonzero(scan_poses.has_pose).tolist()
    if len(usable_scans) < len(scans.times):
        notes.append(
            f"{len(scans.times) - len(usable_scans)} of {len(scans.times)} scans have no pose"
        )
    rows = scans.rows
    if rows.n_resampled:
        notes.append(
            f"{rows.n_resampled} of {len(rows)} scans were resampled to the angles of the first one"
        )
    lidar = rows.make_lidar(scan_poses.mount, scan_poses.upside_down)
    ranges = rows.take_rows([scans.order[n] for n in usable_scans])
    if scan_poses.upside_down:
        ranges = ranges[:, ::-1]
    ranges.setflags(write=False)
    source = replace(
        scan_poses.source,
        file=path.name,
        scans=topic,
        stamps_back=scans.stamps_back,
        notes=tuple(notes),
    )
    odometry = None if scan_poses.odometry is None else scan_poses.odometry[usable_scans]
    speeds = None if scan_poses.speeds is None else scan_poses.speeds[usable_scans]
    times = np.array(scans.times)[usable_scans]
    return Recording(ranges, lidar, scan_poses.poses[usable_scans], times, odometry, source, speeds)


def _choose_scan_topic(bag: BagReader, requested_topic: str | None) -> str:
    """Return the requested topic of scans, or the only one."""
    topics = bag.find_topics(MessageType.SCAN)
    if requested_topic is not None:
        if requested_topic in topics:
            return requested_topic
        have = ", ".join(topics) or f"none of type LaserScan, but {bag.describe_topics()}"
        raise RecordingError(
            f"has no scans on {requested_topic}; set scan_topic= to one of: {have}"
        )
    if not topics:
        raise RecordingError(
            f"has no scans (sensor_msgs/LaserScan); its topics are {bag.describe_topics()};"
            " record the lidar's topic"
        )
    if len(topics) > 1:
        topics = [topic for topic in topics if bag.count_messages([topic])] or topics
    if len(topics) > 1:
        raise RecordingError(
            f"has scans on {' and '.join(topics)}; choose one with scan_topic={topics[0]!r}"
        )
    return topics[0]


@dataclass(frozen=True)
class _BagScans:
    """The scans of a bag, sorted by their stamps."""

    rows: ScanRows
    order: Sequence[int]
    """Index of the row of each time."""
    times: Sequence[float]
    """Stamps, ascending [s]."""
    frame: str
    stamps_back: int
    """Number of scans with a stamp before the stamp of an earlier scan in the log."""


def _compute_log_window(
    bag: BagReader, options: ReadOptions, margin: float = 0.0
) -> tuple[int | None, int | None]:
    """Compute the log times to read between [ns], with a margin [s]; None without a window."""
    if options.window is None:
        return None, None
    (start, end), around = options.window, round(margin * 1e9)
    return bag.start + round(start * 1e9) - around, bag.start + round(end * 1e9) + around


def _read_scans(
    bag: BagReader, topic: str, options: ReadOptions, progress: ProgressCallback | None
) -> _BagScans:
    """Read the scans of a topic, sorted by their stamps."""
    rows, stamps, frame = ScanRows(options.range_limits), list[float](), ""
    latest, stamps_back = -np.inf, 0
    window = _compute_log_window(bag, options)
    for message in bag.read_messages([topic], *window, options.every, progress):
        scan = message.content
        stamp = _convert_stamp(scan.header.stamp, message.logged)
        if stamp < latest - 0.5:  # messages may be out of order, but not by this much
            raise RecordingError(
                f"the clock of {topic} runs backwards by {latest - stamp:.3g} s at"
                f" {(message.logged - bag.start) / 1e9:.3g} s; if simulated time was reset, read a"
                " part of it in Python with window=(start, end) in seconds"
            )
        stamps_back += stamp < latest
        latest = max(latest, stamp)
        frame = frame or normalize_frame_name(scan.header.frame_id)
        scan_geometry = scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max
        rows.add(scan.ranges, *map(float, scan_geometry))
        stamps.append(stamp)
    if not stamps:
        within = "" if options.window is None else " in the window"
        raise RecordingError(f"has no scan on {topic}{within}; record it, or read another part")
    _, order = np.unique(np.array(stamps), return_index=True)
    return _BagScans(rows, order.tolist(), [stamps[n] for n in order], frame, stamps_back)


def _collect_poses(
    bag: BagReader,
    topic: str,
    options: ReadOptions,
    scans: _BagScans,
    progress: ProgressCallback | None,
) -> BagPoses:
    """Read transforms, poses and odometry around the times of the scans."""
    window = _compute_log_window(bag, options, 5.0)
    topics = _find_pose_topics(bag, options)
    topic_list = bag.describe_topics()
    poses = {
        topic_name: kind for topic_name, kind in topics.items() if kind != MessageType.ODOMETRY
    }
    bag_poses = BagPoses(FrameTree([]), scans.times, scans.frame, options, topic_list)
    for message in bag.read_messages(poses, *window, progress=progress):
        _add_pose(message, poses, bag_poses, scans.times)
    # The poses of AMCL are rare, so that odometry is needed at their times as well.
    samples = [
        np.concatenate([part[:, 0] for part in pose_topic.track.samples()])
        for pose_topic in bag_poses.topics.values()
        if pose_topic.kind == MessageType.POSE_WITH_COVARIANCE
    ]
    knots = np.unique(np.concatenate([scans.times, *samples]))
    times = knots[np.isfinite(knots)].tolist()
    tree = FrameTree(times)
    bag_poses = replace(bag_poses, tree=tree)
    of_tf = _select_in_namespace(bag.find_topics(MessageType.TF), topic)
    static = [topic_name for topic_name in of_tf if topic_name.endswith("tf_static")]
    for message in bag.read_messages(static):
        for transform in message.content.transforms:
            tree.add_static(
                transform.header.frame_id,
                transform.child_frame_id,
                _make_transform(transform.transform),
            )
    odometry_topics = topics.keys() - poses.keys()
    topics = {
        topic_name: kind for topic_name, kind in topics.items() if topic_name in odometry_topics
    }
    topics |= {topic_name: MessageType.TF for topic_name in of_tf if topic_name not in static}
    count = 0
    for message in bag.read_messages(topics, *window, progress=progress):
        if topics[message.topic] != MessageType.TF:
            _add_pose(message, topics, bag_poses, times)
            continue
        for transform in message.content.transforms:
            time = _convert_stamp(transform.header.stamp, message.logged)
            pose = _make_transform(transform.transform)
            tree.add(time, transform.header.frame_id, transform.child_frame_id, pose)
        count += 1
        if count % 500 == 0:
            bag_poses.drop_unrelated_frames()
    return bag_poses


def _add_pose(
    message: BagMessage, topics: dict[str, str], bag_poses: BagPoses, times: Sequence[float]
) -> None:
    """Add the pose of a message, decoded by the type of its topic."""
    content, kind = message.content, topics[message.topic]
    if message.topic not in bag_poses.topics:
        child = normalize_frame_name(content.child_frame_id) if kind == MessageType.ODOMETRY else ""
        frame = normalize_frame_name(content.header.frame_id)
        bag_poses.topics[message.topic] = PoseTopic(
            kind, frame, child, TransformTrack(times), TransformTrack(times)
        )
    pose = content.pose if kind == MessageType.POSE else content.pose.pose
    topic, time = (
        bag_poses.topics[message.topic],
        _convert_stamp(content.header.stamp, message.logged),
    )
    topic.track.add(time, _join_transform(pose.position, pose.orientation))
    if kind == MessageType.ODOMETRY:
        topic.speeds.add(time, (content.twist.twist.linear.x, *IDENTITY[1:]))


def _find_pose_topics(bag: BagReader, options: ReadOptions) -> dict[str, str]:
    """Find the topics of poses and odometry to read, with their types."""
    topics: dict[str, str] = {}
    for kind in (MessageType.POSE_WITH_COVARIANCE, MessageType.POSE, MessageType.ODOMETRY):
        topics |= {
            topic: kind for topic in bag.find_topics(kind) if _is_wanted_topic(topic, kind, options)
        }
    for name, option in ((options.pose_topic, "pose_topic"), (options.odom_topic, "odom_topic")):
        if name is not None and name not in topics:
            pose_types = (
                (MessageType.POSE_WITH_COVARIANCE, MessageType.POSE)
                if option == "pose_topic"
                else ()
            )
            have = ", ".join(bag.find_topics(*pose_types, MessageType.ODOMETRY)) or "none"
            raise RecordingError(f"has no poses on {name}; set {option}= to one of: {have}")
    return topics


def _is_wanted_topic(topic: str, kind: str, options: ReadOptions) -> bool:
    """Return True if a topic is requested, or of a needed type without a request."""
    if topic in (options.pose_topic, options.odom_topic):
        return True
    if kind == MessageType.ODOMETRY:
        return options.odom_topic is None
    not_the_robots = ("initialpose", "goal_pose", "goal", "move_base_simple/goal")
    return options.pose_topic is None and not topic.endswith(not_the_robots)


def _select_in_namespace(topics: Sequence[str], scan_topic: str) -> list[str]:
    """Select the TF topics in the namespace of the scans, or all if there are none.

    Examples
    --------
    >>> _select_in_namespace(["/a/tf", "/a/tf_static", "/b/tf"], "/a/front/scan")
    ['/a/tf', '/a/tf_static']
    >>> _select_in_namespace(["/tf", "/tf_static"], "/a/scan")
    ['/tf', '/tf_static']
    """
    spaces = {topic: topic.rpartition("/")[0] + "/" for topic in topics}
    scan_spaces = [space for space in spaces.values() if scan_topic.startswith(space)]
    best = max(scan_spaces, key=len, default=None)
    return [topic for topic in topics if best is None or spaces[topic] == best]


def _convert_stamp(stamp: Any, log_time_ns: int) -> float:
    """Return the time of a stamp, or the log's time for a zero stamp [s]."""
    total = stamp.sec + 1e-9 * stamp.nanosec
    return float(total) if total else log_time_ns * 1e-9


def _make_transform(message: Any) -> Transform:
    """Convert a geometry_msgs/Transform."""
    return _join_transform(message.translation, message.rotation)


def _join_transform(position: Any, quaternion: Any) -> Transform:
    """Combine a position and a quaternion into a transform."""
    return (
        position.x,
        position.y,
        position.z,
        quaternion.x,
        quaternion.y,
        quaternion.z,
        quaternion.w,
    )


class PoseTopic(NamedTuple):
    """A topic of poses: message type, frame, child frame (or empty), and samples."""

    kind: str
    frame: str
    child: str
    track: TransformTrack
    speeds: TransformTrack  # forward speeds by odometry, stored as x of transforms


@dataclass(frozen=True)
class ScanPoses:
    """Poses of the robot at the scans, and the mount of its lidar."""

    poses: Floats
    """Poses in the map's frame, (n, 3) [m, m, rad]; NaN if unknown."""
    odometry: Floats | None
    speeds: Floats | None
    """Forward speeds by odometry, (n,) [m/s]; NaN if unknown."""
    mount: tuple[float, float, float]
    upside_down: bool
    source: RecordingSource
    """Topics and frames of the poses."""

    @property
    def has_pose(self) -> NDArray[np.bool_]:
        """Mask of scans with a pose, and odometry if the bag has it; all if no scan has a pose."""
        is_finite = np.isfinite(self.poses).all(1)
        if not is_finite.any():
            return np.ones(len(self.poses), np.bool_)
        if self.odometry is not None:
            is_finite &= np.isfinite(self.odometry).all(1)
        return np.asarray(is_finite)


@dataclass(frozen=True)
class BagPoses:
    """The transforms and the topics of poses of a bag."""

    tree: FrameTree
    times: Sequence[float]
    """Times of the scans [s], a subset of the times of the tree."""
    lidar_frame: str
    options: ReadOptions
    topic_list: str
    """All topics and types, for error messages."""
    topics: dict[str, PoseTopic] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    """Assumptions and dropped data."""

    @cached_property
    def scan_time_indices(self) -> NDArray[np.int64]:
        """Index of each scan's time among the times of the tree and of odometry."""
        return np.searchsorted(self.tree.times, self.times)

    @property
    def map_frame(self) -> str:
        """Requested frame of the poses, without a leading slash."""
        return self.options.map_frame.lstrip("/")

    def find_odometry_topics(self) -> dict[str, PoseTopic]:
        """Return the topics of odometry by name."""
        return {
            name: pose_topic
            for name, pose_topic in self.topics.items()
            if pose_topic.kind == MessageType.ODOMETRY
        }

    def find_scan_poses(self) -> ScanPoses:
        """Compute poses and odometry at the scans, and the lidar's mount.

        Raises
        ------
        RecordingError
            If there are no poses, frames are unconnected, or the lidar is tilted or moves.
        """
        for topic in (self.options.pose_topic, self.options.odom_topic):
            if topic is not None and topic not in self.topics:
                raise RecordingError(f"has no message on {topic} near the scans; use another topic")
        base = self._choose_base_frame()
        mount, upside_down = self._find_mount(base)
        reported, odometry_from = self._find_odometry(base)
        poses, poses_from, map_frame = self._find_poses(base, reported, odometry_from)
        is_located = np.isfinite(poses).all(axis=1)
        if not poses_from:
            reported, odometry_from = None, ""
        elif not is_located.any():
            pose_topic = self.topics.get(poses_from)
            begin, end = (
                (pose_topic.track.begin, pose_topic.track.end)
                if pose_topic
                else self.tree.moving_time_range
            )
            raise RecordingError(
                f"no scan has a pose: {poses_from} covers {begin:.3f} to {end:.3f} s, but the scans"
                f" cover {self.times[0]:.3f} to {self.times[-1]:.3f} s; check that both use the"
                " same clock"
            )
        odometry = None if reported is None else reported[self.scan_time_indices]
        if odometry is not None:
            odometry_share = np.isfinite(odometry[is_located]).all(axis=1).mean()
            if odometry_share < 0.9:
                self.notes.append(
                    f"{odometry_from} has odometry at only {odometry_share:.0%} of the scans"
                )
                odometry, odometry_from = None, ""
        source = RecordingSource(
            poses=poses_from,
            odometry=odometry_from,
            map_frame=map_frame,
            base_frame=base,
            lidar_frame=self.lidar_frame,
        )
        speeds = None if odometry is None else self._find_speeds(odometry_from)
        return ScanPoses(poses, odometry, speeds, mount, upside_down, source)

    def _find_speeds(self, odometry_source: str) -> Floats | None:
        """Find forward speeds at the scans; None with several odometry topics, or if all are 0."""
        topics = self.find_odometry_topics()
        if len(topics) != 1 and odometry_source not in topics:
            return None
        topic = topics.get(odometry_source) or next(iter(topics.values()))
        speeds = topic.speeds.interpolate()[self.scan_time_indices, 0]
        return speeds if np.nan_to_num(speeds).any() else None

    def drop_unrelated_frames(self) -> None:
        """Drop unneeded transforms once TF connects the map with the lidar."""
        tree = self.tree
        if tree.has_chain(self.map_frame, self.lidar_frame):
            robot_frames = {
                frame for frame in tree.frames if frame.rpartition("/")[2] in (*BASES, "odom")
            }
            base = (self.options.base_frame or "").lstrip("/")
            tree.drop_unrelated_tracks(self.map_frame, {self.lidar_frame, base, *robot_frames})

    def _choose_base_frame(self) -> str:
        """Return the requested frame of the robot, the child of odometry, or a usual name."""
        frames = self.tree.frames
        if self.options.base_frame is not None:
            base = self.options.base_frame.lstrip("/")
            if frames and base not in frames:
                raise RecordingError(
                    f"has no frame {base!r}; set base_frame= to one of: {', '.join(frames)}"
                )
            return base
        reported = [
            pose_topic.child
            for pose_topic in self.find_odometry_topics().values()
            if pose_topic.child
        ]
        standard_frames = [
            frame for base in BASES for frame in frames if frame.rpartition("/")[2] == base
        ]
        candidates = [
            frame for frame in dict.fromkeys(reported + standard_frames) if frame in frames
        ]
        for frame in candidates:
            if self.tree.has_chain(frame, self.lidar_frame):
                return frame
        if candidates:
            return candidates[0]
        if self.lidar_frame in frames:
            self.notes.append(
                f"no frame has a usual name of a robot's: the lidar's, {self.lidar_frame}, is used;"
                " set another with base_frame="
            )
            return self.lidar_frame
        return reported[0] if reported else BASES[1]

    def _find_mount(self, base: str) -> tuple[tuple[float, float, float], bool]:
        """Find the lidar's pose on the robot [m, m, rad], and whether it is upside down."""
        lidar = self.lidar_frame
        if self.options.mount is not None:
            return self.options.mount, False
        if not self.tree.frames:
            self.notes.append(
                "there is no TF: the lidar is assumed at the robot's centre; set mount="
            )
            return (0.0, 0.0, 0.0), False
        pose = self.tree.pose(base, lidar)
        pose = None if pose is None else pose[np.isfinite(pose).all(1)]
        if pose is None or not len(pose):
            raise RecordingError(
                f"TF does not connect the lidar's frame {lidar!r} with the robot's {base!r};"
                f" connected at some times: {self.tree.describe_groups()}; set mount=(x, y, yaw),"
                " or another base_frame="
            )
        up, flat = compute_uprightness(pose), project_to_plane(pose)
        tilt = math.degrees(math.acos(min(1.0, float(np.abs(up).min()))))
        if tilt > 10:
            raise RecordingError(
                f"the lidar {lidar!r} is tilted by {tilt:.0f} deg on {base!r}, so its scans do not"
                " match a 2D map; set another scan_topic="
            )
        flat[:, 2] = flat[0, 2] + wrap_angles(flat[:, 2] - flat[0, 2])
        if np.ptp(flat, axis=0).max() > 0.005:  # metres and radians
            raise RecordingError(
                f"the lidar {lidar!r} moves relative to {base!r};"
                " set another scan_topic= or base_frame="
            )
        x, y, yaw = flat[0].tolist()
        return (x, y, yaw), bool(up[0] < 0)

    def _find_poses(
        self, base: str, reported: Floats | None, odometry_source: str
    ) -> tuple[Floats, str, str]:
        """Return the robot's poses at the scans, their source, and their frame.

        Without poses on the map, return poses by odometry, or NaN if no poses are needed.
        """
        tree, frame, topic = self.tree, self.map_frame, self.options.pose_topic
        if topic is None:
            pose = tree.pose(frame, base) if {frame, base} <= set(tree.frames) else None
            if pose is not None:
                return (
                    project_to_plane(pose)[self.scan_time_indices],
                    f"TF {frame} -> {base}",
                    frame,
                )
            topic = self._choose_pose_topic()
        if topic is None and not self.options.needs_poses:
            return np.full((len(self.times), 3), np.nan), "", ""
        is_expected = frame in tree.frames or self.options.map_frame != ReadOptions.map_frame
        if topic is None and reported is not None and not is_expected:
            self.notes.append(
                f"there are no poses on the map: poses by odometry ({odometry_source}) are used, in"
                " the odometry frame"
            )
            return reported[self.scan_time_indices], odometry_source, ""
        if topic is None:
            raise self._make_no_poses_error(base)
        pose_topic = self.topics[topic]
        if pose_topic.track.left_out:
            self.notes.append(
                f"{pose_topic.track.left_out} poses of {topic} are not numbers and were dropped"
            )
        if pose_topic.track.empty:
            raise RecordingError(
                f"all poses of {topic} are invalid (NaN, or no rotation); set another pose_topic="
            )
        if pose_topic.frame != frame:
            self.notes.append(
                f"the poses of {topic} are in {pose_topic.frame!r}, which is used as the map frame"
            )
        poses = project_to_plane(pose_topic.track.interpolate())
        poses = poses[self.scan_time_indices] if pose_topic.kind == MessageType.ODOMETRY else poses
        if reported is not None and pose_topic.kind == MessageType.POSE_WITH_COVARIANCE:
            carried = _interpolate_poses_by_odometry(
                self.times, pose_topic.track, tree.times, reported
            )
            poses = np.where(np.isfinite(carried), carried, poses)
        return poses, topic, pose_topic.frame

    def _choose_pose_topic(self) -> str | None:
        """Return the only topic of poses of the best available type; None without any."""
        for kind in (MessageType.POSE_WITH_COVARIANCE, MessageType.POSE, MessageType.ODOMETRY):
            topics = [
                name
                for name, pose_topic in self.topics.items()
                if pose_topic.kind == kind
                and (kind != MessageType.ODOMETRY or pose_topic.frame == self.map_frame)
            ]
            if len(topics) == 1:
                return topics[0]
            if topics:
                raise RecordingError(
                    f"has poses on {' and '.join(topics)}; choose one with pose_topic={topics[0]!r}"
                )
        return None

    def _make_no_poses_error(self, base: str) -> RecordingError:
        """Return the error for a bag that has neither poses nor a single odometry."""
        several = [*self.find_odometry_topics()]
        other = f", or one odometry with odom_topic={several[0]!r}" if several else ""
        if not self.tree.frames:
            return RecordingError(
                f"has no poses: neither TF nor a topic of poses; its topics are {self.topic_list};"
                f" also record /tf and /tf_static{other}"
            )
        return RecordingError(
            f"has no poses: TF does not connect {self.map_frame!r} with {base!r}; connected are:"
            f" {self.tree.describe_groups()}; set map_frame= and base_frame={other}"
        )

    def _find_odometry(self, base: str) -> tuple[Floats | None, str]:
        """Find odometry at all times of the tree, separate from the poses, and its source."""
        requested_topic, of_poses = self.options.odom_topic, self.options.pose_topic
        topics = [
            name
            for name, pose_topic in self.find_odometry_topics().items()
            if name != of_poses and pose_topic.frame != self.map_frame
        ]
        if requested_topic is None:
            frames = [self.topics[name].frame for name in topics]
            frames += [frame for frame in self.tree.frames if frame.rpartition("/")[2] == "odom"]
            for frame in frames:
                pose = self.tree.pose(frame, base) if frame != base else None
                if pose is not None:
                    return project_to_plane(pose), f"TF {frame} -> {base}"
        topics = topics if requested_topic is None else [requested_topic]
        if len(topics) == 1:
            return project_to_plane(self.topics[topics[0]].track.interpolate()), topics[0]
        if topics:
            self.notes.append(
                f"odometry is on {' and '.join(topics)}, so none was used; set odom_topic="
            )
        return None, ""


def _interpolate_poses_by_odometry(
    times: Sequence[float], track: TransformTrack, odometry_times: Sequence[float], odometry: Floats
) -> Floats:
    """Compute poses at n times by odometry from the samples before and after.

    AMCL publishes a pose only after some motion, so interpolation alone would miss turns.

    Parameters
    ----------
    times : sequence of n floats
        Times of the scans [s].
    track : Track
        Samples of the pose.
    odometry_times : sequence of m floats
        Times of the odometry, including the times of the samples [s].
    odometry : (m, 3) array
        Poses by odometry, NaN if unknown.

    Returns
    -------
    (n, 3) array
        The poses; NaN if a scan is over 1 m of odometry away from both samples.
    """
    at, knots = np.asarray(times), np.asarray(odometry_times)
    now = odometry[np.searchsorted(knots, at)]
    guesses, weights = [], []
    for samples in track.samples():
        then = samples[:, 0]
        index = np.searchsorted(knots, np.where(np.isfinite(then), then, knots[0]))
        way = compute_motions(odometry[index], now)
        near = np.isfinite(then) & (np.hypot(way[:, 0], way[:, 1]) < 1.0)
        guesses.append(apply_motions(project_to_plane(samples[:, 1:]), way))
        # The sample nearer in time has more weight; a distant sample has none.
        weights.append(np.where(near, 1.0 / np.maximum(np.abs(at - then), 1e-9), 0.0))
    (earlier, later), (first, second) = guesses, weights
    earlier, later = (
        np.where(first[:, None] > 0, earlier, later),
        np.where(second[:, None] > 0, later, earlier),
    )
    total = first + second
    share = np.divide(second, total, out=np.full(len(at), np.nan), where=total > 0)
    step = later - earlier
    step[:, 2] = wrap_angles(step[:, 2])
    carried: Floats = earlier + share[:, None] * step
    return carried


class MessageType(StrEnum):
    """Message types that are read."""

    SCAN = "sensor_msgs/msg/LaserScan"
    TF = "tf2_msgs/msg/TFMessage"
    POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
    POSE = "geometry_msgs/msg/PoseStamped"
    ODOMETRY = "nav_msgs/msg/Odometry"


class BagMessage(NamedTuple):
    """A decoded message: topic, log time [ns], and content."""

    topic: str
    logged: int
    content: Any


class BagReader:
    """An open bag; use `_open_bag` to open one."""

    def __init__(self, reader: Any, typestore: Any, ros1: bool) -> None:
        self._reader, self._typestore, self._ros1 = reader, typestore, ros1

    @property
    def start(self) -> int:
        """Log time of the first message [ns]."""
        return int(self._reader.start_time)

    def find_topics(self, *types: str) -> list[str]:
        """Return the names of all topics of these types."""
        connections = (
            connection
            for connection in self._reader.connections
            if _get_message_type(connection) in types
        )
        return list(dict.fromkeys(connection.topic for connection in connections))

    def count_messages(self, topics: Collection[str]) -> int:
        """Count the messages of some topics."""
        return sum(
            connection.msgcount
            for connection in self._reader.connections
            if connection.topic in topics
        )

    def read_messages(
        self,
        topics: Collection[str],
        start: int | None = None,
        stop: int | None = None,
        step: int = 1,
        progress: ProgressCallback | None = None,
    ) -> Iterator[BagMessage]:
        """Yield every n-th message of some topics in the order of the log, between log times [ns].

        Messages are decoded one at a time.
        """
        connections = [
            topic_connection
            for topic_connection in self._reader.connections
            if topic_connection.topic in topics
        ]
        if not connections:
            return
        total = self.count_messages(topics)
        stream = self._reader.messages(connections=connections, start=start, stop=stop)
        for number, (connection, logged, raw) in enumerate(stream):
            if progress and number % 1000 == 0:
                progress(min(number, total), total)
            if number % step == 0:
                yield self._decode(connection, logged, raw)
        if progress:
            progress(total, total)

    def _decode(self, connection: Any, log_time_ns: int, raw: bytes) -> BagMessage:
        """Decode a raw message."""
        store = self._typestore
        decode = store.deserialize_ros1 if self._ros1 else store.deserialize_cdr
        return BagMessage(connection.topic, log_time_ns, decode(raw, _get_message_type(connection)))

    def describe_topics(self) -> str:
        """Return a text with all topics and their types, for error messages."""
        connections = self._reader.connections
        names = {
            f"{connection.topic} ({_get_message_type(connection).replace('/msg/', '/')})"
            for connection in connections
        }
        return ", ".join(sorted(names)) or "none"


def _get_message_type(connection: Any) -> str:
    """Return the type of a topic's messages; an old type becomes the new type of equal layout."""
    kind = str(connection.msgtype)
    return MessageType.TF if kind == "tf/msg/tfMessage" else kind


@contextmanager
def _open_bag(path: Path) -> Iterator[BagReader]:
    """Open a bag: a file .mcap, .db3 or .bag, or a folder of rosbag2.

    Any error while reading becomes a RecordingError of one line.

    Raises
    ------
    LocplanError
        If the library rosbags is missing.
    RecordingError
        If the bag cannot be read.
    """
    require_extra("rosbags", "ros", "reading a bag")
    from rosbags.rosbag1 import Reader as Reader1, reader as reader1
    from rosbags.rosbag2 import Reader as Reader2, reader as reader2, storage_mcap
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    file = _find_storage(path)
    ros1 = file.suffix == ".bag"
    try:
        for bag_file in file.iterdir() if file.is_dir() else (file,):
            if not bag_file.is_dir():
                reading.open_plain_file(bag_file).close()  # rosbags would wait for a pipe
                protect_input(bag_file)
        _limit_unpacked_sizes(reader1, reader2, storage_mcap)
        with warnings.catch_warnings(action="ignore"):  # ruamel has some for odd metadata.yaml
            reader: Any = Reader1(file) if ros1 else Reader2(file)
            reader.open()
        with closing(reader):
            # These types are equal in all distributions, so definitions in the bag are not needed.
            store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
            if ros1:  # its TFMessage is missing
                transforms = "geometry_msgs/TransformStamped[] transforms"
                store.register(get_types_from_msg(transforms, MessageType.TF))
            yield BagReader(reader, store, ros1)
    except LocplanError:
        raise
    except Exception as error:  # rosbags raises many kinds of errors for damaged bags
        lines = str(error).strip().splitlines() or [type(error).__name__]
        reason = lines[0].replace(f"{str(file)!r} ", "").replace(str(file), "it").rstrip(".")[:200]
        mender = MENDERS.get(file.suffix)
        remedy = f"repair it with `{mender}`" if mender else "record it again"
        raise RecordingError(f"cannot be read as a bag ({reason}); {remedy}") from None


def _find_storage(path: Path) -> Path:
    """Return the file or folder to read; for a folder without metadata.yaml, its only file."""
    if not path.is_dir() or (path / "metadata.yaml").exists():
        return path
    files = sorted(
        storage_file for storage_file in path.iterdir() if storage_file.suffix in SUFFIXES
    )
    if len(files) != 1:
        contents = ", ".join(storage_file.name for storage_file in files) or "no bag"
        raise RecordingError(f"is a folder without metadata.yaml, with {contents}; pass one file")
    return files[0]


@cache
def _limit_unpacked_sizes(ros1: Any, ros2: Any, mcap: Any) -> None:
    """Replace the unpacking functions of these modules of rosbags by functions with size limits."""
    from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

    lz4 = partial(_decompress, LZ4FrameDecompressor)
    ros1.decompressors.update(bz2=partial(_decompress, BZ2Decompressor), lz4=lz4)
    mcap.DECOMPRESSORS["lz4"] = lz4
    zstd: Any = getattr(ros2, "zstd", None)
    if zstd is not None:  # older versions limit the size themselves
        unpacked = partial(_decompress, zstd.ZstdDecompressor)
        mcap.DECOMPRESSORS["zstd"] = unpacked
        bounded_open = partial(_open_with_size_limit, zstd.open)
        vars(ros2)["zstd"] = SimpleNamespace(open=bounded_open, decompress=unpacked)


def _decompress(decompressor_type: Callable[[], Any], packed: bytes, _: int = 0) -> bytes:
    """Unpack a chunk of one or more frames, up to the maximum size."""
    parts, room = list[bytes](), MAX_CHUNK_BYTES
    while packed:
        frame = decompressor_type()
        parts.append(frame.decompress(packed, room + 1))
        room -= len(parts[-1])
        if room < 0:
            raise RecordingError(f"a chunk unpacks to over {MAX_CHUNK_BYTES / 1e6:.0f} MB")
        if not frame.eof:
            raise RecordingError("a chunk is cut off or damaged; record it again")
        packed = frame.unused_data
    return b"".join(parts)


@contextmanager
def _open_with_size_limit(
    unpack: Callable[..., Any], file: BufferedReader, mode: str
) -> Iterator[Any]:
    """Open a packed file for reading, up to the maximum size."""
    left = MAX_RATIO * os.fstat(file.fileno()).st_size

    def read(count: int) -> bytes:
        nonlocal left
        part: bytes = content.read(count)
        left -= len(part)
        if left < 0:
            raise RecordingError(f"it unpacks to over {MAX_RATIO} times its size; unpack it first")
        return part

    with unpack(file, mode) as content:
        yield SimpleNamespace(read=read)
