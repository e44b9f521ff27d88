"""How degenerate poses are, each by itself, with each of many objects besides.

Its covariance is (I + P^-1)^-1, I of the sums of `locplan._kernels.landmarks`, P a prior; the
degeneracy u is the logarithm of the position's greatest deviation between two anchors, 0 to 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.landmarks import HITS, TT, XT, XX, XY, YT, YY, Outline, Rays, with_object
from locplan._kernels.sightings import Sightings
from locplan._kernels.way_covariances import Told


class Anchors(NamedTuple):
    """Prior of a pose, and the deviations at which it is no longer degenerate, or fully."""

    prior: float  # information of x and of y [1 / m^2]
    prior_turn: float  # information of the heading [1 / rad^2]
    least: float  # [m]
    greatest: float  # [m]


@njit(nogil=True, cache=True, error_model="numpy")
def degeneracy_of(sums: NDArray[np.float64], told: Told, anchors: Anchors) -> float:
    """Degeneracy u of a pose with these sums (7,)."""
    share = told.share / (1 + told.other * max(sums[HITS], 0.0))
    turn = anchors.prior_turn + share * sums[TT]
    xt, yt = share * sums[XT], share * sums[YT]
    # Information of the position alone, the heading being unknown.
    xx = anchors.prior + share * sums[XX] - xt * xt / turn
    xy = share * sums[XY] - xt * yt / turn
    yy = anchors.prior + share * sums[YY] - yt * yt / turn
    least = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy * xy)
    deviation = 1 / np.sqrt(max(least, 1e-12))
    u = np.log(deviation / anchors.least) / np.log(anchors.greatest / anchors.least)
    return min(max(u, 0.0), 1.0)


@njit(nogil=True, cache=True, error_model="numpy")
def degeneracies_at(sums: NDArray[np.float64], told: Told, anchors: Anchors) -> NDArray[np.float64]:
    """Degeneracy u of each pose, (n,)."""
    values = np.empty(len(sums))
    for n in range(len(sums)):
        values[n] = degeneracy_of(sums[n], told, anchors)
    return values


@njit(nogil=True, cache=True, error_model="numpy")
def mean_changes(
    candidates: NDArray[np.float64],
    indices: NDArray[np.int64],
    sightings: Sightings,
    hits: NDArray[np.float32],
    sums: NDArray[np.float64],
    rays: Rays,
    outline: Outline,
    told: Told,
    anchors: Anchors,
    now: NDArray[np.float64],
) -> NDArray[np.float64]:
    """What each of some candidates changes in the mean of u over all poses, (m,).

    `now` (n,) are the degeneracies without it; see `way_covariances.uncertainties` for the rest.
    """
    result = np.empty(len(indices))
    changed = np.empty(7)
    for m in range(len(indices)):
        at = indices[m]
        x, y, heading = candidates[at, 0], candidates[at, 1], candidates[at, 2]
        change = 0.0
        for k in range(sightings.starts[at], sightings.starts[at + 1]):
            n = sightings.poses[k]
            begin, many = sightings.rays[k, 0], sightings.rays[k, 1]
            if with_object(sums, hits, rays, n, outline, x, y, heading, begin, many, changed):
                change += degeneracy_of(changed, told, anchors) - now[n]
        result[m] = change / len(sums)
    return result
