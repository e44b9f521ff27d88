"""Drives through a world, or recorded ones, that a particle filter tracks on the map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.lidar import Lidar
from locplan._kernels.measured import BeamDisturbances, measured_ends
from locplan._kernels.particles import BeamScores, Filter, wrapped
from locplan._kernels.tracking import (
    Start,
    advance,
    begin,
    correct,
    estimate,
    is_due,
    spread_of,
)


class Odometry(NamedTuple):
    """Errors of odometry: standard deviations; drifts grow with the root of distance or turn."""

    distance_drift: float  # [m / sqrt(m)]
    heading_drift: float  # [rad / sqrt(m)]
    turn_drift: float  # [rad / sqrt(rad)]
    distance_bias: float  # deviation between drives of the factor on distances
    heading_bias: float  # deviation between drives of the bend to one side [rad / m]
    turn_bias: float  # deviation between drives of the factor on turns


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
    tracker = begin(random, truth[0], start, settings)
    ends, sensor = np.empty((lidar.angles.size, 2)), np.empty(3)
    for n in range(len(truth)):
        due = is_due(tracker, reported, n, settings)
        if due:
            advance(random, tracker, reported, n, settings)
        if due or n == 0:
            sensor[0], sensor[1] = truth[n, 1] / scores.resolution, truth[n, 0] / scores.resolution
            sensor[2] = truth[n, 2]
            measured_ends(random, squares, scores.resolution, sensor, lidar, disturbances, ends)
            correct(random, tracker, scores, ends, n, settings)
        x, y, heading = estimate(tracker, reported, n)
        errors[n, 0], errors[n, 1] = x - truth[n, 0], y - truth[n, 1]
        errors[n, 2] = wrapped(heading - truth[n, 2])


@njit(nogil=True, cache=True)
def replay(
    random: np.random.Generator,
    first: NDArray[np.float64],
    reported: NDArray[np.float64],
    ends: NDArray[np.float64],
    scores: BeamScores,
    start: Start,
    settings: Filter,
    poses: NDArray[np.float64],
    covariances: NDArray[np.float64],
) -> None:
    """Track a recorded drive once, and write the filter's poses and covariances.

    Parameters
    ----------
    random : numpy.random.Generator
        Source of all random numbers.
    first : (3,) array
        Pose that the filter begins about, in the map's own axes [m, m, rad].
    reported : (n, 3) array
        Poses by odometry at the scans, in any frame of their own [m, m, rad].
    ends : (n, beam, 2) array
        Ends of the beams ahead and to the left of the robot [cells]; NaN without a return.
    scores, start, settings
        As for `drive`.
    poses : (n, 3) array
        Filled with the filter's poses in the map's own axes [m, m, rad].
    covariances : (n, 3, 3) array
        Filled with the covariance of the particles where they were resampled, else with NaN.
    """
    tracker = begin(random, first, start, settings)
    for n in range(len(reported)):
        due = is_due(tracker, reported, n, settings)
        if due:
            advance(random, tracker, reported, n, settings)
        covariances[n] = np.nan
        if (due or n == 0) and correct(random, tracker, scores, ends[n], n, settings):
            spread_of(tracker, covariances[n])
        poses[n, 0], poses[n, 1], poses[n, 2] = estimate(tracker, reported, n)
