"""Scalars and axes of pose covariances, their means, anchors, labels and units."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._util.checks import shown
from locplan.errors import ConfigError
from locplan.field._estimator import Estimator
from locplan.field._search_window import OffsetLattice


class Quantity(NamedTuple):
    """Label and unit of a scalar or a layer of a field, for pictures and tables."""

    label: str
    unit: str
    factor: float = 1.0
    """Factor that turns the value into the unit that is shown."""

    @property
    def axis(self) -> str:
        """Label and unit of a colour bar."""
        return f"{self.label} [{self.unit}]"


SCALARS = {
    "e": Quantity("pose uncertainty e", "m² rad"),
    "position_std": Quantity("largest position std. deviation", "cm", 100.0),
    "position_rms": Quantity("rms position deviation", "cm", 100.0),
    "heading_std": Quantity("heading std. deviation", "deg", 180.0 / np.pi),
}
"""Label and shown unit of each scalar of a covariance by name, see `scalar`."""
MIN_VARIANCE = 1e-12
"""Variance far below what any lidar resolves [m^2, rad^2]."""


def scalar(covariance: ArrayLike, name: str) -> NDArray[np.float64]:
    """A scalar of covariances of (x, y, theta), or of (x, y) where there is no rotation.

    Parameters
    ----------
    covariance : (..., d, d) array
        Covariances of (x, y, theta) [m, m, rad], d = 3, or of (x, y), d = 2.
    name : str
        "e": sqrt(det) (Eq. 10) [m^2 rad, or m^2]; "position_std": the largest standard deviation
        in any direction [m]; "position_rms": sqrt of the trace of the positional block [m];
        "heading_std": standard deviation of the heading [rad], zero without rotation.

    Returns
    -------
    (...) array
        The scalar of each covariance; NaN where the covariance is.

    Raises
    ------
    ConfigError
        If there is no such scalar.

    Examples
    --------
    >>> bool(np.isclose(scalar(np.diag([4.0, 1.0, 0.25]), "e"), 1.0))
    True
    >>> float(scalar(np.diag([4.0, 1.0, 0.25]), "position_std"))
    2.0
    """
    matrix = np.asarray(covariance, float)
    if name == "e":
        with np.errstate(invalid="ignore"):  # NaN where a field was not evaluated
            return np.asarray(np.sqrt(np.maximum(np.linalg.det(matrix), 0.0)))
    if name == "position_std":
        return position_axes(matrix)[0]
    if name == "position_rms":
        return np.asarray(np.sqrt(matrix[..., 0, 0] + matrix[..., 1, 1]))
    if name == "heading_std":
        if matrix.shape[-1] == 2:
            return np.where(np.isnan(matrix[..., 0, 0]), np.nan, 0.0)
        return np.asarray(np.sqrt(matrix[..., 2, 2]))
    raise ConfigError(f"scalar must be one of {', '.join(SCALARS)}, not {shown(name)}")


def position_axes(
    covariance: ArrayLike,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Standard deviations along the error ellipse's axes and the first axis' direction.

    Parameters
    ----------
    covariance : (..., d, d) array
        Covariances whose first two axes are x and y [m], such as `CovarianceField.covariance`.

    Returns
    -------
    major, minor : (...) arrays
        Standard deviations [m].
    direction : (...) array
        Direction of the major axis, counter-clockwise from x, in (-pi/2, pi/2] [rad].
    """
    matrix = np.asarray(covariance, float)
    xx, xy, yy = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 1]
    mean, radius = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    major, minor = np.sqrt(mean + radius), np.sqrt(np.maximum(mean - radius, 0.0))
    return major, minor, 0.5 * np.arctan2(2 * xy, xx - yy)


def log_euclidean_mean(
    covariances: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weighted mean of covariances in the matrix logarithm, (d, d).

    ln det of the mean, and so its ln e, is the weighted mean of those of the covariances.

    Parameters
    ----------
    covariances : (n, d, d) array
        The covariances, of one unit.
    weights : (n,) array
        Weight of each of them, not negative; only their ratios count.
    """
    return _exp(np.einsum("n,nij->ij", weights / weights.sum(), _log(covariances)))


def log_euclidean_means(
    some: NDArray[np.float64], others: NDArray[np.float64], shares: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mean of each two covariances (..., d, d) in the matrix logarithm; NaN where one is.

    The others have the shares (...), from 0 to 1, and the first the rest.
    """
    means = np.full(np.broadcast_shapes(some.shape, others.shape), np.nan)
    known = ~np.isnan(some + others).any(axis=(-2, -1))
    share = shares[known][:, None, None]
    means[known] = _exp((1 - share) * _log(some[known]) + share * _log(others[known]))
    return means


def _log(covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    values, vectors = np.linalg.eigh(covariances)
    logs = np.log(np.maximum(values, np.finfo(float).tiny))
    return np.asarray((vectors * logs[..., None, :]) @ np.swapaxes(vectors, -1, -2))


def _exp(logs: NDArray[np.float64]) -> NDArray[np.float64]:
    values, vectors = np.linalg.eigh(logs)
    return np.asarray((vectors * np.exp(values)[..., None, :]) @ np.swapaxes(vectors, -1, -2))


def rotated(covariance: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Covariances (..., d, d) of poses whose axes are turned counter-clockwise by `yaw` [rad]."""
    turn = np.eye(covariance.shape[-1])
    turn[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    return turn @ covariance @ turn.T


def mean_information(covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverse of the mean of the inverses of covariances, (..., d, d).

    It merges the headings of a robot: information adds up. 1e-12 m^2 or rad^2 is added to all
    variances, since one of zero would have no inverse.

    Parameters
    ----------
    covariances : (..., n, d, d) array
        The covariances, of which each n are merged.
    """
    extended = covariances + MIN_VARIANCE * np.eye(covariances.shape[-1])
    return np.linalg.inv(np.linalg.inv(extended).mean(axis=-3))


def anchors_of(estimator: Estimator, window: OffsetLattice, name: str) -> tuple[float, float]:
    """Values of a scalar or a layer at which u is 0 and 1, see `CovarianceField.anchors`."""
    for layer in estimator.layers:
        if layer.name == name:
            return layer.anchors(window)
    least, greatest = estimator.perfect(window), estimator.featureless(window)
    return float(scalar(least, name)), float(scalar(greatest, name))


def quantity_of(estimator: Estimator, e_unit: str, name: str | None) -> Quantity:
    """Label and unit of a scalar or of a layer, see `CovarianceField.quantity`."""
    name = name or estimator.criterion
    if name == "e":
        return Quantity(SCALARS["e"].label, e_unit)
    layers = {each.name: each for each in estimator.layers}
    return Quantity(layers[name].label, layers[name].unit) if name in layers else SCALARS[name]
