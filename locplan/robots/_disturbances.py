"""What disturbs a robot: errors of its odometry, noise, and worlds that differ from the map."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from locplan._util.checks import Settings, keep_checked, number, whole

NEAREST_OBJECT, FARTHEST_OBJECT = 0.5, 2.0
"""Least and greatest distance of an object that occludes the lidar [m]."""
MAX_WORLDS = 1000
"""Greatest number of worlds that differ from the map."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Odometry(Settings):
    """Errors of a robot's odometry.

    The defaults are those of a small robot indoors, set before anything was measured with them.
    `locplan.recordings.calibrate_drive` finds those of a recorded drive.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> Odometry(distance_drift=0.05)
    Odometry(distance_drift=0.05)
    """

    distance_drift: float = 0.02
    """Standard deviation of the reported distance after 1 m, >= 0 [m]; it grows with the root of
    the distance."""
    heading_drift_deg: float = 1.0
    """Standard deviation of the reported heading after 1 m, >= 0 [deg]; it grows with the root of
    the distance."""
    turn_drift_deg: float = 1.0
    """Standard deviation of the reported heading after a turn of 1 rad, >= 0 [deg]; it grows with
    the root of the turn."""
    distance_bias: float = 0.02
    """Standard deviation, from drive to drive, of the factor on reported distances, >= 0 [1]."""
    heading_bias_deg: float = 1.0
    """Standard deviation, from drive to drive, of a reported bend to one side, >= 0 [deg/m]."""
    turn_bias: float = 0.02
    """Standard deviation, from drive to drive, of the factor on reported turns, >= 0 [1]."""

    def __post_init__(self) -> None:
        keep_checked(self, [each.name for each in dataclasses.fields(self)], number, 0.0)


@dataclass(frozen=True, kw_only=True, repr=False)
class Disturbances(Settings):
    """Disturbances of a lidar and a filter, and worlds that differ from the map.

    The defaults are those of a small robot indoors, set before anything was measured with them.
    `locplan.recordings.calibrate_drive` finds those of a recorded drive.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> Disturbances(boundary_noise=0.0).worlds
    8
    """

    boundary_noise: float = 0.1
    """Share of the cells between free space and walls in which the world differs from the map,
    0..1; raise it where furniture is moved or the map is old."""
    worlds: int = 8
    """Number of such worlds, 1 to 1000; drives take them in turn."""
    outliers: float = 0.04
    """Share of the beams that end at a random distance within the range, 0..1."""
    occlusion: float = 0.2
    """Share of the scans in which an object stands in view of the lidar, 0.5 to 2 m away, 0..1;
    raise it where people walk about."""
    occlusion_deg: float = 20.0
    """Width of this object in the lidar's view, 0 to 360 [deg]."""
    start_sigma: float = 0.1
    """Standard deviation of the filter's first position in x and y, >= 0 [m]."""
    start_sigma_deg: float = 3.0
    """Standard deviation of the filter's first heading, >= 0 [deg]."""

    def __post_init__(self) -> None:
        shares = ("boundary_noise", "outliers", "occlusion")
        keep_checked(self, shares, number, 0.0, 1.0)
        keep_checked(self, ("worlds",), whole, 1, MAX_WORLDS)
        keep_checked(self, ("occlusion_deg",), number, 0.0, 360.0)
        names = [each.name for each in dataclasses.fields(self)]
        others = [name for name in names if name not in (*shares, "worlds", "occlusion_deg")]
        keep_checked(self, others, number, 0.0)
