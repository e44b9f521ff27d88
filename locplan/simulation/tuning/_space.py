"""AMCL's parameters: what tuning tries, warnings of bad values, and Nav2's file with them."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from locplan._util.checks import is_number
from locplan._util.intervals import random_of
from locplan._util.reading import scalar_text
from locplan.errors import LocplanError
from locplan.robots import (
    MODELS,
    NOT_SIMULATED,
    OMNIDIRECTIONAL,
    Amcl,
    Lidar,
    ParameterWarning,
    edited_parameters,
    file_and_robot,
    read_amcl,
    read_parameters,
)
from locplan.simulation._simulator import BEAMS, Simulator

Value = float | str
"""A value of a parameter."""
OURS = ("half_cell", "robot_model_type")
ALPHAS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Noise of odometry that is tried."""
NAMES = tuple(each.name for each in dataclasses.fields(Amcl) if each.name not in OURS)
"""Parameters that are both Nav2's and simulated."""


@dataclass(frozen=True)
class Axis:
    """Parameters that are searched together: they all get the same value."""

    name: str
    """Name in tables."""
    fields: tuple[str, ...]
    """Names of the parameters."""
    values: tuple[Value | tuple[Value, ...], ...]
    """Values that are tried besides the user's own, in order: one for all of the parameters, or
    one for each."""

    def of(self, amcl: Amcl) -> tuple[Value, ...]:
        """Values of these parameters."""
        return tuple(getattr(amcl, name) for name in self.fields)

    def choices(self, own: Amcl) -> list[tuple[Value, ...]]:
        """Values to try: the user's own first, which take the place of listed ones near them."""
        mine = self.of(own)
        count = len(self.fields)
        listed = [each if isinstance(each, tuple) else (each,) * count for each in self.values]
        return [mine, *(each for each in listed if not all(map(_near, each, mine)))]

    def beside(self, amcl: Amcl, own: Amcl) -> list[tuple[Value, ...]]:
        """Values to try beside those of a setting: the next ones, and the user's own."""
        at, mine = self.of(amcl), self.of(own)
        choices: list[Any] = sorted({at, *self.choices(own)})
        n = choices.index(at)
        near = dict.fromkeys([*choices[max(0, n - 1) : n + 2], mine])
        return [each for each in near if each != at]

    def steps(self, one: Amcl, other: Amcl) -> int:
        """Number of listed values from the value of one setting to that of another."""
        choices: list[Any] = sorted({self.of(one), *self.choices(other)})
        return abs(choices.index(self.of(one)) - choices.index(self.of(other)))

    def put(self, amcl: Amcl, values: tuple[Value, ...]) -> Amcl:
        """Copy of the settings with these values."""
        changes: dict[str, object] = dict(zip(self.fields, values, strict=True))
        return dataclasses.replace(amcl, **changes)  # type: ignore[arg-type]

    def shown(self, amcl: Amcl) -> str:
        """Text of the values, such as `alphas 0.05`; that of the laser model is its value."""
        values = [value if isinstance(value, str) else f"{value:g}" for value in self.of(amcl)]
        text = values[0] if len(set(values)) == 1 else "/".join(values)
        return text if self.name == "laser_model_type" else f"{self.name} {text}"


def _near(one: Value, other: Value) -> bool:
    """Whether two values are equal, or within a factor 1.5 of each other."""
    if isinstance(one, str) or isinstance(other, str) or not one > 0 < other:
        return one == other
    return abs(math.log(one / other)) < math.log(1.5)


def axes_of(own: Amcl) -> tuple[Axis, ...]:
    """What is searched for a robot: the omnidirectional motion model has one alpha more."""
    sideways = ("alpha5",) * (own.robot_model_type == OMNIDIRECTIONAL)
    return (
        Axis("turn alphas", ("alpha1", "alpha4"), ALPHAS),
        Axis("way alphas", ("alpha2", "alpha3", *sideways), ALPHAS),
        Axis("laser_model_type", ("laser_model_type",), MODELS),
        Axis("update_min_d", ("update_min_d",), (0.1, 0.25)),
        Axis("update_min_a", ("update_min_a",), (0.1, 0.2)),
        Axis("max_beams", ("max_beams",), (30, 60, 120, 180)),
        Axis("sigma_hit", ("sigma_hit",), (0.05, 0.1, 0.2)),
        Axis("z_hit and z_rand", ("z_hit", "z_rand"), ((0.5, 0.5), (0.8, 0.2), (0.95, 0.05))),
    )


def candidates(
    own: Amcl, random: np.random.Generator, like: Sequence[Amcl] = (), most: int = 128
) -> list[Amcl]:
    """Settings to try: the user's own, those that are given, and others drawn at random."""
    axes = axes_of(own)
    choices = [axis.choices(own) for axis in axes]
    every = dict.fromkeys([own, *like])
    for _ in range(10 * most):
        drawn = own
        for axis, values in zip(axes, choices, strict=True):
            drawn = axis.put(drawn, values[int(random.integers(len(values)))])
        every[drawn] = None
        if len(every) == most:
            break
    return [*every]


def beside(own: Amcl, amcl: Amcl) -> list[Amcl]:
    """Settings that differ from one by a step along one axis."""
    return [axis.put(amcl, values) for axis in axes_of(own) for values in axis.beside(amcl, own)]


def steps_between(own: Amcl, amcl: Amcl) -> int:
    """Number of steps along all axes from the user's own settings to others."""
    return sum(axis.steps(amcl, own) for axis in axes_of(own))


def nav2_defaults(own: Amcl) -> Amcl:
    """Nav2's defaults, with what is no parameter of Nav2 as in the user's own settings."""
    values: dict[str, object] = {name: getattr(Amcl(), name) for name in NAMES}
    return dataclasses.replace(own, **values)  # type: ignore[arg-type]


def is_untuned(amcl: Amcl) -> bool:
    """True if all that tuning searches has the values of Nav2's defaults.

    Parameters
    ----------
    amcl : Amcl
        The settings.
    """
    return not changed_axes(nav2_defaults(amcl), amcl)


def changed_axes(own: Amcl, amcl: Amcl) -> list[Axis]:
    """What differs between two settings."""
    return [axis for axis in axes_of(own) if axis.of(own) != axis.of(amcl)]


def described(own: Amcl, amcl: Amcl) -> str:
    """Text of what differs from the user's own, such as `alphas 0.05, likelihood_field_prob`."""
    return ", ".join(axis.shown(amcl) for axis in changed_axes(own, amcl))


@dataclass(frozen=True)
class BeamsLeft:
    """Beams of a scan that AMCL compares, and how many of them return, on the average."""

    compared: int
    """Number of beams that are compared."""
    returned: float
    """Mean number of these that return, over random places of the map."""

    @classmethod
    def on_map(cls, simulator: Simulator) -> BeamsLeft:
        """Count the beams that return at 200 random places of the map where the robot fits.

        Where it fits nowhere, all free cells count.

        Parameters
        ----------
        simulator : Simulator
            The map, the lidar, the filter and the disturbances.
        """
        from locplan._kernels.lidar import measured_ends

        random = random_of(simulator.seed, BEAMS)
        grid, arguments = simulator.grid, simulator.arguments
        cells = np.argwhere(grid.free & (grid.clearance >= simulator.robot.radius))
        cells = cells if len(cells) else np.argwhere(grid.free)
        some = cells[random.integers(0, len(cells), 200)] if len(cells) else cells
        ends = np.empty((arguments.lidar.angles.size, 2))
        returned = 0
        for n, cell in enumerate(some):
            world = simulator.worlds[n % len(simulator.worlds)]
            pose = np.array([*(cell + 0.5), random.uniform(-np.pi, np.pi)])
            sensed = arguments.lidar, arguments.disturbances
            measured_ends(random, world, grid.resolution, pose, *sensed, ends)
            returned += int(np.isfinite(ends[:, 0]).sum())
        return cls(len(ends), returned / 200)

    def __str__(self) -> str:
        return f"of {self.compared} beams compared, {self.returned:.0f} return on this map"

    def warnings(self) -> list[str]:
        """A warning if fewer than half of the beams return."""
        if self.returned >= self.compared / 2:
            return []
        return [
            f"{self}: Nav2 skips the others, whose walls are out of the lidar's range or too near;"
            " raise max_beams, or laser_max_range where it is below the lidar's range"
        ]


def filter_warnings(
    amcl: Amcl, lidar: Lidar, others: Mapping[str, object] | None = None
) -> list[str]:
    """Return warnings about a filter's parameters, one line each.

    Parameters
    ----------
    amcl : Amcl
        The parameters.
    lidar : Lidar
        The robot's lidar.
    others : mapping, optional
        Further parameters in the robot's file, such as `z_short`.
    """
    both = amcl.z_hit + amcl.z_rand
    # Files of the beam model split 1 among four weights; a likelihood field reads but two.
    rest = [(others or {}).get(name) for name in ("z_short", "z_max")]
    total = both + sum(float(value) for value in rest if is_number(value))
    sigma, far = amcl.sigma_hit, amcl.laser_likelihood_max_dist
    least, most, reach = amcl.laser_min_range, amcl.laser_max_range, amcl.reach(lidar)
    faults = {
        f"z_hit and z_rand add up to {both:g}: likelihood fields use these two weights, which"
        " should add up to 1": min(abs(both - 1), abs(total - 1)) > 0.01,
        "alpha1 to alpha4 are all 0: the particles move as odometry says, and cannot correct it": (
            amcl.alpha1 == amcl.alpha2 == amcl.alpha3 == amcl.alpha4 == 0
        ),
        f"laser_max_range ({most:g} m) is beyond the lidar's range of {lidar.range:g} m,"
        " which counts instead": lidar.range < most < 100,  # Nav2's default, for no limit
        f"laser_min_range ({least:g} m) is not below the range of {reach:g} m: no beam counts": (
            least >= reach
        ),
        f"sigma_hit ({sigma:g} m) is wide: walls {2 * sigma:g} m apart look as one": sigma > 0.5,
        f"sigma_hit ({sigma:g} m) is below the lidar's own noise of {lidar.range_sigma:g} m:"
        " it rejects beams that are right": sigma < lidar.range_sigma,
        f"laser_likelihood_max_dist ({far:g} m) is below twice sigma_hit ({sigma:g} m): beams"
        " that miss the walls cost hardly more than those that hit them": far < 2 * sigma,
    }
    return [text for text, present in faults.items() if present]


def check_tunable(params: Path | None) -> None:
    """Check that tuned settings can be written into a file's copy; to be called before long work.

    Parameters
    ----------
    params : Path or None
        The user's parameter file.

    Raises
    ------
    LocplanError
        If they cannot.
    """
    if params is not None:
        axes = axes_of(_read(params))
        trial: dict[str, Value] = {name: 0.123 for axis in axes for name in axis.fields}
        _edited(params, trial | {"laser_model_type": "likelihood_field_prob", "max_beams": 1234})


def write_tuned(file: Path, winner: Amcl, params: Path | None = None) -> None:
    """Write settings as parameters of Nav2.

    It is the user's own file with other values, or without one a section of amcl.

    Parameters
    ----------
    file : Path
        The file.
    winner : Amcl
        The settings.
    params : path, optional
        The user's parameter file, whose copy has other values; it stays as it is.

    Raises
    ------
    LocplanError
        If the file cannot be written, or the values in `params` cannot be changed alone.
    """
    robot = None
    if params is None:
        file.write_bytes(_new_file(winner))
    else:
        before, robot = _read(params), file_and_robot(params)[1]
        changed = {name: getattr(winner, name) for name in differing_names(before, winner)}
        file.write_bytes(_edited(params, changed))
    if differing_names(_read(Path(f"{file}:{robot}") if robot else file), winner):
        raise LocplanError(f"{file}: could not be written as it was meant to be")


def differing_names(one: Amcl, other: Amcl) -> list[str]:
    """The parameters in Nav2's files of which two settings have different values."""
    return [name for name in NAMES if getattr(one, name) != getattr(other, name)]


def _edited(params: Path, values: Mapping[str, Value]) -> bytes:
    """A file with these values, and beams not skipped where they are from now on."""
    given = read_parameters(params).of("amcl")
    if given.get("laser_model_type", MODELS[0]) not in MODELS:  # another model was simulated
        values = {"laser_model_type": MODELS[0], **values}
    skips = given.get("do_beamskip")
    if skips and values.get("laser_model_type") == "likelihood_field_prob":
        # It had no effect with the other laser model, and was not simulated with this one.
        values = {**values, "do_beamskip": False}
    return edited_parameters(params, "amcl", values)


def _read(file: Path) -> Amcl:
    """The settings in a file, about which was warned before."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ParameterWarning)
        return read_amcl(file)


def _new_file(winner: Amcl) -> bytes:
    values = {name: getattr(winner, name) for name in (*NAMES, "robot_model_type")} | NOT_SIMULATED
    lines = ["# Parameters of Nav2's AMCL; frames and topics are Nav2's defaults."]
    lines += ["amcl:", "  ros__parameters:"]
    for name, value in sorted(values.items()):
        default = getattr(Amcl(), name, value)
        note = "" if value == default else f"  # Nav2's default is {_quoted(default)}"
        lines.append(f"    {name}: {_quoted(value)}{note}")
    return ("\n".join(lines) + "\n").encode()


def _quoted(value: float | str | bool) -> str:
    return f'"{value}"' if isinstance(value, str) else scalar_text(value)
