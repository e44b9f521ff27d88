"""How uncertain a robot's position is along its routes, with each of many objects besides.

A covariance P (6,) is [xx, xy, yy, xt, yt, tt]. Between two looks around it becomes F P F^T + Q ds,
and at each (P^-1 + I)^-1; see `locplan._kernels.landmarks` for the sums that make I.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.landmarks import (
    HITS,
    TT,
    XT,
    XX,
    XY,
    YT,
    YY,
    Outline,
    Rays,
    with_object,
)
from locplan._kernels.sightings import Sightings

FORGOTTEN = 1e-6
"""Share by which a variance may differ and yet count as what it was without an object."""


class Told(NamedTuple):
    """How the sum over the rays becomes information: share * sum / (1 + other * hits).

    The hits are those on the map without objects: if those on objects counted, a search would
    rather hide objects from each other than see them well.
    """

    share: float  # [1 / m^2]
    other: float  # how far each further hit lessens what a hit tells


class Motion(NamedTuple):
    """Variances of the motion model per metre, and those at the start."""

    along: float  # [m^2 / m]
    across: float  # [m^2 / m]
    turn: float  # [rad^2 / m]
    start: float  # [m^2]
    start_turn: float  # [rad^2]


@njit(nogil=True, cache=True, error_model="numpy")
def update(p: NDArray[np.float64], sums: NDArray[np.float64], told: Told) -> None:
    """Turn a covariance P (6,) [xx, xy, yy, xt, yt, tt] into (P^-1 + I)^-1, I of the sums (7,)."""
    share = told.share / (1 + told.other * max(sums[HITS], 0.0))
    _invert(p)
    for k in range(6):
        p[k] += share * sums[k]
    _invert(p)


@njit(inline="always")
def _invert(m: NDArray[np.float64]) -> None:
    """Invert a symmetric matrix (6,) in place."""
    a, b, d, c, e, f = m[XX], m[XY], m[YY], m[XT], m[YT], m[TT]
    one, two, three = d * f - e * e, c * e - b * f, b * e - c * d
    factor = 1 / (a * one + b * two + c * three)
    m[XX], m[XY], m[XT] = one * factor, two * factor, three * factor
    m[YY], m[YT], m[TT] = (
        (a * f - c * c) * factor,
        (b * c - a * e) * factor,
        (a * d - b * b) * factor,
    )


@njit(nogil=True, cache=True, error_model="numpy")
def move(p: NDArray[np.float64], dx: float, dy: float, motion: Motion) -> None:
    """Turn a covariance P (6,) into F P F^T + Q ds, as the robot moves by (dx, dy)."""
    way = np.hypot(dx, dy)
    xt, yt, tt = p[XT], p[YT], p[TT]
    p[XX] += -2 * dy * xt + dy * dy * tt
    p[XY] += dx * xt - dy * yt - dx * dy * tt
    p[YY] += 2 * dx * yt + dx * dx * tt
    p[XT] -= dy * tt
    p[YT] += dx * tt
    if way > 0:
        cos, sin = dx / way, dy / way
        along, across = motion.along * way, motion.across * way
        p[XX] += along * cos * cos + across * sin * sin
        p[XY] += (along - across) * cos * sin
        p[YY] += along * sin * sin + across * cos * cos
        p[TT] += motion.turn * way


@njit(nogil=True, cache=True, error_model="numpy")
def covariances(
    sums: NDArray[np.float64],
    poses: NDArray[np.float64],
    routes: NDArray[np.int64],
    told: Told,
    motion: Motion,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Covariances (n, 6) before and after each look around, along routes.

    `routes` (r + 1,) are the indices at which the routes begin, and the number of all poses.
    """
    before, after = np.zeros((len(sums), 6)), np.zeros((len(sums), 6))
    p = np.zeros(6)
    for r in range(routes.size - 1):
        _begin(p, motion)
        for n in range(routes[r], routes[r + 1]):
            if n > routes[r]:
                move(p, poses[n, 0] - poses[n - 1, 0], poses[n, 1] - poses[n - 1, 1], motion)
            for k in range(6):
                before[n, k] = p[k]
            update(p, sums[n], told)
            for k in range(6):
                after[n, k] = p[k]
    return before, after


@njit(inline="always")
def _alike(p: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether an object that is out of sight no longer matters."""
    alike = abs(p[XX] - other[XX]) <= FORGOTTEN * other[XX]
    alike &= abs(p[YY] - other[YY]) <= FORGOTTEN * other[YY]
    return alike and abs(p[TT] - other[TT]) <= FORGOTTEN * other[TT]


@njit(inline="always")
def _begin(p: NDArray[np.float64], motion: Motion) -> None:
    for k in range(6):
        p[k] = 0.0
    p[XX] = p[YY] = motion.start
    p[TT] = motion.start_turn


@njit(nogil=True, cache=True, error_model="numpy")
def uncertainties(
    candidates: NDArray[np.float64],
    indices: NDArray[np.int64],
    sightings: Sightings,
    hits: NDArray[np.float32],
    sums: NDArray[np.float64],
    rays: Rays,
    routes: NDArray[np.int64],
    outline: Outline,
    told: Told,
    motion: Motion,
) -> NDArray[np.float64]:
    """Mean of P_xx + P_yy over all poses with each of some candidates besides, (m,) [m^2].

    Parameters
    ----------
    candidates : (c, 3) array
        x, y and heading of all [m, m, rad].
    indices : (m,) array
        The candidates that are asked for.
    sightings : Sightings
        The poses that see each of all candidates.
    hits : (n, beams, 4) array
        Hits on the map and the objects that stand already.
    sums : (n, 7) array
        What `sums_of` makes of them.
    rays, routes, outline, told, motion
        The poses and their rays, see `covariances`, the object, and the models.
    """
    before, after = covariances(sums, rays.poses, routes, told, motion)
    count = len(sums)
    total = 0.0
    for n in range(count):
        total += after[n, XX] + after[n, YY]
    result = np.empty(len(indices))
    changed, p = np.empty(7), np.empty(6)
    for m in range(len(indices)):
        x, y, heading = (
            candidates[indices[m], 0],
            candidates[indices[m], 1],
            candidates[indices[m], 2],
        )
        value = total
        k, stop = sightings.starts[indices[m]], sightings.starts[indices[m] + 1]
        r = n = 0
        differs = False  # whether the covariance before pose n is another one
        while k < stop or differs:
            if not differs:
                n = sightings.poses[k]
                while routes[r + 1] <= n:
                    r += 1
            meets = k < stop and sightings.poses[k] == n
            if meets:
                begin, many = sightings.rays[k, 0], sightings.rays[k, 1]
                meets = with_object(
                    sums, hits, rays, n, outline, x, y, heading, begin, many, changed
                )
                k += 1
            if not differs and not meets:
                continue
            if not differs:
                for c in range(6):
                    p[c] = before[n, c]
            update(p, changed if meets else sums[n], told)
            value += p[XX] + p[YY] - after[n, XX] - after[n, YY]
            differs = n + 1 < routes[r + 1] and (meets or not _alike(p, after[n]))
            if differs:
                n += 1
                dx = rays.poses[n, 0] - rays.poses[n - 1, 0]
                move(p, dx, rays.poses[n, 1] - rays.poses[n - 1, 1], motion)
        result[m] = value / count
    return result
