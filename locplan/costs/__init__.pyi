from ._about import (
    about_costs as about_costs,
    check_costs as check_costs,
    costs_caption as costs_caption,
)
from ._costmap import ROBOT_RADIUS as ROBOT_RADIUS, Costmap as Costmap
from ._degeneracy import (
    CostSettings as CostSettings,
    check_criterion as check_criterion,
    check_weight as check_weight,
)
from ._lidars import (
    LidarShare as LidarShare,
    compare_lidars as compare_lidars,
    lidars_table as lidars_table,
)
from ._metrics import (
    DEGENERATE as DEGENERATE,
    PathMetrics as PathMetrics,
    path_cost as path_cost,
    path_metrics as path_metrics,
    profile as profile,
)
from ._named_maps import named_maps as named_maps
from ._path import Path as Path, divided_poses as divided_poses
from ._window import (
    CellWindow as CellWindow,
    changed_window as changed_window,
    joined_windows as joined_windows,
)
