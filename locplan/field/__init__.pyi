from ._compute import covariance_field as covariance_field
from ._config import FieldConfig as FieldConfig
from ._config_files import load_config as load_config
from ._config_files import save_config as save_config
from ._covariance import SCALARS as SCALARS
from ._covariance import log_euclidean_mean as log_euclidean_mean
from ._covariance import mean_information as mean_information
from ._covariance import position_axes as position_axes
from ._covariance import scalar as scalar
from ._estimator import Estimator as Estimator
from ._estimator import Layer as Layer
from ._estimator import MapPart as MapPart
from ._field import CovarianceField as CovarianceField
from ._lidar import Lidar as Lidar
from ._registry import ESTIMATORS as ESTIMATORS
from ._search_window import OffsetLattice as OffsetLattice
from ._search_window import SearchWindow as SearchWindow
from ._store import CacheWarning as CacheWarning
from ._store import load_or_compute as load_or_compute
from .estimators._fisher import Fisher as Fisher
from .estimators._sad import Exponential as Exponential
from .estimators._sad import InverseSquare as InverseSquare
from .estimators._sad import Sad as Sad
from .estimators._scan import Scan as Scan

__all__ = [
    "ESTIMATORS",
    "SCALARS",
    "CacheWarning",
    "CovarianceField",
    "Estimator",
    "Exponential",
    "FieldConfig",
    "Fisher",
    "InverseSquare",
    "Layer",
    "Lidar",
    "MapPart",
    "OffsetLattice",
    "Sad",
    "Scan",
    "SearchWindow",
    "covariance_field",
    "load_config",
    "load_or_compute",
    "log_euclidean_mean",
    "mean_information",
    "position_axes",
    "save_config",
    "scalar",
]
