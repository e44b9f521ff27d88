from ._bags import bag as bag
from ._figures import routes_figure as routes_figure
from ._figures import values_figure as values_figure
from ._folders import check_export_folder as check_export_folder
from ._geojson import route_graph as route_graph
from ._geojson import to_geojson as to_geojson
from ._nav2 import check_slowest as check_slowest
from ._nav2 import keepout_mask as keepout_mask
from ._nav2 import nav2_keepout as nav2_keepout
from ._nav2 import nav2_speed as nav2_speed
from ._nav2 import nav2_static as nav2_static
from ._parameters import check_distro as check_distro
from ._plain_files import FIELD_FILES as FIELD_FILES
from ._plain_files import PATH_FILES as PATH_FILES
from ._plain_files import field as field
from ._plain_files import path as path
from ._plain_files import read_path as read_path
from ._roadmap import RouteGraph as RouteGraph
from ._roadmap import roadmap as roadmap
from ._ros_maps import percent as percent
from ._ros_maps import ros_map as ros_map
from ._travel_costs import Conversion as Conversion
from ._travel_costs import check_planner as check_planner

__all__ = [
    "FIELD_FILES",
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
    "read_path",
    "roadmap",
    "ros_map",
    "route_graph",
    "routes_figure",
    "to_geojson",
    "values_figure",
]
