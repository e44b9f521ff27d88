"""The noise level at which a field predicts the deviations measured along a drive."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from locplan._util.intervals import Interval
from locplan._util.progress import ProgressCallback
from locplan.field import FieldConfig
from locplan.maps import OccupancyGrid
from locplan.recordings._blocks import blocks_along, intervals
from locplan.recordings._evaluation import evaluate_drive
from locplan.recordings._geometry import Numbers
from locplan.recordings._recording import Recording
from locplan.simulation._calibration import (
    MIN_VARIANCE,
    Calibration,
    check_determined,
    factor_of,
    fit_level,
    judged,
    rms_of,
)

RESAMPLES = 100


def calibrated_field(
    recording: Recording,
    grid: OccupancyGrid,
    config: FieldConfig,
    *,
    threads: int | None,
    progress: ProgressCallback | None,
) -> Calibration:
    """Fit the noise level of a field to the covariances of the posteriors of a drive's scans.

    The fit is that of `locplan.simulation.calibrate`, between logarithms of rms deviations of the
    position; the interval is over blocks of the drive.

    Raises
    ------
    RecordingError
        If too few scans were taken where the map is known and fits.
    CalibrationError
        If the covariances do not determine k.
    """
    estimator: Any = config.estimator
    plain: Any = dataclasses.replace(estimator, noise_level=1.0)
    name = estimator.name
    found = evaluate_drive(
        recording, grid, estimators={name: plain}, threads=threads, progress=progress
    )
    some = found.compared
    small = MIN_VARIANCE * np.eye(2)
    moments = found.matches.covariance[some][:, :2, :2] + small
    added = estimator.q(estimator.lattice(grid.resolution))[:2, :2] * estimator.adds_q
    bare = found.predicted[name][some][:, :2, :2] - added
    q, measured = np.tile(added + small, (len(bare), 1, 1)), rms_of(moments)

    def level_of(weights: Numbers) -> Numbers:
        return np.log([fit_level(bare, q, measured, weights)[0]])

    (log_level,) = intervals(level_of, blocks_along(recording.poses)[some], RESAMPLES)
    level = Interval(*np.exp(log_level).tolist())
    check_determined(level.value)
    return judged(
        dataclasses.replace(config, estimator=dataclasses.replace(estimator, noise_level=level[0])),
        level,
        bare,
        q,
        moments,
        factor_of(rms_of(estimator.noise_level * bare + q), measured),
        fitted_tau=False,
        maps=[grid.name],
        error="match",
    )
