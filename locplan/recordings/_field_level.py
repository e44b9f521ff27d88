"""The noise level at which a field predicts the deviations measured along a drive."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from locplan._util.intervals import Interval
from locplan._util.poses import Numbers
from locplan._util.progress import ProgressCallback
from locplan.field import FieldConfig
from locplan.maps import OccupancyGrid
from locplan.recordings._blocks import blocks_along, intervals
from locplan.recordings._evaluation import evaluate_drive
from locplan.recordings._recording import Recording
from locplan.simulation import Calibration, calibrate_moments

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
    added = estimator.q(estimator.lattice(grid.resolution))[:2, :2] * estimator.adds_q
    blocks = blocks_along(recording.poses)[some]

    def interval_of(level_of: Callable[[Numbers], float]) -> Interval:
        (log_level,) = intervals(lambda weights: np.log([level_of(weights)]), blocks, RESAMPLES)
        return Interval(*np.exp(log_level).tolist())

    return calibrate_moments(
        config,
        found.predicted[name][some][:, :2, :2] - added,
        added,
        found.matches.covariance[some][:, :2, :2],
        interval_of,
        maps=[grid.name],
    )
