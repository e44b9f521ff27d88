from ._about import about_costs as about_costs
from ._costmap import ROBOT_RADIUS as ROBOT_RADIUS
from ._costmap import Costmap as Costmap
from ._degeneracy import CostSettings as CostSettings
from ._footprint import Footprint as Footprint
from ._metrics import PathMetrics as PathMetrics
from ._metrics import path_metrics as path_metrics
from ._metrics import profile as profile
from ._path import Path as Path

__all__ = [
    "ROBOT_RADIUS",
    "CostSettings",
    "Costmap",
    "Footprint",
    "Path",
    "PathMetrics",
    "about_costs",
    "path_metrics",
    "profile",
]
