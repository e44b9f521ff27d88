"""Where the robot of a bag was at its scans, and where its lidar is mounted.

Poses that are reported now and then are carried by odometry to the scans in between.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._util.poses import (
    FrameTree,
    Numbers,
    Track,
    after_way,
    in_plane,
    upward,
    way_between,
    wrapped,
)
from locplan.errors import RecordingError
from locplan.recordings._bag_files import ODOMETRY, POSE, POSE_WITH_COVARIANCE
from locplan.recordings._options import Options

CARRIED = 1.0
"""Way over which odometry carries a pose to a scan [m]."""
ODOM = "odom"
BASES = ("base_footprint", "base_link", "base")
"""Usual names of a robot's frame, after a prefix."""
LEVEL = math.cos(math.radians(10.0))
"""Cosine of the greatest tilt of a lidar that counts as level."""
FIRM = 0.005
"""Distance [m] and turn [rad] by which a lidar may move on its robot."""
ENOUGH = 0.9
"""Share of the scans that need odometry, for it to be kept."""


class PoseTopic(NamedTuple):
    """A topic of poses: of what type, in which frame, of which frame if it says so."""

    kind: str
    frame: str
    child: str
    track: Track


@dataclass(frozen=True)
class Heard:
    """What a bag says about places: transforms, and topics of poses."""

    tree: FrameTree
    listed: str
    """All topics and types, for error messages."""
    at_scans: NDArray[np.int64]
    """Index of each scan's time among the times of the tree and of odometry."""
    topics: dict[str, PoseTopic] = field(default_factory=dict)

    def add_topic(self, name: str, kind: str, frame: str, child: str, track: Track) -> None:
        """Take a topic of poses at its first message."""
        self.topics[name] = PoseTopic(kind, frame, child, track)

    def poses_of(self, topic: str) -> Numbers:
        """Poses of a topic at the scans, (n, 3); NaN where unknown."""
        found = in_plane(self.topics[topic].track.at_times())
        return found[self.at_scans] if self.topics[topic].kind == ODOMETRY else found


@dataclass(frozen=True)
class Place:
    """Poses of the robot at the scans, the mount of its lidar, and where they come from."""

    poses: Numbers
    """(n, 3) in the map's frame; NaN where unknown [m, m, rad]."""
    odometry: Numbers | None
    mount: tuple[float, float, float]
    upside_down: bool
    poses_from: str
    odometry_from: str
    map_frame: str
    base_frame: str
    notes: tuple[str, ...]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask of the scans with a pose, and odometry if there is any."""
        found = np.isfinite(self.poses).all(1)
        if self.odometry is not None:
            found &= np.isfinite(self.odometry).all(1)
        return np.asarray(found)


def located(heard: Heard, lidar_frame: str, times: Sequence[float], options: Options) -> Place:
    """Find poses, odometry and the lidar's mount in what a bag says.

    Raises
    ------
    RecordingError
        If there are no poses, frames are not connected, or the lidar is tilted or moves.
    """
    notes: list[str] = []
    base = _base_frame(heard, lidar_frame, options, notes)
    mount, upside_down = _mount(heard.tree, base, lidar_frame, options, notes)
    reported, odometry_from = _odometry(heard, base, options, notes)
    poses, poses_from, map_frame = _poses(heard, base, reported, times, options, notes)
    if not np.isfinite(poses).all(1).any():
        raise RecordingError(_apart(heard, poses_from, times))
    odometry = None if reported is None else reported[heard.at_scans]
    if odometry is not None:
        known = np.isfinite(odometry[np.isfinite(poses).all(axis=1)]).all(axis=1).mean()
        if known < ENOUGH:
            notes.append(f"{odometry_from} tells odometry at only {known:.0%} of the scans")
            odometry = None
    return Place(
        poses,
        odometry,
        mount,
        upside_down,
        poses_from,
        odometry_from if odometry is not None else "",
        map_frame,
        base,
        tuple(notes),
    )


def leave_out_others(tree: FrameTree, options: Options, lidar_frame: str) -> None:
    """Leave out the transforms that no pose needs, once TF leads from the map to the lidar."""
    world = options.map_frame.lstrip("/")
    if tree.connected(world, lidar_frame):
        usual = {each for each in tree.frames if each.rpartition("/")[2] in (*BASES, ODOM)}
        tree.keep_between(world, {lidar_frame, (options.base_frame or "").lstrip("/"), *usual})


def _base_frame(heard: Heard, lidar_frame: str, options: Options, notes: list[str]) -> str:
    """Frame of the robot: the one that is named, that of odometry, or one of a usual name."""
    tree = heard.tree
    if options.base_frame is not None:
        base = options.base_frame.lstrip("/")
        if tree.frames and base not in tree.frames:
            raise RecordingError(
                f"has no frame {base!r}; base_frame= can be: {', '.join(tree.frames)}"
            )
        return base
    topics = [each for each in heard.topics.values() if each.kind == ODOMETRY]
    reported = [each.child for each in topics if each.child]
    named = [frame for base in BASES for frame in tree.frames if frame.rpartition("/")[2] == base]
    found = [frame for frame in dict.fromkeys(reported + named) if frame in tree.frames]
    for frame in found:
        if tree.connected(frame, lidar_frame):
            return frame
    if found:
        return found[0]
    if lidar_frame in tree.frames:
        notes.append(
            f"no frame is named as the robot's: the lidar's, {lidar_frame}, is taken for it; name"
            " another one with base_frame="
        )
        return lidar_frame
    return reported[0] if reported else BASES[1]


def _mount(
    tree: FrameTree, base: str, lidar: str, options: Options, notes: list[str]
) -> tuple[tuple[float, float, float], bool]:
    """Pose of the lidar on the robot [m, m, rad], and whether it is upside down."""
    if options.mount is not None:
        return options.mount, False
    if not tree.frames:
        notes.append("there is no TF: the lidar is taken to be at the robot's centre; see mount=")
        return (0.0, 0.0, 0.0), False
    pose = tree.pose(base, lidar)
    if pose is None:
        raise RecordingError(
            f"TF does not connect the lidar's frame {lidar!r} with the robot's {base!r}; connected"
            f" are: {tree.described()}; give mount=(x, y, yaw), or another base_frame="
        )
    pose = pose[np.isfinite(pose).all(1)]
    if not len(pose):
        raise RecordingError(
            f"TF from {base!r} to {lidar!r} is not known at the time of any scan; give"
            " mount=(x, y, yaw)"
        )
    up, flat = upward(pose), in_plane(pose)
    if np.abs(up).min() < LEVEL:
        tilt = math.degrees(math.acos(min(1.0, float(np.abs(up).min()))))
        raise RecordingError(
            f"the lidar {lidar!r} is tilted by {tilt:.0f} deg on {base!r}; a plane map cannot"
            " explain such scans; choose another scan_topic="
        )
    turns = (flat[:, 2] - flat[0, 2] + np.pi) % (2 * np.pi) - np.pi
    if max(np.ptp(flat[:, 0]), np.ptp(flat[:, 1]), np.ptp(turns)) > FIRM:
        raise RecordingError(
            f"the lidar {lidar!r} moves on {base!r}, which looks like the robot's motion;"
            " choose another scan_topic= or base_frame="
        )
    x, y, yaw = flat[0].tolist()
    return (x, y, yaw), bool(up[0] < 0)


def _poses(
    heard: Heard,
    base: str,
    reported: Numbers | None,
    times: Sequence[float],
    options: Options,
    notes: list[str],
) -> tuple[Numbers, str, str]:
    """Poses of the robot at the scans, where they come from, and the frame they are in."""
    tree, frame = heard.tree, options.map_frame.lstrip("/")
    topic = options.pose_topic
    if topic is not None and topic not in heard.topics:
        raise RecordingError(f"has no message on {topic} near the scans; leave out pose_topic=")
    if topic is None:
        pose = tree.pose(frame, base) if {frame, base} <= set(tree.frames) else None
        if pose is not None:
            return in_plane(pose)[heard.at_scans], f"TF {frame} -> {base}", frame
        topic = _only_topic(heard, base, frame)
    found = heard.topics[topic]
    if found.track.left_out:
        notes.append(f"{found.track.left_out} poses of {topic} are not numbers, and left out")
    if found.track.empty:
        raise RecordingError(f"the poses of {topic} are all not numbers (NaN, or no rotation)")
    if found.frame != frame:
        notes.append(f"the poses of {topic} are in {found.frame!r}, which is taken for the map's")
    poses = heard.poses_of(topic)
    if reported is not None and found.kind == POSE_WITH_COVARIANCE:
        carried = carried_poses(times, found.track, heard.tree.times, reported)
        poses = np.where(np.isfinite(carried), carried, poses)
    return poses, topic, found.frame


def _only_topic(heard: Heard, base: str, frame: str) -> str:
    """The only topic of poses, of the type that tells most; where TF does not lead to the map."""
    for kind in (POSE_WITH_COVARIANCE, POSE, ODOMETRY):
        topics = [
            name
            for name, each in heard.topics.items()
            if each.kind == kind and (kind != ODOMETRY or each.frame == frame)
        ]
        if len(topics) == 1:
            return topics[0]
        if topics:
            raise RecordingError(
                f"has poses on {' and '.join(topics)}; choose one with pose_topic={topics[0]!r}"
            )
    tree = heard.tree
    reported = [name for name, each in heard.topics.items() if each.kind == ODOMETRY]
    other = f", or pose_topic={reported[0]!r} for odometry alone" if reported else ""
    if not tree.frames:
        raise RecordingError(
            f"has no poses: neither TF nor a topic of poses; its topics are {heard.listed}; record"
            f" /tf and /tf_static too{other}"
        )
    raise RecordingError(
        f"has no poses: TF does not connect {frame!r} with {base!r}; connected are:"
        f" {tree.described()}; name others with map_frame=, base_frame={other}"
    )


def _apart(heard: Heard, poses_from: str, times: Sequence[float]) -> str:
    """Why no scan has a pose: the clocks differ, or the poses are too far apart."""
    topic = heard.topics.get(poses_from)
    begin, end = (topic.track.begin, topic.track.end) if topic else heard.tree.clock
    return (
        f"no scan has a pose: {poses_from} is known from {begin:.3f} to {end:.3f} s, and the scans"
        f" are from {times[0]:.3f} to {times[-1]:.3f} s; do both have the same clock?"
    )


def _odometry(
    heard: Heard, base: str, options: Options, notes: list[str]
) -> tuple[Numbers | None, str]:
    """Odometry at all times of the tree, if there is some that is not the poses themselves."""
    topics = _odometry_topics(heard, options)
    if options.odom_topic is None:
        frames = [heard.topics[name].frame for name in topics]
        frames += [each for each in heard.tree.frames if each.rpartition("/")[2] == ODOM]
        for frame in frames:
            pose = heard.tree.pose(frame, base) if frame != base else None
            if pose is not None:
                return in_plane(pose), f"TF {frame} -> {base}"
    if len(topics) == 1:
        return in_plane(heard.topics[topics[0]].track.at_times()), topics[0]
    if topics:
        notes.append(
            f"odometry is on {' and '.join(topics)}, and none was taken; choose by odom_topic="
        )
    return None, ""


def _odometry_topics(heard: Heard, options: Options) -> list[str]:
    """The topic that is named, or all of odometry that are not the poses themselves."""
    if options.odom_topic is not None:
        if options.odom_topic not in heard.topics:
            raise RecordingError(f"has no message on {options.odom_topic} near the scans")
        return [options.odom_topic]
    return [
        name
        for name, each in heard.topics.items()
        if each.kind == ODOMETRY
        and name != options.pose_topic
        and each.frame != options.map_frame.lstrip("/")
    ]


def carried_poses(
    times: Sequence[float], track: Track, reported_at: Sequence[float], reported: Numbers
) -> Numbers:
    """Poses at n times that odometry carries there from the samples before and after.

    AMCL tells a pose only once the robot has moved on; between two of them it may have turned back.

    Parameters
    ----------
    times : sequence of n floats
        Times of the scans [s].
    track : Track
        Samples of the pose.
    reported_at : sequence of m floats
        Times of the odometry, those of the samples among them [s].
    reported : (m, 3) array
        Poses by odometry, NaN where unknown.

    Returns
    -------
    (n, 3) array
        NaN where a scan is further than `CARRIED` from both samples.
    """
    at, knots = np.asarray(times), np.asarray(reported_at)
    now = reported[np.searchsorted(knots, at)]
    guesses, weights = [], []
    for samples in track.samples():
        then = samples[:, 0]
        index = np.searchsorted(knots, np.where(np.isfinite(then), then, knots[0]))
        way = way_between(reported[index], now)
        near = np.isfinite(then) & (np.hypot(way[:, 0], way[:, 1]) < CARRIED)
        guesses.append(after_way(in_plane(samples[:, 1:]), way))
        # The nearer sample in time counts for more; one that is too far for nothing.
        weights.append(np.where(near, 1.0 / np.maximum(np.abs(at - then), 1e-9), 0.0))
    (one, other), (first, second) = guesses, weights
    one, other = np.where(first[:, None] > 0, one, other), np.where(second[:, None] > 0, other, one)
    total = first + second
    share = np.divide(second, total, out=np.full(len(at), np.nan), where=total > 0)
    step = other - one
    step[:, 2] = wrapped(step[:, 2])
    found: Numbers = one + share[:, None] * step
    return found
