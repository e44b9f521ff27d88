"""Covariances of poses: scalars, axes, means, units, and checks of an estimator's results."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from locplan._support.checks import check_integer, short_repr
from locplan._support.kernels.arrays import Bools, Floats, Octets
from locplan.errors import ConfigError, FieldError
from locplan.field.estimator import Estimator, MapPart, Values
from locplan.field.search_window import OffsetLattice
from locplan.maps.occupancy import FREE


class QuantityLabel(NamedTuple):
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
    "e": QuantityLabel("pose uncertainty e", "m² rad"),
    "position_std": QuantityLabel("largest position std. deviation", "cm", 100.0),
    "position_rms": QuantityLabel("rms position deviation", "cm", 100.0),
    "heading_std": QuantityLabel("heading std. deviation", "deg", 180.0 / np.pi),
}
"""Label and shown unit of each scalar of a covariance by name, see `scalar`."""


def scalar(covariance: ArrayLike, name: str) -> Floats:
    """Compute a scalar of covariances of (x, y, theta), or of (x, y) without rotation.

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
        The scalar of each covariance; NaN for a NaN covariance.

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
    raise ConfigError(f"scalar must be one of {', '.join(SCALARS)}, not {short_repr(name)}")


def position_axes(covariance: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return standard deviations along the error ellipse's axes, and the first axis' direction.

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


def compute_log_means(first: Floats, second: Floats, shares: Floats) -> Floats:
    """Compute the mean of each two covariances (..., d, d) in the matrix logarithm; NaN stays NaN.

    The second covariances have the weights `shares` (...), 0 to 1, the first the remainder.
    """
    means = np.full(np.broadcast_shapes(first.shape, second.shape), np.nan)
    is_finite = ~np.isnan(first + second).any(axis=(-2, -1))
    share = shares[is_finite][:, None, None]
    means[is_finite] = _exp_matrices(
        (1 - share) * _log_matrices(first[is_finite]) + share * _log_matrices(second[is_finite])
    )
    return means


def _log_matrices(covariances: Floats) -> Floats:
    """Return the matrix logarithms of covariances."""
    values, vectors = np.linalg.eigh(covariances)
    logs = np.log(np.maximum(values, np.finfo(float).tiny))
    return np.asarray((vectors * logs[..., None, :]) @ np.swapaxes(vectors, -1, -2))


def _exp_matrices(logs: Floats) -> Floats:
    """Return the covariances with these matrix logarithms."""
    values, vectors = np.linalg.eigh(logs)
    return np.asarray((vectors * np.exp(values)[..., None, :]) @ np.swapaxes(vectors, -1, -2))


def rotate_covariance(covariance: Floats, yaw: float) -> Floats:
    """Rotate covariances (..., d, d) of poses counter-clockwise by `yaw` [rad]."""
    if not yaw:  # even the sign of a zero stays
        return covariance
    turn = np.eye(covariance.shape[-1])
    turn[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    return turn @ covariance @ turn.T


def average_information(covariances: Floats) -> Floats:
    """Return the inverse of the mean of the inverses of covariances, (..., d, d).

    It merges the headings of a robot: information adds up. 1e-12 m^2 or rad^2, far below what any
    lidar resolves, is added to all variances, since one of zero would have no inverse.

    Parameters
    ----------
    covariances : (..., n, d, d) array
        The covariances, of which each n are merged.
    """
    extended = covariances + 1e-12 * np.eye(covariances.shape[-1])
    return np.linalg.inv(np.linalg.inv(extended).mean(axis=-3))


def compute_anchors(estimator: Estimator, window: OffsetLattice, name: str) -> tuple[float, float]:
    """Return the values of a scalar or a layer at which u is 0 and 1, see
    `CovarianceField.anchors`.
    """
    for layer in estimator.layers:
        if layer.name == name:
            return layer.anchors(window)
    perfect, featureless = estimator.perfect(window), estimator.featureless(window)
    return float(scalar(perfect, name)), float(scalar(featureless, name))


def find_quantity(estimator: Estimator, e_unit: str, name: str | None) -> QuantityLabel:
    """Return label and unit of a scalar or of a layer, see `CovarianceField.quantity`."""
    name = name or estimator.criterion
    if name == "e":
        return QuantityLabel(SCALARS["e"].label, e_unit)
    layers = {layer.name: layer for layer in estimator.layers}
    return QuantityLabel(layers[name].label, layers[name].unit) if name in layers else SCALARS[name]


TOLERANCE, MIN_ROUNDING = 1e-6, 1e-9
"""Rounding that is let pass: of the greatest value beside it, and in any case, of the variances of
a featureless place."""


def check_values(values: object, estimator: Estimator, part: MapPart) -> None:
    """Raise a FieldError unless values are valid covariances and layers at the cells of a part.

    Parameters
    ----------
    values : object
        What `Estimator.covariances` has returned, and no stop had been asked for.
    estimator : Estimator
        The estimator.
    part : MapPart
        The n cells, and k headings; the levels around them are not read.
    """
    expected = ["covariance", *(layer.name for layer in estimator.layers)]
    if not isinstance(values, dict) or set(values) != set(expected):
        actual = _quote_names(values) if isinstance(values, dict) else short_repr(values)
        problem = f"covariances() must return a dict with {_quote_names(expected)}, not {actual}"
        raise _make_estimator_error(estimator, f"{problem}; name all others in `layers`")
    lattice = estimator.lattice(part.resolution)
    for name in expected:
        axes = (lattice.dimension,) * 2 if name == "covariance" else ()
        _check_array(name, values[name], estimator, part, axes)
    scale = np.sqrt(np.diag(lattice.uniform_covariance + lattice.quantisation))
    covariance = values["covariance"] / np.outer(scale, scale)
    skew = np.abs(covariance - np.swapaxes(covariance, -2, -1)).max(axis=(-2, -1))
    rounding = MIN_ROUNDING + TOLERANCE * np.abs(covariance).max(axis=(-2, -1))
    _raise_if_any(skew > rounding, "a covariance that is not symmetric", estimator, part)
    smallest_eigenvalue = np.linalg.eigvalsh(covariance)[..., 0]
    _raise_if_any(
        smallest_eigenvalue < -rounding, "a covariance with a negative eigenvalue", estimator, part
    )


def check_halo(estimator: Estimator, part: MapPart, values: Values, levels: Octets) -> None:
    """Raise a FieldError if the map beyond an estimator's halo changes values of a part.

    They are computed again, each alone, with free and occupied cells swapped beyond the halo.

    Parameters
    ----------
    estimator : Estimator
        The estimator.
    part : MapPart
        The cells, at least one.
    values : dict of arrays
        The values of the part, which `check_values` has let pass.
    levels : (H, W) array of uint8
        Levels of the whole map.
    """
    halo = read_halo(estimator, part.resolution, part.map_shape)
    for cell_index in np.unique(np.linspace(0, len(part.rows) - 1, 3).astype(int)):
        recomputed = estimator.covariances(_isolate_cell(estimator, part, cell_index, halo, levels))
        if not all(
            _are_close(recomputed[name][0], array[cell_index]) for name, array in values.items()
        ):
            raise _make_estimator_error(
                estimator,
                f"the values at {_format_cell(part, cell_index)} change with the map beyond the"
                " halo of"
                f" {halo}"
                " cells; let halo() reach as far as it looks, and draw no random numbers",
            )


def read_halo(estimator: Estimator, resolution: float, map_shape: tuple[int, int]) -> int:
    """Return the halo of an estimator [cells]; a ConfigError if it is no whole number."""
    halo = estimator.halo(resolution, map_shape)
    return check_integer(f"halo() of estimator {short_repr(estimator.name)}", halo, 0)


def _check_array(
    name: str, array: object, estimator: Estimator, part: MapPart, axes: tuple[int, ...]
) -> None:
    """Raise a FieldError if an array has a wrong type or shape, or is not finite."""
    headings = len(part.headings)
    places = (len(part.rows),) if headings == 1 else (len(part.rows), headings)
    shape = (*places, *axes)
    if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype.kind not in "fiu":
        actual = short_repr(array)
        if isinstance(array, np.ndarray):
            actual = f"{array.dtype} of shape {array.shape}"
        problem = f"{short_repr(name)} must be an array of numbers of shape {shape}, not {actual}"
        raise _make_estimator_error(estimator, problem)
    lost = np.isfinite(array).reshape(*places, -1).min(axis=-1, keepdims=True) == 0
    _raise_if_any(lost, f"a {name} that is not finite", estimator, part)


def _raise_if_any(is_bad: Bools, defect: str, estimator: Estimator, part: MapPart) -> None:
    """Raise a FieldError that names the first bad place, if there is one."""
    if is_bad.any():
        cell_text = _format_cell(part, np.argwhere(is_bad)[0][0])
        raise _make_estimator_error(
            estimator, f"{cell_text} has {defect}; correct covariances() there"
        )


def _format_cell(part: MapPart, cell_index: int) -> str:
    """Return the place of a cell for messages."""
    return f"row {part.rows[cell_index]}, column {part.cols[cell_index]} of the map"


def _make_estimator_error(estimator: Estimator, problem: str) -> FieldError:
    """Return the error about a problem of an estimator."""
    return FieldError(f"estimator {short_repr(estimator.name)}: {problem}")


def _quote_names(names: Iterable[str]) -> str:
    """Return names in quotes."""
    return ", ".join(map(short_repr, names))


def _isolate_cell(
    estimator: Estimator, part: MapPart, cell_index: int, halo: int, levels: Octets
) -> MapPart:
    """Return one cell of a part with the map up to the halo, and a ring of a different map around
    it.
    """
    row, col = int(part.rows[cell_index]), int(part.cols[cell_index])

    def make_box(reach: int) -> tuple[slice, slice]:
        rows, cols = (slice(max(0, i - reach), i + reach + 1) for i in (row, col))
        return rows, cols

    # A ring beyond the halo, which must not matter.
    around, outer = FREE - levels, make_box(halo + 16)
    around[make_box(halo)] = levels[make_box(halo)]
    return replace(
        part,
        levels=around[outer],
        rows=part.rows[[cell_index]],
        cols=part.cols[[cell_index]],
        corner=(outer[0].start, outer[1].start),
        prepared=estimator.prepare(around[outer], part.resolution),
        control=np.zeros_like(part.control),
    )


def _are_close(first: Floats, second: Floats) -> bool:
    """True if two covariances are equal up to rounding."""
    greatest = np.abs(second).max(initial=MIN_ROUNDING)
    return first.shape == second.shape and bool(
        (np.abs(first - second) <= TOLERANCE * greatest).all()
    )


DEGENERATE = 0.5
"""The u above which a place counts as degenerate."""
