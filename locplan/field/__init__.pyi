from ._config import FieldConfig as FieldConfig
from ._config_files import load_config as load_config
from ._config_files import save_config as save_config
from ._covariance import SCALARS as SCALARS
from ._covariance import log_euclidean_mean as log_euclidean_mean
from ._covariance import mean_information as mean_information
from ._covariance import position_axes as position_axes
from ._covariance import scalar as scalar
from ._field import CovarianceField as CovarianceField
from ._field import covariance_field as covariance_field
from ._lidar import Lidar as Lidar
from ._search_window import SearchWindow as SearchWindow
from ._store import CacheWarning as CacheWarning
from ._store import load_or_compute as load_or_compute

__all__ = [
    "SCALARS",
    "CacheWarning",
    "CovarianceField",
    "FieldConfig",
    "Lidar",
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
