"""The settings of a covariance field, checked when they are made."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from locplan.errors import ConfigError
from locplan.field._lidar import Lidar

ESTIMATORS = ("sad", "fisher", "scan")
TEMPLATES = ("disc", "visible")
TAU = {"disc": 0.57, "visible": 0.23}
DISC = 6.0
"""The paper's template radius [m]."""
HEADINGS = 8
"""Of a field, where the sensor sees something else in each."""
MAX_STEPS = 1000
"""Of the search window on either side."""
WEIGHT_LAWS = ("exponential", "inverse-square")


@dataclass(frozen=True, kw_only=True)
class FieldConfig:
    """Everything that decides the values of a covariance field.

    The defaults predict measured localization error best; `FieldConfig.paper` follows the
    paper's Eq. 8-10 as printed (doi 10.1186/s40648-023-00256-w).

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> FieldConfig(sensor_range=8.0).sensor_range
    8.0
    >>> FieldConfig(tau=-1.0)
    Traceback (most recent call last):
    locplan.errors.ConfigError: tau must be a positive number of m^2, not -1.0
    """

    estimator: Literal["sad", "fisher", "scan"] = "sad"
    """What fills the field.

    "sad" is the paper's correlation of sums of absolute differences; "fisher" the Fisher
    information of the lidar's beams; "scan" the posterior of a simulated scan in the window.
    """
    sensor_range: float = DISC
    """Radius of the template disc, or the sensor's range [m]."""
    sensor: Lidar | None = None
    """The lidar, for "fisher" and "scan"; None sees all round up to `sensor_range`."""
    headings: int = 0
    """For how many headings of the robot, evenly spaced from 0 on, there are covariances.

    0 is 1 where the sensor sees the same in all of them, as in "sad" always, else 8.
    """
    template: Literal["disc", "visible"] = "disc"
    """What of the disc is compared: all of it as in the paper, or what a ray from the cell sees."""
    window: float = 2.0
    """Half width of the search window in x and in y [m]."""
    step: float = 0.2
    """Spacing of the search window's offsets [m], rounded to whole cells."""
    rotation_window_deg: float = 60.0
    """Half width of the search window in heading [deg]; 0 compares positions only."""
    rotation_step_deg: float = 10.0
    """Spacing of the search window's headings [deg]."""
    weight_law: Literal["exponential", "inverse-square"] = "exponential"
    """Weight of an offset with mismatch area S: exp(-S / tau), or 1 / max(S, floor)^2 (Eq. 9)."""
    tau: float | None = None
    """Scale of the exponential weight law [m^2 of mismatch]; None is 0.57, or 0.23 if visible."""
    floor: float | None = None
    """Least mismatch in the inverse-square law [m^2]; None is half a cell's area."""
    noise_level: float = 1.0
    """Factor k on the weighted covariance (Eq. 8)."""
    sigma_hit: float = 0.1
    """Of "scan": standard deviation of the distance of a beam's end from a wall [m]."""
    z_rand: float = 0.05
    """Of "scan": share of the beams that end anywhere, above 0 and below 1."""
    temperature: float = 0.1
    """Of "scan": factor on the log-likelihood, since neighbouring beams err alike."""
    max_beams: int = 180
    """Of "scan": at most so many of the sensor's beams, evenly spaced, are compared."""
    quantisation: bool = True
    """Whether to add the variance that the window's lattice cannot resolve (step^2 / 12)."""
    stride: float = 0.2
    """Spacing of the evaluated cells [m], rounded to whole cells, at least one."""

    def __post_init__(self) -> None:
        _one_of("estimator", self.estimator, ESTIMATORS)
        _one_of("template", self.template, TEMPLATES)
        _one_of("weight_law", self.weight_law, WEIGHT_LAWS)
        self._settle_sensor()
        for name, unit in (
            ("sigma_hit", "m"),
            ("z_rand", "of 1"),
            ("temperature", "of 1"),
            ("sensor_range", "m"),
            ("window", "m"),
            ("step", "m"),
            ("rotation_step_deg", "deg"),
            ("stride", "m"),
        ):
            self._keep(name, _positive(name, getattr(self, name), unit))
        self._keep("noise_level", _positive("noise_level", self.noise_level, "times Sigma"))
        for name in ("tau", "floor"):
            if getattr(self, name) is not None:
                self._keep(name, _positive(name, getattr(self, name), "m^2"))
        if self.stride > self.sensor_range:
            raise ConfigError(
                f"stride ({self.stride} m) must not exceed sensor_range ({self.sensor_range} m)"
            )
        if self.step > self.window:
            raise ConfigError(f"step ({self.step} m) must not exceed window ({self.window} m)")
        if not (_is_number(self.rotation_window_deg) and 0 <= self.rotation_window_deg <= 180):
            raise ConfigError(
                f"rotation_window_deg must lie in 0..180 deg, not {self.rotation_window_deg!r}"
            )
        self._keep("rotation_window_deg", float(self.rotation_window_deg))
        for half, step in (("window", "step"), ("rotation_window_deg", "rotation_step_deg")):
            if getattr(self, half) > MAX_STEPS * getattr(self, step):
                raise ConfigError(f"{half} must be at most {MAX_STEPS} times {step}")
        if 0 < self.rotation_window_deg < self.rotation_step_deg:
            raise ConfigError(
                f"rotation_step_deg ({self.rotation_step_deg}) must not exceed"
                f" rotation_window_deg ({self.rotation_window_deg}); 0 compares positions only"
            )
        if not isinstance(self.quantisation, bool):
            raise ConfigError(f"quantisation must be true or false, not {self.quantisation!r}")

    def _settle_sensor(self) -> None:
        """One sensor, one range, and a number of headings."""
        if not _is_whole(self.max_beams) or self.max_beams < 1:
            raise ConfigError(
                f"max_beams must be a whole number of 1 or more, not {self.max_beams!r}"
            )
        object.__setattr__(self, "max_beams", int(self.max_beams))
        if not (_is_number(self.z_rand) and 0 < self.z_rand < 1):
            raise ConfigError(f"z_rand must lie between 0 and 1, not {self.z_rand!r}")
        if self.estimator == "sad":
            if self.sensor is not None:
                raise ConfigError(
                    'estimator "sad" knows no sensor but its range: set sensor_range, sensor=None'
                )
            if self.headings not in (0, 1):
                raise ConfigError('estimator "sad" is the same for all headings')
            object.__setattr__(self, "headings", 1)
            return
        if self.sensor is None:
            self._keep("sensor_range", _positive("sensor_range", self.sensor_range, "m"))
            object.__setattr__(self, "sensor", Lidar(range=self.sensor_range))
        if isinstance(self.sensor, Mapping):  # as `dataclasses.asdict` has it
            object.__setattr__(self, "sensor", Lidar(**self.sensor))
        if not isinstance(self.sensor, Lidar):
            raise ConfigError(f"sensor must be a Lidar, not {self.sensor!r}")
        if self.sensor_range not in (DISC, self.sensor.range):
            raise ConfigError(
                f"sensor_range ({self.sensor_range!r} m) is not the sensor's range"
                f" ({self.sensor.range:g} m); set that of the sensor"
            )
        self._keep("sensor_range", self.sensor.range)
        alike = self.sensor.sees_alike_in_all_headings
        if not _is_whole(self.headings) or not 0 <= self.headings <= 360:
            raise ConfigError(f"headings must be a whole number in 0..360, not {self.headings!r}")
        headings = self.headings or (1 if alike else HEADINGS)
        if headings == 1 and not alike:
            raise ConfigError(
                "what this sensor sees depends on the heading: set headings above 1, or to 0"
            )
        object.__setattr__(self, "headings", int(headings))

    @property
    def heading_angles(self) -> NDArray[np.float64]:
        """The headings that a field has covariances for, in the world, (headings,) [rad]."""
        return 2 * np.pi * np.arange(self.headings) / self.headings

    @property
    def mismatch_scale(self) -> float:
        """`tau`, or the template's own [m^2]."""
        return TAU[self.template] if self.tau is None else self.tau

    def _keep(self, name: str, value: float) -> None:
        # All numbers are kept as floats, so that 6 and 6.0 make one and the same config.
        object.__setattr__(self, name, value)

    @classmethod
    def paper(cls, *, sensor_range: float = 6.0, noise_level: float = 1.0) -> FieldConfig:
        """Eq. 8-10 of the paper as printed: inverse-square weights, nothing added."""
        return cls(
            sensor_range=sensor_range,
            noise_level=noise_level,
            weight_law="inverse-square",
            quantisation=False,
        )


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def _is_whole(value: Any) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _positive(name: str, value: Any, unit: str) -> float:
    if not (_is_number(value) and value > 0):
        raise ConfigError(f"{name} must be a positive number of {unit}, not {value!r}")
    return float(value)


def _one_of(name: str, value: object, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise ConfigError(f"{name} must be one of {', '.join(choices)}, not {value!r}")
