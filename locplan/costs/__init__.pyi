from ._about import about_costs as about_costs
from ._check import check_costs as check_costs
from ._costmap import ROBOT_RADIUS as ROBOT_RADIUS, Costmap as Costmap
from ._degeneracy import CostSettings as CostSettings
from ._lidars import LidarShare as LidarShare, compare_lidars as compare_lidars
from ._metrics import (
    DEGENERATE as DEGENERATE,
    PathMetrics as PathMetrics,
    path_cost as path_cost,
    path_metrics as path_metrics,
    profile as profile,
)
from ._path import Path as Path
