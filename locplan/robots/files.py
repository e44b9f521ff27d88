"""Files of a robot: locplan's robot files, Nav2's parameters, and the lidar of a URDF or SDF."""

from __future__ import annotations

import dataclasses
import os
import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from locplan._support.checks import check_file_path, format_suggestion, short_repr
from locplan._support.reading import check_file_stamp, read_content
from locplan.errors import ConfigError
from locplan.robots.amcl import Amcl, NamedFilter
from locplan.robots.descriptions import SUFFIXES as DESCRIPTIONS, read_lidar
from locplan.robots.lidar import Lidar
from locplan.robots.nav2 import (
    ParameterWarning,
    list_parameter_notes,
    name_file_in_errors,
    read_settings,
)
from locplan.robots.parameters import (
    MAX_BYTES,
    PARAMETERS,
    ParameterFile,
    parse_yaml_values,
    resolve_parameters,
    split_robot_name,
)
from locplan.robots.parts import Disturbances, Footprint, Inflation, Kinematics, Odometry

REMEDY = "give a robot's file, Nav2's parameters, or a URDF or SDF"
VERSION = 1
"""Version of a robot's file."""
ROBOT_SETTINGS = ("footprint", "margin", "goal_tolerance")
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


def list_setting_names(kind: type) -> list[str]:
    """List the names of the settings of a part."""
    return [setting.name for setting in dataclasses.fields(kind)]


def footprint_from_corners(value: Any) -> Any:
    """Return a footprint from a list of corners, and any value but a list unchanged."""
    return Footprint(np.asarray(value)) if isinstance(value, (list, tuple)) else value


def read_robot_parts(
    *paths: str | os.PathLike[str], lidar: Lidar | None = None, planner: str | None = None
) -> Iterator[tuple[str | os.PathLike[str], dict[str, Any]]]:
    """Yield each file with the parts of the robot that are known after it.

    Later files replace single settings. The parameter files of Nav2 are merged by ROS's rules. The
    parts have the names of `Robot`'s fields. A given lidar gets its mount from a URDF or SDF, and
    replaces any lidar in the files. If a planner is named, it decides the drive.
    """
    contents = [_read_robot_file(path, lidar) for path in paths]
    parts: dict[str, Any] = {"lidar": lidar}
    nav2: list[tuple[ParameterFile, str | None]] = []
    before: dict[str, Any] = {}
    for at, (path, content) in enumerate(zip(paths, contents, strict=True)):
        if isinstance(content, tuple):
            nav2.append(content)
            if at + 1 < len(paths) and isinstance(contents[at + 1], tuple):
                continue
            now = read_settings(resolve_parameters(*zip(*nav2, strict=True)), planner)
            content, before = _find_changed_settings(before, now), now
        with name_file_in_errors(path):
            parts = _update_parts(parts, content)
        yield path, parts
    if planner is not None and not nav2:
        raise ConfigError(f"no file has the planner {short_repr(planner)}; give Nav2's parameters")
    if nav2:
        for note in list_parameter_notes(resolve_parameters(*zip(*nav2, strict=True)), planner):
            warnings.warn(ParameterWarning(note), stacklevel=3)


def _read_robot_file(
    path: str | os.PathLike[str], lidar: Lidar | None
) -> dict[str, Any] | tuple[ParameterFile, str | None]:
    """Read settings by `Robot`'s fields, or a file of Nav2 and the robot named in its path."""
    file = check_file_path("a robot's file", path)
    suffix = file.suffix.lower()
    if suffix in DESCRIPTIONS:
        return {"lidar": read_lidar(file, lidar)}
    file, robot = split_robot_name(path)
    content = parse_yaml_values(file, read_content(file, MAX_BYTES, REMEDY), REMEDY)
    if isinstance(content.get("robot"), dict) and not _has_nodes(content["robot"]):
        if "version" in content:  # older files have settings of a field besides
            check_file_stamp(path, content, "robot", VERSION)
        with name_file_in_errors(path):
            settings = _check_settings(content["robot"])
        return {
            name: setting for name, setting in settings.items() if not (lidar and name == "lidar")
        }
    if suffix == ".json":  # a calibration that is older, or one of a field alone
        raise ConfigError(f'{path}: has no entry "robot"; {REMEDY}, or write it again')
    return ParameterFile(file, content), robot


def _has_nodes(content: Mapping[str, Any]) -> bool:
    """True if a namespace in the file holds parameters of nodes."""
    return any(
        name == PARAMETERS or (isinstance(value, Mapping) and _has_nodes(value))
        for name, value in content.items()
    )


def _find_changed_settings(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Return new and changed settings, one by one for parts with named settings."""
    changes: dict[str, Any] = {}
    for name, value in after.items():
        earlier = before.get(name)
        if isinstance(value, Mapping) and isinstance(earlier, Mapping):
            value = _find_changed_settings(earlier, value)
            if not value:
                continue
        elif name in before and value == earlier:
            continue
        changes[name] = value
    return changes


def _update_parts(parts: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parts of a robot with some settings replaced; those without a value stay."""
    changed = dict(parts)
    for name, value in settings.items():
        kind, earlier = PARTS.get(name), parts.get(name)
        if kind and isinstance(value, Mapping) and isinstance(earlier, kind):
            if name == "kinematics" and value.get("drive") not in (None, "car-like"):
                value = {"turning_radius": 0.0, **value}
            try:
                value = dataclasses.replace(earlier, **value)  # type: ignore[type-var]
            except ConfigError as error:
                raise ConfigError(f"{name}: {error}") from None
        if name == "lidar" and isinstance(value, str):
            value = Lidar.preset(value)
        changed |= build_robot_parts({name: value})
    return changed


def build_robot_parts(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Build the parts of a robot from plain data."""
    _check_settings(settings)
    parts = {
        name: _build_part(name, value) if name in PARTS else value
        for name, value in settings.items()
    }
    if "footprint" in parts:
        parts["footprint"] = footprint_from_corners(parts["footprint"])
    return parts


def _check_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return plain data of a robot after checking all names."""
    _check_setting_names("a robot", settings, [*PARTS, *ROBOT_SETTINGS])
    for name, value in settings.items():
        if name in PARTS and isinstance(value, Mapping) and not _is_named_filter(name, value):
            _check_setting_names(name, value, list_setting_names(PARTS[name]))
    return dict(settings)


def _is_named_filter(name: str, value: Mapping[str, Any]) -> bool:
    """True if plain data describe a custom filter."""
    return name == "filter" and value.keys() == {"title", "settings"}


def _build_part(name: str, value: Any) -> Any:
    """Build one part of a robot from plain data."""
    kind = PARTS[name]
    if value is None or isinstance(value, str):
        return value  # no such part, or the name of a lidar
    if isinstance(value, kind):
        return value
    if not isinstance(value, Mapping):
        raise ConfigError(f"{name} must hold settings by name, not {short_repr(value)}")
    if _is_named_filter(name, value):
        return NamedFilter(title=value["title"], settings=value["settings"])
    try:
        return kind(**value)
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}") from None


def _check_setting_names(owner: str, settings: Mapping[str, Any], allowed_names: list[str]) -> None:
    """Raise a ConfigError if a setting has an unknown name."""
    for name in settings:
        if name not in allowed_names:
            names = f"{', '.join(allowed_names)}{format_suggestion(name, allowed_names)}"
            raise ConfigError(f"{owner} has no {short_repr(name)}; it has {names}")
