"""Copies of bags with the poses of a trajectory, on topics beside those that were recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan.errors import RecordingError
from locplan.recordings._bag_files import SUFFIXES, Bag, Kind, Message, opened, storage_of
from locplan.recordings._bags import OURS, scan_topic, seconds
from locplan.recordings._logs import Topics

TRUSTED, DOUBTED = f"{OURS}pose", f"{OURS}pose_not_trusted"
"""Topics of the poses that are to be trusted, and of the others."""


@dataclass(frozen=True)
class BagCopy:
    """A copy of a recorded bag, to which a trajectory's poses are added."""

    bag: Path
    """The bag: a file, or a folder of rosbag2."""
    topics: Topics
    """Topic of the scans, where the bag has several, and frame of the poses."""

    @classmethod
    def of(cls, drive: Path, topics: Topics) -> BagCopy | None:
        """The copy of a recorded drive; None where its file is no bag.

        Parameters
        ----------
        drive : path
            The file, or the folder, of the drive.
        topics : Topics
            The topics with which it was read.
        """
        return cls(drive, topics) if drive.is_dir() or drive.suffix in SUFFIXES else None

    @property
    def name(self) -> str:
        """Name of the copy: a file of ROS 1, or a folder of rosbag2."""
        return "with_poses.bag" if storage_of(self.bag).suffix == ".bag" else "with_poses"

    @property
    def files(self) -> tuple[str, ...]:
        """The files of the copy that are known before it is written."""
        return (self.name if self.name.endswith(".bag") else f"{self.name}/metadata.yaml",)

    @property
    def sentence(self) -> str:
        """What is in it, for people."""
        return f"{self.name} has the trusted poses on {TRUSTED}, the others on {DOUBTED}"

    def write(
        self,
        folder: Path,
        times: Floats,
        poses: Floats,
        covariances: Floats,
        trusted: NDArray[np.bool_],
    ) -> None:
        """Write the copy: after each scan its pose, as geometry_msgs/PoseWithCovarianceStamped.

        Parameters
        ----------
        folder : path
            Folder in which there is no copy yet.
        times : (n,) array
            Times of the scans, as they were read of the bag [s].
        poses : (n, 3) array
            Poses of the robot on the map [m, m, rad].
        covariances : (n, 3, 3) array
            Their covariances [m, m, rad].
        trusted : (n,) array
            Whether each is to be trusted.

        Raises
        ------
        RecordingError
            If the bag cannot be read, or none of its scans is at one of the times.
        LocplanError
            If the copy cannot be written.
        """
        scans = {time: n for n, time in enumerate(times.tolist())}
        with opened(self.bag) as bag:

            def made(scan: Message) -> tuple[str, Any] | None:
                n = scans.pop(seconds(scan.content.header.stamp, scan.logged), None)
                if n is None:  # not all scans were read
                    return None
                header = replace(scan.content.header, frame_id=self.topics.map_frame)
                topic = TRUSTED if trusted[n] else DOUBTED
                return topic, message(bag, header, poses[n], covariances[n])

            topic, kind = scan_topic(bag, self.topics.scan_topic), Kind.POSE_WITH_COVARIANCE
            bag.copy(folder / self.name, kind, (TRUSTED, DOUBTED), topic, made)
        if len(scans) == len(times):
            raise RecordingError(f"{self.bag}: has no scan of the trajectory; is it of this drive?")


def message(bag: Bag, header: Any, pose: Floats, covariance: Floats) -> Any:
    """A pose as geometry_msgs/PoseWithCovarianceStamped, of the classes of a bag."""
    types = bag.types
    x, y, heading = pose.tolist()
    point = types["geometry_msgs/msg/Point"](x, y, 0.0)
    turn = types["geometry_msgs/msg/Quaternion"](
        0.0, 0.0, float(np.sin(heading / 2)), float(np.cos(heading / 2))
    )
    place = types["geometry_msgs/msg/Pose"](point, turn)
    whole = np.zeros((6, 6))  # of x, y, z, roll, pitch and yaw
    whole[np.ix_((0, 1, 5), (0, 1, 5))] = covariance
    inner = types["geometry_msgs/msg/PoseWithCovariance"](place, whole.ravel())
    return types[Kind.POSE_WITH_COVARIANCE](header, inner)
