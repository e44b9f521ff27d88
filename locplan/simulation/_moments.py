"""The noise level of a field fitted to errors that were measured elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from locplan._util.intervals import Interval
from locplan.field import FieldConfig
from locplan.simulation._calibration import Calibration, changed, judged
from locplan.simulation._noise_level import (
    MIN_VARIANCE,
    Array,
    check_determined,
    factor_of,
    fit_level,
    rms_of,
)


def calibrate_moments(
    config: FieldConfig,
    covariances: Array,
    added: Array,
    moments: Array,
    interval_of: Callable[[Callable[[Array], float]], Interval],
    *,
    maps: Sequence[str],
) -> Calibration:
    """Fit the noise level to errors that were not simulated, such as those of recorded scans.

    Parameters
    ----------
    config : FieldConfig
        Settings of the field, whose noise level is fitted.
    covariances : (n, 2, 2) array
        The field's positional covariances with k = 1, without Q [m^2].
    added : (2, 2) array
        Covariance Q that the estimator adds [m^2].
    moments : (n, 2, 2) array
        Second moments of the position errors, or measured covariances [m^2].
    interval_of : callable
        Called with a function of weights (n,) that gives the noise level k; it returns k with its
        95 % interval.
    maps : sequence of str
        Names of the maps.

    Returns
    -------
    Calibration
        The fitted settings, and how well they fit.

    Raises
    ------
    CalibrationError
        If the errors do not determine k.
    """
    small = MIN_VARIANCE * np.eye(2)
    moments, q = moments + small, np.tile(added + small, (len(covariances), 1, 1))
    measured = rms_of(moments)
    level = interval_of(lambda weights: fit_level(covariances, q, measured, weights)[0])
    check_determined(level.value)
    before = rms_of(config.estimator.noise_level * covariances + q)
    return judged(
        changed(config, noise_level=level.value),
        level,
        covariances,
        q,
        moments,
        factor_of(before, measured),
        fitted_tau=False,
        maps=maps,
        error="match",
    )
