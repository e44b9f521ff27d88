"""Files for navigation stacks: ROS 2 Nav2 and ROS 1."""

from locplan.export.nav2 import nav2_keepout, nav2_speed
from locplan.export.recommended_routes import nav2_routes
from locplan.export.values import ros_map

__all__ = ["nav2_keepout", "nav2_routes", "nav2_speed", "ros_map"]
