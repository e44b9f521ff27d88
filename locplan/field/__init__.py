"""The covariance field of a map: estimators, settings, files and cache."""

from locplan.field.config import FieldConfig, equip_robot, load_config, save_config
from locplan.field.covariance import position_axes, scalar
from locplan.field.estimator import Estimator
from locplan.field.estimators import ESTIMATORS
from locplan.field.field import CovarianceField
from locplan.field.fisher import Fisher, Fused
from locplan.field.sad import Sad
from locplan.field.scan import Scan
from locplan.field.search_window import OffsetLattice, SearchWindow
from locplan.field.store import covariance_field, load_or_compute
from locplan.field.summary import sample_covariances

__all__ = [
    "ESTIMATORS",
    "CovarianceField",
    "Estimator",
    "FieldConfig",
    "Fisher",
    "Fused",
    "OffsetLattice",
    "Sad",
    "Scan",
    "SearchWindow",
    "covariance_field",
    "equip_robot",
    "load_config",
    "load_or_compute",
    "position_axes",
    "sample_covariances",
    "save_config",
    "scalar",
]
