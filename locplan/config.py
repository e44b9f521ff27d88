"""The settings of a covariance field, checked when they are made."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal

from locplan.errors import ConfigError

ESTIMATORS = ("sad",)
TEMPLATES = ("disc", "visible")
TAU = {"disc": 0.57, "visible": 0.23}
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

    estimator: Literal["sad"] = "sad"
    """What fills the field: "sad" is the paper's correlation of sums of absolute differences."""
    sensor_range: float = 6.0
    """Radius of the template disc [m]."""
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
    quantisation: bool = True
    """Whether to add the variance that the window's lattice cannot resolve (step^2 / 12)."""
    stride: float = 0.2
    """Spacing of the evaluated cells [m], rounded to whole cells, at least one."""

    def __post_init__(self) -> None:
        _one_of("estimator", self.estimator, ESTIMATORS)
        _one_of("template", self.template, TEMPLATES)
        _one_of("weight_law", self.weight_law, WEIGHT_LAWS)
        for name, unit in (
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
        if 0 < self.rotation_window_deg < self.rotation_step_deg:
            raise ConfigError(
                f"rotation_step_deg ({self.rotation_step_deg}) must not exceed"
                f" rotation_window_deg ({self.rotation_window_deg}); 0 compares positions only"
            )
        if not isinstance(self.quantisation, bool):
            raise ConfigError(f"quantisation must be true or false, not {self.quantisation!r}")

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


def _positive(name: str, value: Any, unit: str) -> float:
    if not (_is_number(value) and value > 0):
        raise ConfigError(f"{name} must be a positive number of {unit}, not {value!r}")
    return float(value)


def _one_of(name: str, value: object, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise ConfigError(f"{name} must be one of {', '.join(choices)}, not {value!r}")
