"""A drive through a world, a particle filter that tracks it on the map, and the filter's errors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.lidar import Lidar
from locplan._kernels.measured import BeamDisturbances, measured_ends
from locplan._kernels.particles import (
    BeamScores,
    Filter,
    heaviest_cluster_mean,
    insert,
    make_histogram,
    move,
    resample,
    weigh,
    wrapped,
)


class Odometry(NamedTuple):
    """Errors of odometry: standard deviations; drifts grow with the root of distance or turn."""

    distance_drift: float  # [m / sqrt(m)]
    heading_drift: float  # [rad / sqrt(m)]
    turn_drift: float  # [rad / sqrt(rad)]
    distance_bias: float  # deviation between drives of the factor on distances
    heading_bias: float  # deviation between drives of the bend to one side [rad / m]
    turn_bias: float  # deviation between drives of the factor on turns


class Start(NamedTuple):
    """Standard deviations of the filter's first pose."""

    position: float  # [m]
    heading: float  # [rad]


@njit(nogil=True, cache=True)
def odometry_along(
    random: np.random.Generator, truth: NDArray[np.float64], odometry: Odometry
) -> NDArray[np.float64]:
    """Reported odometry of a drive: poses (n, 3), the first one without error [m, m, rad]."""
    scale = 1 + odometry.distance_bias * random.standard_normal()
    bend = odometry.heading_bias * random.standard_normal()
    turn_scale = 1 + odometry.turn_bias * random.standard_normal()
    poses = np.empty_like(truth)
    for axis in range(3):  # numba takes seconds to compile the assignment of a row
        poses[0, axis] = truth[0, axis]
    for n in range(1, len(truth)):
        dx, dy = truth[n, 0] - truth[n - 1, 0], truth[n, 1] - truth[n - 1, 1]
        way, turn = np.hypot(dx, dy), wrapped(truth[n, 2] - truth[n - 1, 2])
        aside = np.arctan2(dy, dx) - truth[n - 1, 2] if way > 0 else 0.0
        reported = scale * way + odometry.distance_drift * np.sqrt(way) * random.standard_normal()
        reported_turn = turn_scale * turn + bend * way
        reported_turn += random.standard_normal() * np.sqrt(
            odometry.heading_drift**2 * way + odometry.turn_drift**2 * abs(turn)
        )
        heading = poses[n - 1, 2]
        poses[n, 0] = poses[n - 1, 0] + reported * np.cos(heading + aside)
        poses[n, 1] = poses[n - 1, 1] + reported * np.sin(heading + aside)
        poses[n, 2] = heading + reported_turn
    return poses


@njit(nogil=True, cache=True, error_model="numpy")
def drive(
    random: np.random.Generator,
    truth: NDArray[np.float64],
    squares: NDArray[np.uint8],
    scores: BeamScores,
    lidar: Lidar,
    disturbances: BeamDisturbances,
    odometry: Odometry,
    start: Start,
    settings: Filter,
    errors: NDArray[np.float64],
) -> None:
    """Drive once, and write the filter's error at every pose into `errors`.

    As in AMCL, the filter moves, weighs and resamples once odometry has come far enough, and in
    between the pose follows odometry.

    Parameters
    ----------
    random : numpy.random.Generator
        Source of all random numbers.
    truth : (n, 3) array
        The poses driven through, in the map's own axes [m, m, rad].
    squares : (4, H + 2, W + 2) array of uint8
        The world as `rays.empty_squares`, which may differ from the map.
    scores : BeamScores
        Scores of beams on the map.
    lidar, disturbances, odometry, start, settings
        The lidar, what disturbs it, errors of odometry and of the first pose, and the filter.
    errors : (n, 3) array
        Filled with the filter's pose minus the true one [m, m, rad].
    """
    reported = odometry_along(random, truth, odometry)
    most = settings.max_particles
    poses, drawn = np.empty((3, most)), np.empty((3, most))
    sigma = np.array([start.position, start.position, start.heading])
    for axis in range(3):
        poses[axis] = truth[0, axis] + sigma[axis] * random.standard_normal()
    histogram, bins = make_histogram(most), np.int64(0)  # the constant 0 has a type of its own
    for n in range(most):
        for axis in range(3):
            poses[axis, n] += sigma[axis] * random.standard_normal()
        bins = insert(histogram, bins, n, poses[0, n], poses[1, n], poses[2, n])
    count, weights = most, np.full(most, 1 / most)
    pose, at = np.array(heaviest_cluster_mean(histogram, bins, poses, count)), 0
    ends, sensor = np.empty((lidar.angles.size, 2)), np.empty(3)
    updated, updates = 0, 0
    for n in range(len(truth)):
        dx, dy = reported[n, 0] - reported[updated, 0], reported[n, 1] - reported[updated, 1]
        turn = wrapped(reported[n, 2] - reported[updated, 2])
        far = max(abs(dx), abs(dy)) > settings.update_min_d or abs(turn) > settings.update_min_a
        if far:
            move(random, poses, count, dx, dy, turn, reported[updated, 2], settings)
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
                pose, at = np.array(heaviest_cluster_mean(histogram, bins, poses, count)), n
        # Since the last resampling the pose has followed odometry.
        cos, sin = np.cos(pose[2] - reported[at, 2]), np.sin(pose[2] - reported[at, 2])
        x, y = reported[n, 0] - reported[at, 0], reported[n, 1] - reported[at, 1]
        errors[n, 0] = pose[0] + cos * x - sin * y - truth[n, 0]
        errors[n, 1] = pose[1] + sin * x + cos * y - truth[n, 1]
        errors[n, 2] = wrapped(pose[2] + reported[n, 2] - reported[at, 2] - truth[n, 2])
