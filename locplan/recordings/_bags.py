"""Recorded drives from bags: scans in a first pass, what relates them to the map in a second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from locplan._util.poses import IDENTITY, FrameTree, Track, Transform, frame_name
from locplan._util.progress import ProgressCallback
from locplan.errors import RecordingError
from locplan.recordings._bag_files import Bag, Kind, Message, opened
from locplan.recordings._logs import Options, ScanRows
from locplan.recordings._places import Heard, PoseTopic
from locplan.recordings._recording import Recording

OURS = "/locplan/"
"""Beginning of the topics that were added to a bag, which are read only where they are named."""


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
        scans = _read_scans(bag, topic, options, progress)
        heard = _listen(bag, topic, options, scans, progress)
    place, notes = heard.located(), heard.notes
    kept: list[int] = np.flatnonzero(place.known).tolist()
    if len(kept) < len(scans.times):
        notes.append(f"{len(scans.times) - len(kept)} of {len(scans.times)} scans have no pose")
    rows = scans.rows
    if rows.resampled:
        of = f"{rows.resampled} of {len(rows)}"
        notes.append(f"scans of other angles were brought to those of the first ({of})")
    lidar = rows.lidar(place.mount, place.upside_down)
    ranges = rows.finish([scans.order[n] for n in kept])
    if place.upside_down:
        ranges = ranges[:, ::-1]
    ranges.setflags(write=False)
    source = replace(
        place.source,
        file=path.name,
        scans=topic,
        stamps_back=scans.stamps_back,
        notes=tuple(notes),
    )
    odometry = None if place.odometry is None else place.odometry[kept]
    speeds = None if place.speeds is None else place.speeds[kept]
    times = np.array(scans.times)[kept]
    return Recording(ranges, lidar, place.poses[kept], times, odometry, source, speeds)


def scan_topic(bag: Bag, named: str | None) -> str:
    """The topic of the scans: the one that is named, or the only one."""
    topics = bag.of_type(Kind.SCAN)
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
    stamps_back: int
    """Number of scans with stamps before that of one that was logged earlier."""


def _window(bag: Bag, options: Options, margin: float = 0.0) -> tuple[int | None, int | None]:
    """Times of the log between which messages are read [ns], with a margin around them [s]."""
    if options.window is None:
        return None, None
    (start, end), around = options.window, round(margin * 1e9)
    return bag.start + round(start * 1e9) - around, bag.start + round(end * 1e9) + around


def _read_scans(
    bag: Bag, topic: str, options: Options, progress: ProgressCallback | None
) -> _Scans:
    rows, stamps, frame = ScanRows(options.range_limits), list[float](), ""
    latest, stamps_back = -np.inf, 0
    window = _window(bag, options)
    for message in bag.messages([topic], *window, options.every, progress):
        scan = message.content
        stamp = seconds(scan.header.stamp, message.logged)
        if stamp < latest - 0.5:  # messages overtake each other, but not by as much
            raise RecordingError(
                f"the clock of {topic} runs backwards by {latest - stamp:.3g} s at"
                f" {(message.logged - bag.start) / 1e9:.3g} s; was simulated time reset? In"
                " Python, read a part with window=(start, end) in seconds"
            )
        stamps_back += stamp < latest
        latest = max(latest, stamp)
        frame = frame or frame_name(scan.header.frame_id)
        about = scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max
        rows.add(scan.ranges, *map(float, about))
        stamps.append(stamp)
    if not stamps:
        within = "" if options.window is None else " in the window"
        raise RecordingError(f"has no scan on {topic}{within}; record again, or read another part")
    _, order = np.unique(np.array(stamps), return_index=True)
    return _Scans(rows, order.tolist(), [stamps[n] for n in order], frame, stamps_back)


def _listen(
    bag: Bag, topic: str, options: Options, scans: _Scans, progress: ProgressCallback | None
) -> Heard:
    """Transforms, poses and odometry near the times of the scans."""
    window = _window(bag, options, 5.0)
    topics = _pose_topics(bag, options)
    listed = bag.listed()
    poses = {each: kind for each, kind in topics.items() if kind != Kind.ODOMETRY}
    heard = Heard(FrameTree([]), scans.times, scans.frame, options, listed)
    for message in bag.messages(poses, *window, progress=progress):
        _take(message, poses, heard, scans.times)
    # The poses of AMCL are few: they need odometry at their own times, too.
    samples = [
        np.concatenate([part[:, 0] for part in each.track.samples()])
        for each in heard.topics.values()
        if each.kind == Kind.POSE_WITH_COVARIANCE
    ]
    knots = np.unique(np.concatenate([scans.times, *samples]))
    times = knots[np.isfinite(knots)].tolist()
    tree = FrameTree(times)
    heard = replace(heard, tree=tree)
    of_tf = near_namespace(bag.of_type(Kind.TF), topic)
    static = [each for each in of_tf if each.endswith("tf_static")]
    for message in bag.messages(static):
        for each in message.content.transforms:
            tree.add_static(each.header.frame_id, each.child_frame_id, transform(each.transform))
    others = topics.keys() - poses.keys()
    topics = {each: kind for each, kind in topics.items() if each in others}
    topics |= {each: Kind.TF for each in of_tf if each not in static}
    count = 0
    for message in bag.messages(topics, *window, progress=progress):
        if topics[message.topic] != Kind.TF:
            _take(message, topics, heard, times)
            continue
        for each in message.content.transforms:
            time, pose = seconds(each.header.stamp, message.logged), transform(each.transform)
            tree.add(time, each.header.frame_id, each.child_frame_id, pose)
        count += 1
        if count % 500 == 0:
            heard.leave_out_others()
    return heard


def _take(message: Message, topics: dict[str, str], heard: Heard, times: Sequence[float]) -> None:
    """Take a pose of a topic, of the type that is named for it."""
    content, kind = message.content, topics[message.topic]
    if message.topic not in heard.topics:
        child = frame_name(content.child_frame_id) if kind == Kind.ODOMETRY else ""
        frame = frame_name(content.header.frame_id)
        heard.topics[message.topic] = PoseTopic(kind, frame, child, Track(times), Track(times))
    pose = content.pose if kind == Kind.POSE else content.pose.pose
    topic, time = heard.topics[message.topic], seconds(content.header.stamp, message.logged)
    topic.track.add(time, transform_of(pose.position, pose.orientation))
    if kind == Kind.ODOMETRY:
        topic.speeds.add(time, (content.twist.twist.linear.x, *IDENTITY[1:]))


def _pose_topics(bag: Bag, options: Options) -> dict[str, str]:
    """Topics of poses and odometry that may be needed, and their types."""
    topics: dict[str, str] = {}
    for kind in (Kind.POSE_WITH_COVARIANCE, Kind.POSE, Kind.ODOMETRY):
        topics |= {each: kind for each in bag.of_type(kind) if _wanted(each, kind, options)}
    for name, option in ((options.pose_topic, "pose_topic"), (options.odom_topic, "odom_topic")):
        if name is not None and name not in topics:
            others = (Kind.POSE_WITH_COVARIANCE, Kind.POSE) if option == "pose_topic" else ()
            have = ", ".join(bag.of_type(*others, Kind.ODOMETRY)) or "none"
            raise RecordingError(f"has no poses on {name}; topics for {option}= are: {have}")
    return topics


def _wanted(topic: str, kind: str, options: Options) -> bool:
    if topic in (options.pose_topic, options.odom_topic):
        return True
    if kind == Kind.ODOMETRY:
        return options.odom_topic is None
    not_the_robots = ("initialpose", "goal_pose", "goal", "move_base_simple/goal")
    robots = not (topic.endswith(not_the_robots) or topic.startswith(OURS))
    return options.pose_topic is None and robots


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
