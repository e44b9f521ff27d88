"""The noise level k, and tau, at which the field's Sigma is as large as the errors in metres."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import file_path, shown
from locplan._util.intervals import Interval, of_resamples, spearman
from locplan._util.progress import ProgressCallback
from locplan._util.public import called
from locplan._util.tables import finite
from locplan.errors import ConfigError
from locplan.field import Estimator, Exponential, FieldConfig, Sad, config_of, covariances_at
from locplan.robots import Robot
from locplan.simulation._noise_level import (
    MIN_VARIANCE,
    check_determined,
    factor_of,
    fit_level,
    rms_of,
)
from locplan.simulation._places import ErrorKind, Places

Array = NDArray[np.float64]
TAUS = tuple(np.geomspace(0.03, 3.0, 13).tolist())
"""Values of tau that are tried [m^2]."""
MIN_PLACES = 10
"""Least number of places that a calibration needs."""
RESAMPLES = 200
NOT_IN_METRES = "Σ follows these errors less than one value for all places would"
"""Why deviations are not in metres although there is a noise level that fits best."""


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """Noise level (and tau) of a field that fit the errors best, and the quality of the fit.

    The quality is measured at the places to which they were fitted.
    """

    config: FieldConfig
    """Settings of the field, with the fitted `noise_level`, and with `tau` where it was fitted."""
    noise_level: Interval
    """Noise level k with the 95 % interval of a bootstrap over the places, at this tau."""
    fitted_tau: bool
    """True if tau was fitted, too."""
    factor: float
    """Factor, at least 1, by which a place's rms error typically differs from Sigma's: exp of the
    rms difference of their logarithms."""
    factor_before: float
    """Factor by which the errors differed from Sigma's before the calibration."""
    within_two: float
    """Share of the places whose rms error is within a factor 2 of Sigma's, 0..1."""
    r_squared: float
    """Share of the variance of the errors' logarithm that Sigma explains; below 0 it is worse than
    one value for all places."""
    spearman: float
    """Spearman's rank correlation of Sigma's deviation with the error, -1..1."""
    consistency: float
    """Mean of e' inv(Sigma) e / 2 over all position errors e; 1 where Sigma is neither too small
    nor too large."""
    floor_share: float
    """Share of the places whose errors are below Q alone, which no k can reach, 0..1."""
    predicted: Array
    """Rms position deviation of each place by the calibrated Sigma, (n,) [m]."""
    measured: Array
    """Rms position error that was measured at each place, (n,) [m]."""
    maps: Sequence[str]
    """Names of the maps of the places."""
    error: ErrorKind
    """Kind of error that was fitted: "tracking" of a filter, or "match" of single scans."""

    def __repr__(self) -> str:
        return (
            f"Calibration({self.config.estimator.name}, k {self.noise_level.value:.3g}, R²"
            f" {self.r_squared:.2f}, {len(self.measured)} places)"
        )

    @property
    def tau(self) -> float | None:
        """Fitted scale of the exponential weights [m^2]; None where it was not fitted."""
        estimator = self.config.estimator
        return estimator.tau if self.fitted_tau and isinstance(estimator, Sad) else None

    @property
    def in_metres(self) -> bool:
        """True if Sigma explains the errors better than one value for all places would.

        If it does not, the field ranks places at best, and its deviations are no metres.
        """
        return self.r_squared > 0

    @property
    def verdict(self) -> dict[str, object]:
        """Whether deviations are in metres, and if not the reason, fit for JSON."""
        return {"in_metres": True} if self.in_metres else {"in_metres": False, "why": NOT_IN_METRES}

    @property
    def warning(self) -> str:
        """What people are warned of where deviations are not in metres; else empty."""
        return "" if self.in_metres else f"NOT IN METRES: {NOT_IN_METRES}"

    def report(self) -> str:
        """Text for people: what was fitted, and how well it fits."""
        return str(called("locplan.simulation._reports:calibration_report", self))

    def save(
        self, path: str | os.PathLike[str], robot: Robot, *, force: bool = False
    ) -> list[FilePath]:
        """Write the settings as `locplan.save_config` does, and a picture beside them.

        The file says whether deviations are in metres, so that `locplan.load_config` can warn, and
        holds the robot that was simulated, for `Robot.load`.

        Parameters
        ----------
        path : path
            The file, which ends in .json.
        robot : Robot
            The robot that was simulated.
        force : bool, default False
            True replaces files that are no calibration.

        Returns
        -------
        list of Path
            The file and its picture.

        Raises
        ------
        LocplanError
            If a file cannot be written, or is in the way.
        """
        write = "locplan.simulation._reports:write_calibration"
        target = file_path("a calibration's file", path)
        written: list[FilePath] = called(write, target, self, robot, force=force)
        return written

    def summary(self) -> dict[str, object]:
        """Results in numbers, fit for JSON."""
        numbers = ("factor", "factor_before", "within_two", "r_squared", "spearman")
        about: dict[str, object] = {
            **self.verdict,
            "error": self.error,
            "maps": list(self.maps),
            "places": len(self.measured),
            "noise_level": list(self.noise_level),
            "tau": self.tau,
            **{name: getattr(self, name) for name in (*numbers, "consistency", "floor_share")},
        }
        return finite(about)


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
    if error not in get_args(ErrorKind):
        raise ConfigError(
            f"error must be one of {', '.join(get_args(ErrorKind))}, not {shown(error)}"
        )
    estimator = config.estimator
    exponential = isinstance(estimator, Sad) and isinstance(estimator.weights, Exponential)
    if fit_tau and not exponential:
        raise ConfigError("tau is of the exponential weights of estimator sad; fit k alone")
    errors = _errors(places, error)
    measured = rms_of(errors)
    q = np.concatenate([_q(each, config) for each in places])
    before = _bare(places, config, threads)
    fits = []
    for n, tau in enumerate(TAUS if fit_tau else (None,)):
        trial = config if tau is None else changed(config, weights=Exponential(tau))
        bare = before if tau is None else _bare(places, trial, threads)
        level, loss = fit_level(bare, q, measured)
        fits.append((loss, n, changed(trial, noise_level=level), bare))
        if progress:
            progress(n + 1, len(TAUS) if fit_tau else 1)
    _, _, fitted, bare = min(fits, key=lambda fit: fit[:2])
    level = fitted.estimator.noise_level
    check_determined(level)
    return judged(
        fitted,
        _bootstrapped(level, bare, q, measured),
        bare,
        q,
        errors,
        factor_of(rms_of(estimator.noise_level * before + q), measured),
        fitted_tau=fit_tau,
        maps=[each.grid.name for each in places],
        error=error,
    )


def judged(
    config: FieldConfig,
    level: Interval,
    bare: Array,
    q: Array,
    errors: Array,
    factor_before: float,
    *,
    fitted_tau: bool,
    maps: Sequence[str],
    error: ErrorKind,
) -> Calibration:
    """How well the noise level of a config fits second moments of errors, (n, 2, 2) [m^2]."""
    covariance, measured = level.value * bare + q, rms_of(errors)
    predicted = rms_of(covariance)
    difference, variance = np.log(predicted / measured), np.log(measured).var()
    return Calibration(
        config=config,
        noise_level=level,
        fitted_tau=fitted_tau,
        factor=factor_of(predicted, measured),
        factor_before=factor_before,
        within_two=float(np.mean(np.abs(difference) <= math.log(2))),
        r_squared=float(1 - np.mean(difference**2) / variance) if variance > 0 else 0.0,
        spearman=spearman(predicted, measured),
        consistency=_consistency(covariance, errors),
        floor_share=float(np.mean(measured < rms_of(q))),
        predicted=predicted,
        measured=measured,
        maps=maps,
        error=error,
    )


def changed(config: FieldConfig, **settings: object) -> FieldConfig:
    """Copy of a config with some settings of its estimator changed."""
    estimator: Any = config.estimator
    return dataclasses.replace(config, estimator=dataclasses.replace(estimator, **settings))


def _errors(places: Sequence[Places], error: ErrorKind) -> Array:
    """Second moments of the position errors of all places, (n, 2, 2) [m^2]."""
    found = [each.moments(error)[:, :2, :2] for each in places]
    moments = np.concatenate([np.empty((0, 2, 2)), *found])
    known = int(np.isfinite(moments).all(axis=(1, 2)).sum())
    if known < max(MIN_PLACES, len(moments)):
        raise ConfigError(
            f"a calibration needs at least {MIN_PLACES} places, all with {error} errors;"
            f" there are {known} of {len(moments)}"
        )
    return moments + MIN_VARIANCE * np.eye(2)


def _bare(places: Sequence[Places], config: FieldConfig, threads: int | None) -> Array:
    """Positional covariances with k = 1 and without Q, (n, 2, 2) [m^2]."""
    # Places lie on the lattice of the default stride.
    plain = dataclasses.replace(changed(config, noise_level=1.0), stride=FieldConfig.stride)
    found = [
        covariances_at(each.grid, plain, each.points, threads=threads)[:, :2, :2]
        - _added_q(each, config)
        for each in places
    ]
    return np.concatenate(found)


def _q(places: Places, config: FieldConfig) -> Array:
    """Covariance Q that is added to the positions of a map's places, (n, 2, 2) [m^2]."""
    added = _added_q(places, config) + MIN_VARIANCE * np.eye(2)
    return np.tile(added, (len(places.points), 1, 1))


def _added_q(places: Places, config: FieldConfig) -> Array:
    """Covariance Q that the estimator adds to the positions of a map's places, (2, 2) [m^2]."""
    estimator = config.estimator
    q = estimator.q(estimator.lattice(places.grid.resolution))
    return q[:2, :2] * estimator.adds_q


def _consistency(covariance: Array, errors: Array) -> float:
    """Mean of e' inv(Sigma) e / 2 over the errors of all places."""
    return float(np.einsum("nij,nji->n", np.linalg.inv(covariance), errors).mean() / 2)


def _bootstrapped(level: float, bare: Array, q: Array, measured: Array) -> Interval:
    """The noise level with its 95 % interval over the places."""
    random = np.random.default_rng(0)
    draws = random.integers(0, len(bare), (RESAMPLES, len(bare)))
    samples = [fit_level(bare[n], q[n], measured[n])[0] for n in draws]
    return of_resamples(level, np.array(samples))
