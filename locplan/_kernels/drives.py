"""A drive through a world while a particle filter follows on the map, and how far it is off."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.lidar import Lidar
from locplan._kernels.measured import Disturbances, measured_ends
from locplan._kernels.particles import (
    BeamScores,
    Filter,
    insert,
    likeliest,
    make_histogram,
    move,
    resample,
    weigh,
    wrapped,
)


class Odometry(NamedTuple):
    """How wheels mislead: standard deviations, of drifts by the root of the way."""

    distance_drift: float  # [m / sqrt(m)]
    heading_drift: float  # [rad / sqrt(m)]
    turn_drift: float  # [rad / sqrt(rad)]
    distance_bias: float  # of each drive's factor on distances
    heading_bias: float  # of each drive's bend [rad / m]
    turn_bias: float  # of each drive's factor on turns


class Start(NamedTuple):
    """How well the filter knows where it begins: standard deviations."""

    position: float  # [m]
    heading: float  # [rad]


@njit(nogil=True, cache=True)
def odometry_along(
    random: np.random.Generator, truth: NDArray[np.float64], odometry: Odometry
) -> NDArray[np.float64]:
    """What odometry makes of a drive: poses (n, 3), the first one without error [m, m, rad]."""
    scale = 1 + odometry.distance_bias * random.standard_normal()
    bend = odometry.heading_bias * random.standard_normal()
    turn_scale = 1 + odometry.turn_bias * random.standard_normal()
    poses = np.empty_like(truth)
    poses[0] = truth[0]
    for n in range(1, len(truth)):
        dx, dy = truth[n, 0] - truth[n - 1, 0], truth[n, 1] - truth[n - 1, 1]
        way, turn = np.hypot(dx, dy), wrapped(truth[n, 2] - truth[n - 1, 2])
        aside = np.arctan2(dy, dx) - truth[n - 1, 2] if way > 0 else 0.0
        told = scale * way + odometry.distance_drift * np.sqrt(way) * random.standard_normal()
        told_turn = turn_scale * turn + bend * way
        told_turn += random.standard_normal() * np.sqrt(
            odometry.heading_drift**2 * way + odometry.turn_drift**2 * abs(turn)
        )
        heading = poses[n - 1, 2]
        poses[n, 0] = poses[n - 1, 0] + told * np.cos(heading + aside)
        poses[n, 1] = poses[n - 1, 1] + told * np.sin(heading + aside)
        poses[n, 2] = heading + told_turn
    return poses


@njit(nogil=True, cache=True, error_model="numpy")
def drive(
    random: np.random.Generator,
    truth: NDArray[np.float64],
    squares: NDArray[np.uint8],
    scores: BeamScores,
    lidar: Lidar,
    disturbances: Disturbances,
    odometry: Odometry,
    start: Start,
    settings: Filter,
    errors: NDArray[np.float64],
) -> None:
    """Drive once, and write how far the filter's pose is off at every pose, into (n, 3).

    As AMCL does: the filter moves, weighs and resamples once odometry has come far enough, and in
    between the pose follows odometry.

    Parameters
    ----------
    random : numpy.random.Generator
        Of all that is left to chance.
    truth : (n, 3) array
        The poses driven through, in the map's own axes [m, m, rad].
    squares : (4, H + 2, W + 2) array of uint8
        The world as `rays.empty_squares`, which may differ from the map.
    scores : BeamScores
        Of the map.
    lidar, disturbances, odometry, start, settings
        What measures, what disturbs it, and the filter.
    errors : (n, 3) array
        Filled with the filter's pose less the true one [m, m, rad].
    """
    told = odometry_along(random, truth, odometry)
    most = settings.max_particles
    poses, drawn = np.empty((3, most)), np.empty((3, most))
    spread = np.array([start.position, start.position, start.heading])
    for axis in range(3):
        poses[axis] = truth[0, axis] + spread[axis] * random.standard_normal()
    histogram, bins = make_histogram(most), 0
    for n in range(most):
        for axis in range(3):
            poses[axis, n] += spread[axis] * random.standard_normal()
        bins = insert(histogram, bins, n, poses[0, n], poses[1, n], poses[2, n])
    count, weights = most, np.full(most, 1 / most)
    pose, at = np.array(likeliest(histogram, bins, poses, count)), 0
    ends, sensor = np.empty((lidar.angles.size, 2)), np.empty(3)
    updated, updates = 0, 0
    for n in range(len(truth)):
        dx, dy = told[n, 0] - told[updated, 0], told[n, 1] - told[updated, 1]
        turn = wrapped(told[n, 2] - told[updated, 2])
        far = max(abs(dx), abs(dy)) > settings.update_min_d or abs(turn) > settings.update_min_a
        if far:
            move(random, poses, count, dx, dy, turn, told[updated, 2], settings)
        if far or n == 0:
            sensor[0], sensor[1] = truth[n, 1] / scores.resolution, truth[n, 0] / scores.resolution
            sensor[2] = truth[n, 2]
            measured_ends(random, squares, scores.resolution, sensor, lidar, disturbances, ends)
            weigh(scores, ends, poses, count, weights)
            updated, updates = n, updates + 1
            if updates % settings.resample_interval == 0:
                count, bins = resample(
                    random, poses, weights, count, settings, histogram, bins, drawn
                )
                poses, drawn = drawn, poses
                weights[:count] = 1 / count
                pose, at = np.array(likeliest(histogram, bins, poses, count)), n
        # Since then the pose has followed odometry.
        cos, sin = np.cos(pose[2] - told[at, 2]), np.sin(pose[2] - told[at, 2])
        x, y = told[n, 0] - told[at, 0], told[n, 1] - told[at, 1]
        errors[n, 0] = pose[0] + cos * x - sin * y - truth[n, 0]
        errors[n, 1] = pose[1] + sin * x + cos * y - truth[n, 1]
        errors[n, 2] = wrapped(pose[2] + told[n, 2] - told[at, 2] - truth[n, 2])
