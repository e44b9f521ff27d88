from . import (
    advice as advice,
    app as app,
    comparison as comparison,
    export as export,
    field as field,
    maps as maps,
    paper as paper,
    planning as planning,
    recordings as recordings,
    robots as robots,
    simulation as simulation,
    testing as testing,
)
from ._support.records import Table as Table
from .advice.checkup import check as check
from .advice.landmarks import place_landmarks as place_landmarks
from .advice.map_repair import repair as repair
from .app.explorer.explorer import explore as explore
from .comparison.experiment import compare as compare
from .errors import LocplanError as LocplanError
from .field.config import (
    FieldConfig as FieldConfig,
    load_config as load_config,
    save_config as save_config,
)
from .field.field import CovarianceField as CovarianceField
from .field.fisher import Fisher as Fisher, Fused as Fused
from .field.sad import Sad as Sad
from .field.scan import Scan as Scan
from .field.store import covariance_field as covariance_field, load_or_compute as load_or_compute
from .maps.files import load_map as load_map, save_map as save_map
from .maps.grid import OccupancyGrid as OccupancyGrid
from .maps.zones import Zone as Zone, Zones as Zones
from .planning.costmap import Costmap as Costmap
from .planning.pareto import pareto_front as pareto_front
from .planning.path import Path as Path
from .planning.plans import plan as plan
from .planning.results import ParetoFront as ParetoFront, Plan as Plan
from .recordings.location import locate as locate
from .robots.lidar import Lidar as Lidar
from .robots.parts import Footprint as Footprint
from .robots.robot import Robot as Robot
from .simulation.recommendation import Recommendation as Recommendation
from .simulation.recommendations import recommend_paths as recommend_paths
from .simulation.recommender import recommend_path as recommend_path

__version__: str
