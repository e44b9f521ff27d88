"""Where the robot of a bag was at its scans, and where its lidar is mounted.

Poses that are reported now and then are carried by odometry to the scans in between.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan._util.poses import FrameTree, Track, after_way, in_plane, upward, way_between, wrapped
from locplan.errors import RecordingError
from locplan.recordings._bag_files import Kind
from locplan.recordings._logs import Options, Source

BASES = ("base_footprint", "base_link", "base")
"""Usual names of a robot's frame, after a prefix; that of odometry is odom."""


class PoseTopic(NamedTuple):
    """A topic of poses: of what type, in which frame, of which frame if it says so."""

    kind: str
    frame: str
    child: str
    track: Track
    speeds: Track  # ahead by odometry, as x of transforms, which are interpolated alike


@dataclass(frozen=True)
class Place:
    """Poses of the robot at the scans, and the mount of its lidar."""

    poses: Floats
    """(n, 3) in the map's frame; NaN where unknown [m, m, rad]."""
    odometry: Floats | None
    speeds: Floats | None
    """Speeds ahead by odometry, (n,) [m/s]; NaN where unknown."""
    mount: tuple[float, float, float]
    upside_down: bool
    source: Source
    """Where all of it comes from."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask of the scans with a pose, and odometry if there is any; all without any pose."""
        found = np.isfinite(self.poses).all(1)
        if not found.any():
            return np.ones(len(self.poses), np.bool_)
        if self.odometry is not None:
            found &= np.isfinite(self.odometry).all(1)
        return np.asarray(found)


@dataclass(frozen=True)
class Heard:
    """What a bag says about places: transforms, and topics of poses."""

    tree: FrameTree
    times: Sequence[float]
    """Times of the scans [s], all of them among the times of the tree."""
    lidar_frame: str
    options: Options
    listed: str
    """All topics and types, for error messages."""
    topics: dict[str, PoseTopic] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    """What was assumed or left out."""

    @cached_property
    def at_scans(self) -> NDArray[np.int64]:
        """Index of each scan's time among the times of the tree and of odometry."""
        return np.searchsorted(self.tree.times, self.times)

    @property
    def map_frame(self) -> str:
        """Frame of the poses that is asked for, without a leading slash."""
        return self.options.map_frame.lstrip("/")

    def of_odometry(self) -> dict[str, PoseTopic]:
        """The topics of odometry."""
        return {name: each for name, each in self.topics.items() if each.kind == Kind.ODOMETRY}

    def located(self) -> Place:
        """Find poses, odometry and the lidar's mount in what the bag says.

        Raises
        ------
        RecordingError
            If there are no poses, frames are not connected, or the lidar is tilted or moves.
        """
        for topic in (self.options.pose_topic, self.options.odom_topic):
            if topic is not None and topic not in self.topics:
                raise RecordingError(f"has no message on {topic} near the scans; name another one")
        base = self._base_frame()
        mount, upside_down = self._mount(base)
        reported, odometry_from = self._odometry(base)
        poses, poses_from, map_frame = self._poses(base, reported, odometry_from)
        located = np.isfinite(poses).all(axis=1)
        if not poses_from:
            reported, odometry_from = None, ""
        elif not located.any():
            own = self.topics.get(poses_from)
            begin, end = (own.track.begin, own.track.end) if own else self.tree.clock
            raise RecordingError(
                f"no scan has a pose: {poses_from} is known from {begin:.3f} to {end:.3f} s, and"
                f" the scans are from {self.times[0]:.3f} to {self.times[-1]:.3f} s; do both have"
                " the same clock?"
            )
        odometry = None if reported is None else reported[self.at_scans]
        if odometry is not None:
            known = np.isfinite(odometry[located]).all(axis=1).mean()
            if known < 0.9:
                self.notes.append(
                    f"{odometry_from} tells odometry at only {known:.0%} of the scans"
                )
                odometry, odometry_from = None, ""
        source = Source(
            poses=poses_from,
            odometry=odometry_from,
            map_frame=map_frame,
            base_frame=base,
            lidar_frame=self.lidar_frame,
        )
        speeds = None if odometry is None else self._speeds(odometry_from)
        return Place(poses, odometry, speeds, mount, upside_down, source)

    def _speeds(self, odometry_from: str) -> Floats | None:
        """Speeds ahead at the scans, of the topic of odometry; None if there are several, or 0."""
        topics = self.of_odometry()
        if len(topics) != 1 and odometry_from not in topics:
            return None
        topic = topics.get(odometry_from) or next(iter(topics.values()))
        speeds = topic.speeds.at_times()[self.at_scans, 0]
        return speeds if np.nan_to_num(speeds).any() else None

    def leave_out_others(self) -> None:
        """Leave out the transforms that no pose needs, once TF leads from the map to the lidar."""
        tree = self.tree
        if tree.connected(self.map_frame, self.lidar_frame):
            usual = {each for each in tree.frames if each.rpartition("/")[2] in (*BASES, "odom")}
            base = (self.options.base_frame or "").lstrip("/")
            tree.keep_between(self.map_frame, {self.lidar_frame, base, *usual})

    def _base_frame(self) -> str:
        """Frame of the robot: the one that is named, that of odometry, or one of a usual name."""
        frames = self.tree.frames
        if self.options.base_frame is not None:
            base = self.options.base_frame.lstrip("/")
            if frames and base not in frames:
                raise RecordingError(
                    f"has no frame {base!r}; base_frame= can be: {', '.join(frames)}"
                )
            return base
        reported = [each.child for each in self.of_odometry().values() if each.child]
        named = [frame for base in BASES for frame in frames if frame.rpartition("/")[2] == base]
        found = [frame for frame in dict.fromkeys(reported + named) if frame in frames]
        for frame in found:
            if self.tree.connected(frame, self.lidar_frame):
                return frame
        if found:
            return found[0]
        if self.lidar_frame in frames:
            self.notes.append(
                f"no frame is named as the robot's: the lidar's, {self.lidar_frame}, is taken for"
                " it; name another one with base_frame="
            )
            return self.lidar_frame
        return reported[0] if reported else BASES[1]

    def _mount(self, base: str) -> tuple[tuple[float, float, float], bool]:
        """Pose of the lidar on the robot [m, m, rad], and whether it is upside down."""
        lidar = self.lidar_frame
        if self.options.mount is not None:
            return self.options.mount, False
        if not self.tree.frames:
            self.notes.append(
                "there is no TF: the lidar is taken to be at the robot's centre; see mount="
            )
            return (0.0, 0.0, 0.0), False
        pose = self.tree.pose(base, lidar)
        pose = None if pose is None else pose[np.isfinite(pose).all(1)]
        if pose is None or not len(pose):
            raise RecordingError(
                f"TF does not connect the lidar's frame {lidar!r} with the robot's {base!r};"
                f" connected are: {self.tree.described()}, though not at each time; give"
                " mount=(x, y, yaw), or another base_frame="
            )
        up, flat = upward(pose), in_plane(pose)
        tilt = math.degrees(math.acos(min(1.0, float(np.abs(up).min()))))
        if tilt > 10:
            raise RecordingError(
                f"the lidar {lidar!r} is tilted by {tilt:.0f} deg on {base!r}; a plane map cannot"
                " explain such scans; choose another scan_topic="
            )
        flat[:, 2] = flat[0, 2] + wrapped(flat[:, 2] - flat[0, 2])
        if np.ptp(flat, axis=0).max() > 0.005:  # metres and radians
            raise RecordingError(
                f"the lidar {lidar!r} moves on {base!r}, which looks like the robot's motion;"
                " choose another scan_topic= or base_frame="
            )
        x, y, yaw = flat[0].tolist()
        return (x, y, yaw), bool(up[0] < 0)

    def _poses(
        self, base: str, reported: Floats | None, odometry_from: str
    ) -> tuple[Floats, str, str]:
        """Poses of the robot at the scans, where they come from, and the frame they are in.

        Without poses on the map they are those of odometry; or NaN, if none are needed.
        """
        tree, frame, topic = self.tree, self.map_frame, self.options.pose_topic
        if topic is None:
            pose = tree.pose(frame, base) if {frame, base} <= set(tree.frames) else None
            if pose is not None:
                return in_plane(pose)[self.at_scans], f"TF {frame} -> {base}", frame
            topic = self._only_topic()
        if topic is None and not self.options.needs_poses:
            return np.full((len(self.times), 3), np.nan), "", ""
        is_expected = frame in tree.frames or self.options.map_frame != Options.map_frame
        if topic is None and reported is not None and not is_expected:
            self.notes.append(
                f"there are no poses on the map: those of odometry ({odometry_from}) are taken, in"
                " their own frame"
            )
            return reported[self.at_scans], odometry_from, ""
        if topic is None:
            raise self._no_poses(base)
        found = self.topics[topic]
        if found.track.left_out:
            self.notes.append(
                f"{found.track.left_out} poses of {topic} are not numbers, and left out"
            )
        if found.track.empty:
            raise RecordingError(f"the poses of {topic} are all not numbers (NaN, or no rotation)")
        if found.frame != frame:
            self.notes.append(
                f"the poses of {topic} are in {found.frame!r}, which is taken for the map's"
            )
        poses = in_plane(found.track.at_times())
        poses = poses[self.at_scans] if found.kind == Kind.ODOMETRY else poses
        if reported is not None and found.kind == Kind.POSE_WITH_COVARIANCE:
            carried = carried_poses(self.times, found.track, tree.times, reported)
            poses = np.where(np.isfinite(carried), carried, poses)
        return poses, topic, found.frame

    def _only_topic(self) -> str | None:
        """The only topic of poses, of the type that tells most; None without any."""
        for kind in (Kind.POSE_WITH_COVARIANCE, Kind.POSE, Kind.ODOMETRY):
            topics = [
                name
                for name, each in self.topics.items()
                if each.kind == kind and (kind != Kind.ODOMETRY or each.frame == self.map_frame)
            ]
            if len(topics) == 1:
                return topics[0]
            if topics:
                raise RecordingError(
                    f"has poses on {' and '.join(topics)}; choose one with pose_topic={topics[0]!r}"
                )
        return None

    def _no_poses(self, base: str) -> RecordingError:
        """Return the error of a bag that has neither poses nor one odometry."""
        several = [*self.of_odometry()]
        other = f", or one odometry with odom_topic={several[0]!r}" if several else ""
        if not self.tree.frames:
            return RecordingError(
                f"has no poses: neither TF nor a topic of poses; its topics are {self.listed};"
                f" record /tf and /tf_static too{other}"
            )
        return RecordingError(
            f"has no poses: TF does not connect {self.map_frame!r} with {base!r}; connected are:"
            f" {self.tree.described()}; name others with map_frame= and base_frame={other}"
        )

    def _odometry(self, base: str) -> tuple[Floats | None, str]:
        """Odometry at all times of the tree, if there is some that is not the poses themselves."""
        named, of_poses = self.options.odom_topic, self.options.pose_topic
        topics = [
            name
            for name, each in self.of_odometry().items()
            if name != of_poses and each.frame != self.map_frame
        ]
        if named is None:
            frames = [self.topics[name].frame for name in topics]
            frames += [each for each in self.tree.frames if each.rpartition("/")[2] == "odom"]
            for frame in frames:
                pose = self.tree.pose(frame, base) if frame != base else None
                if pose is not None:
                    return in_plane(pose), f"TF {frame} -> {base}"
        topics = topics if named is None else [named]
        if len(topics) == 1:
            return in_plane(self.topics[topics[0]].track.at_times()), topics[0]
        if topics:
            self.notes.append(
                f"odometry is on {' and '.join(topics)}, and none was taken; choose by odom_topic="
            )
        return None, ""


def carried_poses(
    times: Sequence[float], track: Track, reported_at: Sequence[float], reported: Floats
) -> Floats:
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
        NaN where a scan is over 1 m of odometry from both samples.
    """
    at, knots = np.asarray(times), np.asarray(reported_at)
    now = reported[np.searchsorted(knots, at)]
    guesses, weights = [], []
    for samples in track.samples():
        then = samples[:, 0]
        index = np.searchsorted(knots, np.where(np.isfinite(then), then, knots[0]))
        way = way_between(reported[index], now)
        near = np.isfinite(then) & (np.hypot(way[:, 0], way[:, 1]) < 1.0)
        guesses.append(after_way(in_plane(samples[:, 1:]), way))
        # The nearer sample in time counts for more; one that is too far for nothing.
        weights.append(np.where(near, 1.0 / np.maximum(np.abs(at - then), 1e-9), 0.0))
    (one, other), (first, second) = guesses, weights
    one, other = np.where(first[:, None] > 0, one, other), np.where(second[:, None] > 0, other, one)
    total = first + second
    share = np.divide(second, total, out=np.full(len(at), np.nan), where=total > 0)
    step = other - one
    step[:, 2] = wrapped(step[:, 2])
    found: Floats = one + share[:, None] * step
    return found
