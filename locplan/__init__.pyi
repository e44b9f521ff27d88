from . import comparison as comparison
from . import costs as costs
from . import export as export
from . import field as field
from . import maps as maps
from . import paper as paper
from . import planners as planners
from . import plotting as plotting
from . import simulation as simulation
from .comparison import Comparison as Comparison
from .comparison import PlannerSpec as PlannerSpec
from .comparison import compare as compare
from .costs import Costmap as Costmap
from .costs import Footprint as Footprint
from .costs import Path as Path
from .costs import PathMetrics as PathMetrics
from .errors import LocplanError as LocplanError
from .field import CovarianceField as CovarianceField
from .field import FieldConfig as FieldConfig
from .field import Fisher as Fisher
from .field import Lidar as Lidar
from .field import Sad as Sad
from .field import Scan as Scan
from .field import SearchWindow as SearchWindow
from .field import covariance_field as covariance_field
from .field import load_config as load_config
from .field import load_or_compute as load_or_compute
from .field import save_config as save_config
from .maps import OccupancyGrid as OccupancyGrid
from .maps import load_map as load_map
from .maps import save_map as save_map
from .planners import CostToGo as CostToGo
from .planners import ParetoFront as ParetoFront
from .planners import Plan as Plan
from .planners import Query as Query
from .planners import pareto_front as pareto_front
from .planners import plan as plan
from .planners import plan_field as plan_field

__version__: str

__all__ = [
    "Comparison",
    "CostToGo",
    "Costmap",
    "CovarianceField",
    "FieldConfig",
    "Fisher",
    "Footprint",
    "Lidar",
    "LocplanError",
    "OccupancyGrid",
    "ParetoFront",
    "Path",
    "PathMetrics",
    "Plan",
    "PlannerSpec",
    "Query",
    "Sad",
    "Scan",
    "SearchWindow",
    "compare",
    "comparison",
    "costs",
    "covariance_field",
    "export",
    "field",
    "load_config",
    "load_map",
    "load_or_compute",
    "maps",
    "paper",
    "pareto_front",
    "plan",
    "plan_field",
    "planners",
    "plotting",
    "save_config",
    "save_map",
    "simulation",
]
