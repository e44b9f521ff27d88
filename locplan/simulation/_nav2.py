"""AMCL's parameters from a parameter file of Nav2."""

from __future__ import annotations

import dataclasses
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence

from locplan.errors import LocplanError, one_line
from locplan.maps._ros_parameters import AMCL, read_parameters
from locplan.simulation._settings import DIFFERENTIAL, OMNIDIRECTIONAL, Amcl

OLDER_NAMES = {"differential": DIFFERENTIAL, "omnidirectional": OMNIDIRECTIONAL}
"""Motion models by their names before Nav2's Humble."""
NO_MATTER = {
    "allow_parameter_qos_overrides",
    "always_reset_initial_pose",
    "base_frame_id",
    "beam_skip_distance",
    "beam_skip_error_threshold",
    "beam_skip_threshold",
    "do_beamskip",
    "first_map_only",
    "freespace_downsampling",
    "global_frame_id",
    "initial_pose",
    "initialize_at_saved_pose",
    "lambda_short",
    "map_topic",
    "odom_frame_id",
    "random_seed",
    "recovery_alpha_fast",
    "recovery_alpha_slow",
    "save_pose_rate",
    "saved_pose_filepath",
    "scan_topic",
    "set_initial_pose",
    "tf_broadcast",
    "transform_tolerance",
    "use_sim_time",
    "z_max",
    "z_short",
}
"""Further parameters of AMCL, most of which do not matter for the simulation."""


class ParameterWarning(UserWarning):
    """Warning that a robot's parameters are simulated in part only."""


def read_amcl(path: str | os.PathLike[str]) -> Amcl:
    """Read AMCL's parameters from a parameter file of Nav2.

    Warns of parameters in the file that are not simulated.

    Parameters
    ----------
    path : path
        YAML file with a node `amcl`; parameters that are missing there have Nav2's defaults. Where
        it has several robots, the namespace of one follows, as in "nav2.yaml:robot1".

    Raises
    ------
    LocplanError
        If the file cannot be read, has no parameters of amcl, or a value is out of its range.
    """
    amcl, left_out = read_filter(path)
    warn_of(path, left_out)
    return amcl


def warn_of(path: str | os.PathLike[str], left_out: Sequence[str]) -> None:
    """Warn of parameters in a file that are not simulated, if there are any."""
    if left_out:
        message = one_line(f"{path}: not simulated: {', '.join(left_out)}")
        warnings.warn(ParameterWarning(message), stacklevel=3)


def read_filter(path: str | os.PathLike[str]) -> tuple[Amcl, tuple[str, ...]]:
    """Read AMCL's parameters as `read_amcl` does, and the names of those that are not simulated."""
    parameters = read_parameters(path)
    given, own = parameters.of(AMCL), parameters.of(AMCL, shared=False)
    known = {each.name for each in dataclasses.fields(Amcl)} - {"half_cell"}
    taken = {name: value for name, value in given.items() if name in known}
    if not taken and all(each.is_shared for each in parameters.entries(AMCL)):
        raise LocplanError(f"{path}: has no parameters of amcl; give the file that starts it")
    model = str(taken.pop("robot_model_type", DIFFERENTIAL))
    model = OLDER_NAMES.get(model, model)
    foreign = model not in (DIFFERENTIAL, OMNIDIRECTIONAL)
    if not foreign:
        taken["robot_model_type"] = model
    try:
        amcl = Amcl(**taken)
    except LocplanError as error:
        raise LocplanError(f"{path}: amcl: {error}") from None
    unknown = sorted({name.partition(".")[0] for name in own} - known - NO_MATTER)
    return amcl, (*_not_simulated(given), *["robot_model_type"] * foreign, *unknown)


def other_parameters(params: str | os.PathLike[str] | None) -> dict[str, object]:
    """Parameters of amcl in a file of Nav2, or none."""
    return read_parameters(params).of(AMCL)


def _not_simulated(given: Mapping[str, object]) -> Iterator[str]:
    """Names of parameters in `NO_MATTER` that do matter with the values given."""
    for name in ("recovery_alpha_slow", "recovery_alpha_fast"):
        if given.get(name):
            yield name
    if given.get("do_beamskip") and given.get("laser_model_type") == "likelihood_field_prob":
        yield "do_beamskip"
