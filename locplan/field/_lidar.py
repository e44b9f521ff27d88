"""The settings of a 2D lidar: its beams, its mount on the robot, and its noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import Settings, keep_checked, number, one_of, positive, shown, whole
from locplan.errors import ConfigError

FULL_CIRCLE = 360.0
MAX_BEAMS = 100_000
MAX_RANGE = 10_000.0
"""Greatest range [m], beyond that of any lidar."""
MIN_SIGMA = 1e-6
"""Least `range_sigma` [m]; with less, rounding errors would dominate a covariance."""


def checked_range(name: str, value: object) -> float:
    """Return the range of a lidar or a template as a float [m]."""
    return number(name, positive(name, value, "m"), 0.0, MAX_RANGE)


@dataclass(frozen=True, kw_only=True, repr=False)
class Lidar(Settings):
    """A 2D lidar on a robot.

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

    range: float = 12.0
    """Greatest distance that is measured [m]."""
    field_of_view_deg: float = FULL_CIRCLE
    """Angle that the beams cover, centred on `mount_yaw_deg` [deg]."""
    beams: int = 360
    """Number of beams in the field of view."""
    range_sigma: float = 0.03
    """Standard deviation of a measured distance [m]."""
    mount_x: float = 0.0
    """Position of the lidar on the robot, ahead of its centre [m]."""
    mount_y: float = 0.0
    """Position of the lidar on the robot, to the left of its centre [m]."""
    mount_yaw_deg: float = 0.0
    """Direction of the middle beam on the robot, counter-clockwise from ahead [deg]."""

    def __post_init__(self) -> None:
        keep_checked(self, ("range_sigma",), number, MIN_SIGMA)
        keep_checked(self, ("range",), checked_range)
        keep_checked(self, ("field_of_view_deg",), positive, "deg")
        keep_checked(self, ("mount_x", "mount_y", "mount_yaw_deg"), number)
        if self.field_of_view_deg > FULL_CIRCLE:
            raise ConfigError(
                f"field_of_view_deg must be at most 360 deg, not {shown(self.field_of_view_deg)}"
            )
        keep_checked(self, ("beams",), whole, 1, MAX_BEAMS)

    @classmethod
    def preset(cls, name: str) -> Lidar:
        """Common lidar with the values of its data sheet, see `LIDARS`.

        Raises
        ------
        ConfigError
            If the name is unknown.
        """
        one_of("lidar", name, LIDARS)
        return LIDARS[name]

    @property
    def angles(self) -> NDArray[np.float64]:
        """Angles of the beams from the middle one, counter-clockwise, (beams,) [rad]."""
        width = math.radians(self.field_of_view_deg)
        if self.sees_all_round:  # the first and the last beam must not coincide
            between = np.arange(self.beams, dtype=np.float64) + 0.5
            return between * (width / self.beams) - width / 2
        beside = np.arange(self.beams, dtype=np.float64) - (self.beams - 1) / 2
        return beside * (width / max(1, self.beams - 1))

    @property
    def mount_yaw(self) -> float:
        """`mount_yaw_deg` in radians."""
        return math.radians(self.mount_yaw_deg)

    @property
    def sees_all_round(self) -> bool:
        """True if the beams cover the whole circle."""
        return self.field_of_view_deg == FULL_CIRCLE

    @property
    def sees_alike_in_all_headings(self) -> bool:
        """True if what the lidar sees at a place does not depend on the robot's heading.

        Where a feature lies between two beams is neglected.
        """
        return self.sees_all_round and self.mount_x == self.mount_y == 0.0


LIDARS = {
    # Slamtec, RPLIDAR A1M8 data sheet: 0.15-12 m, 360 deg, 1 deg, resolution 1 % of the distance.
    "rplidar-a1": Lidar(range=12.0, beams=360, range_sigma=0.03),
    # Hokuyo, UTM-30LX data sheet: 0.1-30 m, 270 deg, 0.25 deg, repeatability 10 mm to 10 m, 30 mm
    # beyond.
    "utm-30lx": Lidar(range=30.0, field_of_view_deg=270.0, beams=1081, range_sigma=0.03),
    # Sick, LMS291 technical description: 80 m, 180 deg, 0.5 deg, statistical error 10 mm.
    "lms291": Lidar(range=80.0, field_of_view_deg=180.0, beams=361, range_sigma=0.01),
    # Hokuyo, URG-04LX-UG01 data sheet: 5.6 m, 240 deg, 0.36 deg (682 steps), 30 mm to 1 m,
    # 3 % beyond.
    "urg-04lx": Lidar(range=5.6, field_of_view_deg=240.0, beams=682, range_sigma=0.03),
}
"""Common lidars by their makers' data sheets."""
