"""A particle filter that tracks simulated or recorded drives on the map.

At each pose of a drive, if `is_update_due`, `advance_particles` moves the particles and
`correct_particles` weighs them. `estimate_pose` returns the filter's pose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels import particles
from locplan._support.kernels.arrays import Floats, Ints, Octets, Random
from locplan._support.kernels.lidar import BeamDisturbances, LidarBeams, simulate_measured_ends
from locplan._support.kernels.particles import BeamScores, FilterSettings, wrap_angle

NOW, COUNT, BINS, UPDATES, UPDATED, AT = range(6)
"""Indices in `FilterState.state`."""


class StartSpread(NamedTuple):
    """Standard deviations of the error of the filter's first pose."""

    position: float  # [m]
    heading: float  # [rad]


class FilterState(NamedTuple):
    """State of a particle filter: its particles, weights and last pose."""

    clouds: Floats  # (2, 3, n) the particles, and space for the next ones
    weights: Floats  # (n,)
    histogram: particles.PoseHistogram
    averages: Floats  # (2,) slow and fast average of the mean weight, 0 before the first one
    pose: Floats  # (3,) mean of the heaviest cluster at the last resampling
    state: Ints
    # (6,) index of the cloud in use, number of particles, of bins and of updates, index of the
    # reported pose at the last update, and at the last resampling


@njit(nogil=True, cache=True)
def start_filter(
    random: Random, first_pose: Floats, deviations: StartSpread, settings: FilterSettings
) -> FilterState:
    """Draw a filter's particles around a first pose with a random error of the same deviations."""
    max_particles = settings.max_particles
    clouds, weights = np.empty((2, 3, max_particles)), np.empty(max_particles)
    poses = clouds[0]
    sigma = deviations.position, deviations.position, deviations.heading
    for axis in range(3):
        middle = first_pose[axis] + sigma[axis] * random.standard_normal()
        for n in range(max_particles):
            poses[axis, n] = middle
    histogram = particles.make_histogram(max_particles)
    bins = np.int64(0)  # the constant 0 has a type of its own
    for n in range(max_particles):
        weights[n] = 1 / max_particles
        for axis in range(3):
            poses[axis, n] += sigma[axis] * random.standard_normal()
        bins = particles.insert_particle(histogram, bins, n, poses[0, n], poses[1, n], poses[2, n])
    pose, averages, state = np.empty(3), np.zeros(2), np.zeros(6, np.int64)
    pose[0], pose[1], pose[2] = particles.compute_heaviest_mean(
        histogram, bins, poses, max_particles
    )
    state[COUNT], state[BINS] = max_particles, bins
    return FilterState(clouds, weights, histogram, averages, pose, state)


@njit(nogil=True, cache=True)
def is_update_due(
    filter_state: FilterState, reported: Floats, pose_index: int, settings: FilterSettings
) -> bool:
    """True if odometry (n, 3) has moved or turned far enough since the last update."""
    last = filter_state.state[UPDATED]
    dx, dy = (
        reported[pose_index, 0] - reported[last, 0],
        reported[pose_index, 1] - reported[last, 1],
    )
    turn = wrap_angle(reported[pose_index, 2] - reported[last, 2])
    return max(abs(dx), abs(dy)) > settings.update_min_d or abs(turn) > settings.update_min_a


@njit(nogil=True, cache=True)
def advance_particles(
    random: Random, tracker: FilterState, reported: Floats, n: int, settings: FilterSettings
) -> None:
    """Move the particles by the odometry (n, 3) from the last update to pose `n`."""
    state = tracker.state
    last = state[UPDATED]
    dx, dy = reported[n, 0] - reported[last, 0], reported[n, 1] - reported[last, 1]
    turn = wrap_angle(reported[n, 2] - reported[last, 2])
    poses = tracker.clouds[state[NOW]]
    particles.move_particles(random, poses, state[COUNT], dx, dy, turn, reported[last, 2], settings)


@njit(nogil=True, cache=True)
def update_lost_share(averages: Floats, weight: float, settings: FilterSettings) -> float:
    """Update the slow and fast averages (2,) of the mean weight; return max(0, 1 - fast / slow).

    The result is AMCL's share of random particles, which recover a filter after its weights drop.
    """
    if weight > 0:
        for n in range(2):
            alpha = settings.recovery_alpha_fast if n else settings.recovery_alpha_slow
            averages[n] = averages[n] + alpha * (weight - averages[n]) if averages[n] else weight
    return max(0.0, 1 - averages[1] / averages[0]) if averages[0] > 0 else 0.0


@njit(nogil=True, cache=True)
def correct_particles(
    random: Random,
    tracker: FilterState,
    scores: BeamScores,
    ends: Floats,
    n: int,
    settings: FilterSettings,
) -> bool:
    """Weigh the particles by the scan (beam, 2) at pose `n`, and resample every few updates.

    Return True if the particles were resampled, which updates the filter's pose.
    """
    state, weights = tracker.state, tracker.weights
    poses, new_poses = tracker.clouds[state[NOW]], tracker.clouds[1 - state[NOW]]
    weight = particles.weigh_particles(scores, ends, poses, state[COUNT], weights)
    lost = update_lost_share(tracker.averages, weight, settings)
    state[UPDATED] = n
    state[UPDATES] += 1
    if state[UPDATES] % settings.resample_interval:
        return False
    count, bins = particles.resample_particles(
        random,
        poses,
        weights,
        state[COUNT],
        settings,
        tracker.histogram,
        state[BINS],
        new_poses,
        scores,
        lost,
    )
    if lost > 0:  # as in AMCL; otherwise more and more particles would be random
        tracker.averages[0] = tracker.averages[1] = 0.0
    state[NOW], state[COUNT], state[BINS], state[AT] = 1 - state[NOW], count, bins, n
    for k in range(count):
        weights[k] = 1 / count
    x, y, heading = particles.compute_heaviest_mean(tracker.histogram, bins, new_poses, count)
    tracker.pose[0], tracker.pose[1], tracker.pose[2] = x, y, heading
    return True


@njit(nogil=True, cache=True)
def estimate_pose(
    filter_state: FilterState, reported: Floats, pose_index: int
) -> tuple[float, float, float]:
    """Return the filter's pose at `pose_index`: the last resampled pose plus odometry."""
    pose, at = filter_state.pose, filter_state.state[AT]
    cos, sin = np.cos(pose[2] - reported[at, 2]), np.sin(pose[2] - reported[at, 2])
    x, y = reported[pose_index, 0] - reported[at, 0], reported[pose_index, 1] - reported[at, 1]
    return (
        pose[0] + cos * x - sin * y,
        pose[1] + sin * x + cos * y,
        pose[2] + reported[pose_index, 2] - reported[at, 2],
    )


@njit(nogil=True, cache=True)
def write_cloud_covariance(filter_state: FilterState, covariance: Floats) -> None:
    """Write the covariance of all particles, as AMCL publishes it, into `covariance` (3, 3).

    The heading has its circular variance, and no covariance with the position.
    """
    poses, count = filter_state.clouds[filter_state.state[NOW]], filter_state.state[COUNT]
    x, y = poses[0, :count].mean(), poses[1, :count].mean()
    xx = xy = yy = cos = sin = 0.0
    for n in range(count):
        dx, dy = poses[0, n] - x, poses[1, n] - y
        xx += dx * dx
        xy += dx * dy
        yy += dy * dy
        cos += np.cos(poses[2, n])
        sin += np.sin(poses[2, n])
    covariance[:] = 0.0
    covariance[0, 0], covariance[1, 1] = xx / count, yy / count
    covariance[0, 1] = covariance[1, 0] = xy / count
    covariance[2, 2] = -2 * np.log(min(1.0, np.hypot(cos, sin) / count))


class OdometryErrors(NamedTuple):
    """Standard deviations of odometry errors; drifts grow with the root of distance or turn."""

    distance_drift: float  # [m / sqrt(m)]
    heading_drift: float  # [rad / sqrt(m)]
    turn_drift: float  # [rad / sqrt(rad)]
    distance_bias: float  # deviation between drives of the factor on distances
    heading_bias: float  # deviation between drives of the bend to one side [rad / m]
    turn_bias: float  # deviation between drives of the factor on turns


class DrivenWorld(NamedTuple):
    """World, which may differ from the filter's map, and the robot's poses in it."""

    squares: Octets  # (4, H + 2, W + 2) from `rays.compute_empty_squares`
    resolution: float  # edge of a cell [m]
    poses: Floats  # (n, 3) row, column [cells] and heading [rad] of the true poses


@njit(nogil=True, cache=True)
def simulate_odometry(random: Random, truth: Floats, odometry: OdometryErrors) -> Floats:
    """Return poses (n, 3) of simulated odometry; the first one has no error [m, m, rad]."""
    scale = 1 + odometry.distance_bias * random.standard_normal()
    bend = odometry.heading_bias * random.standard_normal()
    turn_scale = 1 + odometry.turn_bias * random.standard_normal()
    poses = np.empty_like(truth)
    for axis in range(3):  # numba takes seconds to compile the assignment of a row
        poses[0, axis] = truth[0, axis]
    for n in range(1, len(truth)):
        dx, dy = truth[n, 0] - truth[n - 1, 0], truth[n, 1] - truth[n - 1, 1]
        way, turn = np.hypot(dx, dy), wrap_angle(truth[n, 2] - truth[n - 1, 2])
        bearing = np.arctan2(dy, dx) - truth[n - 1, 2] if way > 0 else 0.0
        reported = scale * way + odometry.distance_drift * np.sqrt(way) * random.standard_normal()
        reported_turn = turn_scale * turn + bend * way
        reported_turn += random.standard_normal() * np.sqrt(
            odometry.heading_drift**2 * way + odometry.turn_drift**2 * abs(turn)
        )
        heading = poses[n - 1, 2]
        poses[n, 0] = poses[n - 1, 0] + reported * np.cos(heading + bearing)
        poses[n, 1] = poses[n - 1, 1] + reported * np.sin(heading + bearing)
        poses[n, 2] = heading + reported_turn
    return poses


@njit(nogil=True, cache=True, error_model="numpy")
def simulate_drive(
    random: Random,
    truth: Floats,
    reported: Floats,
    world: DrivenWorld,
    scores: BeamScores,
    lidar: LidarBeams,
    disturbances: BeamDisturbances,
    start: StartSpread,
    settings: FilterSettings,
    errors: Floats,
) -> None:
    """Simulate one drive, and write the filter's error at every pose into `errors`.

    As in AMCL, the filter moves, weighs and resamples when odometry has moved far enough. In
    between, the pose follows odometry.

    Parameters
    ----------
    random : numpy.random.Generator
        Source of all random numbers.
    truth : (n, 3) array
        True poses in the axes of the filter's map [m, m, rad].
    reported : (n, 3) array
        Poses by odometry in any frame, as from `simulate_odometry` [m, m, rad].
    world : World
        The world of the drive, and the true poses in it.
    scores : BeamScores
        Scores of beams on the filter's map.
    lidar, disturbances, start, settings
        The lidar, its disturbances, errors of the first pose, and the filter's settings.
    errors : (n, 3) array
        Filled with the filter's pose minus the true one [m, m, rad].
    """
    tracker = start_filter(random, truth[0], start, settings)
    ends, finer = np.empty((lidar.angles.size, 2)), world.resolution / scores.resolution
    for n in range(len(truth)):
        due = is_update_due(tracker, reported, n, settings)
        if due:
            advance_particles(random, tracker, reported, n, settings)
        if due or n == 0:
            simulate_measured_ends(
                random, world.squares, world.resolution, world.poses[n], lidar, disturbances, ends
            )
            for b in range(len(ends)):  # the filter measures in cells of its map
                ends[b, 0] *= finer
                ends[b, 1] *= finer
            correct_particles(random, tracker, scores, ends, n, settings)
        x, y, heading = estimate_pose(tracker, reported, n)
        errors[n, 0], errors[n, 1] = x - truth[n, 0], y - truth[n, 1]
        errors[n, 2] = wrap_angle(heading - truth[n, 2])


@njit(nogil=True, cache=True)
def replay_filter(
    random: Random,
    first_pose: Floats,
    reported: Floats,
    ends: Floats,
    scores: BeamScores,
    deviations: StartSpread,
    settings: FilterSettings,
    poses: Floats,
    covariances: Floats,
) -> None:
    """Track a recorded drive once, and write the filter's poses and covariances.

    Parameters
    ----------
    random : numpy.random.Generator
        Source of all random numbers.
    first_pose : (3,) array
        Pose around which the filter starts, in the axes of the map [m, m, rad].
    reported : (n, 3) array
        Poses by odometry at the scans, in any frame [m, m, rad].
    ends : (n, beam, 2) array
        Ends of the beams ahead and to the left of the robot [cells]; NaN without a return.
    scores, start, settings
        As for `simulate_drive`.
    poses : (n, 3) array
        Filled with the filter's poses in the axes of the map [m, m, rad].
    covariances : (n, 3, 3) array
        Filled with the covariance of the particles at resamplings, and with NaN elsewhere.
    """
    tracker = start_filter(random, first_pose, deviations, settings)
    for n in range(len(reported)):
        due = is_update_due(tracker, reported, n, settings)
        if due:
            advance_particles(random, tracker, reported, n, settings)
        covariances[n] = np.nan
        if (due or n == 0) and correct_particles(random, tracker, scores, ends[n], n, settings):
            write_cloud_covariance(tracker, covariances[n])
        poses[n, 0], poses[n, 1], poses[n, 2] = estimate_pose(tracker, reported, n)
