"""Robot descriptions in URDF and SDF: the pose and settings of the lidar."""

from __future__ import annotations

import dataclasses
import math
import re
import warnings
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from locplan._support.checks import FARTHEST, parse_finite_numbers, short_repr
from locplan._support.kernels.arrays import Floats
from locplan._support.poses import (
    compose_transforms,
    compute_uprightness,
    invert_transforms,
    is_transform,
    project_to_plane,
)
from locplan._support.reading import MAX_BYTES, read_bytes
from locplan.errors import ConfigError
from locplan.robots.lidar import Lidar
from locplan.robots.nav2 import ParameterWarning, name_file_in_errors

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element


BASES = ("base_footprint", "base_link", "base")
"""Usual names of the base link, after a prefix such as robot1/."""
SCANNERS = re.compile(r".*lidar|.*laser|scan|scanner|lds|hokuyo|sick|urg|utm|ust|tim|lms")
"""A word in the name of a scanner's frame, such as laser_frame or base_scan."""
MAX_DEPTH = 200
"""Maximum number of SDF frames that are relative to each other."""


IDENTITY = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])


class _UnknownFrame(Exception):
    """Error: a pose is relative to a frame that the file does not have."""


class RobotLinks:
    """The links of a robot's description, with their poses."""

    def __init__(self, root: Element, file: Path) -> None:
        self.root, self.file = root, file
        self._parents = {child: parent for parent in root.iter() for child in parent}
        self._joints = {_find_joint_link(joint, "child"): joint for joint in root.findall("joint")}

    def warn_of_missing_mount(self, fault: str) -> None:
        """Warn that the file lacks the lidar's mount."""
        remedy = "set mount_x, mount_y and mount_yaw_deg unless the lidar sits at 0, 0, 0"
        warnings.warn(ParameterWarning(f"{self.file}: {fault}; {remedy}"), stacklevel=6)

    def pose_of_sensor(self, sensor: Element) -> Floats:
        """Return the pose of a sensor on the base link; warn if the file lacks it."""
        pose = _parse_pose(sensor, "the lidar's pose")
        carrier = self._parents.get(sensor)
        if carrier is None:
            return pose
        try:
            if carrier.tag == "link":
                frame, model = _find_reference_frame(sensor), self._parents.get(carrier)
                if frame and model is not None:
                    return compose_transforms(
                        self._pose_on_base(model, _frame_pose_in_model(model, frame)), pose
                    )
                return compose_transforms(self._pose_on_robot(carrier), pose)
            if carrier.tag == "gazebo" and (name := carrier.get("reference")):
                return compose_transforms(self._pose_from_joints(name), pose)
        except _UnknownFrame as normalize_frame_name:
            self._warn_of_frame(normalize_frame_name)
        return pose

    def pose_of_link(self, link: Element) -> Floats:
        """Return the pose of a link on the base link; warn if the file lacks it."""
        try:
            return self._pose_on_robot(link)
        except _UnknownFrame as normalize_frame_name:
            self._warn_of_frame(normalize_frame_name)
            return IDENTITY

    def find_scanner_links(self) -> list[Element]:
        """List the links named like a scanner's frame; of a chain of them the last."""
        links: dict[str, Element] = {}
        for link in self.root.iter("link"):
            name = link.get("name") or ""
            if any(map(SCANNERS.fullmatch, re.findall("[a-z]+", name.lower()))):
                links[name] = link
        carriers = {
            _find_joint_link(self._joints[name], "parent") for name in links if name in self._joints
        }
        return [link for name, link in links.items() if name not in carriers]

    def _warn_of_frame(self, name: _UnknownFrame) -> None:
        """Warn that the file does not have a frame."""
        self.warn_of_missing_mount(
            f"has no pose of {short_repr(str(name))}, which carries the lidar"
        )

    def _pose_on_robot(self, link: Element) -> Floats:
        """Return the pose of a link of a URDF or SDF on the base link."""
        model = self._parents.get(link)
        if model is not None and model.tag == "model":
            return self._pose_on_base(model, _pose_in_model(model, link))
        return self._pose_from_joints(link.get("name") or "")

    def _pose_on_base(self, model: Element, pose: Floats) -> Floats:
        """Return a pose in an SDF model on the base link, or in the outermost model without one."""
        while True:
            links = {_strip_scope(link.get("name")): link for link in model.findall("link")}
            for base in BASES:
                if base in links:
                    return compose_transforms(
                        invert_transforms(_pose_in_model(model, links[base])), pose
                    )
            outer = self._parents.get(model)
            if outer is None or outer.tag != "model":
                return pose
            pose, model = compose_transforms(_pose_in_model(outer, model), pose), outer

    def _pose_from_joints(self, name: str) -> Floats:
        """Return the pose of a URDF's link on the base link: the topmost of a usual name, or the
        root of the chain."""
        if name not in self._joints and all(
            link.get("name") != name for link in self.root.findall("link")
        ):
            raise _UnknownFrame(name)
        pose, poses = IDENTITY, dict[str, Floats]()
        while name not in poses:
            poses[name] = pose
            joint = self._joints.get(name)
            if joint is None:
                bases = [link_name for link_name in poses if _strip_scope(link_name) in BASES]
                return poses[bases[-1] if bases else name]
            pose, name = (
                compose_transforms(_read_joint_origin(joint), pose),
                _find_joint_link(joint, "parent"),
            )
        raise ConfigError(
            f"its joints form a circle at {short_repr(name)}; give each link one parent"
        )


def _pose_in_model(model: Element, element: Element, depth: int = 0) -> Floats:
    """Return the pose of a link, joint, frame or nested model in its SDF model."""
    if depth > MAX_DEPTH:
        raise ConfigError(f"its frames form a circle, or a chain of over {MAX_DEPTH}")
    pose = _parse_pose(element, f"the pose of {short_repr(element.get('name'))}")
    default = {"frame": element.get("attached_to"), "joint": element.findtext("child")}.get(
        element.tag
    )
    frame = (_find_reference_frame(element) or default or "").strip()
    if frame:
        pose = compose_transforms(_frame_pose_in_model(model, frame, depth + 1), pose)
    placed = element.get("placement_frame") if element.tag == "model" else None
    if placed:
        pose = compose_transforms(
            pose, invert_transforms(_frame_pose_in_model(element, placed, depth + 1))
        )
    return pose


def _frame_pose_in_model(model: Element, name: str, depth: int = 0) -> Floats:
    """Return the pose of a frame in an SDF model by its name, such as base_link or arm::hand."""
    if name == "__model__":
        return IDENTITY
    first, _, inner = name.partition("::")
    for tag in ("model",) if inner else ("link", "frame", "joint", "model"):
        for part in model.findall(tag):
            if part.get("name") == first:
                pose = _pose_in_model(model, part, depth)
                return (
                    compose_transforms(pose, _frame_pose_in_model(part, inner, depth + 1))
                    if inner
                    else pose
                )
    raise _UnknownFrame(name)


def _find_reference_frame(element: Element) -> str:
    """Return the name of the frame that a pose is relative to."""
    pose = element.find("pose")
    return "" if pose is None else (pose.get("relative_to") or "").strip()


def _find_joint_link(joint: Element, role: str) -> str:
    """Return the parent or child link of a URDF's joint; empty without one."""
    link = joint.find(role)
    return "" if link is None else link.get("link") or ""


def _strip_scope(name: str | None) -> str:
    """Return a name without its prefixes, such as robot1/."""
    return (name or "").rpartition("/")[2]


def _read_joint_origin(joint: Element) -> Floats:
    """Return the pose of a URDF's joint in its parent link."""
    origin = joint.find("origin")
    attributes = {} if origin is None else origin.attrib
    texts = [attributes.get(name) or "0 0 0" for name in ("xyz", "rpy")]
    subject = f"the origin of joint {short_repr(joint.get('name'))}"
    return _make_transform(_parse_six_numbers(" ".join(texts), subject))


def _parse_pose(element: Element, subject: str) -> Floats:
    """Return the pose in an SDF element, the identity without one."""
    pose = element.find("pose")
    text = "" if pose is None else (pose.text or "").strip()
    if pose is None or not text:
        return IDENTITY
    if pose.get("rotation_format") == "quat_xyzw":
        values = parse_finite_numbers(text.split())
        if len(values) != 7 or not is_transform(values):
            raise ConfigError(f"{subject} must be x y z and a quaternion, not {short_repr(text)}")
        return np.array([values])
    values = _parse_six_numbers(text, subject)
    if pose.get("degrees") in ("true", "1"):
        values = (*values[:3], *map(math.radians, values[3:]))
    return _make_transform(values)


def _parse_six_numbers(text: str, subject: str) -> tuple[float, ...]:
    """Parse x, y, z, roll, pitch, yaw."""
    values = parse_finite_numbers(text.split())
    if len(values) != 6 or max(map(abs, values)) > FARTHEST:
        macro = "; run xacro on a .xacro file first" if "$" in text else ""
        raise ConfigError(f"{subject} must be six numbers [m, rad], not {short_repr(text)}{macro}")
    return values


def _make_transform(pose: tuple[float, ...]) -> Floats:
    """Return the transform of x, y, z, roll, pitch, yaw [m, rad]."""
    place = np.array([[*pose[:3], 0.0, 0.0, 0.0, 1.0]])
    for axis in (2, 1, 0):  # the yaw first, about the axes of what it has turned
        turn = np.zeros(7)
        turn[[3 + axis, 6]] = math.sin(pose[3 + axis] / 2), math.cos(pose[3 + axis] / 2)
        place = compose_transforms(place, turn[None])
    return place


SUFFIXES = (".urdf", ".sdf", ".xml", ".world", ".xacro", ".launch")
"""Endings of files in XML; `.launch` is one of ROS 1, which gets an error of its own."""
SENSOR_TYPES = ("ray", "gpu_ray", "lidar", "gpu_lidar")
"""Types of lidars in all versions of Gazebo."""


class LidarMount(NamedTuple):
    """Pose of a lidar on the robot."""

    x: float
    y: float
    yaw: float
    upside_down: bool


def read_lidar(file: Path, lidar: Lidar | None = None) -> Lidar:
    """Read the lidar that a file describes, with its mount; or the mount of a known lidar.

    Parameters
    ----------
    file : Path
        A URDF or SDF; see `Lidar.from_file`.
    lidar : Lidar, optional
        The lidar, if it is known. Then the file needs no sensor: the only link that is named as a
        scanner's frame has the mount. A lidar with a mount keeps it.
    """
    with name_file_in_errors(file):
        if file.suffix.lower() in (".yaml", ".yml"):
            raise ConfigError(
                "Nav2's parameters only limit a lidar's range; name a lidar of"
                " locplan.robots.LIDARS, or give the robot's URDF or SDF"
            )
        tree = RobotLinks(_read_root(file), file)
        sensors = _find_planar_sensors(tree.root)
        if lidar is None:
            return _lidar_from_sensor(_find_only_sensor(sensors, tree.root), tree)
        return _add_mount(lidar, sensors, tree)


def _find_only_sensor(sensors: list[Element], root: Element) -> Element:
    """Return the only planar lidar; a ConfigError if there are none or several."""
    if len(sensors) == 1:
        return sensors[0]
    if sensors:
        names = ", ".join(short_repr(sensor.get("name")) for sensor in sensors[:5])
        raise ConfigError(
            f"has {len(sensors)} planar lidars ({names}); leave one sensor of type ray or lidar in"
            " the file"
        )
    if any("xacro" in node.tag.partition("}")[0] for node in root.iter()):
        raise ConfigError("has no planar lidar, but macros; run xacro on it first")
    raise ConfigError("has no planar lidar; name the robot's, such as lidar='turtlebot4'")


def _add_mount(lidar: Lidar, sensors: list[Element], robot_links: RobotLinks) -> Lidar:
    """Return the lidar with the mount of the file's only sensor or scanner's frame."""
    if lidar.mount_x or lidar.mount_y or lidar.mount_yaw_deg:
        return lidar
    if len(sensors) == 1:
        described = _lidar_from_sensor(sensors[0], robot_links)
        return dataclasses.replace(
            lidar,
            mount_x=described.mount_x,
            mount_y=described.mount_y,
            mount_yaw_deg=described.mount_yaw_deg,
        )
    links = [] if sensors else robot_links.find_scanner_links()
    if len(links) == 1:
        mount = _mount_from_pose(robot_links.pose_of_link(links[0]))
        yaw = math.degrees(mount.yaw)
        return dataclasses.replace(lidar, mount_x=mount.x, mount_y=mount.y, mount_yaw_deg=yaw)
    names = ", ".join(short_repr(part.get("name")) for part in (sensors or links)[:5])
    if sensors or links:
        several = "planar lidars" if sensors else "links named like a scanner"
        robot_links.warn_of_missing_mount(f"has {len(sensors or links)} {several} ({names})")
    else:
        robot_links.warn_of_missing_mount("has no link named like a scanner")
    return lidar


def _find_planar_sensors(root: Element) -> list[Element]:
    """List the lidars with one row of beams."""
    sensors = [sensor for sensor in root.iter("sensor") if sensor.get("type") in SENSOR_TYPES]
    return [sensor for sensor in sensors if _read_number(sensor, ".//vertical/samples", 1.0) <= 1]


def _lidar_from_sensor(sensor: Element, robot_links: RobotLinks) -> Lidar:
    """Return the lidar that a sensor element describes."""
    value = partial(_read_number, sensor)
    first, last = value(".//horizontal/min_angle"), value(".//horizontal/max_angle")
    beams = int(value(".//horizontal/samples") * value(".//horizontal/resolution", 1.0))
    if beams < 2:
        raise ConfigError(f"its lidar has {beams} beams, but needs at least 2")
    mount = _mount_from_pose(robot_links.pose_of_sensor(sensor))
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


def _mount_from_pose(pose: Floats) -> LidarMount:
    """Return the mount of a lidar at a pose; a ConfigError if it is tilted."""
    up = float(compute_uprightness(pose)[0])
    if abs(up) < math.cos(math.radians(10)):
        raise ConfigError("its lidar is tilted; locplan supports horizontal lidars only")
    x, y, yaw = project_to_plane(pose)[0].tolist()
    return LidarMount(round(x, 9), round(y, 9), round(yaw, 9), up < 0)


def _read_root(file: Path) -> Element:
    """Read the root element of an XML file."""
    from xml.etree import ElementTree

    try:
        content = read_bytes(file, MAX_BYTES)
    except OSError as error:
        raise ConfigError(f"cannot be read ({error.strerror or error})") from None
    if b"<!ENTITY" in content:
        raise ConfigError("is no robot's description; name a URDF or SDF file")
    begin = _find_xml_declaration(content)
    try:
        root = ElementTree.fromstring(content[begin:])
    except ElementTree.ParseError as error:
        line = content.count(b"\n", 0, begin) + error.position[0]
        raise ConfigError(f"is no XML, see line {line}; name a URDF or SDF file") from None
    except (ValueError, LookupError):  # of an encoding that Python does not know
        raise ConfigError("is no XML; name a URDF or SDF file") from None
    if root.tag == "launch":
        raise ConfigError(_explain_launch_file(root))
    return root


def _explain_launch_file(launch: Element) -> str:
    """Return the reason why a launch file cannot be read."""
    nodes = [*launch.iter("node"), *launch.iter("include")]
    ros1 = any(node.get("type") or "$(find " in (node.get("file") or "") for node in nodes)
    if ros1:
        return (
            "is a launch file of ROS 1, whose parameters locplan does not read; write them into a"
            " YAML of Nav2 (amcl: ros__parameters: ...), or give the robot's URDF"
        )
    return "is a launch file; give the YAML of parameters or the URDF that it names"


def _find_xml_declaration(content: bytes) -> int:
    """Return the position of the XML declaration, if only comments and blanks precede it.

    Such a file is not well-formed, but Gazebo and many parsers read it.
    """
    blanks = re.compile(rb"(?:\xef\xbb\xbf)?\s*")
    begin = blanks.match(content).end()  # type: ignore[union-attr]
    while content.startswith(b"<!--", begin) and (end := content.find(b"-->", begin)) > 0:
        begin = blanks.match(content, end + 3).end()  # type: ignore[union-attr]
    return begin if content.startswith(b"<?xml", begin) else 0


def _read_number(sensor: Element, tag_path: str, default: float | None = None) -> float:
    """Read a number from a sensor element."""
    text, name = sensor.findtext(tag_path), tag_path.removeprefix(".//")
    if text is None and default is None:
        raise ConfigError(f"its lidar has no {name}")
    values = parse_finite_numbers(default if text is None else text)
    if not values:
        fault = f"{name} must be a number, not {short_repr(text)}"
        raise ConfigError(f"{fault}; run xacro on a .xacro file first")
    return values[0]
