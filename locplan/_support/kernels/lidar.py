"""Planar lidar on a robot: ideal and simulated scans, and the information in their beams.

Information is about the robot's pose. A beam of direction d meets a surface with the unit normal n
at h, measured from the robot's centre of rotation. When the robot moves by dp and turns by dtheta,
the measured end of the beam departs from the surface, along the normal, by

    n . dp + (h x n) dtheta,        h x n = h_x n_y - h_y n_x.

The range changes by this departure over -(d . n), for any position of the lidar on the robot (A.
Censi, "On achievable accuracy for range-finder localization", ICRA 2007, doi
10.1109/ROBOT.2007.364120). The information is the sum of g g^T over the beams, for a standard
deviation of 1. g is the gradient of the departure or of the range.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import N_DONE, STOP, Floats, Ints, Octets, Random, Singles
from locplan._support.kernels.rays import cast_ray


class LidarBeams(NamedTuple):
    """Planar lidar and its mount on the robot."""

    angles: Floats  # (beam,) angles from the lidar's axis [rad]
    forward: float  # distance ahead of the robot's centre of rotation [m]
    left: float  # distance to the left of the centre [m]
    yaw: float  # angle of the lidar's axis against the robot's [rad]
    sigma: float  # standard deviation of a range [m]
    min_range: float  # nearer returns count as none [m]
    max_range: float  # [m]


@njit(nogil=True, cache=True, error_model="numpy")
def compute_lidar_offset(
    lidar: LidarBeams, heading: float, resolution: float
) -> tuple[float, float]:
    """Return the lidar's position from the robot's centre, x (columns) and y (rows) [cells].

    The position is rounded to a fraction of a cell, so that its sum with any cell's position is
    exact. A part of a map then gives the same bits as the whole map.
    """
    fraction = 2.0**-20
    cos, sin = np.cos(heading), np.sin(heading)
    x = (cos * lidar.forward - sin * lidar.left) / resolution
    y = (sin * lidar.forward + cos * lidar.left) / resolution
    return np.rint(x / fraction) * fraction, np.rint(y / fraction) * fraction


@njit(nogil=True, cache=True, error_model="numpy")
def write_scan_ends(
    empty_squares: Octets,
    resolution: float,
    row: float,
    col: float,
    heading: float,
    lidar: LidarBeams,
    ends: Floats,
) -> None:
    """Write the ends of the beams, x (columns) and y (rows) from the robot [cells], into `ends`.

    A beam ends at the middle of its line through the cell that stops it, so that rounding cannot
    move the end out of that cell. The end is NaN without a return.

    Parameters
    ----------
    empty_squares : (4, H + 2, W + 2) array of uint8
        The map as `rays.compute_empty_squares`.
    resolution : float
        Edge of a cell [m].
    row, col, heading : float
        The robot's pose on the grid [cells, cells, rad].
    lidar : LidarBeams
        Beams and mount of the lidar.
    ends : (beam, 2) array
        Filled with the ends of the beams.
    """
    lever_x, lever_y = compute_lidar_offset(lidar, heading, resolution)
    from_row, from_col = row + lever_y, col + lever_x
    min_range, max_range = lidar.min_range / resolution, lidar.max_range / resolution
    for b in range(lidar.angles.size):
        bearing = heading + lidar.yaw + lidar.angles[b]
        dx, dy = np.cos(bearing), np.sin(bearing)
        at, hit_row, hit_col = cast_ray(empty_squares, from_row, from_col, dy, dx, max_range)
        if not 0 < at < np.inf or at < min_range:  # at 0 the lidar itself is within a wall
            ends[b, 0] = ends[b, 1] = np.nan
            continue
        leave_row = (hit_row + (dy >= 0) - from_row) / dy
        leave_col = (hit_col + (dx >= 0) - from_col) / dx
        middle = (at + max(at, min(leave_row, leave_col))) / 2
        ends[b, 0] = lever_x + middle * dx
        ends[b, 1] = lever_y + middle * dy


@njit(nogil=True, cache=True, error_model="numpy")
def add_end_noise(
    resolution: float, heading: float, lidar: LidarBeams, noise: Floats, ends: Floats
) -> None:
    """Move the ends of the beams outwards by ``noise[b, 0]`` [m] and ``noise[b, 1]`` of the range.

    The arguments are the same as in `write_scan_ends`, which fills `ends`; `noise` is (beam, 2).
    """
    lever_x, lever_y = compute_lidar_offset(lidar, heading, resolution)
    for b in range(lidar.angles.size):
        x, y = ends[b, 0] - lever_x, ends[b, 1] - lever_y
        farther = noise[b, 1] + noise[b, 0] / resolution / np.hypot(x, y)
        ends[b, 0] += farther * x
        ends[b, 1] += farther * y


class BeamDisturbances(NamedTuple):
    """Outliers and occlusions of scans."""

    outliers: float  # share of the beams that end at a random distance within the range
    occlusion: float  # probability that an object occludes a part of a scan
    width: float  # angle that the object takes in the lidar's view [rad]
    nearest: float  # minimum distance of the object from the lidar [m]
    farthest: float  # maximum distance of the object from the lidar [m]


@njit(nogil=True, cache=True, error_model="numpy")
def simulate_measured_ends(
    random: Random,
    empty_squares: Octets,
    resolution: float,
    pose: Floats,
    lidar: LidarBeams,
    disturbances: BeamDisturbances,
    ends: Floats,
) -> None:
    """Write the measured ends of beams, ahead and to the left of the robot [cells], into `ends`.

    Ends are NaN without a return, and for measured ranges below the lidar's minimum range. The
    number of random draws is the same for every scan.

    Parameters
    ----------
    random : numpy.random.Generator
        Source of random numbers: two per beam, and three more.
    squares, resolution, lidar
        The world and the lidar, as for `lidar.write_scan_ends`.
    pose : (3,) array
        Row, column [cells] and heading [rad] of the robot.
    disturbances : BeamDisturbances
        Outliers and occlusions, in addition to the noise of `lidar.sigma`.
    ends : (beam, 2) array
        Filled with the ends of the beams.
    """
    row, col, heading = pose
    # A near wall still hides what lies behind it.
    near = LidarBeams(
        lidar.angles, lidar.forward, lidar.left, lidar.yaw, lidar.sigma, 0.0, lidar.max_range
    )
    write_scan_ends(empty_squares, resolution, row, col, heading, near, ends)
    lever_x, lever_y = compute_lidar_offset(lidar, heading, resolution)
    min_range, reach = lidar.min_range / resolution, lidar.max_range / resolution
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
        angle_offset = abs((lidar.angles[b] - middle + np.pi) % (2 * np.pi) - np.pi)
        if occluded and angle_offset <= disturbances.width / 2 and not before > at:
            at = before
        if not 0 < at < reach or at < min_range:
            ends[b, 0] = ends[b, 1] = np.nan
            continue
        # Start at the lidar's position on the robot, and go along the beam.
        ahead = cos * lever_x + sin * lever_y
        left = cos * lever_y - sin * lever_x
        ends[b, 0] = ahead + at * np.cos(bearing)
        ends[b, 1] = left + at * np.sin(bearing)


@njit(nogil=True, cache=True, error_model="numpy")
def compute_fisher_information(
    empty_squares: Octets,
    normals: Singles,
    resolution: float,
    rows: Floats,
    cols: Floats,
    headings: Floats,
    lidar: LidarBeams,
    of_ranges: bool,
    control: Ints,
) -> Floats:
    """Compute the information about (x, y, theta) at each position and heading.

    Parameters
    ----------
    empty_squares : (4, H + 2, W + 2) array of uint8
        The map as `rays.compute_empty_squares`.
    normals : (H, W, 2) array of float32
        Unit normals (row, col) of the cells that stop a beam; beams at zero normals are ignored.
    resolution : float
        Edge of a cell [m].
    rows, cols : (n,) arrays of float
        Positions of the robot [cells]; a cell's centre ends in .5.
    headings : (m,) array of float
        Headings of the robot [rad], from the columns' axis towards the rows' axis.
    lidar : LidarBeams
        Beams and mount.
    of_ranges : bool
        True to measure ranges; False to measure distances of the ends from the surface.
    control : (2,) or (1,) array of int64
        Shared with other threads: the first is set to stop early, the second, if any, counts the
        finished positions. The other positions are NaN.

    Returns
    -------
    (n, m, 3, 3) array of float64
        Information in the axes of the grid, x along the columns and y along the rows
        [1, m/rad, m^2/rad^2], for a standard deviation of 1 m; zero without any return.
    """
    result = np.full((rows.size, headings.size, 3, 3), np.nan)
    beam_x = np.empty((headings.size, lidar.angles.size))
    beam_y = np.empty((headings.size, lidar.angles.size))
    for k in range(headings.size):
        for b in range(lidar.angles.size):
            bearing = headings[k] + lidar.yaw + lidar.angles[b]
            beam_x[k, b], beam_y[k, b] = np.cos(bearing), np.sin(bearing)
    min_range, max_range = lidar.min_range / resolution, lidar.max_range / resolution
    for n in range(rows.size):
        if control[STOP]:
            break
        for k in range(headings.size):
            ahead_x, ahead_y = compute_lidar_offset(lidar, headings[k], resolution)
            row, col = rows[n] + ahead_y, cols[n] + ahead_x
            xx = xy = yy = xt = yt = tt = 0.0
            for b in range(lidar.angles.size):
                dx, dy = beam_x[k, b], beam_y[k, b]
                at, hit_row, hit_col = cast_ray(empty_squares, row, col, dy, dx, max_range)
                if not 0 < at < np.inf or at < min_range:  # at 0 the lidar itself is within a wall
                    continue
                ny, nx = normals[hit_row, hit_col, 0], normals[hit_row, hit_col, 1]
                hx, hy = (ahead_x + at * dx) * resolution, (ahead_y + at * dy) * resolution
                turn = hx * ny - hy * nx
                cosine = dx * nx + dy * ny
                # Below 0.15 a range on a grid no longer grows as 1 / |d . n|.
                weight = 1 / max(cosine**2, 0.15**2) if of_ranges else 1.0
                xx += weight * nx * nx
                xy += weight * nx * ny
                yy += weight * ny * ny
                xt += weight * nx * turn
                yt += weight * ny * turn
                tt += weight * turn * turn
            of_pose = result[n, k]
            of_pose[0, 0], of_pose[1, 1], of_pose[2, 2] = xx, yy, tt
            of_pose[0, 1] = of_pose[1, 0] = xy
            of_pose[0, 2] = of_pose[2, 0] = xt
            of_pose[1, 2] = of_pose[2, 1] = yt
        if control.size > N_DONE:
            control[N_DONE] += 1
    return result
