from ._about import about_costs as about_costs
from ._costmap import Costmap as Costmap
from ._footprint import Footprint as Footprint
from ._metrics import PathMetrics as PathMetrics
from ._metrics import path_metrics as path_metrics
from ._metrics import profile as profile
from ._path import Path as Path

__all__ = [
    "Costmap",
    "Footprint",
    "Path",
    "PathMetrics",
    "about_costs",
    "path_metrics",
    "profile",
]
