"""The estimators of the pose covariance by name; a new one is a module here and a line here."""

from __future__ import annotations

from locplan._support.checks import check_choice
from locplan.field.estimator import Estimator
from locplan.field.fisher import Fisher, Fused
from locplan.field.sad import Sad
from locplan.field.scan import Scan

ESTIMATORS: dict[str, type[Estimator]] = {
    "sad": Sad,
    "fisher": Fisher,
    "scan": Scan,
    "fused": Fused,
}
"""The estimators by name."""


def estimator_class(name: str) -> type[Estimator]:
    """Find the class of an estimator.

    Parameters
    ----------
    name : str
        A name in `ESTIMATORS`.

    Raises
    ------
    ConfigError
        If no estimator has this name.
    """
    check_choice("estimator", name, ESTIMATORS)
    return ESTIMATORS[name]
