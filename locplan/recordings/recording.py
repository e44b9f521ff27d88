"""A recorded drive: scans, the lidar that took them, poses, and odometry."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._support.checks import (
    check_instance,
    check_integer,
    check_number,
    make_printable,
    set_frozen_fields,
    short_repr,
)
from locplan._support.kernels.arrays import Floats
from locplan._support.poses import (
    compute_motions,
    compute_path_length,
    move_ends_to_poses,
    move_poses,
    wrap_angles,
)
from locplan._support.tables import format_table, nan_to_none
from locplan.errors import RecordingError
from locplan.recordings.logs import RecordingSource, check_array, check_poses, freeze_array
from locplan.robots.lidar import Lidar
from locplan.robots.parts import Kinematics
from locplan.robots.robot import Robot


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """A recorded drive of a robot with a 2D lidar.

    All arrays are read-only, with a row per scan. `ranges`, `poses`, `times`, `odometry` and
    `speeds` are checked and copied unless they are read-only already.

    Raises
    ------
    RecordingError
        If the arrays differ in length, a pose is not finite, times decrease, or no beam of any scan
        has a return within the lidar's range.

    Examples
    --------
    >>> lidar = Lidar(range=10.0, field_of_view_deg=180.0, beams=3)
    >>> drive = Recording([[2.0, 1.0, 2.0], [2.0, 0.5, 12.0]], lidar, [[0.0, 0, 0], [0.5, 0, 0]])
    >>> drive
    Recording(2 scans of 3 beams, 0.5 m)
    >>> drive.ranges[1].tolist()
    [2.0, 0.5, inf]
    >>> drive.move(1.0, 0.0, 0.0).poses[:, 0].tolist()
    [1.0, 1.5]
    """

    ranges: NDArray[np.float32]
    """Distances along the beams, (n, beams) float32 [m], in the order of `lidar.angles`; inf
    without a return, or with a return outside of the lidar's limits."""
    lidar: Lidar
    """The lidar, with its mount on the robot."""
    poses: Floats
    """Poses x, y, heading of the robot in the map's frame at the scans, (n, 3) [m, m, rad]; all NaN
    if the log has none, see `read_recording`."""
    times: Floats | None = None
    """Times of the scans, (n,) [s]; None without reliable times."""
    odometry: Floats | None = None
    """Poses by odometry at the scans, (n, 3) [m, m, rad], in the odometry frame; or None."""
    source: RecordingSource = field(default_factory=RecordingSource)
    """File, topics and frames of the recording."""
    speeds: Floats | None = None
    """Forward speeds by odometry at the scans, (n,) [m/s], NaN if unknown; or None."""

    if TYPE_CHECKING:  # the constructor accepts lists, the fields are arrays

        def __init__(
            self,
            ranges: ArrayLike,
            lidar: Lidar,
            poses: ArrayLike,
            times: ArrayLike | None = None,
            odometry: ArrayLike | None = None,
            source: RecordingSource = ...,
            speeds: ArrayLike | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        check_instance("lidar", self.lidar, Lidar)
        check_instance("source", self.source, RecordingSource)
        poses = check_array("poses", self.poses, np.dtype(np.float64), 2)
        if not len(poses) or not np.isnan(poses).all():
            poses = check_poses("pose", poses)
        ranges = check_array("ranges", self.ranges, np.dtype(np.float32), 2)
        if len(ranges) == 0 or ranges.shape != (len(poses), self.lidar.beams):
            raise RecordingError(
                f"ranges must be (scans, beams) for {len(poses)} poses and {self.lidar.beams} beams"
                f" of the lidar, not {ranges.shape}"
            )
        # In blocks of scans, which saves memory.
        parts = (ranges[n : n + 4096] for n in range(0, len(ranges), 4096))
        returns = np.concatenate([self.lidar.has_return(part) for part in parts])
        if not returns.any():
            raise RecordingError(
                f"no beam of {len(ranges)} scans ends within {self.lidar.min_range:g} to"
                f" {self.lidar.range:g} m; check that the ranges are in metres, and the lidar"
            )
        if not (returns | (ranges == np.inf)).all():
            ranges = freeze_array(np.where(returns, ranges, np.float32(np.inf)))
        set_frozen_fields(self, ranges=ranges, poses=poses)
        if self.times is not None:
            times = check_array("times", self.times, np.dtype(np.float64), 1)
            if times.shape != (len(poses),) or not np.isfinite(times).all():
                raise RecordingError(f"times must be {len(poses)} finite seconds, one per scan")
            if (np.diff(times) < 0).any():
                scan = int(np.argmax(np.diff(times) < 0)) + 1
                raise RecordingError(f"times decrease at scan {scan}; pass None if they are wrong")
            set_frozen_fields(self, times=times)
        if self.odometry is not None:
            odometry = check_poses("odometry", self.odometry)
            if len(odometry) != len(poses):
                raise RecordingError(
                    f"odometry must be a pose for each of {len(poses)} scans, not {len(odometry)}"
                )
            set_frozen_fields(self, odometry=odometry)
        if self.speeds is not None:
            speeds = check_array("speeds", self.speeds, np.dtype(np.float64), 1)
            if speeds.shape != (len(poses),):
                raise RecordingError(
                    f"speeds must be {len(poses)} numbers, one per scan, not {speeds.shape}"
                )
            set_frozen_fields(self, speeds=speeds)

    def __repr__(self) -> str:
        name = f"{make_printable(self.source.file)}, " if self.source.file else ""
        without = "" if self.odometry is None else ", with odometry"
        scans, beams = self.ranges.shape
        length = f"{self.length:.4g} m" if self.has_poses else "no poses"
        return f"Recording({name}{scans} scans of {beams} beams, {length}{without})"

    def __len__(self) -> int:
        """Return the number of scans."""
        return len(self.poses)

    def __getitem__(self, selection: slice | ArrayLike) -> Recording:
        """Return the recording of some scans, selected by a slice, indices, or a mask.

        Raises
        ------
        RecordingError
            If no scan is selected, or the indices are invalid.
        """
        index: Any = selection
        if not isinstance(selection, slice):
            index = np.asarray(selection)
            if index.ndim != 1 or index.dtype.kind not in "biu":
                raise RecordingError(
                    "scans are selected by a slice, indices or a mask, not"
                    f" {short_repr(selection)}; use drive[n : n + 1] for a single scan"
                )
        try:
            poses = self.poses[index]
        except IndexError:
            raise RecordingError(
                f"the recording has {len(self)} scans; there are none at these indices"
            ) from None
        if not len(poses):
            raise RecordingError(f"none of {len(self)} scans is selected; select at least one")
        return replace(
            self,
            ranges=freeze_array(self.ranges[index]),
            poses=poses,
            times=None if self.times is None else self.times[index],
            odometry=None if self.odometry is None else self.odometry[index],
            speeds=None if self.speeds is None else self.speeds[index],
        )

    def subsample(self, step: int) -> Recording:
        """Return the recording of every n-th scan, from the first on.

        Parameters
        ----------
        step : int
            The number n, at least 1.
        """
        return self[:: check_integer("every", step)]

    def window(self, start: float, end: float) -> Recording:
        """Return the recording of a part of the drive.

        Parameters
        ----------
        start, end : float
            Times after the first scan [s]: from `start` on, before `end`.

        Raises
        ------
        RecordingError
            If the recording has no times, or no scan lies in the window.
        """
        start, end = check_number("start", start), check_number("end", end)
        if self.times is None:
            raise RecordingError("the recording has no times; select scans by their indices")
        after = self.times - self.times[0]
        inside = (after >= start) & (after < end)
        if not inside.any():
            raise RecordingError(
                f"no scan lies {start:g} to {end:g} s after the first; the drive takes"
                f" {after[-1]:.4g} s"
            )
        return self[inside]

    def move(self, x: float, y: float, turn: float) -> Recording:
        """Return the recording with poses turned about the map frame's origin, then shifted.

        Use it if `fit_to_map` finds that the map is shifted.

        Parameters
        ----------
        x, y : float
            Shift after the turn [m].
        turn : float
            Counter-clockwise turn about the frame's origin [rad].
        """
        x, y, turn = check_number("x", x), check_number("y", y), check_number("turn", turn)
        return replace(self, poses=move_poses(self.poses, (x, y, turn)))

    @property
    def has_poses(self) -> bool:
        """True if the recording has poses."""
        return not bool(np.isnan(self.poses).all())

    @property
    def length(self) -> float:
        """Length of the path from scan to scan [m]."""
        return compute_path_length(self.poses)

    def ends_on_robot(self) -> Floats:
        """Return the beams' ends in the robot's frame, (n, beams, 2) [m]; NaN without a return."""
        return self.lidar.compute_ends_on_robot(self.ranges)

    def ends(self) -> Floats:
        """Return the beams' ends in the map's frame, (n, beams, 2) [m]; NaN without a return."""
        return move_ends_to_poses(self.ends_on_robot(), self.poses)

    def robot(self, base_robot: Robot | None = None) -> Robot:
        """Return the recorded robot, with its lidar, speed and kind of drive.

        Unless its kinematics are known, the speed is the median while the robot moves, and the
        robot is omnidirectional if it moves sideways by odometry.

        Parameters
        ----------
        base_robot : Robot, optional
            The robot's other settings; by default those of `Robot()`.

        Examples
        --------
        >>> lidar = Lidar(range=10.0, field_of_view_deg=180.0, beams=3)
        >>> poses = [[0, 0, 0], [0.5, 0, 0], [1.0, 0, 0], [1.0, 0, 0]]
        >>> drive = Recording([[2.0, 1.0, 2.0]] * 4, lidar, poses, times=[0, 2, 4, 9])
        >>> drive.robot().kinematics
        Kinematics(speed=0.25)
        """
        base_robot = Robot() if base_robot is None else base_robot
        check_instance("robot", base_robot, Robot, 'such as locplan.Robot("turtlebot4")')
        robot = replace(base_robot, lidar=self.lidar)
        if robot.kinematics != Kinematics():
            return robot
        kinematics_settings: dict[str, Any] = {}
        if self.times is not None:
            steps = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
            with np.errstate(divide="ignore", invalid="ignore"):
                speeds = steps / np.diff(self.times)
            moving = speeds[np.isfinite(speeds) & (speeds > 0.05)]  # slower robots stand still
            if moving.size:
                kinematics_settings["speed"] = round(float(np.median(moving)), 2)
        if self.odometry is not None:
            ahead, left, turn = compute_motions(self.odometry[:-1], self.odometry[1:]).T
            straight = np.abs(wrap_angles(turn)) < 0.02  # an arc also moves the robot sideways
            way = np.hypot(ahead, left)[straight].sum()
            if np.abs(left)[straight].sum() > 0.2 * way:
                kinematics_settings["drive"] = "omnidirectional"
        return replace(robot, kinematics=replace(robot.kinematics, **kinematics_settings))

    def summary(self) -> dict[str, Any]:
        """Return length, duration, spacing and shares of returns, for JSON."""
        finite_ranges = self.ranges[np.isfinite(self.ranges)]
        steps = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
        source, has_odometry = self.source, self.odometry is not None
        return nan_to_none(
            {
                "file": source.file,
                "scans": len(self.poses),
                "beams": self.lidar.beams,
                "lidar": self.lidar.title,
                "length": float(steps.sum()),
                "turned": float(np.abs(wrap_angles(np.diff(self.poses[:, 2]))).sum()),
                "seconds": None if self.times is None else float(self.times[-1] - self.times[0]),
                "spacing": float(np.median(steps)) if len(steps) else 0.0,
                "returns": finite_ranges.size / self.ranges.size,
                "median_range": float(np.median(finite_ranges)),
                "poses": source.poses or "given",
                "odometry": (source.odometry or "given") if has_odometry else "",
                "notes": list(source.notes),
            }
        )

    def rows(self) -> list[tuple[str, str]]:
        """Return the summary as labels and texts for people."""
        drive_summary = self.summary()
        took = (
            "no times" if drive_summary["seconds"] is None else f"{drive_summary['seconds']:.4g} s"
        )
        median_range = drive_summary["median_range"]
        returns = f"{drive_summary['returns']:.0%} of the beams, median {median_range:.2g} m"
        beams, spacing = drive_summary["beams"], drive_summary["spacing"]
        scans = f"{drive_summary['scans']:,} of {beams} beams, {spacing:.2g} m apart"
        return [
            (
                "drive",
                f"{drive_summary['file'] or 'a recording'}: {drive_summary['length']:.4g} m,"
                f" {took}",
            ),
            ("scans", scans),
            ("lidar", drive_summary["lidar"]),
            ("returns", returns),
            ("poses", drive_summary["poses"]),
            ("odometry", drive_summary["odometry"] or "none"),
            *(("note", note) for note in drive_summary["notes"]),
        ]

    def report(self) -> str:
        """Return the summary as a table for people."""
        return format_table([], self.rows())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save the recording without loss, in the format that `read_recording` describes.

        Parameters
        ----------
        path : path
            File that ends in .npz.

        Raises
        ------
        RecordingError
            If the file does not end in .npz.
        LocplanError
            If the file cannot be written.
        """
        from locplan.recordings.files import save_recording

        save_recording(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Recording:
        """Load a recording that `save` wrote.

        Parameters
        ----------
        path : path
            File that ends in .npz.

        Raises
        ------
        RecordingError
            If the file cannot be read, or is not a recording.
        """
        from locplan.recordings.files import read_recording

        recording: Recording = read_recording(path)
        return recording
