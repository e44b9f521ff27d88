"""Uncertainty of a robot along routes, with each of many candidate objects.

A covariance P (6,) is [xx, xy, yy, xt, yt, tt]. Along a route it becomes F P F^T + Q ds between two
scans, and (P^-1 + I)^-1 at each scan. `locplan.advice.kernels.landmarks` computes the sums that
make up I.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Floats, Ints
from locplan.advice.kernels.landmarks import (
    HITS,
    TT,
    XT,
    XX,
    XY,
    YT,
    YY,
    LandmarkScene,
    ObjectSightings,
    write_object_sums,
)


class BeamSensing(NamedTuple):
    """Conversion of the sum over the rays to information: share * sum / (1 + coefficient * hits).

    The hits are on the map without objects. If hits on objects counted, a search would prefer to
    hide objects behind objects.
    """

    share: float  # [1 / m^2]
    hit_coefficient: float  # reduction of a hit's information by each further hit


class MotionNoise(NamedTuple):
    """Variances of the motion model per metre, and at the start."""

    along: float  # [m^2 / m]
    across: float  # [m^2 / m]
    turn: float  # [rad^2 / m]
    start: float  # [m^2]
    start_turn: float  # [rad^2]


@njit(nogil=True, cache=True, error_model="numpy")
def update_covariance(covariance: Floats, sums: Floats, sensing: BeamSensing) -> None:
    """Turn a covariance P (6,) into (P^-1 + I)^-1, with I from the sums (7,)."""
    share = sensing.share / (1 + sensing.hit_coefficient * max(sums[HITS], 0.0))
    _invert_covariance(covariance)
    for k in range(6):
        covariance[k] += share * sums[k]
    _invert_covariance(covariance)


@njit(inline="always")
def _invert_covariance(matrix: Floats) -> None:
    """Invert a symmetric matrix (6,) in place."""
    a, b, d, c, e, f = matrix[XX], matrix[XY], matrix[YY], matrix[XT], matrix[YT], matrix[TT]
    cofactor_xx, cofactor_xy, cofactor_xt = d * f - e * e, c * e - b * f, b * e - c * d
    factor = 1 / (a * cofactor_xx + b * cofactor_xy + c * cofactor_xt)
    matrix[XX], matrix[XY], matrix[XT] = (
        cofactor_xx * factor,
        cofactor_xy * factor,
        cofactor_xt * factor,
    )
    matrix[YY], matrix[YT], matrix[TT] = (
        (a * f - c * c) * factor,
        (b * c - a * e) * factor,
        (a * d - b * b) * factor,
    )


@njit(nogil=True, cache=True, error_model="numpy")
def move_covariance(covariance: Floats, dx: float, dy: float, motion: MotionNoise) -> None:
    """Turn a covariance P (6,) into F P F^T + Q ds, as the robot moves by (dx, dy)."""
    way = np.hypot(dx, dy)
    xt, yt, tt = covariance[XT], covariance[YT], covariance[TT]
    covariance[XX] += -2 * dy * xt + dy * dy * tt
    covariance[XY] += dx * xt - dy * yt - dx * dy * tt
    covariance[YY] += 2 * dx * yt + dx * dx * tt
    covariance[XT] -= dy * tt
    covariance[YT] += dx * tt
    if way > 0:
        cos, sin = dx / way, dy / way
        along, across = motion.along * way, motion.across * way
        covariance[XX] += along * cos * cos + across * sin * sin
        covariance[XY] += (along - across) * cos * sin
        covariance[YY] += along * sin * sin + across * cos * cos
        covariance[TT] += motion.turn * way


@njit(nogil=True, cache=True, error_model="numpy")
def compute_route_covariances(
    sums: Floats, poses: Floats, routes: Ints, sensing: BeamSensing, motion: MotionNoise
) -> tuple[Floats, Floats]:
    """Return the covariances (n, 6) before and after each scan along routes.

    `routes` (r + 1,) holds the index of each route's first pose, and the number of all poses.
    """
    covariances_before, covariances_after = np.zeros((len(sums), 6)), np.zeros((len(sums), 6))
    covariance = np.zeros(6)
    for r in range(routes.size - 1):
        _set_start_covariance(covariance, motion)
        for n in range(routes[r], routes[r + 1]):
            if n > routes[r]:
                move_covariance(
                    covariance, poses[n, 0] - poses[n - 1, 0], poses[n, 1] - poses[n - 1, 1], motion
                )
            for k in range(6):
                covariances_before[n, k] = covariance[k]
            update_covariance(covariance, sums[n], sensing)
            for k in range(6):
                covariances_after[n, k] = covariance[k]
    return covariances_before, covariances_after


@njit(inline="always")
def _is_object_forgotten(covariance: Floats, covariance_without_object: Floats) -> bool:
    """True if an object that is out of sight no longer matters."""
    share = 1e-6  # by which a variance may differ from what it was
    is_close = (
        abs(covariance[XX] - covariance_without_object[XX]) <= share * covariance_without_object[XX]
    )
    is_close &= (
        abs(covariance[YY] - covariance_without_object[YY]) <= share * covariance_without_object[YY]
    )
    return (
        is_close
        and abs(covariance[TT] - covariance_without_object[TT])
        <= share * covariance_without_object[TT]
    )


@njit(inline="always")
def _set_start_covariance(covariance: Floats, motion: MotionNoise) -> None:
    """Set a covariance to its value at the start of a route."""
    for k in range(6):
        covariance[k] = 0.0
    covariance[XX] = covariance[YY] = motion.start
    covariance[TT] = motion.start_turn


@njit(nogil=True, cache=True, error_model="numpy")
def compute_mean_variances(
    candidates: Floats,
    indices: Ints,
    sightings: ObjectSightings,
    scene: LandmarkScene,
    routes: Ints,
    sensing: BeamSensing,
    motion: MotionNoise,
) -> Floats:
    """Return the mean of P_xx + P_yy over all poses with each of some candidates, (m,) [m^2].

    Parameters
    ----------
    candidates : (c, 3) array
        x, y and heading of all candidates [m, m, rad].
    indices : (m,) array
        Indices of the candidates to evaluate.
    sightings : ObjectSightings
        The poses that see each candidate.
    scene : LandmarkScene
        The hits on the map and earlier objects, the poses with their rays, and the object.
    routes, sensing, motion
        See `compute_route_covariances`.
    """
    base_covariances = compute_route_covariances(
        scene.sums, scene.rays.poses, routes, sensing, motion
    )
    after, count = base_covariances[1], len(scene.sums)
    total = 0.0
    for n in range(count):
        total += after[n, XX] + after[n, YY]
    result = np.empty(len(indices))
    for m in range(len(indices)):
        at = indices[m]
        stretch = sightings.starts[at], sightings.starts[at + 1]
        place = candidates[at, 0], candidates[at, 1], candidates[at, 2]
        models = sensing, motion
        value = _sum_variances(
            total, place, stretch, sightings, scene, routes, models, base_covariances
        )
        result[m] = value / count
    return result


@njit(nogil=True, cache=True, error_model="numpy")
def _sum_variances(
    variance_sum: float,
    place: tuple[float, float, float],
    stretch: tuple[int, int],
    sightings: ObjectSightings,
    scene: LandmarkScene,
    routes: Ints,
    models: tuple[BeamSensing, MotionNoise],
    base_covariances: tuple[Floats, Floats],
) -> float:
    """Return the sum of P_xx + P_yy over all poses, updated for an object at `place`.

    `stretch` is the range of the object's sightings. Covariances are followed from each pose that
    sees the object until they agree with `base_covariances`, before and after each scan without it.
    """
    sensing, motion = models
    covariances_before, covariances_after = base_covariances
    sums, poses = scene.sums, scene.rays.poses
    changed, covariance = np.empty(7), np.empty(6)
    k, stop = stretch
    r = n = 0
    differs = False  # True if the covariance before pose n has changed
    while k < stop or differs:
        if not differs:
            n = sightings.poses[k]
            while routes[r + 1] <= n:
                r += 1
        meets = k < stop and sightings.poses[k] == n
        if meets:
            begin, n_rays = sightings.rays[k, 0], sightings.rays[k, 1]
            meets = write_object_sums(scene, n, place, begin, n_rays, changed)
            k += 1
        if not differs and not meets:
            continue
        if not differs:
            for entry in range(6):
                covariance[entry] = covariances_before[n, entry]
        update_covariance(covariance, changed if meets else sums[n], sensing)
        variance_sum += (
            covariance[XX] + covariance[YY] - covariances_after[n, XX] - covariances_after[n, YY]
        )
        differs = n + 1 < routes[r + 1] and (
            meets or not _is_object_forgotten(covariance, covariances_after[n])
        )
        if differs:
            n += 1
            move_covariance(
                covariance, poses[n, 0] - poses[n - 1, 0], poses[n, 1] - poses[n - 1, 1], motion
            )
    return variance_sum
