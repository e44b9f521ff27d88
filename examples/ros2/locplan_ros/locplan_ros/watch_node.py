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

"""The node that takes poses from tf or a topic, and publishes the readings of `Watch`."""

from __future__ import annotations

import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from locplan_ros import messages
from locplan_ros.field_file import FieldFile
from locplan_ros.watch import Limits, Watch
import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from rosidl_runtime_py import set_message_fields
from tf2_ros import Buffer, TransformException, TransformListener
from visualization_msgs.msg import Marker, MarkerArray

PARAMETERS = {
    'field': '',
    'pose_topic': '',
    'map_frame': 'map',
    'base_frame': 'base_link',
    'rate': 5.0,
    'enter': 0.5,
    'leave': 0.4,
    'patience': 5,
    'ellipse_spacing': 2.0,
    'ellipse_scale': 1.0,
}
"""Names and defaults; config/watch.yaml explains them."""
ANY_TIME = {'sec': 0, 'nanosec': 0}
"""A stamp for content that does not change: tf then takes the latest transform."""


class WatchNode(Node):
    """A node that publishes the field's covariance at the robot's pose, and warns."""

    def __init__(self) -> None:
        super().__init__('localizability_watch')
        settings = {
            name: self.declare_parameter(name, value).value for name, value in PARAMETERS.items()
        }
        self.frame, self.base = settings['map_frame'], settings['base_frame']
        if not (settings['rate'] > 0 and settings['ellipse_spacing'] > 0):
            raise ValueError('rate and ellipse_spacing must be positive')
        limits = Limits(settings['enter'], settings['leave'], settings['patience'])
        field = FieldFile.load(settings['field'])
        self.watch = Watch(field, limits)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.poses = self.create_publisher(PoseWithCovarianceStamped, '~/covariance', 10)
        self.warnings = self.create_publisher(Marker, '~/warning', latched)
        self.ellipses = self.create_publisher(MarkerArray, '~/ellipses', latched)
        self.diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        markers = messages.make_ellipses(
            ANY_TIME, self.frame, field, settings['ellipse_spacing'], settings['ellipse_scale']
        )
        self._send(self.ellipses, MarkerArray(), markers)
        if field.origin[2]:
            self.get_logger().warning("the map has a yaw, which Nav2's costmaps and AMCL ignore")
        if settings['pose_topic']:
            topic = settings['pose_topic']
            self.create_subscription(PoseWithCovarianceStamped, topic, self._on_pose, 10)
        else:
            self.buffer = Buffer()
            self.listener = TransformListener(self.buffer, self)
            self.create_timer(1.0 / settings['rate'], self._on_timer)

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        pose = message.pose.pose
        self._update(_make_stamp(message.header.stamp), pose.position, pose.orientation)

    def _on_timer(self) -> None:
        try:
            stamped = self.buffer.lookup_transform(self.frame, self.base, Time())
        except TransformException as error:
            self.get_logger().info(f'waiting for the pose: {error}', throttle_duration_sec=10.0)
            return
        transform = stamped.transform
        self._update(_make_stamp(stamped.header.stamp), transform.translation, transform.rotation)

    def _update(self, stamp: messages.Fields, position: Any, quaternion: Any) -> None:
        yaw = messages.yaw_from_quaternion(quaternion.x, quaternion.y, quaternion.z, quaternion.w)
        reading = self.watch.update(position.x, position.y, yaw)
        if reading.is_known:
            content = messages.make_pose_with_covariance(stamp, self.frame, reading)
            self._send(self.poses, PoseWithCovarianceStamped(), content)
        self._send(self.warnings, Marker(), messages.make_warning(stamp, self.frame, reading))
        now = _make_stamp(self.get_clock().now().to_msg())
        self._send(self.diagnostics, DiagnosticArray(), messages.make_diagnostics(now, reading))
        if reading.event is None:
            return
        if reading.event.is_warning:  # rclpy allows each line of code only one severity
            self.get_logger().warning(reading.event.text)
        else:
            self.get_logger().info(reading.event.text)

    @staticmethod
    def _send(publisher: Any, message: Any, content: messages.Fields) -> None:
        set_message_fields(message, content)
        publisher.publish(message)


def _make_stamp(stamp: Any) -> messages.Fields:
    return {'sec': stamp.sec, 'nanosec': stamp.nanosec}


def main() -> None:
    """Run the node until it is shut down; end with one line and code 2 for a wrong parameter."""
    rclpy.init()
    try:
        rclpy.spin(WatchNode())
    except (ValueError, ParameterException) as error:
        print(f'locplan_ros: {error}', file=sys.stderr)
        sys.exit(2)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()
