"""The settings of AMCL that tuning tries, and the levels of disturbance that it tries them at."""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass

import numpy as np

from locplan.robots import MODELS, OMNIDIRECTIONAL, Amcl, Robot

Value = float | str
"""A value of a parameter."""
MAX_SETTINGS = 128
"""Greatest number of settings that are tried; of more, some are drawn at random."""
NEAR = 1.5
"""Factor within which the user's own value takes the place of the listed one."""
MAX_CLUTTER = 0.5
"""Greatest share of outliers, of occluded scans and of changed cells that a level asks for."""

NAMES = (
    *("alpha1", "alpha2", "alpha3", "alpha4", "alpha5"),
    *("laser_likelihood_max_dist", "laser_max_range"),
    *("laser_min_range", "laser_model_type", "max_beams", "max_particles", "min_particles"),
    *("pf_err", "pf_z", "resample_interval", "sigma_hit", "update_min_a", "update_min_d"),
    *("z_hit", "z_rand"),
)
"""Parameters that are both Nav2's and simulated."""


@dataclass(frozen=True)
class Axis:
    """Parameters that are searched together: they all get the same value."""

    name: str
    """Name in tables."""
    fields: tuple[str, ...]
    """Names of the parameters."""
    values: tuple[Value, ...]
    """Values that are tried besides the user's own."""

    def of(self, amcl: Amcl) -> tuple[Value, ...]:
        """Values of these parameters."""
        return tuple(getattr(amcl, name) for name in self.fields)

    def choices(self, own: Amcl) -> list[tuple[Value, ...]]:
        """Values to try: the user's own first, which take the place of listed ones near them."""
        mine = self.of(own)
        listed = [(value,) * len(self.fields) for value in self.values]
        return [mine, *(values for values in listed if not _near(values, mine))]

    def put(self, amcl: Amcl, values: tuple[Value, ...]) -> Amcl:
        """Copy of the settings with these values."""
        changes: dict[str, object] = dict(zip(self.fields, values, strict=True))
        return dataclasses.replace(amcl, **changes)  # type: ignore[arg-type]

    def shown(self, amcl: Amcl) -> str:
        """Text of the values, such as `alphas 0.05`; that of the laser model is its value."""
        values = [value if isinstance(value, str) else f"{value:g}" for value in self.of(amcl)]
        text = values[0] if len(set(values)) == 1 else "/".join(values)
        return text if self.name == "laser_model_type" else f"{self.name} {text}"


ALPHAS = ("alpha1", "alpha2", "alpha3", "alpha4")
AXES = (
    Axis("alphas", ALPHAS, (0.2, 0.1, 0.05, 0.02)),
    Axis("laser_model_type", ("laser_model_type",), MODELS),
    Axis("update_min_d", ("update_min_d",), (0.25, 0.1)),
    Axis("max_beams", ("max_beams",), (30, 60, 120, 180)),
    Axis("sigma_hit", ("sigma_hit",), (0.1, 0.2)),
)
"""What is searched; see `axes_of`."""


@dataclass(frozen=True)
class DisturbanceLevel:
    """A level of disturbance, relative to the one that was asked for."""

    name: str
    """The name, such as x3."""
    odometry: float
    """Factor on the drift and the bias of odometry."""
    clutter: float
    """Factor on the shares of outliers, of occluded scans and of cells that differ."""

    def of(self, robot: Robot) -> Robot:
        """The robot at this level.

        Parameters
        ----------
        robot : Robot
            The robot, with the odometry and the disturbances that were asked for.
        """
        odometry = dataclasses.asdict(robot.odometry)
        changes = {name: value * self.odometry for name, value in odometry.items()}
        for name in ("boundary_noise", "outliers", "occlusion"):
            share = getattr(robot.disturbances, name)
            changes[name] = min(share * self.clutter, max(share, MAX_CLUTTER))
        return robot.changed(changes)


LEVELS = (
    DisturbanceLevel("x1/3", 1 / 3, 0.5),
    DisturbanceLevel("x1", 1.0, 1.0),
    DisturbanceLevel("x3", 3.0, 2.0),
)
"""The levels of disturbance; their names are those of the factor on odometry's errors."""


def axes_of(own: Amcl) -> tuple[Axis, ...]:
    """What is searched for a robot: the omnidirectional motion model has one alpha more."""
    if own.robot_model_type != OMNIDIRECTIONAL:
        return AXES
    return tuple(
        dataclasses.replace(axis, fields=(*ALPHAS, "alpha5")) if axis.fields == ALPHAS else axis
        for axis in AXES
    )


def candidates(own: Amcl, random: np.random.Generator) -> list[Amcl]:
    """Settings to try, the user's own first; at most `MAX_SETTINGS`, drawn at random."""
    every = [own]
    for axis in axes_of(own):
        every = [
            axis.put(amcl, values) for amcl, values in itertools.product(every, axis.choices(own))
        ]
    if len(every) > MAX_SETTINGS:
        drawn = 1 + random.choice(len(every) - 1, MAX_SETTINGS - 1, replace=False)
        every = [own, *(every[n] for n in np.sort(drawn))]
    return every


def nav2_defaults(own: Amcl) -> Amcl:
    """Nav2's defaults, with what is no parameter of Nav2 as in the user's own settings."""
    values: dict[str, object] = {name: getattr(Amcl(), name) for name in NAMES}
    return dataclasses.replace(own, **values)  # type: ignore[arg-type]


def changed_axes(own: Amcl, amcl: Amcl) -> list[Axis]:
    """What differs between two settings."""
    return [axis for axis in axes_of(own) if axis.of(own) != axis.of(amcl)]


def changed_values(own: Amcl, amcl: Amcl) -> dict[str, Value]:
    """Values of the settings that differ from the user's own, by name."""
    return {
        each.name: getattr(amcl, each.name)
        for each in dataclasses.fields(Amcl)
        if getattr(amcl, each.name) != getattr(own, each.name)
    }


def described(own: Amcl, amcl: Amcl) -> str:
    """Text of what differs from the user's own, such as `alphas 0.05, likelihood_field_prob`."""
    return ", ".join(axis.shown(amcl) for axis in changed_axes(own, amcl))


def _near(values: tuple[Value, ...], others: tuple[Value, ...]) -> bool:
    """Whether all values are within a factor `NEAR` of the others, or equal."""
    return all(
        one == other
        or (
            not isinstance(one, str)
            and not isinstance(other, str)
            and one > 0 < other
            and abs(math.log(one / other)) < math.log(NEAR)
        )
        for one, other in zip(values, others, strict=True)
    )
