# Copyright 2026 locplan developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
The content of the node's messages, as dictionaries for rosidl_runtime_py.set_message_fields.

Fields and constants follow ros2/common_interfaces: geometry_msgs, diagnostic_msgs and
visualization_msgs.
"""

from __future__ import annotations

import math
from typing import Any

from locplan_ros.field_file import FieldFile
from locplan_ros.watch import (
    CLEAR,
    compute_ellipse,
    DEGENERATE,
    format_deviations,
    Reading,
)
import numpy as np

OK, WARN = b'\x00', b'\x01'
"""diagnostic_msgs/DiagnosticStatus.level."""
CYLINDER, TEXT = 3, 9
"""visualization_msgs/Marker.type."""
ADD, DELETE = 0, 2
"""visualization_msgs/Marker.action."""
SHARP, VERMILION = np.array([0.0, 0.45, 0.7]), np.array([0.84, 0.37, 0.0])
"""Colours of u = 0 and u = 1, which differ for colour-blind people."""
UNKNOWN_HEADING = math.pi**2 / 3
"""Variance of an unknown heading [rad^2]."""
Fields = dict[str, Any]


def make_header(stamp: Fields, frame: str) -> Fields:
    """Return a std_msgs/Header; a stamp is {"sec": ..., "nanosec": ...}."""
    return {'stamp': stamp, 'frame_id': frame}


def make_pose(x: float, y: float, yaw: float) -> Fields:
    """Return a geometry_msgs/Pose on the plane."""
    turn = {'z': math.sin(yaw / 2), 'w': math.cos(yaw / 2)}
    return {'position': {'x': float(x), 'y': float(y)}, 'orientation': turn}


def yaw_from_quaternion(x: float, y: float, z: float, w: float) -> float:
    """Return the heading of a quaternion [rad]."""
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def make_covariance_6x6(covariance: np.ndarray) -> list[float]:
    """
    Return a covariance of (x, y, theta), or of (x, y), as PoseWithCovariance stores it.

    It has 36 numbers row by row, in the order x, y, z and rotation about x, y, z, along the axes
    of the message's frame. z and the rotations about x and y stay 0, as in AMCL's messages.
    """
    full = np.zeros((6, 6))
    places = [0, 1, 5][: len(covariance)]
    full[np.ix_(places, places)] = covariance
    if len(covariance) == 2:
        full[5, 5] = UNKNOWN_HEADING
    return [float(value) for value in full.ravel()]


def make_pose_with_covariance(stamp: Fields, frame: str, reading: Reading) -> Fields:
    """
    Return a geometry_msgs/PoseWithCovarianceStamped of the robot's pose.

    The covariance is that of a scan match there.
    """
    at = make_pose(reading.x, reading.y, reading.heading)
    value = {'pose': at, 'covariance': make_covariance_6x6(reading.covariance)}
    return {'header': make_header(stamp, frame), 'pose': value}


def make_diagnostics(stamp: Fields, reading: Reading) -> Fields:
    """Return a diagnostic_msgs/DiagnosticArray of the state."""
    texts = {
        CLEAR: 'a scan match knows the pose here',
        DEGENERATE: 'degenerate place',
    }
    values = {'u': f'{reading.u:.3f}', 'x': f'{reading.x:.3f}', 'y': f'{reading.y:.3f}'}
    if reading.is_known:
        major, minor, direction = compute_ellipse(reading.covariance)
        values['major_std_m'] = f'{major:.4f}'
        values['minor_std_m'] = f'{minor:.4f}'
        values['major_axis_deg'] = f'{math.degrees(direction):.1f}'
    status = {
        'level': OK if reading.state == CLEAR else WARN,
        'name': 'localizability',
        'message': texts.get(reading.state, 'off the field'),
        'values': [{'key': key, 'value': value} for key, value in values.items()],
    }
    return {'header': make_header(stamp, ''), 'status': [status]}


def make_warning(stamp: Fields, frame: str, reading: Reading) -> Fields:
    """
    Return a visualization_msgs/Marker with a text above the robot in a degenerate place.

    Elsewhere it removes the text.
    """
    marker = {'header': make_header(stamp, frame), 'ns': 'warning', 'id': 0, 'type': TEXT}
    if reading.state == CLEAR or not reading.is_known:
        return marker | {'action': DELETE}
    at = make_pose(reading.x, reading.y, 0.0)
    at['position']['z'] = 1.0
    text = f'degenerate: u {reading.u:.2f}\n{format_deviations(reading.covariance)}'
    look = {'scale': {'z': 0.4}, 'color': _make_color(VERMILION, 1.0), 'text': text}
    return marker | {'action': ADD, 'pose': at} | look


def make_ellipses(
    stamp: Fields, frame: str, field: FieldFile, spacing: float, scale: float
) -> Fields:
    """
    Return a visualization_msgs/MarkerArray with the field's ellipses.

    They are blue in places where the pose is sharp, and vermilion in degenerate ones.
    """
    markers = []
    for n, (x, y) in enumerate(field.positions(spacing)):
        u, covariance = field.at(x, y)
        major, minor, direction = compute_ellipse(covariance)
        sizes = {'x': max(2 * scale * major, 1e-3), 'y': max(2 * scale * minor, 1e-3), 'z': 0.02}
        kind = {'header': make_header(stamp, frame), 'ns': 'ellipses', 'id': n, 'type': CYLINDER}
        look = {'scale': sizes, 'color': _make_color(SHARP + u * (VERMILION - SHARP), 0.7)}
        markers.append(kind | {'action': ADD, 'pose': make_pose(x, y, direction)} | look)
    return {'markers': markers}


def _make_color(rgb: np.ndarray, alpha: float) -> Fields:
    red, green, blue = (float(value) for value in rgb)
    return {'r': red, 'g': green, 'b': blue, 'a': alpha}
