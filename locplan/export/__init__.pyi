from ._batch import (
    field_jobs as field_jobs,
    field_runs_table as field_runs_table,
    run_field_jobs as run_field_jobs,
)
from ._charges import (
    keepout_mask as keepout_mask,
)
from ._costmap import CostmapInflation as CostmapInflation, PlannedPath as PlannedPath
from ._figures import routes_figure as routes_figure, values_figure as values_figure
from ._graph_files import to_geojson as to_geojson
from ._nav2 import (
    nav2_keepout as nav2_keepout,
    nav2_speed as nav2_speed,
)
from ._parameter_files import write_merged as write_merged
from ._parameters import (
    DISTRIBUTIONS as DISTRIBUTIONS,
    DistroWarning as DistroWarning,
    ParametersChanged as ParametersChanged,
    RobotWarning as RobotWarning,
    distribution as distribution,
)
from ._plain_files import field as field, path as path
from ._recommended import (
    nav2_routes as nav2_routes,
    recommended_ways as recommended_ways,
)
from ._registry import (
    ExportJob as ExportJob,
    ExportSummary as ExportSummary,
    Format as Format,
    formats as formats,
)
from ._route_graph import RouteGraph as RouteGraph
from ._servers import write_filter_map as write_filter_map
from ._user_graph import annotate_graph as annotate_graph, nav2_graph as nav2_graph
from ._values import YawWarning as YawWarning, ros_map as ros_map
