"""The parameter file of Nav2 with the tuned settings of AMCL."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from pathlib import Path

from locplan._util.reading import scalar_text
from locplan.errors import LocplanError
from locplan.robots import (
    Amcl,
    ParameterWarning,
    edited_parameters,
    file_and_robot,
    read_amcl,
    read_parameters,
)
from locplan.simulation.tuning._results import Tuning
from locplan.simulation.tuning._space import NAMES, Value, axes_of

PRODUCT = "likelihood_field_prob"
"""The one laser model that `do_beamskip` matters for."""
OTHERS: dict[str, float | str | bool] = {
    "base_frame_id": "base_footprint",
    "beam_skip_distance": 0.5,
    "beam_skip_error_threshold": 0.9,
    "beam_skip_threshold": 0.3,
    "do_beamskip": False,
    "global_frame_id": "map",
    "lambda_short": 0.1,
    "odom_frame_id": "odom",
    "recovery_alpha_fast": 0.0,
    "recovery_alpha_slow": 0.0,
    "save_pose_rate": 0.5,
    "scan_topic": "scan",
    "tf_broadcast": True,
    "transform_tolerance": 1.0,
    "z_max": 0.05,
    "z_short": 0.05,
}
"""Parameters that are not simulated, with the values that Nav2 has for them."""


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
        trial |= {"laser_model_type": PRODUCT, "max_beams": 1234}
        edited_parameters(params, "amcl", _without_skips(params, trial))


def write_tuned(folder: Path, tuning: Tuning, params: Path | None = None) -> None:
    """Write nav2_params.yaml with what gains into a folder.

    Parameters
    ----------
    folder : Path
        The folder.
    tuning : Tuning
        What was found.
    params : path, optional
        The user's parameter file, whose copy has other values; it stays as it is.

    Raises
    ------
    LocplanError
        If the file cannot be written, or the values in `params` cannot be changed.
    """
    file = folder / "nav2_params.yaml"
    file.write_bytes(tuned_file(tuning, params))
    check_written(file, tuning.winner, params)


def tuned_file(tuning: Tuning, params: Path | None) -> bytes:
    """Content of a parameter file with the settings to use.

    It is the user's own file with other values, or without one a section of amcl.

    Raises
    ------
    LocplanError
        If the file cannot be read any more, or its values cannot be changed alone.
    """
    if params is None:
        return _new_file(tuning)
    before, winner = _read(params), tuning.winner
    values: dict[str, Value] = {
        name: getattr(winner, name)
        for name in NAMES
        if getattr(winner, name) != getattr(before, name)
    }
    return edited_parameters(params, "amcl", _without_skips(params, values))


def check_written(file: Path, winner: Amcl, params: Path | None = None) -> None:
    """Raise a LocplanError unless a file has exactly these settings, for the robot of `params`."""
    robot = file_and_robot(params)[1] if params else None
    read = _read(file if robot is None else Path(f"{file}:{robot}"))
    if any(getattr(read, name) != getattr(winner, name) for name in NAMES):
        raise LocplanError(f"{file}: could not be written as it was meant to be")


def _without_skips(params: Path, values: Mapping[str, Value]) -> dict[str, float | str | bool]:
    """Values to write, with beams not skipped where that had no effect, and would have one."""
    skips = read_parameters(params).of("amcl").get("do_beamskip")
    turned = skips and values.get("laser_model_type") == PRODUCT
    return {**values, "do_beamskip": False} if turned else {**values}


def _read(file: Path) -> Amcl:
    """The settings in a file, about which was warned before."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ParameterWarning)
        return read_amcl(file)


def _new_file(tuning: Tuning) -> bytes:
    defaults, winner = Amcl(), tuning.winner
    simulated = (*NAMES, "robot_model_type")
    values = {name: getattr(winner, name) for name in simulated} | OTHERS
    lines = ["# Parameters of Nav2's AMCL; frames and topics are Nav2's defaults."]
    lines += ["amcl:", "  ros__parameters:"]
    names = {each.name for each in dataclasses.fields(Amcl)}
    for name, value in sorted(values.items()):
        line = f"    {name}: {_quoted(value)}"
        if name in names and value != getattr(defaults, name):
            line += f"  # Nav2's default is {_quoted(getattr(defaults, name))}"
        lines.append(line)
    return ("\n".join(lines) + "\n").encode()


def _quoted(value: float | str | bool) -> str:
    return f'"{value}"' if isinstance(value, str) else scalar_text(value)
