"""The noise level k, and tau, at which the field's Sigma is as large as the errors in metres."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from locplan.config import FieldConfig
from locplan.errors import ConfigError
from locplan.intervals import Interval
from locplan.progress import ProgressCallback
from locplan.search_window import SearchWindow
from locplan.simulation.places import ErrorKind, Places
from locplan.simulation.predictors import covariances_at
from locplan.simulation.ranking import RESAMPLES, spearman

Array = NDArray[np.float64]
TAUS = tuple(np.geomspace(0.03, 3.0, 13).tolist())
"""That are tried [m^2]."""
LEVELS = 1e-6, 1e4
"""Between which the noise level is looked for."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """A field's noise level, and tau, that fit the errors, and how well they do."""

    config: FieldConfig
    """With `noise_level`, and `tau` where it was free."""
    noise_level: Interval
    """k, with the 95 % interval of a bootstrap over the places, at this tau."""
    factor: float
    """By which a place's error typically differs from Sigma's: exp of the rms difference of the
    logarithms."""
    factor_before: float
    """The same as the config was."""
    within_two: float
    """Share of the places whose error is within a factor 2 of Sigma's."""
    r_squared: float
    """Share of the variance of the errors' logarithm that Sigma explains; below 0 it is worse than
    one value for all places."""
    spearman: float
    """Rank correlation of Sigma's deviation with the error."""
    consistency: float
    """Mean of e' inv(Sigma) e / d over the d-dimensional position errors; 1 if Sigma is neither
    too small nor too large."""
    floor_share: float
    """Share of the places with errors below what Q alone adds, which no k can reach."""
    predicted: Array
    """Rms position deviation of each place, (n,) [m]."""
    measured: Array
    """Rms position error of each place, (n,) [m]."""
    maps: Sequence[str]
    error: ErrorKind
    fitted_tau: bool

    def summary(self) -> dict[str, Any]:
        """In numbers, fit for JSON."""
        numbers = ("factor", "factor_before", "within_two", "r_squared", "spearman")
        return {
            "error": self.error,
            "maps": list(self.maps),
            "places": len(self.measured),
            "noise_level": list(self.noise_level),
            "tau_m2": self.config.mismatch_scale if self.fitted_tau else None,
            **{name: getattr(self, name) for name in (*numbers, "consistency", "floor_share")},
        }


def calibrate(
    places: Sequence[Places],
    config: FieldConfig | None = None,
    *,
    error: ErrorKind = "tracking",
    fit_tau: bool = False,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Calibration:
    """Fit the noise level, and tau where the config has one, to errors at places.

    The least squares of the logarithms of the rms position deviation and error.

    Parameters
    ----------
    places : sequence of Places
        As `locplan.simulation.places.measure` or an `Evaluation` has them.
    config : FieldConfig, optional
        What to calibrate.
    error : str
        "tracking" or "match".
    fit_tau : bool
        Whether tau is free, too, where the weight law is exponential and the estimator "sad". A
        tau for errors in metres is not one for planning: a large one sees no corridor.
    threads : int, optional
        All cores by default.
    progress : callable, optional
        Called with (done, total) values of tau.

    Raises
    ------
    ConfigError
        If there are too few places, or errors of none.
    """
    config = config or FieldConfig()
    moments = np.concatenate([each.moments(error) for each in places])[:, :2, :2]
    measured = np.sqrt(np.trace(moments, axis1=1, axis2=2))
    if len(measured) < 10 or not (measured > 0).all():
        raise ConfigError(
            f"a calibration needs at least 10 places with errors, not {len(measured)}"
        )
    tried = TAUS if fit_tau and _has_tau(config) else (None,)
    fits = []
    for n, tau in enumerate(tried):
        trial = config if tau is None else dataclasses.replace(config, tau=tau)
        bare = _bare(places, trial, threads)
        level, loss = _fit(bare, _q(places[0], trial), measured)
        fits.append((loss, level, trial, bare))
        if progress:
            progress(n + 1, len(tried))
    _, level, chosen, bare = min(fits, key=lambda fit: fit[0])
    before = bare if len(tried) == 1 else _bare(places, config, threads)
    return _calibration(
        places,
        dataclasses.replace(chosen, noise_level=level),
        error,
        bare,
        moments,
        _factor(_predicted(before, _q(places[0], config), config.noise_level), measured),
    )


def _calibration(
    places: Sequence[Places],
    config: FieldConfig,
    error: ErrorKind,
    bare: Array,
    moments: Array,
    factor_before: float,
) -> Calibration:
    q = _q(places[0], config)
    measured = np.sqrt(np.trace(moments, axis1=1, axis2=2))
    covariance = config.noise_level * bare + q
    predicted = _predicted(bare, q, config.noise_level)
    difference = np.log(predicted / measured)
    spread = np.log(measured)
    random = np.random.default_rng(0)
    levels = []
    for _ in range(RESAMPLES // 5):
        drawn = random.integers(0, len(measured), len(measured))
        levels.append(_fit(bare[drawn], q, measured[drawn])[0])
    low, high = np.quantile(levels, (0.025, 0.975)).tolist()
    normalised = np.einsum("nij,nji->n", np.linalg.inv(covariance), moments) / 2
    return Calibration(
        config=config,
        noise_level=Interval(config.noise_level, low, high),
        factor=_factor(predicted, measured),
        factor_before=factor_before,
        within_two=float(np.mean(np.abs(difference) <= math.log(2))),
        r_squared=float(1 - np.mean(difference**2) / spread.var()) if spread.var() > 0 else 0.0,
        spearman=spearman(predicted, measured),
        consistency=float(normalised.mean()),
        floor_share=float(np.mean(measured**2 < np.trace(q))),
        predicted=predicted,
        measured=measured,
        maps=[each.grid.name for each in places],
        error=error,
        fitted_tau=config.tau is not None and _has_tau(config),
    )


def _has_tau(config: FieldConfig) -> bool:
    return config.estimator == "sad" and config.weight_law == "exponential"


def _bare(places: Sequence[Places], config: FieldConfig, threads: int | None) -> Array:
    """Positional covariances with k = 1 and without Q, (n, 2, 2) [m^2]."""
    plain = dataclasses.replace(config, noise_level=1.0, quantisation=False)
    return np.concatenate(
        [covariances_at(each.grid, plain, each.points, threads=threads) for each in places]
    )[:, :2, :2]


def _q(places: Places, config: FieldConfig) -> Array:
    """What the config adds to positions, (2, 2) [m^2]."""
    if not config.quantisation:
        return np.zeros((2, 2))
    return SearchWindow.from_config(config, places.grid.resolution).quantisation[:2, :2]


def _predicted(bare: Array, q: Array, level: float) -> Array:
    """Rms position deviation, (n,) [m]; never quite 0."""
    variance = level * np.trace(bare, axis1=1, axis2=2) + np.trace(q)
    return np.sqrt(np.maximum(variance, np.finfo(float).tiny))


def _fit(bare: Array, q: Array, measured: Array) -> tuple[float, float]:
    """The level of least loss, and the loss."""

    def loss(log_level: float) -> float:
        predicted = _predicted(bare, q, math.exp(log_level))
        return float(np.mean(np.log(predicted / measured) ** 2))

    low, high = map(math.log, LEVELS)
    coarse = np.linspace(low, high, 60)
    nearest = coarse[int(np.argmin([loss(each) for each in coarse]))]
    step = coarse[1] - coarse[0]
    found = minimize_scalar(loss, bounds=(nearest - step, nearest + step), method="bounded")
    return math.exp(found.x), float(found.fun)


def _factor(predicted: Array, measured: Array) -> float:
    return float(np.exp(np.sqrt(np.mean(np.log(predicted / measured) ** 2))))
