"""Settings of a simulation: the filter, configured as AMCL is, and the disturbances."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from locplan._util.checks import (
    Settings,
    instance,
    keep_checked,
    number,
    one_of,
    positive,
    shown,
    whole,
)
from locplan.errors import ConfigError
from locplan.field import FieldConfig, Lidar
from locplan.field.estimators._sad import PAPER_RANGE

MODELS: Final[tuple[str, ...]] = ("likelihood_field", "likelihood_field_prob")
DIFFERENTIAL: Final = "nav2_amcl::DifferentialMotionModel"
OMNIDIRECTIONAL: Final = "nav2_amcl::OmniMotionModel"
MIN_BEAMS = 2
MAX_PARTICLES = 1_000_000
"""Greatest number of particles of a filter."""
TITLE_NAMES = 5
"""Greatest number of parameters that a filter's title names."""
MAX_WORLDS = 1000
"""Greatest number of worlds that differ from the map."""
SHORT_LIDAR = Lidar(range=PAPER_RANGE, range_sigma=0.025)
"""Lidar that is simulated where none is named; its range is that of the paper's disc."""


def lidar_of(config: FieldConfig | None) -> Lidar:
    """Lidar of a field's settings; without one, a short lidar of the range that the field reads."""
    if config is None:
        return SHORT_LIDAR
    own: Lidar | None = getattr(config.estimator, "lidar", None)
    return own or dataclasses.replace(SHORT_LIDAR, range=config.estimator.reach)


@dataclass(frozen=True, kw_only=True, repr=False)
class Amcl(Settings):
    """Parameters of Nav2's AMCL, by its names and with its defaults.

    They are those of its motion models and its likelihood fields. Give your robot's own, which
    `read_amcl` reads from its file; `tune` looks for better ones. As by default in Nav2,
    `recovery_alpha_fast` and `_slow` are 0: no random particles are added. Unlike here, Nav2
    ignores a map's yaw.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> Amcl(min_particles=500, max_particles=500).max_beams
    60
    """

    alpha1: float = 0.2
    """Variance of a turn per square of the turn, >= 0 [1]."""
    alpha2: float = 0.2
    """Variance of a turn per square of the distance driven in an update, >= 0 [rad^2 / m^2]."""
    alpha3: float = 0.2
    """Variance of the distance per square of the distance, >= 0 [1]."""
    alpha4: float = 0.2
    """Variance of the distance per square of the turn, >= 0 [m^2 / rad^2]."""
    alpha5: float = 0.2
    """Variance of a shift to the side per square of the distance, >= 0 [1]; only an omnidirectional
    robot has it."""
    robot_model_type: Literal[
        "nav2_amcl::DifferentialMotionModel", "nav2_amcl::OmniMotionModel"
    ] = DIFFERENTIAL
    """Motion model: of a robot that drives where it heads, or of one that can drive sideways."""
    laser_model_type: Literal["likelihood_field", "likelihood_field_prob"] = "likelihood_field"
    """Sensor model: a weight is 1 plus the sum of cubed likelihoods, or (`_prob`) their product."""
    laser_likelihood_max_dist: float = 2.0
    """Greatest distance of a beam's end from a wall, above 0; larger ones count as this [m]."""
    laser_min_range: float = -1.0
    """Range below which a beam counts as without a return [m]; 0 or less takes the lidar's own."""
    laser_max_range: float = 100.0
    """Range above which a beam counts as without a return [m]; 0 or less takes the lidar's own."""
    max_beams: int = 60
    """Approximate number of a scan's beams, evenly spaced, that are compared; at least 2."""
    max_particles: int = 2000
    """Greatest number of particles, up to a million; if equal to `min_particles`, the number is
    constant."""
    min_particles: int = 500
    """Least number of particles, at least 1."""
    pf_err: float = 0.05
    """Greatest error that KLD sampling allows, above 0; a smaller one takes more particles."""
    pf_z: float = 0.99
    """Quantile of the normal distribution for KLD sampling, above 0, as in AMCL: not the
    probability."""
    resample_interval: int = 1
    """Number of updates per resampling, at least 1."""
    sigma_hit: float = 0.2
    """Standard deviation of the distance of a beam's end from a wall, above 0 [m]."""
    update_min_a: float = 0.2
    """Turn after which the filter updates, >= 0 [rad]."""
    update_min_d: float = 0.25
    """Distance along x or y after which the filter updates, >= 0 [m]."""
    z_hit: float = 0.5
    """Weight of beams that end at a wall, 0..1."""
    z_rand: float = 0.5
    """Weight of beams that end anywhere, 0..1; this and `z_hit` are not both 0."""
    half_cell: bool = True
    """True reads the likelihood field half a cell aside along x and y, as Nav2's AMCL does; False
    simulates a filter that reads it where the beams end."""

    def __post_init__(self) -> None:
        one_of("laser_model_type", self.laser_model_type, MODELS)
        one_of("robot_model_type", self.robot_model_type, (DIFFERENTIAL, OMNIDIRECTIONAL))
        instance("half_cell", self.half_cell, bool, "give true or false")
        above_0 = ("laser_likelihood_max_dist", "sigma_hit", "pf_err", "pf_z")
        from_0 = (*(f"alpha{n}" for n in range(1, 6)), "update_min_a", "update_min_d")
        keep_checked(self, above_0, positive)
        keep_checked(self, from_0, number, 0.0)
        keep_checked(self, ("laser_min_range", "laser_max_range"), number)
        keep_checked(self, ("z_hit", "z_rand"), number, 0.0, 1.0)
        keep_checked(self, ("resample_interval",), whole)
        keep_checked(self, ("min_particles", "max_particles"), whole, 1, MAX_PARTICLES)
        keep_checked(self, ("max_beams",), whole, MIN_BEAMS)
        if self.min_particles > self.max_particles:
            raise ConfigError(
                f"min_particles ({self.min_particles}) must not exceed max_particles"
                f" ({self.max_particles})"
            )
        if self.z_hit + self.z_rand == 0:
            raise ConfigError("one of z_hit and z_rand must be above 0")

    @property
    def title(self) -> str:
        """Parameters that differ from Nav2's defaults, in one short line for people.

        Examples
        --------
        >>> Amcl().title
        "Nav2's defaults"
        >>> Amcl(alpha1=0.05, laser_model_type="likelihood_field_prob").title
        "AMCL's alpha1 0.05, laser_model_type likelihood_field_prob"
        """
        own = differing(self)
        if not own:
            return "Nav2's defaults"
        more = len(own) - TITLE_NAMES
        listed = ", ".join(own[:TITLE_NAMES])
        return f"AMCL's {listed}{f' and {more} more' if more > 0 else ''}"


@dataclass(frozen=True, kw_only=True, repr=False)
class Disturbances(Settings):
    """Disturbances of a robot: noise, errors of odometry, and worlds that differ from the map.

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


def differing(settings: Amcl | Disturbances) -> list[str]:
    """Name and value of each setting that has not its default."""
    every = [(getattr(settings, each.name), each) for each in dataclasses.fields(settings)]
    return [f"{each.name} {_plain(value)}" for value, each in every if value != each.default]


def _plain(value: object) -> str:
    """Text of a parameter: a number, true or false, or a word without its package."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value).rpartition("::")[2]


def changed(
    amcl: Amcl, disturbances: Disturbances, changes: Mapping[str, object]
) -> tuple[Amcl, Disturbances]:
    """Copies of the filter's parameters and the disturbances with some fields changed by name.

    Raises
    ------
    ConfigError
        If neither has such a field, or a value is out of its range.
    """
    owners: tuple[Any, Any] = amcl, disturbances
    known = [[each.name for each in dataclasses.fields(owner)] for owner in owners]
    for name in changes:
        if name not in (names := sorted(known[0] + known[1])):
            raise ConfigError(
                f"nothing simulated is called {shown(name)}; there are {', '.join(names)}"
            )
    one, other = (
        dataclasses.replace(owner, **{name: changes[name] for name in names if name in changes})
        for owner, names in zip(owners, known, strict=True)
    )
    return one, other
