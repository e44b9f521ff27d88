from ._compute import covariance_field as covariance_field
from ._config import (
    SHORT_LIDAR as SHORT_LIDAR,
    FieldConfig as FieldConfig,
    equipped as equipped,
    lidar_of as lidar_of,
)
from ._config_files import (
    CalibrationWarning as CalibrationWarning,
    load_config as load_config,
    save_config as save_config,
)
from ._covariance import (
    SCALARS as SCALARS,
    log_euclidean_mean as log_euclidean_mean,
    mean_information as mean_information,
    position_axes as position_axes,
    scalar as scalar,
)
from ._estimator import Estimator as Estimator, Layer as Layer, MapPart as MapPart
from ._field import CovarianceField as CovarianceField
from ._registry import ESTIMATORS as ESTIMATORS
from ._search_window import OffsetLattice as OffsetLattice, SearchWindow as SearchWindow
from ._store import CacheWarning as CacheWarning, load_or_compute as load_or_compute
from .estimators._fisher import Fisher as Fisher
from .estimators._fused import Fused as Fused
from .estimators._sad import Exponential as Exponential, InverseSquare as InverseSquare, Sad as Sad
from .estimators._scan import Scan as Scan
