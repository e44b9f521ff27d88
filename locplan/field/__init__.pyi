from . import templates as templates
from ._cache import (
    CacheWarning as CacheWarning,
    cache_entries as cache_entries,
    cache_folder as cache_folder,
    cache_table as cache_table,
    clear_cache as clear_cache,
    load_or_compute_result as load_or_compute_result,
)
from ._compute import finished_chunks as finished_chunks
from ._config import (
    SHORT_LIDAR as SHORT_LIDAR,
    FieldConfig as FieldConfig,
    config_of as config_of,
    equipped as equipped,
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
from ._files import FIELD_SUFFIX as FIELD_SUFFIX
from ._lattice import (
    every_second_point as every_second_point,
    points_near as points_near,
)
from ._search_window import OffsetLattice as OffsetLattice, SearchWindow as SearchWindow
from ._store import (
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
from .estimators import ESTIMATORS as ESTIMATORS, estimator_class as estimator_class
from .estimators._beams import (
    NORMAL_REACH as NORMAL_REACH,
    surface_normals as surface_normals,
    wall_cells as wall_cells,
)
from .estimators._fisher import Fisher as Fisher, Fused as Fused
from .estimators._sad import Exponential as Exponential, InverseSquare as InverseSquare, Sad as Sad
from .estimators._scan import Scan as Scan, likelihood_field as likelihood_field
