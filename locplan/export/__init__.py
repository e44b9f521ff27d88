"""Files for navigation stacks: ROS 2 Nav2, ROS 1, Foxglove, and for anything that reads tables.

Folders are written whole or not at all, with a README.md that says what each file is and how to
launch it.
"""

from locplan.export.bags import bag
from locplan.export.folders import check_export_folder
from locplan.export.geojson import route_graph, to_geojson
from locplan.export.nav2 import (
    check_slowest,
    keepout_mask,
    nav2_keepout,
    nav2_speed,
    nav2_static,
)
from locplan.export.parameters import check_distro, read_parameters
from locplan.export.plain_files import FIELD_FILES, PATH_FILES, field, path, read_path
from locplan.export.roadmap import RouteGraph, roadmap
from locplan.export.ros_maps import percent, ros_map
from locplan.export.travel_costs import Conversion, check_planner

FORMATS = (
    "nav2-keepout",
    "nav2-static",
    "nav2-speed",
    "ros-map",
    "route-graph",
    "bag",
    "path",
    "csv",
    "npz",
    "png",
)
"""What ``locplan export --to`` knows."""

__all__ = [
    "FIELD_FILES",
    "FORMATS",
    "PATH_FILES",
    "Conversion",
    "RouteGraph",
    "bag",
    "check_distro",
    "check_export_folder",
    "check_planner",
    "check_slowest",
    "field",
    "keepout_mask",
    "nav2_keepout",
    "nav2_speed",
    "nav2_static",
    "path",
    "percent",
    "read_parameters",
    "read_path",
    "roadmap",
    "ros_map",
    "route_graph",
    "to_geojson",
]
