"""How a robot moves, how its odometry errs, and what else disturbs it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

from locplan._util.checks import Settings, instance, keep_checked, number, one_of, positive, whole
from locplan.errors import ConfigError


@dataclass(frozen=True, kw_only=True, repr=False)
class Kinematics(Settings):
    """How a robot moves.

    Raises
    ------
    ConfigError
        If a value is out of its range, or a robot that turns on the spot has a turning radius.

    Examples
    --------
    >>> Kinematics(drive="car-like", turning_radius=1.2)
    Kinematics(drive='car-like', turning_radius=1.2)
    """

    drive: Literal["differential", "omnidirectional", "car-like"] = "differential"
    """A differential drive turns on the spot, an omnidirectional one moves sideways, too, and a
    car-like one needs a turning radius."""
    turning_radius: float = 0.0
    """Least turning radius, above 0 for a car-like robot and else 0 [m]."""
    reverse: bool = True
    """Whether the robot drives in reverse, too."""
    speed: float = 0.5
    """Usual speed, above 0 [m/s]."""

    def __post_init__(self) -> None:
        one_of("drive", self.drive, ("differential", "omnidirectional", "car-like"))
        instance("reverse", self.reverse, bool, "give true or false")
        keep_checked(self, ("turning_radius",), number, 0.0)
        keep_checked(self, ("speed",), positive)
        if (self.drive == "car-like") != (self.turning_radius > 0):
            raise ConfigError(
                "a car-like robot, and no other, has a turning_radius above 0; this one is"
                f" {self.drive} with {self.turning_radius:g} m"
            )


@dataclass(frozen=True, kw_only=True, repr=False)
class Inflation(Settings):
    """Nav2's inflation of a costmap, which keeps planned paths off the walls.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> Inflation(inflation_radius=0.7).cost_scaling_factor
    10.0
    """

    inflation_radius: float = 0.55
    """Distance from walls up to which cells cost more, >= 0 [m]."""
    cost_scaling_factor: float = 10.0
    """Decay of the cost with the distance, above 0 [1/m]."""

    def __post_init__(self) -> None:
        keep_checked(self, ("inflation_radius",), number, 0.0)
        keep_checked(self, ("cost_scaling_factor",), positive)


NEAREST_OBJECT, FARTHEST_OBJECT = 0.5, 2.0
"""Least and greatest distance of an object that occludes the lidar [m]."""


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
    """Number of such worlds, which single scans take in turn, 1 to 1000; a drive has its own."""
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
        keep_checked(self, ("boundary_noise", "outliers", "occlusion"), number, 0.0, 1.0)
        keep_checked(self, ("worlds",), whole, 1, 1000)
        keep_checked(self, ("occlusion_deg",), number, 0.0, 360.0)
        keep_checked(self, ("start_sigma", "start_sigma_deg"), number, 0.0)
