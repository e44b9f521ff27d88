"""The noise level k, and tau, at which the field's Sigma is as large as the errors in metres."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from locplan._kernels.arrays import Floats, Ints
from locplan._util.checks import one_of
from locplan._util.intervals import Interval, intervals, of_resamples, spearman
from locplan._util.progress import ProgressCallback
from locplan.errors import CalibrationError, ConfigError
from locplan.field import Estimator, Exponential, FieldConfig, config_of, covariances_at
from locplan.maps import OccupancyGrid
from locplan.simulation._calibration import Calibration
from locplan.simulation._places import KINDS, ErrorKind, Places

LEVELS = 1e-6, 1e4
"""Minimum and maximum noise level that are tried."""
SMALL = 1e-12 * np.eye(2)
"""Covariance that is added so that none is singular [m^2]."""


def calibrate(
    places: Sequence[Places],
    config: FieldConfig | Estimator | None = None,
    *,
    error: ErrorKind = "tracking",
    fit_tau: bool = False,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Calibration:
    """Fit the noise level, and tau if asked, to errors at places.

    The fit is by least squares between the logarithms of the rms position deviation and error, so
    that no place counts more than another however large its error is. A likelihood of Gaussian
    errors would follow the few places where Sigma is far too small, and make it far too large
    elsewhere.

    Parameters
    ----------
    places : sequence of Places
        Results of `locplan.simulation.measure`, or the `places` of an evaluation.
        Together they have at least 10 places.
    config : FieldConfig or Estimator, optional
        Settings of the field to calibrate; `Sad()` by default.
    error : str, default "tracking"
        Kind of error to fit: "tracking" of a particle filter, or "match" of single scans. Take
        "match" for a robot that localizes itself by scan matching.
    fit_tau : bool, default False
        True fits tau, too; the estimator must be "sad" with exponential weights. A tau that fits
        errors in metres is not suited for planning: a large one sees no corridor.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) values of tau.

    Returns
    -------
    Calibration
        The fitted settings, and how well they fit.

    Raises
    ------
    ConfigError
        If there are too few places with errors, or if tau is to be fitted but the estimator has
        none.
    CalibrationError
        If the errors do not determine k.
    """
    config = config_of(config)
    one_of("error", error, KINDS)
    trials = [config]
    if fit_tau:
        if not isinstance(getattr(config.estimator, "weights", None), Exponential):
            raise ConfigError("tau is of the exponential weights of estimator sad; fit k alone")
        taus = np.geomspace(0.03, 3.0, 13).tolist()
        trials = [changed(config, weights=Exponential(tau)) for tau in taus]
    errors, before = _errors(places, error), _bare(places, config, threads)
    measured = rms_of(errors)
    added = [np.tile(_q(each.grid, config), (len(each.points), 1, 1)) for each in places]
    q = np.concatenate(added) + SMALL
    fits = []
    for n, trial in enumerate(trials):
        bare = _bare(places, trial, threads) if fit_tau else before
        level, loss = fit_level(bare, q, measured)
        fits.append((loss, n, level, bare))
        if progress:
            progress(n + 1, len(trials))
    _, n, level, bare = min(fits, key=lambda fit: fit[:2])
    draws = np.random.default_rng(0).integers(0, len(bare), (200, len(bare)))
    samples = [fit_level(bare[some], q[some], measured[some])[0] for some in draws]
    interval, maps = of_resamples(level, np.array(samples)), [each.grid.name for each in places]
    found = _judged(trials[n], interval, bare, q, errors, before, maps)
    return dataclasses.replace(found, fitted_tau=fit_tau, error=error)


def _judged(
    config: FieldConfig,
    level: Interval,
    bare: Floats,
    q: Floats,
    errors: Floats,
    before: Floats,
    maps: Sequence[str],
) -> Calibration:
    """How well a noise level fits second moments of errors, and how the config's own did.

    `bare` are the covariances with k = 1 and without Q, `before` those by the config that was
    given, all (n, 2, 2) [m^2].
    """
    _check_determined(level.value)
    covariance, measured = level.value * bare + q, rms_of(errors)
    predicted = rms_of(covariance)
    difference, variance = np.log(predicted / measured), np.log(measured).var()
    return Calibration(
        config=changed(config, noise_level=level.value),
        noise_level=level,
        fitted_tau=False,
        factor=_factor_of(predicted, measured),
        factor_before=_factor_of(rms_of(config.estimator.noise_level * before + q), measured),
        within_two=float(np.mean(np.abs(difference) <= math.log(2))),
        r_squared=float(1 - np.mean(difference**2) / variance) if variance > 0 else 0.0,
        spearman=spearman(predicted, measured),
        consistency=float(np.einsum("nij,nji->n", np.linalg.inv(covariance), errors).mean() / 2),
        floor_share=float(np.mean(measured < rms_of(q))),
        predicted=predicted,
        measured=measured,
        maps=maps,
        error="match",
    )


def changed(config: FieldConfig, **settings: object) -> FieldConfig:
    """Copy of a config with some settings of its estimator changed."""
    estimator: Any = config.estimator
    return dataclasses.replace(config, estimator=dataclasses.replace(estimator, **settings))


def _errors(places: Sequence[Places], error: ErrorKind) -> Floats:
    """Second moments of the position errors of all places, (n, 2, 2) [m^2]."""
    found = [each.moments(error)[:, :2, :2] for each in places]
    moments = np.concatenate([np.empty((0, 2, 2)), *found])
    known, needed = int(np.isfinite(moments).all(axis=(1, 2)).sum()), 10
    if known < max(needed, len(moments)):
        raise ConfigError(
            f"a calibration needs at least {needed} places, all with {error} errors;"
            f" there are {known} of {len(moments)}"
        )
    return moments + SMALL


def _bare(places: Sequence[Places], config: FieldConfig, threads: int | None) -> Floats:
    """Positional covariances with k = 1 and without Q, (n, 2, 2) [m^2]."""
    # Places lie on the lattice of the default stride.
    plain = dataclasses.replace(changed(config, noise_level=1.0), stride=FieldConfig.stride)
    found = [
        covariances_at(each.grid, plain, each.points, threads=threads)[:, :2, :2]
        - _q(each.grid, config)
        for each in places
    ]
    return np.concatenate(found)


def _q(grid: OccupancyGrid, config: FieldConfig) -> Floats:
    """Covariance Q that the estimator adds to the positions of a map's places, (2, 2) [m^2]."""
    estimator = config.estimator
    q = estimator.q(estimator.lattice(grid.resolution))
    return q[:2, :2] * estimator.adds_q


def calibrate_moments(
    config: FieldConfig, grid: OccupancyGrid, covariances: Floats, moments: Floats, blocks: Ints
) -> Calibration:
    """Fit the noise level to errors that were not simulated, such as those of recorded scans.

    Parameters
    ----------
    config : FieldConfig
        Settings of the field, whose noise level is fitted.
    grid : OccupancyGrid
        The map.
    covariances : (n, 2, 2) array
        The field's positional covariances with k = 1 [m^2].
    moments : (n, 2, 2) array
        Second moments of the position errors, or measured covariances [m^2].
    blocks : (n,) array of int
        The block of the drive that each belongs to; the interval of k is over these.

    Returns
    -------
    Calibration
        The fitted settings, and how well they fit.

    Raises
    ------
    CalibrationError
        If the errors do not determine k.
    """
    added, moments = _q(grid, config), moments + SMALL
    bare, q = covariances - added, np.tile(added + SMALL, (len(covariances), 1, 1))
    measured = rms_of(moments)

    def log_level(weights: Floats) -> Floats:
        return np.log([fit_level(bare, q, measured, weights)[0]])

    level = Interval(*np.exp(intervals(log_level, blocks, 100)[0]).tolist())
    return _judged(config, level, bare, q, moments, bare, [grid.name])


def rms_of(covariance: Floats) -> Floats:
    """Rms deviation of positions, (n,) [m]."""
    return np.asarray(np.sqrt(np.trace(covariance, axis1=1, axis2=2)))


def fit_level(
    bare: Floats, q: Floats, measured: Floats, weights: Floats | None = None
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


def _check_determined(level: float) -> None:
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


def _factor_of(predicted: Floats, measured: Floats) -> float:
    """Factor by which predicted and measured deviations (n,) typically differ."""
    return float(np.exp(np.sqrt(np.mean(np.log(predicted / measured) ** 2))))
