"""A few positions that stand for a whole field, and its values at some cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.field._covariance import mean_information
from locplan.field._field import CovarianceField
from locplan.field._lattice import read_at, well_spaced

MIN_CLEARANCE = 0.15
"""Least distance of a sample from walls [m]; closer ones would lie in slits and stray cells."""


def sampled_covariances(
    field: CovarianceField, spacing: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Choose positions of a field with their covariances, far from walls first.

    Parameters
    ----------
    field : CovarianceField
        The field.
    spacing : float
        Least distance of two positions [m].

    Returns
    -------
    xy : (n, 2) array
        The positions [m].
    covariances : (n, d, d) array
        Their covariances; for several headings that of the mean information.
    """
    stride = field.stride
    clearance = field.grid.clearance[::stride, ::stride]
    i, j = np.nonzero(field.evaluated & (clearance >= MIN_CLEARANCE))
    xy = np.stack(field.grid.grid_to_world(i * stride + 0.5, j * stride + 0.5), axis=1)
    chosen = well_spaced(xy, clearance[i, j], spacing)
    covariance = field.covariance[i[chosen], j[chosen]]
    return xy[chosen], mean_information(covariance) if covariance.ndim == 4 else covariance


def values_at(
    field: CovarianceField,
    values: NDArray[np.float64],
    rows: NDArray[Any],
    cols: NDArray[Any],
    *,
    logarithmic: bool = True,
) -> NDArray[np.float64]:
    """Interpolate lattice values as `CovarianceField.on_map` does, at some cells alone.

    Parameters
    ----------
    field : CovarianceField
        The field, which has the lattice.
    values : (h, w) array
        The values at its lattice points.
    rows, cols : array
        The cells, broadcast together; they may lie between cells, free or not.
    logarithmic : bool, default True
        Whether the logarithms are interpolated, or the values themselves.

    Returns
    -------
    array
        The values at the cells, NaN where no corner was evaluated.
    """
    if logarithmic:
        values = np.log(np.maximum(values, np.finfo(float).tiny))
    read = read_at(field.on_lattice(values), rows, cols, field.stride)
    return np.exp(read, out=read) if logarithmic else read
