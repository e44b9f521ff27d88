"""AMCL's parameters: warnings of bad values, and Nav2's file with tuned ones."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from locplan._support.checks import is_number
from locplan._support.intervals import make_generator
from locplan._support.reading import format_yaml_scalar
from locplan.errors import LocplanError
from locplan.robots.amcl import MODELS, NOT_SIMULATED, SIMULATED, Amcl
from locplan.robots.lidar import Lidar
from locplan.robots.nav2 import ParameterWarning, read_amcl
from locplan.robots.parameter_edits import edit_parameters
from locplan.robots.parameters import read_parameters, split_robot_name
from locplan.robots.presets import PRESET_PARAMETERS
from locplan.robots.robot import Robot
from locplan.simulation.simulator import BEAM_STREAM, Simulator


def has_default_preset_parameters(amcl: Amcl) -> bool:
    """True if all that presets change has the values of Nav2's defaults.

    Parameters
    ----------
    amcl : Amcl
        The settings.
    """
    defaults = Amcl()
    return all(getattr(amcl, name) == getattr(defaults, name) for name in PRESET_PARAMETERS)


@dataclass(frozen=True)
class BeamCount:
    """Beams of a scan that AMCL compares, and how many of them return, on the average."""

    compared: int
    """Number of beams that are compared."""
    returned: float
    """Mean number of these that return, over random places of the map."""

    @classmethod
    def on_map(cls, simulator: Simulator) -> BeamCount:
        """Count the beams that return at 200 random places of the map in which the robot fits.

        If it fits nowhere, all free cells count.

        Parameters
        ----------
        simulator : Simulator
            The map, the lidar, the filter and the disturbances.
        """
        from locplan._support.kernels.lidar import simulate_measured_ends

        random = make_generator(simulator.seed, BEAM_STREAM)
        grid, arguments = simulator.grid, simulator.arguments
        cells = np.argwhere(grid.free & (grid.clearance >= simulator.robot.radius))
        cells = cells if len(cells) else np.argwhere(grid.free)
        sampled_cells = cells[random.integers(0, len(cells), 200)] if len(cells) else cells
        ends = np.empty((arguments.lidar.angles.size, 2))
        returned = 0
        for n, cell in enumerate(sampled_cells):
            world = simulator.worlds[n % len(simulator.worlds)]
            pose = np.array([*(cell + 0.5), random.uniform(-np.pi, np.pi)])
            sensed = arguments.lidar, arguments.disturbances
            simulate_measured_ends(random, world, grid.resolution, pose, *sensed, ends)
            returned += int(np.isfinite(ends[:, 0]).sum())
        return cls(len(ends), returned / 200)

    def __str__(self) -> str:
        return f"of {self.compared} beams compared, {self.returned:.0f} return on this map"

    def find_warnings(self) -> list[str]:
        """Return a warning if fewer than half of the beams return."""
        if self.returned >= self.compared / 2:
            return []
        return [
            f"{self}: Nav2 skips the others, whose walls are out of the lidar's range or too near;"
            " raise max_beams, or laser_max_range if it is below the lidar's range"
        ]


def find_filter_warnings(
    amcl: Amcl, lidar: Lidar, further_parameters: Mapping[str, object] | None = None
) -> list[str]:
    """Return warnings about a filter's parameters, one line each.

    Parameters
    ----------
    amcl : Amcl
        The parameters.
    lidar : Lidar
        The robot's lidar.
    further_parameters : mapping, optional
        Further parameters in the robot's file, such as `z_short`.
    """
    weight_sum = amcl.z_hit + amcl.z_rand
    # Files of the beam model split 1 among four weights; a likelihood field reads but two.
    rest = [(further_parameters or {}).get(name) for name in ("z_short", "z_max")]
    total = weight_sum + sum(float(value) for value in rest if is_number(value))
    sigma, far = amcl.sigma_hit, amcl.laser_likelihood_max_dist
    min_range, max_range, reach = (
        amcl.laser_min_range,
        amcl.laser_max_range,
        amcl.compute_max_range(lidar),
    )
    faults = {
        f"z_hit and z_rand add up to {weight_sum:g}: likelihood fields use these two weights, which"
        " should add up to 1": min(abs(weight_sum - 1), abs(total - 1)) > 0.01,
        "alpha1 to alpha4 are all 0: the particles move as odometry says, and cannot correct it": (
            amcl.alpha1 == amcl.alpha2 == amcl.alpha3 == amcl.alpha4 == 0
        ),
        f"laser_max_range ({max_range:g} m) is beyond the lidar's range of {lidar.range:g} m,"
        " which counts instead": lidar.range < max_range < 100,  # Nav2's default, for no limit
        f"laser_min_range ({min_range:g} m) is not below the range of {reach:g} m:"
        " no beam counts": (min_range >= reach),
        f"sigma_hit ({sigma:g} m) is wide: walls {2 * sigma:g} m apart look as one": sigma > 0.5,
        f"sigma_hit ({sigma:g} m) is below the lidar's own noise of {lidar.range_sigma:g} m:"
        " it rejects beams that are right": sigma < lidar.range_sigma,
        f"laser_likelihood_max_dist ({far:g} m) is below twice sigma_hit ({sigma:g} m): beams"
        " that miss the walls cost hardly more than those that hit them": far < 2 * sigma,
    }
    return [text for text, present in faults.items() if present]


def list_setting_warnings(
    robot: Robot,
    settings: Amcl,
    beam_count: BeamCount,
    further_parameters: Mapping[str, object] | None = None,
) -> tuple[str, ...]:
    """Return warnings about a robot's settings, and about a change to new settings.

    Parameters
    ----------
    robot : Robot
        The robot with the user's settings.
    settings : Amcl
        The settings to use.
    beam_count : BeamCount
        Number of the compared beams that return.
    further_parameters : mapping, optional
        Further parameters in the robot's file, such as `do_beamskip`.
    """
    user_amcl, warnings = robot.amcl, []
    if (
        settings.multiplies_likelihoods
        and not user_amcl.multiplies_likelihoods
        and (further_parameters or {}).get("do_beamskip")
    ):
        skips = "do_beamskip becomes false with the laser model, since only this one reads it"
        warnings.append(f"{skips}, and it was not simulated")
    warnings += find_filter_warnings(user_amcl, robot.known_lidar, further_parameters)
    return (*warnings, *beam_count.find_warnings())


def check_can_write_tuning(params: Path | None) -> None:
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
        _edit_parameters(
            params, {**dict.fromkeys(PRESET_PARAMETERS, 0.123), "laser_model_type": MODELS[1]}
        )


def write_tuned_parameters(file: Path, winner: Amcl, params: Path | None = None) -> None:
    """Write settings as parameters of Nav2.

    The result is a copy of the user's file with the new values. Without a file, it is an amcl
    section.

    Parameters
    ----------
    file : Path
        The file.
    winner : Amcl
        The settings.
    params : path, optional
        The user's parameter file; it stays unchanged.

    Raises
    ------
    LocplanError
        If the file cannot be written, or the values in `params` cannot be changed alone.
    """
    robot = None
    if params is None:
        file.write_bytes(_make_parameter_file(winner))
    else:
        before, robot = _read_settings_without_warnings(params), split_robot_name(params)[1]
        changed = {
            name: getattr(winner, name) for name in find_differing_parameters(before, winner)
        }
        file.write_bytes(_edit_parameters(params, changed))
    if find_differing_parameters(
        _read_settings_without_warnings(Path(f"{file}:{robot}") if robot else file), winner
    ):
        raise LocplanError(f"{file}: could not be written as it was meant to be")


def find_differing_parameters(first: Amcl, second: Amcl) -> list[str]:
    """The parameters in Nav2's files of which two settings have different values."""
    names = [
        setting_field.name
        for setting_field in dataclasses.fields(Amcl)
        if setting_field.name in SIMULATED
    ]
    return [name for name in names if getattr(first, name) != getattr(second, name)]


def _edit_parameters(params: Path, values: Mapping[str, float | str]) -> bytes:
    """Return the file's content with these values, and with beam skipping turned off."""
    parameters = read_parameters(params).read_node_parameters("amcl")
    if parameters.get("laser_model_type", MODELS[0]) not in MODELS:  # another model was simulated
        values = {"laser_model_type": MODELS[0], **values}
    skips = parameters.get("do_beamskip")
    if skips and values.get("laser_model_type") == "likelihood_field_prob":
        # It had no effect with the other laser model, and was not simulated with this one.
        values = {**values, "do_beamskip": False}
    return edit_parameters(params, "amcl", values)


def _read_settings_without_warnings(file: Path) -> Amcl:
    """Return the settings in a file without repeating its warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ParameterWarning)
        return read_amcl(file)


def _make_parameter_file(winner: Amcl) -> bytes:
    values = {name: getattr(winner, name) for name in SIMULATED}
    values |= {name: value for name, value in NOT_SIMULATED.items() if value is not None}
    lines = ["# Parameters of Nav2's AMCL; frames and topics are Nav2's defaults."]
    lines += ["amcl:", "  ros__parameters:"]
    for name, value in sorted(values.items()):
        default = getattr(Amcl(), name, value)
        note = "" if value == default else f"  # Nav2's default is {_format_value(default)}"
        lines.append(f"    {name}: {_format_value(value)}{note}")
    return ("\n".join(lines) + "\n").encode()


def _format_value(value: float | str | bool) -> str:
    return f'"{value}"' if isinstance(value, str) else format_yaml_scalar(value)
