"""The robot's filter, configured as Nav2's AMCL is."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final, Literal, Protocol

from locplan._support.checks import (
    Settings,
    check_positive,
    checked_setting,
    describe_changed_settings,
)
from locplan.errors import ConfigError

if TYPE_CHECKING:
    import numpy as np
    from numpy.random import Generator as Random
    from numpy.typing import NDArray

    from locplan._support.kernels.arrays import Floats
    from locplan.maps.grid import OccupancyGrid
    from locplan.robots.lidar import Lidar

Deviation = tuple[float, float]
"""Standard deviations of a position along x and y each [m], and of a heading [rad]."""


class Filter(Protocol):
    """Settings of a filter; `start` begins any number of trackers.

    They are a frozen dataclass like `Amcl`: drives run in threads, and their filters share nothing
    but the settings. `locplan.testing.check_filter` checks a custom filter.
    """

    @property
    def title(self) -> str:
        """The filter in one short line for people."""

    def start(
        self, grid: OccupancyGrid, lidar: Lidar, pose: Floats, deviation: Deviation, random: Random
    ) -> Tracker:
        """Begin to track a robot.

        Parameters
        ----------
        grid : OccupancyGrid
            The filter's map, which may differ from the map for planning and from the world.
        lidar : Lidar
            The lidar that takes the scans.
        pose : (3,) array
            First pose x, y, heading in the world [m, m, rad].
        deviation : (position, heading)
            Standard deviations of the first pose, along x and y each [m], and of the heading [rad].
        random : numpy.random.Generator
            The only source of random numbers, so that equal seeds give equal drives.
        """


class Tracker(Protocol):
    """A running filter: at every pose `motion`, `scan` and `estimate` are called in turn."""

    def motion(self, odometry: Floats) -> None:
        """Update with the pose that odometry reports.

        Parameters
        ----------
        odometry : (3,) array
            The accumulated pose x, y, heading in the odometry frame [m, m, rad].
        """

    def scan(self, ranges: NDArray[np.float32]) -> None:
        """Update with a scan taken at the pose of the last `motion`.

        Parameters
        ----------
        ranges : (beams,) array
            Distances along all of the lidar's beams [m]; a value outside its range is no return.
        """

    def estimate(self) -> Floats:
        """Return the robot's pose x, y, heading in the world, (3,) [m, m, rad]."""

    def covariance(self) -> Floats:
        """Return the estimate's covariance in the world, (3, 3) [m, m, rad]; NaN if unknown."""


@dataclass(frozen=True, repr=False)
class NamedFilter:
    """A custom filter as files describe it, by name and without its code."""

    title: str
    settings: str

    def __repr__(self) -> str:
        return self.settings

    def start(self, *_: object) -> Tracker:
        """Raise an error, because the filter's code is not known."""
        raise ConfigError(f"a file does not hold the code of {self.title}; give the robot's filter")


MODELS: Final[tuple[str, ...]] = ("likelihood_field", "likelihood_field_prob")
DIFFERENTIAL: Final = "nav2_amcl::DifferentialMotionModel"
OMNIDIRECTIONAL: Final = "nav2_amcl::OmniMotionModel"


@dataclass(frozen=True, kw_only=True, repr=False)
class Amcl(Settings):
    """Parameters of Nav2's AMCL, by its names and with its defaults.

    They configure its motion models and its likelihood fields. `read_amcl` reads your robot's
    parameters from its file; `tune` searches better ones. Unlike here, Nav2 ignores a map's yaw.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> Amcl(min_particles=500, max_particles=500).max_beams
    60
    """

    alpha1: float = checked_setting(0.2, 0.0)
    """Variance of a turn per square of the turn, >= 0 [1]."""
    alpha2: float = checked_setting(0.2, 0.0)
    """Variance of a turn per square of the distance driven in an update, >= 0 [rad^2 / m^2]."""
    alpha3: float = checked_setting(0.2, 0.0)
    """Variance of the distance per square of the distance, >= 0 [1]."""
    alpha4: float = checked_setting(0.2, 0.0)
    """Variance of the distance per square of the turn, >= 0 [m^2 / rad^2]."""
    alpha5: float = checked_setting(0.2, 0.0)
    """Variance of a shift to the side per square of the distance, >= 0 [1]; only an omnidirectional
    robot has it."""
    robot_model_type: Literal[
        "nav2_amcl::DifferentialMotionModel", "nav2_amcl::OmniMotionModel"
    ] = checked_setting(DIFFERENTIAL, DIFFERENTIAL, OMNIDIRECTIONAL)
    """Motion model: of a robot that drives where it heads, or of one that can drive sideways."""
    laser_model_type: Literal["likelihood_field", "likelihood_field_prob"] = checked_setting(
        "likelihood_field", *MODELS
    )
    """Sensor model: a weight is 1 plus the sum of cubed likelihoods, or (`_prob`) their product."""
    laser_likelihood_max_dist: float = checked_setting(2.0, check_positive)
    """Maximum distance of a beam's end from a wall, above 0; larger ones count as this [m]."""
    laser_min_range: float = checked_setting(-1.0)
    """Range below which a beam counts as without a return [m]; 0 or less takes the lidar's own."""
    laser_max_range: float = checked_setting(100.0)
    """Range above which a beam counts as without a return [m]; 0 or less takes the lidar's own."""
    max_beams: int = checked_setting(60, 2)
    """Approximate number of a scan's beams, evenly spaced, that are compared; at least 2."""
    max_particles: int = checked_setting(2000, 1, 1_000_000)
    """Maximum number of particles, up to a million; if equal to `min_particles`, the number is
    constant."""
    min_particles: int = checked_setting(500, 1, 1_000_000)
    """Minimum number of particles, at least 1."""
    pf_err: float = checked_setting(0.05, check_positive)
    """Maximum error that KLD sampling allows, above 0; a smaller one takes more particles."""
    pf_z: float = checked_setting(0.99, check_positive)
    """Quantile of the normal distribution for KLD sampling, above 0, as in AMCL: not the
    probability."""
    recovery_alpha_fast: float = checked_setting(0.0, 0.0, 1.0)
    """Share by which the fast average of the particles' weights follows them, 0..1. Where it falls
    below the slow one, random particles are added; with both 0 none are."""
    recovery_alpha_slow: float = checked_setting(0.0, 0.0, 1.0)
    """Share by which the slow average of the particles' weights follows them, 0..1."""
    resample_interval: int = checked_setting(1)
    """Number of updates per resampling, at least 1."""
    sigma_hit: float = checked_setting(0.2, check_positive)
    """Standard deviation of the distance of a beam's end from a wall, above 0 [m]."""
    update_min_a: float = checked_setting(0.2, 0.0)
    """Turn after which the filter updates, >= 0 [rad]."""
    update_min_d: float = checked_setting(0.25, 0.0)
    """Distance along x or y after which the filter updates, >= 0 [m]."""
    z_hit: float = checked_setting(0.5, 0.0, 1.0)
    """Weight of beams that end at a wall, 0..1."""
    z_rand: float = checked_setting(0.5, 0.0, 1.0)
    """Weight of beams that end anywhere, 0..1; this and `z_hit` are not both 0."""
    half_cell: bool = checked_setting(True)
    """True reads the likelihood field half a cell aside along x and y, as Nav2's AMCL does; False
    simulates a filter that reads it where the beams end."""

    def __post_init__(self) -> None:
        super().__post_init__()
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
        differences = describe_changed_settings(self)
        if not differences:
            return "Nav2's defaults"
        rest_text = f" and {len(differences) - 5} more" if len(differences) > 5 else ""
        return f"AMCL's {', '.join(differences[:5])}{rest_text}"

    @property
    def multiplies_likelihoods(self) -> bool:
        """True if a weight is the product of the beams' likelihoods."""
        return self.laser_model_type == "likelihood_field_prob"

    @property
    def is_omnidirectional(self) -> bool:
        """True if the motion model lets the robot drive sideways."""
        return self.robot_model_type == OMNIDIRECTIONAL

    def start(
        self, grid: OccupancyGrid, lidar: Lidar, pose: Floats, deviation: Deviation, random: Random
    ) -> Tracker:
        """Start to track a robot with particles around a pose; see `Filter.start`.

        Parameters
        ----------
        grid : OccupancyGrid
            The filter's map.
        lidar : Lidar
            The lidar that takes the scans.
        pose : (3,) array
            First pose x, y, heading in the world [m, m, rad].
        deviation : (position, heading)
            Standard deviations of the first pose [m], and of its heading [rad].
        random : numpy.random.Generator
            The only source of random numbers.
        """
        from locplan.robots.particles import ParticleFilter

        return ParticleFilter(self, grid, lidar, pose, deviation, random)

    def compute_max_range(self, lidar: Lidar) -> float:
        """Return the maximum range of a beam that counts as a return [m].

        Parameters
        ----------
        lidar : Lidar
            The robot's lidar, whose range counts if it is shorter than `laser_max_range`.
        """
        max_range = self.laser_max_range
        return min(lidar.range, max_range) if max_range > 0 else lidar.range

    def compute_beam_step(self, beams: int) -> int:
        """Return n such that every n-th of a scan's beams is compared.

        The two sensor models thin beams out in different ways.

        Parameters
        ----------
        beams : int
            Number of beams of a scan.
        """
        if self.multiplies_likelihoods:
            return math.ceil(beams / self.max_beams)
        return max(1, (beams - 1) // (self.max_beams - 1))


SIMULATED = {parameter.name for parameter in fields(Amcl)} - {"half_cell"}
"""Nav2's parameters of AMCL that are simulated: all settings but `half_cell`, which Nav2 lacks."""
NOT_SIMULATED: dict[str, float | str | bool | None] = {
    "allow_parameter_qos_overrides": None,
    "always_reset_initial_pose": None,
    "base_frame_id": "base_footprint",
    "beam_skip_distance": 0.5,
    "beam_skip_error_threshold": 0.9,
    "beam_skip_threshold": 0.3,
    "do_beamskip": False,
    "first_map_only": None,
    "freespace_downsampling": None,
    "global_frame_id": "map",
    "initial_pose": None,
    "initialize_at_saved_pose": None,
    "lambda_short": 0.1,
    "map_topic": None,
    "odom_frame_id": "odom",
    "random_seed": None,
    "save_pose_rate": 0.5,
    "saved_pose_filepath": None,
    "scan_topic": "scan",
    "set_initial_pose": None,
    "tf_broadcast": True,
    "transform_tolerance": 1.0,
    "use_sim_time": None,
    "z_max": 0.05,
    "z_short": 0.05,
}
"""Nav2's other parameters of AMCL, with its default if a new file of parameters has them."""
