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
    """Choose positions (n, 2) at least `spacing` apart [m], far from walls first.

    Their covariances (n, d, d) come with them; for several headings, of the mean information.
    """
    stride = field.stride
    clearance = field.grid.clearance[::stride, ::stride]
    i, j = np.nonzero(field.evaluated & (clearance >= MIN_CLEARANCE))
    xy = np.stack(field.grid.grid_to_world(i * stride + 0.5, j * stride + 0.5), axis=1)
    chosen = well_spaced(xy, clearance[i, j], spacing)
    covariance = field.covariance[i[chosen], j[chosen]]
    return xy[chosen], mean_information(covariance) if covariance.ndim == 4 else covariance
