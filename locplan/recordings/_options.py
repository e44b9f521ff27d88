"""What is read of a log, and what the drive in it holds before it is checked."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

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
from locplan.errors import ConfigError
from locplan.robots import Lidar

MAX_ARRAY_BYTES = 2**28
"""Greatest size of a file's arrays together, unpacked; reading takes some six times as much."""
FOR_BAGS = ("pose_topic", "odom_topic", "base_frame")
"""Options that only a bag can follow."""
FOR_LOGS = ("scan_topic", "map_frame")
"""Options that only a bag or a log of CARMEN can follow."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Options(Settings):
    """What is read of a log; `read_drive` explains each."""

    every: int = 1
    window: tuple[float, float] | None = None
    scan_topic: str | None = None
    pose_topic: str | None = None
    odom_topic: str | None = None
    map_frame: str = "map"
    base_frame: str | None = None
    range_limits: tuple[float, float] | None = None
    mount: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        keep_checked(self, ("every",), whole)
        for name in ("scan_topic", "pose_topic", "odom_topic", "base_frame"):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, str) and value):
                raise ConfigError(f"{name} must be a name, not {shown(value)}")
        if not (isinstance(self.map_frame, str) and self.map_frame):
            raise ConfigError(f"map_frame must be a name, not {shown(self.map_frame)}")
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
