"""The node: it takes poses from tf or a topic, and publishes what `Watch` makes of them."""

from __future__ import annotations

import sys
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from rosidl_runtime_py import set_message_fields
from tf2_ros import Buffer, TransformException, TransformListener
from visualization_msgs.msg import Marker, MarkerArray

from locplan_ros import messages
from locplan_ros.field_file import FieldFile
from locplan_ros.watch import Limits, Watch

PARAMETERS = {
    "field": "",
    "pose_topic": "",
    "map_frame": "map",
    "base_frame": "base_link",
    "rate": 5.0,
    "enter": 0.5,
    "leave": 0.4,
    "patience": 5,
    "ellipse_spacing": 2.0,
    "ellipse_scale": 1.0,
}
"""Names and defaults; config/watch.yaml says what they mean."""
ANY_TIME = {"sec": 0, "nanosec": 0}
"""The stamp of what holds whenever it is shown: tf takes the latest transform for it."""


class WatchNode(Node):
    """Publishes the field's covariance at the robot's pose, and warns in degenerate places."""

    def __init__(self) -> None:
        super().__init__("localizability_watch")
        given = {
            name: self.declare_parameter(name, value).value for name, value in PARAMETERS.items()
        }
        self.frame, self.base = given["map_frame"], given["base_frame"]
        if not (given["rate"] > 0 and given["ellipse_spacing"] > 0):
            raise ValueError("rate and ellipse_spacing must be positive")
        limits = Limits(given["enter"], given["leave"], given["patience"])
        field = FieldFile.load(given["field"])
        self.watch = Watch(field, limits)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.poses = self.create_publisher(PoseWithCovarianceStamped, "~/covariance", 10)
        self.warnings = self.create_publisher(Marker, "~/warning", latched)
        self.ellipses = self.create_publisher(MarkerArray, "~/ellipses", latched)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        shown = given["ellipse_spacing"], given["ellipse_scale"]
        markers = messages.ellipses(ANY_TIME, self.frame, field, *shown)
        self._send(self.ellipses, MarkerArray(), markers)
        if field.origin[2]:
            self.get_logger().warning("the map has a yaw, which Nav2's costmaps and AMCL ignore")
        if given["pose_topic"]:
            topic = given["pose_topic"]
            self.create_subscription(PoseWithCovarianceStamped, topic, self._on_pose, 10)
        else:
            self.buffer = Buffer()
            self.listener = TransformListener(self.buffer, self)
            self.create_timer(1.0 / given["rate"], self._on_timer)

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        self._update(_fields_of(message.header.stamp), place, turn)

    def _on_timer(self) -> None:
        try:
            found = self.buffer.lookup_transform(self.frame, self.base, Time())
        except TransformException as error:
            self.get_logger().info(f"waiting for the pose: {error}", throttle_duration_sec=10.0)
            return
        place, turn = found.transform.translation, found.transform.rotation
        self._update(_fields_of(found.header.stamp), place, turn)

    def _update(self, stamp: messages.Fields, place: Any, turn: Any) -> None:
        yaw = messages.yaw_of(turn.x, turn.y, turn.z, turn.w)
        reading = self.watch.update(place.x, place.y, yaw)
        if reading.is_known:
            content = messages.pose_with_covariance(stamp, self.frame, reading)
            self._send(self.poses, PoseWithCovarianceStamped(), content)
        self._send(self.warnings, Marker(), messages.warning(stamp, self.frame, reading))
        self._send(self.diagnostics, DiagnosticArray(), messages.diagnostics(self._now(), reading))
        if reading.event is None:
            return
        if reading.event.is_warning:  # rclpy allows a line of code but one severity
            self.get_logger().warning(reading.event.text)
        else:
            self.get_logger().info(reading.event.text)

    def _now(self) -> messages.Fields:
        return _fields_of(self.get_clock().now().to_msg())

    @staticmethod
    def _send(publisher: Any, message: Any, content: messages.Fields) -> None:
        set_message_fields(message, content)
        publisher.publish(message)


def _fields_of(stamp: Any) -> messages.Fields:
    return {"sec": stamp.sec, "nanosec": stamp.nanosec}


def main() -> None:
    """Run the node until it is told to end; a wrong parameter is one line and exit code 2."""
    rclpy.init()
    try:
        rclpy.spin(WatchNode())
    except (ValueError, ParameterException) as error:
        sys.exit(_said(f"locplan_ros: {error}"))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


def _said(text: str) -> int:
    print(text, file=sys.stderr)
    return 2
