"""The settings of a 2D lidar: its beams, its mount on the robot, its noise; and known lidars.

The command line reads their names before it works, so that numpy is imported in the methods.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from locplan._support.checks import (
    Settings,
    check_choice,
    check_file_path,
    check_number,
    check_positive,
    check_range,
    checked_setting,
    short_repr,
)
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from locplan._support.kernels.arrays import Bools, Floats, Singles

MAX_BEAMS = 100_000


class LidarDataSheet(NamedTuple):
    """Values from a lidar's data sheet."""

    range: float
    """Maximum distance that is measured [m]."""
    min_range: float
    """Minimum distance that is measured [m]."""
    field_of_view_deg: float
    """Angle that the beams cover [deg]."""
    beams: int
    """Number of beams in the field of view, at the usual rate."""
    range_sigma: float
    """Standard deviation of a measured distance [m]."""
    source: str
    """Document that has these values."""


_A1 = LidarDataSheet(
    12.0, 0.15, 360.0, 360, 0.03, "Slamtec, RPLIDAR A1M8 data sheet, 2016; no error given"
)
_LDS_02 = LidarDataSheet(
    8.0, 0.16, 360.0, 360, 0.03, "ROBOTIS e-Manual, LDS-02; 3 % of the range at 1 m"
)

LIDARS: dict[str, LidarDataSheet] = {
    "rplidar-a1": _A1,
    "rplidar-a2": LidarDataSheet(
        12.0, 0.2, 360.0, 1600, 0.03, "Slamtec, A2M12 data sheet LD310, 2022; no error given"
    ),
    "rplidar-a3": LidarDataSheet(
        25.0, 0.2, 360.0, 1600, 0.03, "Slamtec, A3M1 data sheet v1.3, 2019; no error given"
    ),
    "rplidar-s2": LidarDataSheet(
        30.0, 0.05, 360.0, 3200, 0.03, "Slamtec, S2M1-R2 sheet rev. 2.3, 2024"
    ),
    "rplidar-c1": LidarDataSheet(
        12.0, 0.05, 360.0, 500, 0.03, "Slamtec, C1M1 sheet rev. 1.1, 2024"
    ),
    "ld19": LidarDataSheet(12.0, 0.02, 360.0, 450, 0.01, "LDROBOT, LD19 data sheet v2.5, 2022"),
    "ydlidar-x4": LidarDataSheet(
        10.0, 0.12, 360.0, 720, 0.035, "YDLIDAR, X4 data sheet v1.2, 2024; 3.5 % at 1 m"
    ),
    "lds-01": LidarDataSheet(
        3.5, 0.12, 360.0, 360, 0.035, "ROBOTIS e-Manual, LDS-01; 3.5 % at 1 m"
    ),
    "lds-02": _LDS_02,
    "turtlebot3": _LDS_02,
    "turtlebot4": _A1,
    "tim571": LidarDataSheet(
        25.0, 0.05, 270.0, 811, 0.02, "SICK, TiM571 data sheet; driver sick_scan_xd"
    ),
    "lms111": LidarDataSheet(20.0, 0.5, 270.0, 541, 0.012, "SICK, LMS111 product data, at 50 Hz"),
    "lms291": LidarDataSheet(80.0, 0.0, 180.0, 361, 0.01, "SICK, LMS291 technical description"),
    "ust-10lx": LidarDataSheet(
        10.0, 0.06, 270.0, 1081, 0.03, "Hokuyo, UST-10LX manual MRS-0020D, 2015"
    ),
    "utm-30lx": LidarDataSheet(
        30.0, 0.1, 270.0, 1081, 0.03, "Hokuyo, UTM-30LX data sheet; 10 mm below 10 m, 30 mm beyond"
    ),
    "urg-04lx": LidarDataSheet(
        5.6, 0.02, 240.0, 682, 0.03, "Hokuyo, URG-04LX-UG01 data sheet; 30 mm to 1 m, 3 % beyond"
    ),
}
"""The presets by name, with ranges for bright targets, as walls are.

If a data sheet has no standard deviation of a range, its error bound is used, or 0.03 m without
any. Robots are listed with the lidar that they carry."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Lidar(Settings):
    """A 2D lidar on a robot.

    Two scanners at opposite corners whose scans are merged count as one lidar of 360 deg, mounted
    midway between them. In passages barely wider than the robot, results are then some 10 % too
    good. For a filter that reads only one of the scanners, give the mount and field of view of that
    scanner.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> Lidar(range=10.0, field_of_view_deg=180.0, beams=3).angles.round(3).tolist()
    [-1.571, 0.0, 1.571]
    >>> Lidar.preset("utm-30lx").range
    30.0
    """

    range: float = checked_setting(12.0, check_range)
    """Maximum distance that is measured [m], above 0 up to 10,000: that of bright walls."""
    min_range: float = checked_setting(0.0, 0.0)
    """Distance below which a return counts as none [m], from 0 to below `range`."""
    field_of_view_deg: float = checked_setting(360.0, check_positive, "deg")
    """Angle that the beams cover, centred on `mount_yaw_deg` [deg], above 0 up to 360.

    Less than 360 makes what the lidar sees depend on the robot's heading.
    """
    beams: int = checked_setting(360, 1, MAX_BEAMS)
    """Number of beams in the field of view, 1 to 100,000."""
    # With less noise, rounding errors would dominate a covariance.
    range_sigma: float = checked_setting(0.03, 1e-6)
    """Standard deviation of a measured distance [m], at least 1e-6.

    Simulated scans and `Fisher` of ranges read it; the other estimators do not.
    """
    model: str = field(default="", compare=False)
    """Name of the lidar, for titles; it decides nothing."""
    mount_x: float = checked_setting(0.0)
    """Position of the lidar on the robot, ahead of its centre [m]; negative is behind it."""
    mount_y: float = checked_setting(0.0)
    """Position of the lidar on the robot, to the left of its centre [m]; negative is right."""
    mount_yaw_deg: float = checked_setting(0.0)
    """Direction of the middle beam on the robot, counter-clockwise from ahead [deg]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_range >= self.range:
            raise ConfigError(
                f"min_range ({self.min_range} m) must be below range ({self.range} m)"
            )
        if self.field_of_view_deg > 360:
            raise ConfigError(
                "field_of_view_deg must be at most 360 deg, not"
                f" {short_repr(self.field_of_view_deg)}"
            )

    @classmethod
    def preset(cls, name: str) -> Lidar:
        """Return a common lidar, or the lidar of a robot, with the values of its data sheet.

        Parameters
        ----------
        name : str
            One of `locplan.robots.LIDARS`, such as "rplidar-a1" or "turtlebot3".

        Raises
        ------
        ConfigError
            If the name is unknown.
        """
        check_choice("lidar", name, LIDARS)
        sheet = LIDARS[name]
        return cls(
            range=sheet.range,
            min_range=sheet.min_range,
            field_of_view_deg=sheet.field_of_view_deg,
            beams=sheet.beams,
            range_sigma=sheet.range_sigma,
            model=name,
        )

    @classmethod
    def from_scan(
        cls,
        *,
        angle_min: float,
        angle_max: float,
        angle_increment: float,
        range_min: float,
        range_max: float,
        mount: tuple[float, float, float] = (0.0, 0.0, 0.0),
        range_sigma: float | None = None,
        model: str = "",
    ) -> Lidar:
        """Return the lidar that took a scan, from the fields of a sensor_msgs/LaserScan.

        Parameters
        ----------
        angle_min, angle_max, angle_increment : float
            Angles of the first and the last beam, and from one beam to the next [rad]. If the lidar
            is mounted upside down (a roll of pi in TF), give the first two with the opposite sign.
        range_min, range_max : float
            Minimum and maximum distance that is measured [m], 0 <= range_min < range_max.
        mount : (x, y, yaw), default (0.0, 0.0, 0.0)
            Pose of the lidar on the robot [m, m, rad], as TF has it.
        range_sigma : float, optional
            Standard deviation of a measured distance [m], 0.03 by default.
        model : str, default ""
            Name of the lidar, for titles.

        Raises
        ------
        ConfigError
            If a value is out of its range.
        """
        for name, value in {"angle_min": angle_min, "angle_max": angle_max}.items():
            check_number(name, value)
        x, y, yaw = (check_number("mount", coordinate) for coordinate in mount)
        step = check_number("angle_increment", angle_increment)
        if step == 0 or not 0 <= (angle_max - angle_min) / step < MAX_BEAMS:
            raise ConfigError(
                "angle_increment must lead from angle_min to angle_max in fewer than"
                f" {MAX_BEAMS:,} steps, not be {step!r}"
            )
        beams = round((angle_max - angle_min) / step) + 1
        width, between = (abs(math.degrees(turn)) for turn in ((beams - 1) * step, step))
        if width > 360.1:
            raise ConfigError(f"a scan covers at most 360 deg, not {width:g}")
        # A full circle may end a step before where it began, or with a second beam ahead; a scan
        # may miss it by a tenth of a degree.
        full = width + between > 359.9
        beams -= width > 360 - between / 2
        middle = (angle_min + angle_max) / 2
        return cls(
            range=range_max,
            min_range=range_min,
            field_of_view_deg=360.0 if full else width,
            beams=beams,
            range_sigma=cls.range_sigma if range_sigma is None else range_sigma,
            mount_x=x,
            mount_y=y,
            mount_yaw_deg=math.degrees(yaw + (0.0 if full else middle)),
            model=model,
        )

    @classmethod
    def from_file(cls, path: str | os.PathLike[str]) -> Lidar:
        """Read the lidar of a robot's description: the only ray sensor in a URDF or SDF file.

        Its mount is its pose on the base link (`base_footprint`, `base_link`, or otherwise the root
        of the joints or the model): along the joints of a URDF, or by the poses of an SDF's links,
        models and frames. The noise is the file's if it is Gaussian.

        Parameters
        ----------
        path : path
            The URDF or SDF file; a .xacro file is to be run through xacro first.

        Raises
        ------
        ConfigError
            If the file cannot be read, or has no ray sensor, or several. With `Robot.load`, a
            lidar can be named for a file without sensor.

        Warns
        -----
        ParameterWarning
            If the file lacks the pose of the sensor's link.
        """
        from locplan.robots.descriptions import read_lidar

        return read_lidar(check_file_path("a robot's description", path))

    @property
    def title(self) -> str:
        """Name, range and field of view, for titles."""
        return f"{self.model or 'lidar'}, {self.range:g} m, {self.field_of_view_deg:g}°"

    @property
    def angles(self) -> Floats:
        """Angles of the beams from the middle one, counter-clockwise, (beams,) [rad]."""
        import numpy as np

        width = math.radians(self.field_of_view_deg)
        if self.sees_all_round:  # the first and the last beam must not coincide
            between = np.arange(self.beams, dtype=np.float64) + 0.5
            return between * (width / self.beams) - width / 2
        offsets = np.arange(self.beams, dtype=np.float64) - (self.beams - 1) / 2
        return offsets * (width / max(1, self.beams - 1))

    @property
    def mount_yaw(self) -> float:
        """`mount_yaw_deg` in radians."""
        return math.radians(self.mount_yaw_deg)

    def to_kernel_settings(self) -> Any:
        """The lidar in the form that the kernels take."""
        from locplan._support.kernels.lidar import LidarBeams as Beams

        mount = self.mount_x, self.mount_y, self.mount_yaw
        return Beams(self.angles, *mount, self.range_sigma, self.min_range, self.range)

    @property
    def sees_all_round(self) -> bool:
        """True if the beams cover the whole circle."""
        return self.field_of_view_deg == 360

    @property
    def is_heading_independent(self) -> bool:
        """True if the lidar sees the same at every heading of the robot.

        The position of features between two beams is neglected.
        """
        return self.sees_all_round and self.mount_x == self.mount_y == 0.0

    def has_return(self, ranges: Singles) -> Bools:
        """Return the mask of the beams with a return: within the lidar's range, and above 0.

        Parameters
        ----------
        ranges : array
            Distances along beams, of any shape [m].
        """
        import numpy as np

        with np.errstate(invalid="ignore"):
            min_range = np.float32(self.min_range)
            within = (ranges >= min_range) & (ranges > 0) & (ranges < np.float32(self.range))
        return np.asarray(within)

    def compute_ends_on_robot(self, ranges: NDArray[Any], beams: slice | None = None) -> Floats:
        """Ends of beams ahead and to the left of the robot, (n, beams, 2) [m]; NaN for none.

        Parameters
        ----------
        ranges : (n, beams) array
            Distances along the beams [m], in the order of `angles`.
        beams : slice, optional
            The beams that these belong to; all by default.
        """
        import numpy as np

        bearings = self.mount_yaw + self.angles[beams or slice(None)]
        finite_ranges = np.where(np.isfinite(ranges), ranges, np.nan).astype(np.float64)
        ends = finite_ranges[..., None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
        return np.asarray(ends + np.array([self.mount_x, self.mount_y]))
