"""The estimators of the pose covariance by name; a new one is a module here and a line here."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from locplan._support.checks import one_of

if TYPE_CHECKING:
    from locplan.field.estimator import Estimator

ESTIMATORS: dict[str, str] = {
    "sad": "locplan.field.sad:Sad",
    "fisher": "locplan.field.fisher:Fisher",
    "scan": "locplan.field.scan:Scan",
    "fused": "locplan.field.fisher:Fused",
}
"""Module and class of each estimator; imported when first used."""


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
    one_of("estimator", name, ESTIMATORS)
    module, _, attribute = ESTIMATORS[name].partition(":")
    found: type[Estimator] = getattr(import_module(module), attribute)
    return found
