"""A robot in the parameters of Nav2: its filter, outline, inflation and kinematics."""

from __future__ import annotations

import dataclasses
import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from locplan._util.checks import number, positive
from locplan.errors import ConfigError, LocplanError, one_line
from locplan.robots._amcl import DIFFERENTIAL, OMNIDIRECTIONAL, Amcl
from locplan.robots._footprint import Footprint
from locplan.robots._kinematics import Inflation, Kinematics
from locplan.robots._parameters import (
    AMCL,
    GLOBAL_COSTMAP,
    LOCAL_COSTMAP,
    PLANNER_SERVER,
    Nav2Parameters,
    read_parameters,
)

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
    amcl = filter_of(path, read_parameters(path))
    if amcl is None:
        raise LocplanError(f"{path}: has no parameters of amcl; give the file that starts it")
    return amcl


def parts_of(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What a parameter file says of a robot, by the names of `Robot`'s fields."""
    parameters = read_parameters(path)
    found = {
        "filter": filter_of(path, parameters),
        **_outline(path, parameters),
        "inflation": _inflation(path, parameters),
        "kinematics": _kinematics(path, parameters),
    }
    return {name: part for name, part in found.items() if part is not None}


def filter_of(path: str | os.PathLike[str], parameters: Nav2Parameters) -> Amcl | None:
    """AMCL's parameters, or None without any; warns of those that are not simulated."""
    given, own = parameters.of(AMCL), parameters.of(AMCL, shared=False)
    known = {each.name for each in dataclasses.fields(Amcl)} - {"half_cell"}
    taken = {name: value for name, value in given.items() if name in known}
    if not taken and all(each.is_shared for each in parameters.entries(AMCL)):
        return None
    model = _motion_model(str(taken.pop("robot_model_type", DIFFERENTIAL)))
    foreign = model not in (DIFFERENTIAL, OMNIDIRECTIONAL)
    if not foreign:
        taken["robot_model_type"] = model
    with _at(path, AMCL):
        amcl = Amcl(**taken)
    unknown = sorted({name.partition(".")[0] for name in own} - known - NO_MATTER)
    left_out = (*_not_simulated(given), *["robot_model_type"] * foreign, *unknown)
    if left_out:
        message = one_line(f"{path}: not simulated: {', '.join(left_out)}")
        warnings.warn(ParameterWarning(message), stacklevel=4)
    return amcl


def _outline(path: str | os.PathLike[str], parameters: Nav2Parameters) -> dict[str, Any]:
    """Footprint or radius, and its padding, of the first costmap that has one.

    As in Nav2, `footprint` counts where it is not "[]", and else `robot_radius`.
    """
    for costmap in (GLOBAL_COSTMAP, LOCAL_COSTMAP):
        own = parameters.of(costmap)
        footprint, radius = str(own.get("footprint") or "[]"), own.get("robot_radius")
        if footprint == "[]" and radius is None:
            continue
        with _at(path, costmap.partition("/")[0]):
            outline: Footprint | float = (
                positive("robot_radius", radius, "m")
                if footprint == "[]"
                else Footprint.from_text(footprint)
            )
            padding = own.get("footprint_padding", 0.01)  # as Nav2 has it
            return {"footprint": outline, "margin": number("footprint_padding", padding, 0.0)}
    return {}


def _inflation(path: str | os.PathLike[str], parameters: Nav2Parameters) -> Inflation | None:
    """Inflation of the global costmap, or None where it has no such layer."""
    own = parameters.of(GLOBAL_COSTMAP)
    for layer in parameters.names(GLOBAL_COSTMAP, "plugins"):
        if own.get(f"{layer}.plugin") == "nav2_costmap_2d::InflationLayer":
            names = [each.name for each in dataclasses.fields(Inflation)]
            given = {name: own[f"{layer}.{name}"] for name in names if f"{layer}.{name}" in own}
            with _at(path, f"global_costmap: {layer}"):
                return Inflation(**given)
    return None


def _kinematics(path: str | os.PathLike[str], parameters: Nav2Parameters) -> Kinematics | None:
    """Kinematics of the first planner with a car-like motion model, or of AMCL's motion model."""
    own = parameters.of(PLANNER_SERVER)
    for planner in parameters.names(PLANNER_SERVER, "planner_plugins"):
        model = own.get(f"{planner}.motion_model_for_search")
        if model in ("DUBIN", "REEDS_SHEPP"):  # the latter drives in reverse, too
            radius = own.get(f"{planner}.minimum_turning_radius", 0.4)
            with _at(path, f"planner_server: {planner}"):
                reverse = model == "REEDS_SHEPP"
                return Kinematics(drive="car-like", turning_radius=radius, reverse=reverse)
    sideways = _motion_model(str(parameters.of(AMCL).get("robot_model_type"))) == OMNIDIRECTIONAL
    return Kinematics(drive="omnidirectional") if sideways else None


def _motion_model(name: str) -> str:
    """The name of AMCL's motion model, or that of one which was named otherwise before Humble."""
    older = {"differential": DIFFERENTIAL, "omnidirectional": OMNIDIRECTIONAL}
    return older.get(name, name)


@contextmanager
def _at(path: str | os.PathLike[str], where: str) -> Iterator[None]:
    """Name the file and the place in it in an error of the block."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"{path}: {where}: {error}") from None


def _not_simulated(given: Mapping[str, object]) -> Iterator[str]:
    """Names of parameters in `NO_MATTER` that do matter with the values given."""
    for name in ("recovery_alpha_slow", "recovery_alpha_fast"):
        if given.get(name):
            yield name
    if given.get("do_beamskip") and given.get("laser_model_type") == "likelihood_field_prob":
        yield "do_beamskip"
