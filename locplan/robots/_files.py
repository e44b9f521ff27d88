"""Files of a robot: locplan's own, Nav2's parameters, and the lidar of a URDF or SDF."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from locplan._util.checks import file_path, shown, suggestion
from locplan._util.reading import check_stamp, read_content
from locplan.errors import ConfigError
from locplan.robots._amcl import Amcl, NamedFilter
from locplan.robots._descriptions import SUFFIXES as DESCRIPTIONS, lidar_in
from locplan.robots._lidar import Lidar
from locplan.robots._nav2 import errors_at, parts_of
from locplan.robots._parameters import MAX_BYTES, values_in
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


def names_of(kind: type) -> list[str]:
    """Names of the settings of a part."""
    return [each.name for each in dataclasses.fields(kind)]


def outline_of(value: Any) -> Any:
    """A footprint of a list of corners; anything else as it is."""
    return Footprint(np.asarray(value)) if isinstance(value, (list, tuple)) else value


def parts_in(path: str | os.PathLike[str], lidar: Lidar | None = None) -> dict[str, Any]:
    """What a file of any kind says of a robot, by the names of `Robot`'s fields.

    A lidar that is known gets its mount from a URDF or SDF, and replaces that of any file.
    """
    file = file_path("a robot's file", path)
    suffix = file.suffix.lower()
    if suffix in DESCRIPTIONS:
        return {"lidar": lidar_in(file, lidar)}
    parts = _parameters_in(path, file, suffix)
    if lidar:
        parts.pop("lidar", None)
    return parts


def _parameters_in(path: str | os.PathLike[str], file: Path, suffix: str) -> dict[str, Any]:
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
            names = f"{', '.join(known)}{suggestion(each, known)}"
            raise ConfigError(f"{what} has no {shown(each)}; it has {names}")
