"""Recorded drives from bags: scans in a first pass, what relates them to the map in a second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.poses import FrameTree, Track, Transform, frame_name
from locplan._util.progress import ProgressCallback
from locplan.errors import RecordingError
from locplan.recordings._bag_files import (
    ODOMETRY,
    POSE,
    POSE_WITH_COVARIANCE,
    SCAN,
    TF,
    Bag,
    Message,
    opened,
)
from locplan.recordings._options import Options, Source
from locplan.recordings._places import Heard, leave_out_others, located
from locplan.recordings._recording import Recording
from locplan.recordings._scans import ScanRows

BACK = 0.5
"""Time by which a stamp may lie before an earlier one, as messages overtake each other [s]."""
MARGIN = 5 * 10**9
"""Time around a window in which poses are read [ns]."""
LOOK = 500
"""Number of messages of TF after which transforms that are not needed are left out."""
NOT_ROBOTS = ("initialpose", "goal_pose", "goal", "move_base_simple/goal")
"""Ends of topics whose poses are not where the robot is."""


def read_bag(path: Path, options: Options, progress: ProgressCallback | None = None) -> Recording:
    """Read a drive from a bag; only the topics that are needed are decoded.

    Raises
    ------
    RecordingError
        If the bag is damaged, has no scans or poses, its frames are not connected, or its clock
        runs backwards.
    """
    with opened(path) as bag:
        topic = scan_topic(bag, options.scan_topic)
        start, stop = _window(bag, options)
        scans = _read_scans(bag, topic, options, start, stop, progress)
        heard = _listen(bag, topic, options, scans, start, stop, progress)
    place = located(heard, scans.frame, scans.times, options)
    kept: list[int] = np.flatnonzero(place.known).tolist()
    notes = list(place.notes)
    if len(kept) < len(scans.times):
        notes.append(f"{len(scans.times) - len(kept)} of {len(scans.times)} scans have no pose")
    rows = scans.rows
    if rows.resampled:
        of = f"{rows.resampled} of {len(rows)}"
        notes.append(f"scans of other angles were brought to those of the first ({of})")
    lidar = rows.lidar(place.mount, place.upside_down)
    ranges = rows.finish([scans.order[n] for n in kept] if scans.in_order else range(len(rows)))
    if not scans.in_order:
        ranges = ranges[[scans.order[n] for n in kept]]
    if place.upside_down:
        ranges = ranges[:, ::-1]
    ranges.setflags(write=False)
    source = Source(
        file=path.name,
        scans=topic,
        poses=place.poses_from,
        odometry=place.odometry_from,
        map_frame=place.map_frame,
        base_frame=place.base_frame,
        lidar_frame=scans.frame,
        notes=tuple(notes),
    )
    odometry = None if place.odometry is None else place.odometry[kept]
    return Recording(
        ranges, lidar, place.poses[kept], np.array(scans.times)[kept], odometry, source
    )


def scan_topic(bag: Bag, named: str | None) -> str:
    """The topic of the scans: the one that is named, or the only one."""
    topics = bag.of_type(SCAN)
    if named is not None:
        if named in topics:
            return named
        have = ", ".join(topics) or f"none of type LaserScan, but {bag.listed()}"
        raise RecordingError(f"has no scans on {named}; scan_topic= can be: {have}")
    if not topics:
        raise RecordingError(
            f"has no scans (sensor_msgs/LaserScan); its topics are {bag.listed()}; record one"
        )
    if len(topics) > 1:
        topics = [each for each in topics if bag.count([each])] or topics
    if len(topics) > 1:
        raise RecordingError(
            f"has scans on {' and '.join(topics)}; choose one with scan_topic={topics[0]!r}"
        )
    return topics[0]


@dataclass(frozen=True)
class _Scans:
    """The scans of a bag, and in what order of their stamps they were logged."""

    rows: ScanRows
    order: Sequence[int]
    """Index of the row of each time."""
    times: Sequence[float]
    """Times of the stamps, ascending [s]."""
    frame: str

    @property
    def in_order(self) -> bool:
        """True if no scan overtook another one."""
        return all(one < other for one, other in zip(self.order, self.order[1:], strict=False))


def _window(bag: Bag, options: Options) -> tuple[int | None, int | None]:
    if options.window is None:
        return None, None
    start, end = (bag.start + round(each * 1e9) for each in options.window)
    return start, end


def _read_scans(
    bag: Bag,
    topic: str,
    options: Options,
    start: int | None,
    stop: int | None,
    progress: ProgressCallback | None,
) -> _Scans:
    expected = bag.count([topic]) // options.every + 1 if options.window is None else 0
    rows, stamps, frame = ScanRows(options.range_limits, expected), list[float](), ""
    latest = -np.inf
    for message in bag.messages([topic], start, stop, options.every, progress):
        scan = message.content
        stamp = seconds(scan.header.stamp, message.logged)
        if stamp < latest - BACK:
            raise RecordingError(
                f"the clock of {topic} runs backwards by {latest - stamp:.3g} s at"
                f" {(message.logged - bag.start) / 1e9:.3g} s; was simulated time reset? Read a"
                " part with window=(start, end) in seconds"
            )
        latest = max(latest, stamp)
        frame = frame or frame_name(scan.header.frame_id)
        rows.add(
            float(scan.angle_min),
            float(scan.angle_increment),
            scan.ranges,
            float(scan.range_min),
            float(scan.range_max),
        )
        stamps.append(stamp)
    if not stamps:
        within = "" if options.window is None else " in the window"
        raise RecordingError(f"has no scan on {topic}{within}; record again, or read another part")
    _, order = np.unique(np.array(stamps), return_index=True)
    return _Scans(rows, order.tolist(), [stamps[n] for n in order], frame)


def _listen(
    bag: Bag,
    topic: str,
    options: Options,
    scans: _Scans,
    start: int | None,
    stop: int | None,
    progress: ProgressCallback | None,
) -> Heard:
    """Transforms, poses and odometry near the times of the scans."""
    first = None if start is None else start - MARGIN
    last = None if stop is None else stop + MARGIN
    topics = _pose_topics(bag, options)
    others = {each: kind for each, kind in topics.items() if kind != ODOMETRY}
    first_heard = Heard(FrameTree([]), "", np.empty(0, np.int64))
    for message in bag.messages(others, first, last, progress=progress):
        _take(message, others, first_heard, scans.times)
    knots = _knots(first_heard, scans.times)
    times = knots.tolist()
    tree = FrameTree(times)
    of_tf = near_namespace(bag.of_type(TF), topic)
    static = [each for each in of_tf if each.endswith("tf_static")]
    heard = Heard(tree, bag.listed(), np.searchsorted(knots, scans.times), first_heard.topics)
    for message in bag.messages(static):
        for each in message.content.transforms:
            tree.add_static(each.header.frame_id, each.child_frame_id, transform(each.transform))
    topics = {each: kind for each, kind in topics.items() if kind == ODOMETRY}
    topics |= {each: TF for each in of_tf if each not in static}
    count = 0
    for message in bag.messages(topics, first, last, progress=progress):
        if topics[message.topic] != TF:
            _take(message, topics, heard, times)
            continue
        for each in message.content.transforms:
            time, pose = seconds(each.header.stamp, message.logged), transform(each.transform)
            tree.add(time, each.header.frame_id, each.child_frame_id, pose)
        count += 1
        if count % LOOK == 0:
            leave_out_others(tree, options, scans.frame)
    return heard


def _knots(heard: Heard, times: Sequence[float]) -> NDArray[np.float64]:
    """Times of the scans, and of the poses of AMCL, which are few and need odometry, too [s]."""
    samples = [
        np.concatenate([part[:, 0] for part in each.track.samples()])
        for each in heard.topics.values()
        if each.kind == POSE_WITH_COVARIANCE
    ]
    knots = np.unique(np.concatenate([times, *samples]))
    return np.asarray(knots[np.isfinite(knots)])


def _take(message: Message, topics: dict[str, str], heard: Heard, times: Sequence[float]) -> None:
    """Take a pose of a topic, of the type that is named for it."""
    content, kind = message.content, topics[message.topic]
    if message.topic not in heard.topics:
        child = frame_name(content.child_frame_id) if kind == ODOMETRY else ""
        frame = frame_name(content.header.frame_id)
        heard.add_topic(message.topic, kind, frame, child, Track(times))
    pose = content.pose if kind == POSE else content.pose.pose
    heard.topics[message.topic].track.add(
        seconds(content.header.stamp, message.logged),
        transform_of(pose.position, pose.orientation),
    )


def _pose_topics(bag: Bag, options: Options) -> dict[str, str]:
    """Topics of poses and odometry that may be needed, and their types."""
    topics: dict[str, str] = {}
    for kind in (POSE_WITH_COVARIANCE, POSE, ODOMETRY):
        topics |= {each: kind for each in bag.of_type(kind) if _wanted(each, kind, options)}
    for name, option in ((options.pose_topic, "pose_topic"), (options.odom_topic, "odom_topic")):
        if name is not None and name not in topics:
            others = (POSE_WITH_COVARIANCE, POSE) if option == "pose_topic" else ()
            have = ", ".join(bag.of_type(*others, ODOMETRY)) or "none"
            raise RecordingError(f"has no poses on {name}; topics for {option}= are: {have}")
    return topics


def _wanted(topic: str, kind: str, options: Options) -> bool:
    if topic in (options.pose_topic, options.odom_topic):
        return True
    if kind == ODOMETRY:
        return options.odom_topic is None
    return options.pose_topic is None and not topic.endswith(NOT_ROBOTS)


def near_namespace(topics: Sequence[str], scan: str) -> list[str]:
    """Of the TF topics of several robots those in the namespace of the scans; else all.

    Examples
    --------
    >>> near_namespace(["/a/tf", "/a/tf_static", "/b/tf"], "/a/front/scan")
    ['/a/tf', '/a/tf_static']
    >>> near_namespace(["/tf", "/tf_static"], "/a/scan")
    ['/tf', '/tf_static']
    """
    spaces = {topic: topic.rpartition("/")[0] + "/" for topic in topics}
    ours = [space for space in spaces.values() if scan.startswith(space)]
    best = max(ours, key=len, default=None)
    return [topic for topic in topics if best is None or spaces[topic] == best]


def seconds(stamp: Any, logged: int) -> float:
    """Time of a stamp, or where it is zero that of the log [s]."""
    total = stamp.sec + 1e-9 * stamp.nanosec
    return float(total) if total else logged * 1e-9


def transform(message: Any) -> Transform:
    """A transform of a geometry_msgs/Transform."""
    return transform_of(message.translation, message.rotation)


def transform_of(place: Any, turn: Any) -> Transform:
    """A transform of a position and a quaternion."""
    return (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w)
