from . import templates as templates
from ._cache import (
    CacheEntry as CacheEntry,
    FieldCache as FieldCache,
    cache_folder as cache_folder,
    clear_cache as clear_cache,
)
from ._compute import (
    check_scheduler as check_scheduler,
    executor_of as executor_of,
    finished_chunks as finished_chunks,
)
from ._config import (
    SHORT_LIDAR as SHORT_LIDAR,
    FieldConfig as FieldConfig,
    config_of as config_of,
    equipped as equipped,
    lidar_of as lidar_of,
    load_config as load_config,
    save_config as save_config,
)
from ._covariance import (
    SCALARS as SCALARS,
    mean_information as mean_information,
    position_axes as position_axes,
    scalar as scalar,
)
from ._estimator import Estimator as Estimator, Layer as Layer, MapPart as MapPart
from ._field import CovarianceField as CovarianceField
from ._kept import kept as kept, kept_solidity as kept_solidity
from ._lattice import (
    every_second_point as every_second_point,
    points_near as points_near,
)
from ._search_window import OffsetLattice as OffsetLattice, SearchWindow as SearchWindow
from ._store import (
    CacheWarning as CacheWarning,
    covariance_field as covariance_field,
    field_path as field_path,
    load_or_compute as load_or_compute,
)
from ._summary import (
    FieldSummary as FieldSummary,
    Percentiles as Percentiles,
    about_field as about_field,
    sampled_covariances as sampled_covariances,
    well_spaced as well_spaced,
)
from ._tiles import untouched_points as untouched_points
from ._zarr import FIELD_SUFFIX as FIELD_SUFFIX, check_field_target as check_field_target
from .estimators import ESTIMATORS as ESTIMATORS, estimator_class as estimator_class
from .estimators._beams import (
    NORMAL_REACH as NORMAL_REACH,
    surface_normals as surface_normals,
    wall_cells as wall_cells,
)
from .estimators._fisher import Fisher as Fisher, Fused as Fused
from .estimators._sad import Exponential as Exponential, InverseSquare as InverseSquare, Sad as Sad
from .estimators._scan import Scan as Scan, likelihood_field as likelihood_field
