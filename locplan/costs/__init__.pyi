from ._any_path import AnyPath as AnyPath, path_from as path_from
from ._cells import (
    CellWindow as CellWindow,
    changed_window as changed_window,
    joined_windows as joined_windows,
)
from ._costmap import (
    ROBOT_RADIUS as ROBOT_RADIUS,
    Costmap as Costmap,
    about_costs as about_costs,
    check_costs as check_costs,
)
from ._crossing import crossed_cells as crossed_cells
from ._degeneracy import check_criterion as check_criterion
from ._layers import (
    CostSettings as CostSettings,
    check_weight as check_weight,
)
from ._metrics import (
    DEGENERATE as DEGENERATE,
    LidarShare as LidarShare,
    PathMetrics as PathMetrics,
    compare_lidars as compare_lidars,
    costs_caption as costs_caption,
    lidars_table as lidars_table,
    path_cost as path_cost,
    path_metrics as path_metrics,
    profile as profile,
)
from ._named_maps import named_maps as named_maps
from ._path import Path as Path, divided_poses as divided_poses
