"""A particle filter that tracks a robot: what it holds, and its steps in AMCL's order.

Whoever drives the robot, in a world or from a recording, calls at every pose `is_due`, and if it is
`advance` and `correct`, and then `estimate`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.particles import (
    BeamScores,
    Filter,
    Histogram,
    heaviest_cluster_mean,
    insert,
    make_histogram,
    move,
    resample,
    weigh,
    wrapped,
)

NOW, COUNT, BINS, UPDATES, UPDATED, AT = range(6)
"""Places in `Tracker.state`."""


class Start(NamedTuple):
    """Standard deviations of the filter's first pose."""

    position: float  # [m]
    heading: float  # [rad]


class Tracker(NamedTuple):
    """The particles of a filter, and the pose that it told last."""

    clouds: NDArray[np.float64]  # (2, 3, most) particles, and room for those that are drawn
    weights: NDArray[np.float64]  # (most,)
    histogram: Histogram
    pose: NDArray[np.float64]  # (3,) mean of the heaviest cluster at the last resampling
    state: NDArray[np.int64]
    # (6,) which cloud holds the particles, their number, that of their bins, the number of updates,
    # the index of the reported pose at the last one, and of that at the last resampling


@njit(nogil=True, cache=True)
def begin(
    random: np.random.Generator, first: NDArray[np.float64], start: Start, settings: Filter
) -> Tracker:
    """Spread a filter's particles about a pose that is off from `first` (3,) by as much."""
    most = settings.max_particles
    clouds, weights = np.empty((2, 3, most)), np.full(most, 1 / most)
    poses = clouds[0]
    sigma = np.array([start.position, start.position, start.heading])
    for axis in range(3):
        poses[axis] = first[axis] + sigma[axis] * random.standard_normal()
    histogram, bins = make_histogram(most), np.int64(0)  # the constant 0 has a type of its own
    for n in range(most):
        for axis in range(3):
            poses[axis, n] += sigma[axis] * random.standard_normal()
        bins = insert(histogram, bins, n, poses[0, n], poses[1, n], poses[2, n])
    pose = np.array(heaviest_cluster_mean(histogram, bins, poses, most))
    return Tracker(clouds, weights, histogram, pose, np.array([0, most, bins, 0, 0, 0]))


@njit(nogil=True, cache=True)
def is_due(tracker: Tracker, reported: NDArray[np.float64], n: int, settings: Filter) -> bool:
    """Whether odometry (n, 3) has come far enough since the last update."""
    last = tracker.state[UPDATED]
    dx, dy = reported[n, 0] - reported[last, 0], reported[n, 1] - reported[last, 1]
    turn = wrapped(reported[n, 2] - reported[last, 2])
    return max(abs(dx), abs(dy)) > settings.update_min_d or abs(turn) > settings.update_min_a


@njit(nogil=True, cache=True)
def advance(
    random: np.random.Generator,
    tracker: Tracker,
    reported: NDArray[np.float64],
    n: int,
    settings: Filter,
) -> None:
    """Move the particles by the odometry (n, 3) from the last update to pose `n`."""
    state = tracker.state
    last = state[UPDATED]
    dx, dy = reported[n, 0] - reported[last, 0], reported[n, 1] - reported[last, 1]
    turn = wrapped(reported[n, 2] - reported[last, 2])
    poses = tracker.clouds[state[NOW]]
    move(random, poses, state[COUNT], dx, dy, turn, reported[last, 2], settings)


@njit(nogil=True, cache=True)
def correct(
    random: np.random.Generator,
    tracker: Tracker,
    scores: BeamScores,
    ends: NDArray[np.float64],
    n: int,
    settings: Filter,
) -> bool:
    """Weigh the particles by the scan (beam, 2) at pose `n`, and resample every few updates.

    It returns whether they were resampled, from which the filter's pose follows anew.
    """
    state, weights = tracker.state, tracker.weights
    poses, drawn = tracker.clouds[state[NOW]], tracker.clouds[1 - state[NOW]]
    weigh(scores, ends, poses, state[COUNT], weights)
    state[UPDATED] = n
    state[UPDATES] += 1
    if state[UPDATES] % settings.resample_interval:
        return False
    count, bins = resample(
        random, poses, weights, state[COUNT], settings, tracker.histogram, state[BINS], drawn
    )
    state[NOW], state[COUNT], state[BINS], state[AT] = 1 - state[NOW], count, bins, n
    weights[:count] = 1 / count
    x, y, heading = heaviest_cluster_mean(tracker.histogram, bins, drawn, count)
    tracker.pose[0], tracker.pose[1], tracker.pose[2] = x, y, heading
    return True


@njit(nogil=True, cache=True)
def estimate(tracker: Tracker, reported: NDArray[np.float64], n: int) -> tuple[float, float, float]:
    """The filter's pose at pose `n`: since the last resampling it has followed odometry."""
    pose, at = tracker.pose, tracker.state[AT]
    cos, sin = np.cos(pose[2] - reported[at, 2]), np.sin(pose[2] - reported[at, 2])
    x, y = reported[n, 0] - reported[at, 0], reported[n, 1] - reported[at, 1]
    return (
        pose[0] + cos * x - sin * y,
        pose[1] + sin * x + cos * y,
        pose[2] + reported[n, 2] - reported[at, 2],
    )


@njit(nogil=True, cache=True)
def spread_of(tracker: Tracker, covariance: NDArray[np.float64]) -> None:
    """Write the covariance of all particles, as AMCL publishes it, into `covariance` (3, 3).

    That of the heading is its circular variance; it has no covariance with the position.
    """
    poses, count = tracker.clouds[tracker.state[NOW]], tracker.state[COUNT]
    x, y = poses[0, :count].mean(), poses[1, :count].mean()
    xx = xy = yy = cos = sin = 0.0
    for n in range(count):
        aside, up = poses[0, n] - x, poses[1, n] - y
        xx += aside * aside
        xy += aside * up
        yy += up * up
        cos += np.cos(poses[2, n])
        sin += np.sin(poses[2, n])
    covariance[:] = 0.0
    covariance[0, 0], covariance[1, 1] = xx / count, yy / count
    covariance[0, 1] = covariance[1, 0] = xy / count
    covariance[2, 2] = -2 * np.log(min(1.0, np.hypot(cos, sin) / count))
