"""What is read of a log, and what the drive in it holds before it is checked."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import (
    MAX_RANGE,
    Settings,
    keep,
    keep_checked,
    number,
    positive,
    shown,
    whole,
)
from locplan._util.poses import wrapped
from locplan._util.tables import finite, table
from locplan.errors import ConfigError
from locplan.robots import Lidar

MAX_ARRAY_BYTES = 2**28
"""Greatest size of a file's arrays together, unpacked; reading takes some six times as much."""
FOR_BAGS = ("pose_topic", "odom_topic", "base_frame")
"""Options that only a bag can follow."""
FOR_LOGS = ("scan_topic", "map_frame")
"""Options that only a bag or a log of CARMEN can follow."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Topics(Settings):
    """Topics and frames that are read of a robot's log, where it has several, or others than usual.

    Raises
    ------
    ConfigError
        If one is no name.

    Examples
    --------
    >>> Topics(scan_topic="/front/scan")
    Topics(scan_topic='/front/scan')
    """

    scan_topic: str | None = None
    """Topic of the scans; in a log of CARMEN "FLASER" or "ROBOTLASER1". It is needed where there
    are several."""
    pose_topic: str | None = None
    """Topic of the robot's poses, in place of TF. Only for bags."""
    odom_topic: str | None = None
    """Topic of the robot's odometry. Only for bags."""
    map_frame: str = "map"
    """Frame of the poses."""
    base_frame: str | None = None
    """Frame of the robot; by default that of odometry, or base_footprint or base_link. Only for
    bags."""

    def __post_init__(self) -> None:
        for name in ("scan_topic", "pose_topic", "odom_topic", "base_frame"):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, str) and value):
                raise ConfigError(f"{name} must be a name, not {shown(value)}")
        if not (isinstance(self.map_frame, str) and self.map_frame):
            raise ConfigError(f"map_frame must be a name, not {shown(self.map_frame)}")


@dataclass(frozen=True, kw_only=True, repr=False)
class Options(Topics):
    """What is read of a log; `read_drive` explains each."""

    every: int = 1
    window: tuple[float, float] | None = None
    range_limits: tuple[float, float] | None = None
    mount: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        keep_checked(self, ("every",), whole)
        if self.window is not None:
            start, end = _pair("window", self.window)
            if not 0 <= start < end:
                raise ConfigError(
                    f"window must be two times from the start on, the first one earlier [s], not"
                    f" {start:g}, {end:g}"
                )
            keep(self, window=(start, end))
        if self.range_limits is not None:
            least, most = _pair("range_limits", self.range_limits)
            positive("range_limits", most, "m")
            if not 0 <= least < most <= MAX_RANGE:
                raise ConfigError(
                    f"range_limits must be a least and a greatest distance [m], not {least:g},"
                    f" {most:g}"
                )
            keep(self, range_limits=(least, most))
        if self.mount is not None:
            keep(self, mount=_move(self.mount))

    def refuse_those_for_bags(self, what: str) -> None:
        """Raise a ConfigError if an option is set that only a bag can follow."""
        self._refuse(FOR_BAGS, what)

    def refuse_those_for_logs(self, what: str) -> None:
        """Raise a ConfigError if an option is set that only the log of a robot can follow."""
        self._refuse((*FOR_BAGS, *FOR_LOGS), what)

    def _refuse(self, names: tuple[str, ...], what: str) -> None:
        for name in names:
            if getattr(self, name) != getattr(type(self), name):
                kinds = "logs of robots" if name in FOR_LOGS else "bags"
                raise ConfigError(f"{name} is for {kinds}, and {what} has none; leave it out")


def with_options(lidar: Lidar, options: Options) -> Lidar:
    """A lidar with the mount and the limits that were named."""
    if options.mount is not None:
        x, y, yaw = options.mount
        lidar = replace(lidar, mount_x=x, mount_y=y, mount_yaw_deg=math.degrees(yaw))
    if options.range_limits is not None:
        least, most = options.range_limits
        lidar = replace(lidar, least_range=least, range=most)
    return lidar


def _pair(name: str, value: object) -> tuple[float, float]:
    first: object
    second: object
    try:
        first, second = value  # type: ignore[misc]
    except (TypeError, ValueError):
        raise ConfigError(f"{name} must be two numbers, not {shown(value)}") from None
    return number(name, first), number(name, second)


def _move(move: object) -> tuple[float, float, float]:
    """A mount or a move as three numbers [m, m, rad]."""
    try:
        x, y, turn = (number("mount", each) for each in move)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise ConfigError(
            f"mount must be x, y [m] and yaw [rad] of the lidar, not {shown(move)}"
        ) from None
    return x, y, turn


@dataclass(frozen=True, kw_only=True, repr=False)
class Source(Settings):
    """Where a recording comes from: its file, and the topics and frames that were used."""

    file: str = ""
    """Name of the file or folder, without its path."""
    scans: str = ""
    """Topic of the scans, or the kind of lines."""
    poses: str = ""
    """Topic of the poses, or the frames that TF relates."""
    odometry: str = ""
    """Topic of the odometry, or the frames that TF relates; empty if there is none."""
    map_frame: str = ""
    """Frame that the poses are in."""
    base_frame: str = ""
    """Frame of the robot, whose poses these are."""
    lidar_frame: str = ""
    """Frame of the lidar."""
    notes: tuple[str, ...] = ()
    """What was assumed or left out, in sentences without a full stop."""


class Contents(NamedTuple):
    """The fields of a `Recording`."""

    ranges: NDArray[Any]
    lidar: Lidar
    poses: NDArray[Any]
    times: NDArray[Any] | None
    odometry: NDArray[Any] | None
    source: Source

    def summary(self) -> dict[str, Any]:
        """How long a drive is, how dense its scans are, and how many beams have a return."""
        known = self.ranges[np.isfinite(self.ranges)]
        steps = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
        source, has_odometry = self.source, self.odometry is not None
        return finite(
            {
                "file": source.file,
                "scans": len(self.poses),
                "beams": self.lidar.beams,
                "lidar": self.lidar.title,
                "length": float(steps.sum()),
                "turned": float(np.abs(wrapped(np.diff(self.poses[:, 2]))).sum()),
                "seconds": None if self.times is None else float(self.times[-1] - self.times[0]),
                "spacing": float(np.median(steps)) if len(steps) else 0.0,
                "returns": known.size / self.ranges.size,
                "median_range": float(np.median(known)),
                "poses": source.poses or "given",
                "odometry": (source.odometry or "given") if has_odometry else "",
                "notes": list(source.notes),
            }
        )

    def report(self) -> str:
        """The summary for people."""
        about = self.summary()
        took = "no times" if about["seconds"] is None else f"{about['seconds']:.4g} s"
        returns = f"{about['returns']:.0%} of the beams, median {about['median_range']:.2g} m"
        scans = f"{about['scans']:,} of {about['beams']} beams, {about['spacing']:.2g} m apart"
        rows = [
            ("drive", f"{about['file'] or 'a recording'}: {about['length']:.4g} m, {took}"),
            ("scans", scans),
            ("lidar", about["lidar"]),
            ("returns", returns),
            ("poses", about["poses"]),
            ("odometry", about["odometry"] or "none"),
            *(("note", note) for note in about["notes"]),
        ]
        return table([], rows)
