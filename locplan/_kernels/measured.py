"""The scan of a real lidar in a world: with noise, outliers, and an object that occludes it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.lidar import Lidar, lever, scan_ends


class BeamDisturbances(NamedTuple):
    """Outliers and occlusions of scans."""

    outliers: float  # share of the beams that end at a random distance within the range
    occlusion: float  # probability that an object occludes a part of a scan
    width: float  # angle that the object takes in the lidar's view [rad]
    nearest: float  # least distance of the object from the lidar [m]
    farthest: float  # greatest distance of the object from the lidar [m]


@njit(nogil=True, cache=True, error_model="numpy")
def measured_ends(
    random: np.random.Generator,
    squares: NDArray[np.uint8],
    resolution: float,
    pose: NDArray[np.float64],
    lidar: Lidar,
    disturbances: BeamDisturbances,
    ends: NDArray[np.float64],
) -> None:
    """Write the measured ends of beams, ahead and to the left of the robot [cells], into `ends`.

    Ends are NaN without a return, and where less than the lidar's least range is measured. As many
    random numbers are drawn whatever a scan meets.

    Parameters
    ----------
    random : numpy.random.Generator
        Source of random numbers: two per beam, and three more.
    squares, resolution, lidar
        The world and the lidar, as for `lidar.scan_ends`.
    pose : (3,) array
        Row, column [cells] and heading [rad] of the robot.
    disturbances : BeamDisturbances
        Outliers and occlusions, in addition to the noise of `lidar.sigma`.
    ends : (beam, 2) array
        Filled with the ends of the beams.
    """
    row, col, heading = pose
    # A near wall still hides what lies behind it.
    near = Lidar(
        lidar.angles, lidar.forward, lidar.left, lidar.yaw, lidar.sigma, 0.0, lidar.max_range
    )
    scan_ends(squares, resolution, row, col, heading, near, ends)
    lever_x, lever_y = lever(lidar, heading, resolution)
    least, reach = lidar.min_range / resolution, lidar.max_range / resolution
    occluded = random.random() < disturbances.occlusion
    middle = lidar.angles[0] + random.random() * (lidar.angles[-1] - lidar.angles[0])
    between = disturbances.farthest - disturbances.nearest
    before = (disturbances.nearest + random.random() * between) / resolution
    cos, sin = np.cos(heading), np.sin(heading)
    for b in range(len(ends)):
        noise, chance = random.standard_normal(), random.random()
        bearing = lidar.yaw + lidar.angles[b]
        at = np.hypot(ends[b, 0] - lever_x, ends[b, 1] - lever_y)
        at += noise * lidar.sigma / resolution
        if chance < disturbances.outliers:
            at = chance / disturbances.outliers * reach
        aside = abs((lidar.angles[b] - middle + np.pi) % (2 * np.pi) - np.pi)
        if occluded and aside <= disturbances.width / 2 and not before > at:
            at = before
        if not 0 < at < reach or at < least:
            ends[b] = np.nan
            continue
        # Start at the lidar's position on the robot, and go along the beam.
        ahead = cos * lever_x + sin * lever_y
        left = cos * lever_y - sin * lever_x
        ends[b, 0] = ahead + at * np.cos(bearing)
        ends[b, 1] = left + at * np.sin(bearing)
