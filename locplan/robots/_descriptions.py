"""The lidar of a robot's description: the only ray sensor of a URDF or SDF, with its mount."""

from __future__ import annotations

import dataclasses
import math
import re
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from locplan._kernels.arrays import Floats
from locplan._util.checks import finite_numbers, shown
from locplan._util.poses import in_plane, upward
from locplan._util.reading import MAX_BYTES, read_bytes
from locplan.errors import ConfigError
from locplan.robots._lidar import Lidar
from locplan.robots._links import Links
from locplan.robots._nav2 import errors_at

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

SUFFIXES = (".urdf", ".sdf", ".xml", ".world", ".xacro", ".launch")
"""Endings of files in XML; `.launch` is one of ROS 1, which gets an error of its own."""
SENSOR_TYPES = ("ray", "gpu_ray", "lidar", "gpu_lidar")
"""Types of lidars in all versions of Gazebo."""


class Mount(NamedTuple):
    """Pose of a lidar on the robot."""

    x: float
    y: float
    yaw: float
    upside_down: bool


def lidar_in(file: Path, lidar: Lidar | None = None) -> Lidar:
    """Return the lidar that a file describes, with its mount; or a known lidar with that mount.

    Parameters
    ----------
    file : Path
        A URDF or SDF; see `Lidar.from_file`.
    lidar : Lidar, optional
        The lidar, if it is known. Then the file needs no sensor: the only link that is named as a
        scanner's frame has the mount. A lidar with a mount keeps it.
    """
    with errors_at(file):
        if file.suffix.lower() in (".yaml", ".yml"):
            raise ConfigError(
                "parameters name no lidar, their ranges only limit one; name a lidar of"
                " locplan.robots.PRESETS, or give the robot's URDF or SDF"
            )
        tree = Links(_root(file), file)
        sensors = _planar_sensors(tree.root)
        if lidar is None:
            return _lidar_of_sensor(_only_sensor(sensors, tree.root), tree)
        return _with_mount(lidar, sensors, tree)


def _only_sensor(sensors: list[Element], root: Element) -> Element:
    if len(sensors) == 1:
        return sensors[0]
    if sensors:
        names = ", ".join(shown(sensor.get("name")) for sensor in sensors[:5])
        raise ConfigError(
            f"has {len(sensors)} planar lidars ({names}); leave one sensor of type ray or lidar in"
            " the file"
        )
    if any("xacro" in element.tag.partition("}")[0] for element in root.iter()):
        raise ConfigError("has no planar lidar, but macros; run xacro on it first")
    raise ConfigError("has no planar lidar; name the robot's, such as lidar='turtlebot4'")


def _with_mount(lidar: Lidar, sensors: list[Element], tree: Links) -> Lidar:
    """Return the lidar with the mount of the file's only sensor or scanner's frame."""
    if lidar.mount_x or lidar.mount_y or lidar.mount_yaw_deg:
        return lidar
    if len(sensors) == 1:
        described = _lidar_of_sensor(sensors[0], tree)
        mounts = ("mount_x", "mount_y", "mount_yaw_deg")
        return dataclasses.replace(lidar, **{name: getattr(described, name) for name in mounts})
    links = [] if sensors else tree.scanner_links()
    if len(links) == 1:
        mount = _horizontal(tree.pose_of_link(links[0]))
        yaw = math.degrees(mount.yaw)
        return dataclasses.replace(lidar, mount_x=mount.x, mount_y=mount.y, mount_yaw_deg=yaw)
    names = ", ".join(shown(each.get("name")) for each in (sensors or links)[:5])
    if sensors or links:
        several = "planar lidars" if sensors else "links named like a scanner"
        tree.warn(f"has {len(sensors or links)} {several} ({names})")
    else:
        tree.warn("has no link named like a scanner")
    return lidar


def _planar_sensors(root: Element) -> list[Element]:
    sensors = [each for each in root.iter("sensor") if each.get("type") in SENSOR_TYPES]
    return [each for each in sensors if _number(each, ".//vertical/samples", 1.0) <= 1]


def _lidar_of_sensor(sensor: Element, tree: Links) -> Lidar:
    value = partial(_number, sensor)
    first, last = value(".//horizontal/min_angle"), value(".//horizontal/max_angle")
    beams = int(value(".//horizontal/samples") * value(".//horizontal/resolution", 1.0))
    if beams < 2:
        raise ConfigError(f"its lidar has {beams} beams, but needs at least 2")
    mount = _horizontal(tree.pose_of_sensor(sensor))
    if mount.upside_down:
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
        mount=mount[:3],
        range_sigma=(value(".//noise/stddev", 0.0) if gaussian else 0.0) or None,
        model=sensor.get("name") or "",
    )
    # Gazebo casts all samples, also where the last one of a full circle meets the first.
    return dataclasses.replace(lidar, beams=beams)


def _horizontal(pose: Floats) -> Mount:
    """Return the mount that a pose is; a ConfigError if the lidar is tilted."""
    up = float(upward(pose)[0])
    if abs(up) < math.cos(math.radians(10)):
        raise ConfigError("its lidar is tilted; locplan supports horizontal lidars only")
    x, y, yaw = in_plane(pose)[0].tolist()
    return Mount(round(x, 9), round(y, 9), round(yaw, 9), up < 0)


def _root(file: Path) -> Element:
    from xml.etree import ElementTree

    try:
        content = read_bytes(file, MAX_BYTES)
    except OSError as error:
        raise ConfigError(f"cannot be read ({error.strerror or error})") from None
    if b"<!ENTITY" in content:
        raise ConfigError("is no robot's description; name a URDF or SDF file")
    begin = _declaration(content)
    try:
        root = ElementTree.fromstring(content[begin:])
    except ElementTree.ParseError as error:
        line = content.count(b"\n", 0, begin) + error.position[0]
        raise ConfigError(f"is no XML, see line {line}; name a URDF or SDF file") from None
    except (ValueError, LookupError):  # of an encoding that Python does not know
        raise ConfigError("is no XML; name a URDF or SDF file") from None
    if root.tag == "launch":
        raise ConfigError(_launch_fault(root))
    return root


def _launch_fault(launch: Element) -> str:
    nodes = [*launch.iter("node"), *launch.iter("include")]
    ros1 = any(node.get("type") or "$(find " in (node.get("file") or "") for node in nodes)
    if ros1:
        return (
            "is a launch file of ROS 1, whose parameters locplan does not read; write them into a"
            " YAML of Nav2 (amcl: ros__parameters: ...), or give the robot's URDF"
        )
    return "is a launch file; give the YAML of parameters or the URDF that it names"


def _declaration(content: bytes) -> int:
    """Return where the XML declaration begins, if only comments and blanks stand before it.

    Such a file is not well-formed, but Gazebo and many parsers read it.
    """
    blanks = re.compile(rb"(?:\xef\xbb\xbf)?\s*")
    begin = blanks.match(content).end()  # type: ignore[union-attr]
    while content.startswith(b"<!--", begin) and (end := content.find(b"-->", begin)) > 0:
        begin = blanks.match(content, end + 3).end()  # type: ignore[union-attr]
    return begin if content.startswith(b"<?xml", begin) else 0


def _number(sensor: Element, where: str, default: float | None = None) -> float:
    text, name = sensor.findtext(where), where.removeprefix(".//")
    if text is None and default is None:
        raise ConfigError(f"its lidar has no {name}")
    values = finite_numbers(default if text is None else text)
    if not values:
        what = f"{name} must be a number, not {shown(text)}"
        raise ConfigError(f"{what}; run xacro on a .xacro file first")
    return values[0]
