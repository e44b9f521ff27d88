from . import (
    comparison as comparison,
    costs as costs,
    diagnosis as diagnosis,
    explorer as explorer,
    export as export,
    field as field,
    landmarks as landmarks,
    maps as maps,
    matching as matching,
    mending as mending,
    paper as paper,
    planners as planners,
    plotting as plotting,
    recordings as recordings,
    robots as robots,
    simulation as simulation,
    testing as testing,
)
from ._util.records import Table as Table
from .comparison import compare as compare
from .costs import Costmap as Costmap, Path as Path
from .diagnosis import check as check
from .errors import LocplanError as LocplanError
from .explorer import explore as explore
from .field import (
    CovarianceField as CovarianceField,
    FieldConfig as FieldConfig,
    Fisher as Fisher,
    Fused as Fused,
    Sad as Sad,
    Scan as Scan,
    covariance_field as covariance_field,
    load_config as load_config,
    load_or_compute as load_or_compute,
    save_config as save_config,
)
from .landmarks import place_landmarks as place_landmarks
from .maps import OccupancyGrid as OccupancyGrid, load_map as load_map, save_map as save_map
from .mending import mend as mend
from .planners import (
    ParetoFront as ParetoFront,
    Plan as Plan,
    pareto_front as pareto_front,
    plan as plan,
)
from .recordings import locate as locate
from .robots import Footprint as Footprint, Lidar as Lidar, Robot as Robot
from .simulation import Choice as Choice, choose as choose, choose_many as choose_many

__version__: str
