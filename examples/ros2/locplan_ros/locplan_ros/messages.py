"""The content of the node's messages, as dictionaries for rosidl_runtime_py.set_message_fields.

Fields and constants read from ros2/common_interfaces: geometry_msgs, diagnostic_msgs and
visualization_msgs.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from locplan_ros.field_file import FieldFile
from locplan_ros.watch import CLEAR, DEGENERATE, Reading, ellipse, spread

OK, WARN = b"\x00", b"\x01"
"""diagnostic_msgs/DiagnosticStatus.level."""
CYLINDER, TEXT = 3, 9
"""visualization_msgs/Marker.type."""
ADD, DELETE = 0, 2
"""visualization_msgs/Marker.action."""
SHARP, VERMILION = np.array([0.0, 0.45, 0.7]), np.array([0.84, 0.37, 0.0])
"""Colours of u = 0 and of u = 1, which the colour-blind tell apart."""
UNKNOWN_HEADING = math.pi**2 / 3
"""Variance of a heading of which nothing is known [rad^2]."""
Fields = dict[str, Any]


def header(stamp: Fields, frame: str) -> Fields:
    """std_msgs/Header; a stamp is {"sec": ..., "nanosec": ...}."""
    return {"stamp": stamp, "frame_id": frame}


def pose(x: float, y: float, yaw: float) -> Fields:
    """geometry_msgs/Pose on the plane."""
    turn = {"z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}
    return {"position": {"x": float(x), "y": float(y)}, "orientation": turn}


def yaw_of(x: float, y: float, z: float, w: float) -> float:
    """Heading of a quaternion [rad]."""
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def covariance_6x6(covariance: np.ndarray) -> list[float]:
    """A covariance of (x, y, theta), or of (x, y), as PoseWithCovariance has it.

    36 numbers row by row, in the order x, y, z and rotation about x, y, z, along the axes of the
    message's frame. What the plane has not, z and the rotations about x and y, stays 0, as AMCL
    leaves it.
    """
    full = np.zeros((6, 6))
    places = [0, 1, 5][: len(covariance)]
    full[np.ix_(places, places)] = covariance
    if len(covariance) == 2:
        full[5, 5] = UNKNOWN_HEADING
    return [float(value) for value in full.ravel()]


def pose_with_covariance(stamp: Fields, frame: str, reading: Reading) -> Fields:
    """geometry_msgs/PoseWithCovarianceStamped: the robot's pose, what a match there would know."""
    at = pose(reading.x, reading.y, reading.heading)
    value = {"pose": at, "covariance": covariance_6x6(reading.covariance)}
    return {"header": header(stamp, frame), "pose": value}


def diagnostics(stamp: Fields, reading: Reading) -> Fields:
    """diagnostic_msgs/DiagnosticArray of the state."""
    texts = {
        CLEAR: "a match knows the pose here",
        DEGENERATE: "degenerate place",
    }
    values = {"u": f"{reading.u:.3f}", "x": f"{reading.x:.3f}", "y": f"{reading.y:.3f}"}
    if reading.is_known:
        major, minor, direction = ellipse(reading.covariance)
        values["major_std_m"] = f"{major:.4f}"
        values["minor_std_m"] = f"{minor:.4f}"
        values["major_axis_deg"] = f"{math.degrees(direction):.1f}"
    status = {
        "level": OK if reading.state == CLEAR else WARN,
        "name": "localizability",
        "message": texts.get(reading.state, "the field has no value here"),
        "values": [{"key": key, "value": value} for key, value in values.items()],
    }
    return {"header": header(stamp, ""), "status": [status]}


def warning(stamp: Fields, frame: str, reading: Reading) -> Fields:
    """visualization_msgs/Marker: a text above the robot in a degenerate place, or its removal."""
    marker = {"header": header(stamp, frame), "ns": "warning", "id": 0, "type": TEXT}
    if reading.state == CLEAR or not reading.is_known:
        return marker | {"action": DELETE}
    at = pose(reading.x, reading.y, 0.0)
    at["position"]["z"] = 1.0
    text = f"degenerate: u {reading.u:.2f}\n{spread(reading.covariance)}"
    look = {"scale": {"z": 0.4}, "color": _color(VERMILION, 1.0), "text": text}
    return marker | {"action": ADD, "pose": at} | look


def ellipses(stamp: Fields, frame: str, field: FieldFile, spacing: float, scale: float) -> Fields:
    """visualization_msgs/MarkerArray: the field's ellipses, blue where sharp, else vermilion."""
    markers = []
    for n, (x, y) in enumerate(field.positions(spacing)):
        u, covariance = field.at(x, y)
        major, minor, direction = ellipse(covariance)
        sizes = {"x": max(2 * scale * major, 1e-3), "y": max(2 * scale * minor, 1e-3), "z": 0.02}
        kind = {"header": header(stamp, frame), "ns": "ellipses", "id": n, "type": CYLINDER}
        look = {"scale": sizes, "color": _color(SHARP + u * (VERMILION - SHARP), 0.7)}
        markers.append(kind | {"action": ADD, "pose": pose(x, y, direction)} | look)
    return {"markers": markers}


def _color(rgb: np.ndarray, alpha: float) -> Fields:
    red, green, blue = (float(value) for value in rgb)
    return {"r": red, "g": green, "b": blue, "a": alpha}
