"""Files of a robot: locplan's own, Nav2's parameters, and the lidar of a URDF or SDF."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._util.checks import file_path, finite_numbers, shown
from locplan._util.reading import MAX_BYTES as MAX_XML_BYTES, check_stamp, read_bytes, read_content
from locplan.errors import ConfigError
from locplan.robots._amcl import Amcl, NamedFilter
from locplan.robots._lidar import Lidar
from locplan.robots._nav2 import errors_at, parts_of
from locplan.robots._parameters import MAX_BYTES, values_in
from locplan.robots._parts import Disturbances, Footprint, Inflation, Kinematics, Odometry

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

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


def lidar_in(file: Path) -> Lidar:
    """The only planar lidar that a file describes; see `Lidar.from_file`."""
    with errors_at(file):
        return _described(_sensor(file))


def _sensor(file: Path) -> Element:
    if file.suffix.lower() in (".yaml", ".yml"):
        raise ConfigError(
            "parameters name no lidar, their ranges only limit one; name a lidar of"
            " locplan.robots.PRESETS, or give the robot's URDF or SDF"
        )
    kinds = ("ray", "gpu_ray", "lidar", "gpu_lidar")  # in the words of all versions of Gazebo
    sensors = [each for each in _root(file).iter("sensor") if each.get("type") in kinds]
    planar = [each for each in sensors if _number(each, ".//vertical/samples", 1.0) <= 1]
    if len(planar) != 1:
        names = ", ".join(shown(each.get("name")) for each in planar[:5])
        what = f"has {len(planar)} planar lidars ({names})" if planar else "has no planar lidar"
        raise ConfigError(f"{what}; leave one sensor of type ray or lidar in the file")
    return planar[0]


def _described(sensor: Element) -> Lidar:
    value = partial(_number, sensor)
    first, last = value(".//horizontal/min_angle"), value(".//horizontal/max_angle")
    beams = int(value(".//horizontal/samples") * value(".//horizontal/resolution", 1.0))
    if beams < 2:
        raise ConfigError(f"its lidar has {beams} beams; there must be 2 at least")
    x, y, _, roll, pitch, yaw = _pose(sensor)
    if max(abs(math.sin(roll)), abs(math.sin(pitch))) > 0.1 or math.cos(pitch) < 0:
        raise ConfigError("its lidar is tilted; locplan knows horizontal ones only")
    if math.cos(roll) < 0:  # it is mounted upside down
        first, last = -last, -first
    noise = sensor.find(".//noise")
    kind = "" if noise is None else noise.get("type") or noise.findtext("type") or ""
    gaussian = kind.strip().startswith("gaussian")
    lidar = Lidar.from_scan(
        angle_min=first,
        angle_max=last,
        angle_increment=(last - first) / (beams - 1),
        range_min=value(".//range/min", 0.0),
        range_max=value(".//range/max"),
        mount=(x, y, yaw),
        range_sigma=(value(".//noise/stddev", 0.0) if gaussian else 0.0) or None,
        model=sensor.get("name") or "",
    )
    # Gazebo casts all samples, also where the last one of a full circle meets the first.
    return dataclasses.replace(lidar, beams=beams)


def _root(file: Path) -> Element:
    from xml.etree import ElementTree

    try:
        content = read_bytes(file, MAX_XML_BYTES)
    except OSError as error:
        raise ConfigError(f"cannot be read ({error.strerror or error})") from None
    if b"<!ENTITY" in content:
        raise ConfigError("is no robot's description; name a URDF or SDF file")
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError):
        raise ConfigError("is no XML; name a URDF or SDF file, not a .xacro") from None


def _pose(sensor: Element) -> tuple[float, ...]:
    pose = sensor.find("pose")
    text = sensor.findtext("pose") or "0 0 0 0 0 0"
    values = finite_numbers(text.split())
    if len(values) != 6:
        raise ConfigError(f"the lidar's pose must be six numbers, not {shown(text)}")
    if pose is not None and pose.get("degrees") in ("true", "1"):
        return (*values[:3], *map(math.radians, values[3:]))
    return values


def _number(sensor: Element, where: str, default: float | None = None) -> float:
    text, name = sensor.findtext(where), where.removeprefix(".//")
    if text is None and default is None:
        raise ConfigError(f"its lidar has no {name}")
    values = finite_numbers(default if text is None else text)
    if not values:
        what = f"{name} must be a number, not {shown(text)}"
        raise ConfigError(f"{what}; run xacro on a .xacro file first")
    return values[0]
