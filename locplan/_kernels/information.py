"""Fisher information of a lidar's beams about the robot's pose.

A beam of direction d meets a surface with the unit normal n at h, counted from the robot's own
centre of rotation. When the robot moves by dp and turns by dtheta, the beam's end as it was
measured departs from the surface, along the normal, by

    n . dp + (h x n) dtheta,        h x n = h_x n_y - h_y n_x,

and the range changes by that over -(d . n), wherever on the robot the lidar is mounted (A. Censi,
"On achievable accuracy for range-finder localization", ICRA 2007, doi 10.1109/ROBOT.2007.364120).
The information is the sum of g g^T over the beams, g the gradient of one or the other, for a
standard deviation of 1.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.lidar import Lidar, lever
from locplan._kernels.rays import cast

STOP, DONE = 0, 1
MIN_COSINE = 0.15
"""Value of |d . n| below which a range on a grid no longer grows as 1 / |d . n|."""


@njit(nogil=True, cache=True, error_model="numpy")
def information(
    squares: NDArray[np.uint8],
    normals: NDArray[np.float32],
    resolution: float,
    rows: NDArray[np.float64],
    cols: NDArray[np.float64],
    headings: NDArray[np.float64],
    lidar: Lidar,
    of_ranges: bool,
    control: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Information about (x, y, theta) at each position and heading.

    Parameters
    ----------
    squares : (4, H + 2, W + 2) array of uint8
        The map as `rays.empty_squares`.
    normals : (H, W, 2) array of float32
        Unit normals (row, col) of the cells that stop a beam; beams at zero normals are ignored.
    resolution : float
        Edge of a cell [m].
    rows, cols : (n,) arrays of float
        Positions of the robot [cells]; a cell's centre ends in .5.
    headings : (m,) array of float
        Headings of the robot [rad], from the columns' axis towards that of the rows.
    lidar : Lidar
        Beams and mount.
    of_ranges : bool
        Whether a beam tells its range, or else its end's distance from the surface.
    control : (2,) or (1,) array of int64
        Shared with other threads: the first is set to stop early, the second, if any, counts the
        positions done. Positions left out are NaN.

    Returns
    -------
    (n, m, 3, 3) array of float64
        Information in the grid's own axes, x along the columns and y along the rows
        [1, m/rad, m^2/rad^2], for a standard deviation of 1 m; zero without any return.
    """
    result = np.full((rows.size, headings.size, 3, 3), np.nan)
    bearings = headings.reshape(-1, 1) + lidar.yaw + lidar.angles
    beam_x, beam_y = np.cos(bearings), np.sin(bearings)
    least, most = lidar.min_range / resolution, lidar.max_range / resolution
    for n in range(rows.size):
        if control[STOP]:
            break
        for k in range(headings.size):
            ahead_x, ahead_y = lever(lidar, headings[k], resolution)
            row, col = rows[n] + ahead_y, cols[n] + ahead_x
            xx = xy = yy = xt = yt = tt = 0.0
            for b in range(lidar.angles.size):
                dx, dy = beam_x[k, b], beam_y[k, b]
                at, hit_row, hit_col = cast(squares, row, col, dy, dx, most)
                if not 0 < at < np.inf or at < least:  # at 0 the lidar itself is within a wall
                    continue
                ny, nx = normals[hit_row, hit_col, 0], normals[hit_row, hit_col, 1]
                hx, hy = (ahead_x + at * dx) * resolution, (ahead_y + at * dy) * resolution
                turn = hx * ny - hy * nx
                cosine = dx * nx + dy * ny
                weight = 1 / max(cosine**2, MIN_COSINE**2) if of_ranges else 1.0
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
        if control.size > DONE:
            control[DONE] += 1
    return result
