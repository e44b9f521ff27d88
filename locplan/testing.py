"""A check of filters that users add."""

from __future__ import annotations

import numpy as np

from locplan._support.kernels.arrays import Floats, Singles
from locplan.errors import LocplanError
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE, OCCUPIED
from locplan.robots.amcl import Filter
from locplan.robots.lidar import Lidar

STEPS, AHEAD = 8, 0.3
"""Number of steps of the drive that a filter is checked on, and their length [m]."""


def check_filter(filter: Filter) -> None:
    """Check that a filter follows the protocol `locplan.robots.Filter`.

    It tracks a short drive through a small empty room, twice with the same random numbers.

    Parameters
    ----------
    filter : Filter
        The settings of the filter.

    Raises
    ------
    LocplanError
        If an estimate or a covariance has the wrong shape or is not finite, the covariance is not
        symmetric or has a negative variance, equal seeds give unequal poses, or the filter ends
        far from the robot.

    Examples
    --------
    >>> from locplan.robots import Amcl
    >>> check_filter(Amcl())
    """
    first, second = _estimate_drive(filter), _estimate_drive(filter)
    if not np.array_equal(first, second):
        raise LocplanError(
            "equal seeds give unequal poses: draw only from `random`, and share nothing between two"
            " filters that were started"
        )
    off = np.abs(first[-1] - _make_true_poses()[-1])
    if off.max() > 0.5:
        x, y, heading = first[-1]
        raise LocplanError(
            f"the filter ends at {x:.2f},{y:.2f} heading {heading:.2f}, far from the robot; poses"
            " are in the world [m, m, rad], and odometry is in a frame of its own"
        )


def _make_true_poses() -> Floats:
    """Return the poses (n, 3) of a straight drive."""
    poses = np.zeros((STEPS, 3))
    poses[:, :2] = (1.5, 1.8)
    poses[:, 0] += AHEAD * np.arange(STEPS)
    return poses


def _estimate_drive(filter: Filter) -> Floats:
    """Return the filter's poses (n, 3) along the drive, after checking each of them."""
    cells = np.full((40, 60), FREE)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1, name="room")
    lidar, truth = Lidar(range=8.0, beams=72), _make_true_poses()
    tracker = filter.start(grid, lidar, truth[0], (0.05, 0.02), np.random.default_rng(1))
    estimates = []
    for pose in truth:
        tracker.motion(np.add(pose, (7.0, -3.0, 0.0)))  # odometry has a frame of its own
        tracker.scan(_simulate_scan(pose, lidar))
        estimate, covariance = np.asarray(tracker.estimate()), np.asarray(tracker.covariance())
        if estimate.shape != (3,) or not np.isfinite(estimate).all():
            raise LocplanError("estimate() must be x, y, heading, three finite numbers")
        if covariance.shape != (3, 3):
            raise LocplanError(f"covariance() must be (3, 3), not {covariance.shape}")
        has_covariance = np.isfinite(covariance).all()
        if has_covariance and (
            not np.allclose(covariance, covariance.T) or np.linalg.eigvalsh(covariance)[0] < -1e-9
        ):
            raise LocplanError("covariance() must be symmetric, without negative variances")
        estimates.append(estimate)
    return np.array(estimates)


def _simulate_scan(pose: Floats, lidar: Lidar) -> Singles:
    """Compute the distances to the walls of the room, (beams,) [m]."""
    cos, sin = np.cos(lidar.angles + pose[2]), np.sin(lidar.angles + pose[2])
    with np.errstate(divide="ignore"):
        across = np.where(cos > 0, 5.9 - pose[0], 0.1 - pose[0]) / cos
        along = np.where(sin > 0, 3.9 - pose[1], 0.1 - pose[1]) / sin
    return np.asarray(np.minimum(np.abs(across), np.abs(along)), np.float32)
