"""A few positions that stand for a whole field."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from locplan.field._covariance import mean_information
from locplan.field._field import CovarianceField
from locplan.field._lattice import well_spaced

MIN_CLEARANCE = 0.15
"""Least distance of a sample from walls [m]; closer ones would lie in slits and stray cells."""


def sampled(
    field: CovarianceField, spacing: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions at least `spacing` [m] apart, chosen far from walls first, and their covariances.

    Returns
    -------
    xy : (n, 2) array
        Positions of lattice points of the field [m].
    covariance : (n, d, d) array
        Covariances there; for several headings, those of the mean information.
    """
    stride = field.stride
    clearance = field.grid.clearance[::stride, ::stride]
    i, j = np.nonzero(field.evaluated & (clearance >= MIN_CLEARANCE))
    clearance = clearance[i, j]
    x, y = field.grid.grid_to_world(i * stride + 0.5, j * stride + 0.5)
    xy = np.stack([x, y], axis=1)
    chosen = well_spaced(xy, clearance, spacing)
    covariance = field.covariance[i[chosen], j[chosen]]
    several = covariance.ndim == 4
    return xy[chosen], mean_information(covariance) if several else covariance
