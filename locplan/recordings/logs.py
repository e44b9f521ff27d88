"""Shared parts of the log readers: options, source, and scans resampled to the same beams."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._support.checks import (
    FARTHEST,
    MAX_RANGE,
    Settings,
    check_integer,
    format_suggestion,
    parse_finite_numbers,
    set_frozen_fields,
    short_repr,
)
from locplan._support.kernels.arrays import Floats
from locplan._support.poses import wrap_angles
from locplan.errors import ConfigError, LocplanError, RecordingError
from locplan.robots.lidar import MAX_BEAMS, Lidar

FIRST_ROWS = 256
"""Number of scans for which memory is allocated at first."""
MAX_ROOM = 2**30
"""Maximum total size of the ranges of a log [bytes]."""


@dataclass(frozen=True, kw_only=True, repr=False)
class LogTopics(Settings):
    """Topics and frames to read from a log, if it has several, or has unusual names.

    Raises
    ------
    ConfigError
        If a value is not a name.

    Examples
    --------
    >>> LogTopics(scan_topic="/front/scan")
    LogTopics(scan_topic='/front/scan')
    """

    scan_topic: str | None = None
    """Topic of the scans; "FLASER" or "ROBOTLASER1" in a log of CARMEN. Required if there are
    several."""
    pose_topic: str | None = None
    """Topic of the robot's poses, instead of TF. Only for bags."""
    odom_topic: str | None = None
    """Topic of the robot's odometry. Only for bags."""
    map_frame: str = "map"
    """Frame of the poses."""
    base_frame: str | None = None
    """Frame of the robot; by default the child frame of odometry, base_footprint or base_link.
    Only for bags."""

    def __post_init__(self) -> None:
        for topic_field in fields(LogTopics):
            value = getattr(self, topic_field.name)
            if value != topic_field.default and not (isinstance(value, str) and value):
                raise ConfigError(f"{topic_field.name} must be a name, not {short_repr(value)}")


@dataclass(frozen=True, kw_only=True, repr=False)
class ReadOptions(LogTopics):
    """Options of `read_recording`, which documents them."""

    every: int = 1
    window: tuple[float, float] | None = None
    range_limits: tuple[float, float] | None = None
    mount: tuple[float, float, float] | None = None
    needs_poses: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        set_frozen_fields(self, every=check_integer("every", self.every))
        set_frozen_fields(
            self,
            window=_parse_numbers("window", self.window, 2, "two numbers"),
            range_limits=_parse_numbers("range_limits", self.range_limits, 2, "two numbers"),
            mount=_parse_numbers("mount", self.mount, 3, "x, y [m] and yaw [rad] of the lidar"),
        )
        for name, upper_limit, requirement in (
            ("window", math.inf, "a start and a later end after the first scan [s]"),
            ("range_limits", MAX_RANGE, "a minimum and a maximum distance [m]"),
        ):
            ends = getattr(self, name)
            if ends and not 0 <= ends[0] < ends[1] <= upper_limit:
                raise ConfigError(f"{name} must be {requirement}, not {short_repr(ends)}")

    def refuse_unused(self, file_kind: str, *, of_robot: bool) -> None:
        """Raise a ConfigError if an option is set that does not apply to this file format.

        Logs of CARMEN have a scan topic and a map frame; bags have all topics and frames.
        """
        of_robots = ("scan_topic", "map_frame")
        for topic_field in fields(LogTopics):
            kinds = "logs of robots" if topic_field.name in of_robots else "bags"
            allowed = of_robot and topic_field.name in of_robots
            if getattr(self, topic_field.name) != topic_field.default and not allowed:
                raise ConfigError(
                    f"{topic_field.name} applies only to {kinds}, not to {file_kind}; omit it"
                )

    def make_lidar(self, values: Mapping[str, Any]) -> Lidar:
        """Return the lidar that a file describes, with the mount and limits of these options."""
        lidar_fields = [lidar_field.name for lidar_field in fields(Lidar)]
        for name in values:
            if name not in lidar_fields:
                raise RecordingError(
                    f"its lidar has no {short_repr(name)}; known are {', '.join(lidar_fields)}"
                    f"{format_suggestion(name, lidar_fields)}"
                )
        try:
            lidar = Lidar(**values)
        except LocplanError as error:
            raise RecordingError(f"its lidar is invalid: {error}") from None
        if self.mount is not None:
            x, y, yaw = self.mount
            lidar = replace(lidar, mount_x=x, mount_y=y, mount_yaw_deg=math.degrees(yaw))
        if self.range_limits is not None:
            min_range, max_range = self.range_limits
            lidar = replace(lidar, min_range=min_range, range=max_range)
        return lidar


def _parse_numbers(
    name: str, values: Any, count: int, requirement: str
) -> tuple[float, ...] | None:
    """Parse a fixed number of finite numbers; None stays None."""
    if values is None:
        return None
    numbers = parse_finite_numbers(values)
    if len(numbers) != count:
        raise ConfigError(f"{name} must be {requirement}, not {short_repr(values)}")
    return numbers


@dataclass(frozen=True, kw_only=True, repr=False)
class RecordingSource(Settings):
    """Source of a recording: its file, and the topics and frames that were read."""

    file: str = ""
    """Name of the file or folder, without its path."""
    scans: str = ""
    """Topic of the scans, or the name of their lines in a log of CARMEN."""
    poses: str = ""
    """Topic of the poses, or the two frames of TF."""
    odometry: str = ""
    """Topic of the odometry, or the two frames of TF; empty without odometry."""
    map_frame: str = ""
    """Frame of the poses."""
    base_frame: str = ""
    """Frame of the robot."""
    lidar_frame: str = ""
    """Frame of the lidar."""
    stamps_back: int = 0
    """Number of scans with a stamp before the stamp of an earlier scan in the log."""
    notes: tuple[str, ...] = ()
    """Assumptions and dropped data, as sentences without a full stop."""


def check_memory_limit(n_scans: int, n_beams: int, max_bytes: int) -> None:
    """Raise a RecordingError if one more scan exceeds the memory limit."""
    # A scan counts as at least 256 bytes, because its pose and times take memory as well.
    if n_scans == (max_scans := max_bytes // max(256, 4 * n_beams)):
        raise RecordingError(
            f"over {max_scans:,} scans of {n_beams} beams take too much memory; read every n-th"
            " scan (every=), or a part of the log"
        )


class ScanRows:
    """Growing array of scans, resampled to the beams of the first scan.

    Beams are counter-clockwise. A scan with different angles (from a lidar with an unregulated
    motor) is resampled: a beam takes the nearest reading, if there is one within a step.
    """

    def __init__(self, range_limits: tuple[float, float] | None = None) -> None:
        self._limits = range_limits
        self._rows: NDArray[np.float32] = np.empty((0, 0), np.float32)
        self._count = 0
        self._first, self._step, self._beams = 0.0, 0.0, 0
        self._lidar = Lidar()
        self.n_resampled = 0

    def __len__(self) -> int:
        """Return the number of scans."""
        return self._count

    def add(
        self, ranges: ArrayLike, first: float, step: float, min_range: float, max_range: float
    ) -> None:
        """Add a scan with its ranges [m], first angle and step [rad], and range limits [m].

        Raises
        ------
        RecordingError
            If the scan has no beams, or invalid angles.
        """
        with np.errstate(over="ignore"):  # no lidar's range exceeds single precision
            values = np.asarray(ranges, np.float32)
        if not self._count:
            self._set_beams(first, step, len(values), min_range, max_range)
        check_memory_limit(self._count, self._beams, MAX_ROOM)
        if self._count == len(self._rows):
            self._rows.resize((FIRST_ROWS + self._count * 5 // 4, self._beams), refcheck=False)
        if step < 0:
            first, step, values = first + step * (len(values) - 1), -step, values[::-1]
        row = self._rows[self._count]
        off = abs(first - self._first) + abs(step - self._step) * self._beams
        if len(values) >= self._beams and off < self._step / 10:
            row[:] = values[: self._beams]
        else:
            self.n_resampled += 1
            row[:] = self._resample(first, step, values)
        row[~self._lidar.has_return(row)] = np.inf
        self._count += 1

    def take_rows(self, order: Sequence[int]) -> NDArray[np.float32]:
        """Return the scans in this order, (n, beams); no scan can be added afterwards."""
        rows, self._rows = self._rows, np.empty((0, 0), np.float32)
        if (np.diff(order) < 0).any():
            return np.asarray(rows[np.asarray(order)])
        for to, index in enumerate(order):
            if to != index:  # in place: a copy would take the memory twice
                rows[to] = rows[index]
        rows.resize((len(order), self._beams), refcheck=False)
        self._count = 0
        return rows

    def make_lidar(self, mount: tuple[float, float, float], upside_down: bool) -> Lidar:
        """Return the lidar with its mount on the robot [m, m, rad].

        The beams of an upside-down lidar are clockwise: the caller reverses the rows.
        """
        middle = self._first + self._step * (self._beams - 1) / 2
        yaw = mount[2] + (-middle if upside_down else middle)
        turn = math.degrees((yaw + math.pi) % (2 * math.pi) - math.pi)
        x, y = round(mount[0], 6), round(mount[1], 6)
        return replace(self._lidar, mount_x=x, mount_y=y, mount_yaw_deg=round(turn, 4))

    def _set_beams(
        self, first: float, step: float, count: int, min_range: float, max_range: float
    ) -> None:
        """Set the beams of all scans to those of the first scan."""
        if not (math.isfinite(first) and math.isfinite(step) and step and 0 < count < MAX_BEAMS):
            raise RecordingError(
                f"its first scan is invalid: {count} beams from {first:g} rad, {step:g} rad apart"
            )
        if self._limits is not None:
            min_range, max_range = self._limits
        elif not 0 < max_range <= MAX_RANGE:
            raise RecordingError(
                f"its scans have an invalid maximum range of {max_range:g} m; set"
                " range_limits=(min, max)"
            )
        if step < 0:
            first, step = first + step * (count - 1), -step
        lidar = Lidar.from_scan(
            angle_min=first,
            angle_max=first + step * (count - 1),
            angle_increment=step,
            range_min=min(max(_round_to_single(min_range), 0.0), 0.999 * max_range)
            if math.isfinite(min_range)
            else 0.0,
            range_max=_round_to_single(max_range),
        )
        # Angles were stored in single precision, with four reliable decimals.
        lidar = replace(lidar, field_of_view_deg=round(lidar.field_of_view_deg, 4))
        self._first, self._step, self._beams, self._lidar = first, step, lidar.beams, lidar
        self._rows = np.empty((FIRST_ROWS, lidar.beams), np.float32)

    def _resample(
        self, first: float, step: float, values: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Resample a scan to the beams of the first scan; inf if no reading is near."""
        row = np.full(self._beams, np.inf, np.float32)
        if not (math.isfinite(first) and math.isfinite(step) and step and len(values)):
            return row
        angles = self._first + self._step * np.arange(self._beams)
        turn = 2 * math.pi
        beam = np.rint(((angles - first + step / 2) % turn - step / 2) / step).astype(np.int64)
        is_covered = (beam >= 0) & (beam < len(values))
        row[is_covered] = values[beam[is_covered]]
        return row


def _round_to_single(value: float) -> float:
    """Round a number to the digits of single precision."""
    return float(f"{value:.7g}")


def check_poses(name: str, values: object) -> Floats:
    """Return read-only rows of finite x, y, heading, with headings within +-pi."""
    poses = check_array(f"{name}s", values, np.dtype(np.float64), 2)
    if poses.shape[1] != 3:
        raise RecordingError(f"{name}s must be rows of x, y, heading, not {poses.shape}")
    wrong = ~np.isfinite(poses).all(1) | (np.abs(poses) > FARTHEST).any(1)
    if wrong.any():
        scan = int(np.argmax(wrong))
        x, y, heading = poses[scan]
        raise RecordingError(
            f"{name} {scan} must be finite and within ±{FARTHEST:g} m, not"
            f" {x:g}, {y:g}, {heading:g}; remove such scans"
        )
    inside = (np.abs(poses[:, 2]) <= np.pi).all()
    return (
        poses if inside else freeze_array(np.column_stack([poses[:, :2], wrap_angles(poses[:, 2])]))
    )


def check_array(name: str, values: object, dtype: np.dtype[Any], dimensions: int) -> NDArray[Any]:
    """Return a read-only array of numbers, a copy unless it is read-only already."""
    try:
        with np.errstate(over="ignore"):  # no lidar's range exceeds single precision
            array = np.asarray(values, dtype)
    except (TypeError, ValueError, OverflowError):
        raise RecordingError(
            f"{name} must be an array of numbers, not {short_repr(values)}"
        ) from None
    if array.ndim != dimensions:
        raise RecordingError(f"{name} must have {dimensions} dimensions, not {array.ndim}")
    return freeze_array(array.copy() if array.flags.writeable else array)


def freeze_array(array: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only and return it."""
    array.setflags(write=False)
    return array
