"""A robot in files: locplan's own, and the parameters of Nav2."""

from __future__ import annotations

import dataclasses
import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from locplan._util.checks import file_path, number, positive, shown
from locplan._util.reading import check_stamp, read_content
from locplan.errors import ConfigError, LocplanError, one_line
from locplan.robots._amcl import DIFFERENTIAL, OMNIDIRECTIONAL, Amcl, NamedFilter
from locplan.robots._lidar import Lidar
from locplan.robots._parameters import (
    AMCL,
    GLOBAL_COSTMAP,
    LOCAL_COSTMAP,
    MAX_BYTES,
    PLANNER_SERVER,
    Nav2Parameters,
    read_parameters,
    values_in,
)
from locplan.robots._parts import Disturbances, Footprint, Inflation, Kinematics, Odometry

REMEDY = "give a robot's file, Nav2's parameters, or a URDF or SDF"
VERSION = 1
"""Version of a robot's file."""
OWN = ("footprint", "margin", "goal_tolerance")
"""Settings of the robot itself."""
PARTS: dict[str, type] = {
    "lidar": Lidar,
    "kinematics": Kinematics,
    "inflation": Inflation,
    "filter": Amcl,
    "odometry": Odometry,
    "disturbances": Disturbances,
}
"""The parts with settings of their own, in the order in which settings are looked up."""
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
    with errors_at(path, AMCL):
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
        with errors_at(path, costmap.partition("/")[0]):
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
            with errors_at(path, f"global_costmap: {layer}"):
                return Inflation(**given)
    return None


def _kinematics(path: str | os.PathLike[str], parameters: Nav2Parameters) -> Kinematics | None:
    """Kinematics of the first planner with a car-like motion model, or of AMCL's motion model."""
    own = parameters.of(PLANNER_SERVER)
    for planner in parameters.names(PLANNER_SERVER, "planner_plugins"):
        model = own.get(f"{planner}.motion_model_for_search")
        if model in ("DUBIN", "REEDS_SHEPP"):  # the latter drives in reverse, too
            radius = own.get(f"{planner}.minimum_turning_radius", 0.4)
            with errors_at(path, f"planner_server: {planner}"):
                reverse = model == "REEDS_SHEPP"
                return Kinematics(drive="car-like", turning_radius=radius, reverse=reverse)
    sideways = _motion_model(str(parameters.of(AMCL).get("robot_model_type"))) == OMNIDIRECTIONAL
    return Kinematics(drive="omnidirectional") if sideways else None


def _motion_model(name: str) -> str:
    """The name of AMCL's motion model, or that of one which was named otherwise before Humble."""
    older = {"differential": DIFFERENTIAL, "omnidirectional": OMNIDIRECTIONAL}
    return older.get(name, name)


@contextmanager
def errors_at(path: str | os.PathLike[str], where: str = "") -> Iterator[None]:
    """Name the file, and the place in it, in an error of the block."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"{path}: {where}{': ' if where else ''}{error}") from None


def _not_simulated(given: Mapping[str, object]) -> Iterator[str]:
    """Names of parameters in `NO_MATTER` that do matter with the values given."""
    for name in ("recovery_alpha_slow", "recovery_alpha_fast"):
        if given.get(name):
            yield name
    if given.get("do_beamskip") and given.get("laser_model_type") == "likelihood_field_prob":
        yield "do_beamskip"


def names_of(kind: type) -> list[str]:
    """Names of the settings of a part."""
    return [each.name for each in dataclasses.fields(kind)]


def outline_of(value: Any) -> Any:
    """A footprint of a list of corners; anything else as it is."""
    return Footprint(np.asarray(value)) if isinstance(value, (list, tuple)) else value


def parts_in(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What a file of any kind says of a robot, by the names of `Robot`'s fields."""
    file = file_path("a robot's file", path)
    suffix = file.suffix.lower()
    if suffix in (".urdf", ".sdf", ".xml", ".world", ".xacro"):
        return {"lidar": Lidar.from_file(file)}
    if suffix in (".yaml", ".yml", ".json") and file.exists():
        content = values_in(file, read_content(file, MAX_BYTES, REMEDY), REMEDY)
        if isinstance(content.get("robot"), dict):
            if "version" in content:  # what calibrate wrote has settings of a field besides
                check_stamp(path, content, "robot", VERSION)
            with errors_at(path):
                return made(content["robot"])
        if suffix == ".json":  # a calibration that is older, or one of a field alone
            raise ConfigError(f'{path}: has no entry "robot"; {REMEDY}, or calibrate it again')
    return parts_of(path)


def made(about: Mapping[str, Any]) -> dict[str, Any]:
    """Parts of a robot that plain data describe."""
    _check_known("a robot", about, [*PARTS, *OWN])
    found = {name: _part(name, value) if name in PARTS else value for name, value in about.items()}
    if "footprint" in found:
        found["footprint"] = outline_of(found["footprint"])
    return found


def _part(name: str, value: Any) -> Any:
    kind = PARTS[name]
    if value is None or isinstance(value, str):
        return value  # no such part, or the name of a lidar
    if not isinstance(value, Mapping):
        raise ConfigError(f"{name} must hold settings by name, not {shown(value)}")
    if name == "filter" and value.keys() == {"title", "settings"}:
        return NamedFilter(**value)
    _check_known(name, value, names_of(kind))
    try:
        return kind(**value)
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}") from None


def _check_known(what: str, given: Mapping[str, Any], known: list[str]) -> None:
    for each in given:
        if each not in known:
            raise ConfigError(f"{what} has no {shown(each)}; it has {', '.join(known)}")
