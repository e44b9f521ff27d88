"""The noise level k at which covariances are as large as errors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from locplan.errors import CalibrationError

Array = NDArray[np.float64]
LEVELS = 1e-6, 1e4
"""Least and greatest noise level that are tried."""
MIN_VARIANCE = 1e-12
"""Variance that is added so that no covariance is singular [m^2]."""


def rms_of(covariance: Array) -> Array:
    """Rms deviation of positions, (n,) [m]."""
    return np.asarray(np.sqrt(np.trace(covariance, axis1=1, axis2=2)))


def fit_level(
    bare: Array, q: Array, measured: Array, weights: Array | None = None
) -> tuple[float, float]:
    """Noise level of least loss, and the loss: the mean squared difference of logarithms."""
    from scipy.optimize import minimize_scalar

    variance, added = np.trace(bare, axis1=1, axis2=2), np.trace(q, axis1=1, axis2=2)

    def loss(log_level: float) -> float:
        predicted = np.sqrt(math.exp(log_level) * variance + added)
        return float(np.average(np.log(predicted / measured) ** 2, weights=weights))

    low, high = map(math.log, LEVELS)
    coarse = np.linspace(low, high, 60)
    nearest = coarse[int(np.argmin([loss(each) for each in coarse]))]
    step = coarse[1] - coarse[0]
    bounds = max(low, nearest - step), min(high, nearest + step)
    found = minimize_scalar(loss, bounds=bounds, method="bounded")
    return math.exp(found.x), float(found.fun)


def check_determined(level: float) -> None:
    """Raise a CalibrationError if a noise level lies at the ends of those tried."""
    low, high = LEVELS
    if level < 2 * low:
        raise CalibrationError(
            "the errors do not determine k: they are below what Q adds, or Sigma says nothing of"
            " them; calibrate with quantisation false, or on other maps"
        )
    if level > high / 2:
        raise CalibrationError(
            f"the errors do not determine k: it would be above {high:g}; calibrate on other maps,"
            " or another estimator"
        )


def factor_of(predicted: Array, measured: Array) -> float:
    """Factor by which predicted and measured deviations (n,) typically differ."""
    return float(np.exp(np.sqrt(np.mean(np.log(predicted / measured) ** 2))))
