from ._bags import bag as bag
from ._figures import routes_figure as routes_figure, values_figure as values_figure
from ._geojson import route_graph as route_graph, to_geojson as to_geojson
from ._lif import lif as lif, to_lif as to_lif
from ._nav2 import (
    keepout_mask as keepout_mask,
    nav2_keepout as nav2_keepout,
    nav2_speed as nav2_speed,
    nav2_static as nav2_static,
)
from ._plain_files import field as field, path as path
from ._registry import (
    ExportJob as ExportJob,
    ExportSummary as ExportSummary,
    Format as Format,
    formats as formats,
)
from ._roadmap import roadmap as roadmap
from ._route_graphs import RouteGraph as RouteGraph
from ._stations import (
    Station as Station,
    read_stations as read_stations,
    with_stations as with_stations,
)
from ._travel_costs import Conversion as Conversion
from ._value_maps import percent as percent, ros_map as ros_map
