"""What a robot sees where parts of a map are away, and how far parts that were moved pull it.

Rays, hits, sums and covariances are those of `landmarks` and `way_covariances`.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.landmarks import NORMAL_X, NORMAL_Y, RANGE, TT, TURN, XT, XX, XY, YT, YY, Rays
from locplan._kernels.rays import cast


@njit(nogil=True, cache=True, error_model="numpy")
def look(
    squares: NDArray[np.uint8],
    normals: NDArray[np.float32],
    labels: NDArray[np.int32],
    silent: NDArray[np.bool_],
    resolution: float,
    rays: Rays,
    wanted: NDArray[np.int64],
    hits: NDArray[np.float32],
    cells: NDArray[np.int64],
) -> None:
    """Fill the hits (k, 4) of some rays, and the cells that they meet (k,); -1 for none.

    Parameters
    ----------
    squares, normals, resolution, rays
        See `landmarks.hits_of_map`.
    labels : (H, W) array
        Number of the feature that a cell belongs to, or -1.
    silent : (m,) array of bool
        Features that stop rays and tell nothing.
    wanted : (k,) array
        The rays: pose * beams + beam. A cell is row * W + col.
    """
    for k in range(wanted.size):
        n, b = wanted[k] // rays.beams, wanted[k] % rays.beams
        x, y = rays.poses[n, 0] + rays.levers[n, 0], rays.poses[n, 1] + rays.levers[n, 1]
        bearing = rays.first[n] + b * rays.step
        dx, dy = np.cos(bearing), np.sin(bearing)
        at, row, col = cast(squares, y / resolution, x / resolution, dy, dx, rays.most / resolution)
        at *= resolution
        hit = hits[k]
        hit[NORMAL_X] = hit[NORMAL_Y] = hit[TURN] = 0.0
        cells[k] = row * labels.shape[1] + col if row >= 0 else -1
        if not 0 < at < np.inf or at < rays.least:
            hit[RANGE] = at if at < rays.least else np.inf
            continue
        label = labels[row, col]
        if label >= 0 and silent[label]:
            hit[RANGE] = np.inf
            continue
        nx, ny = np.float64(normals[row, col, 1]), np.float64(normals[row, col, 0])
        hx, hy = rays.levers[n, 0] + at * dx, rays.levers[n, 1] + at * dy
        hit[RANGE], hit[NORMAL_X], hit[NORMAL_Y] = at, nx, ny
        hit[TURN] = hx * ny - hy * nx


@njit(nogil=True, cache=True, error_model="numpy")
def biases(
    pulls: NDArray[np.float64],
    information: NDArray[np.float64],
    after: NDArray[np.float64],
    poses: NDArray[np.float64],
    routes: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Errors (n, 3, 2) of the filter's pose by a feature that stands elsewhere, to first order.

    The columns are those of a unit shift [m] of the feature along x and along y. On the way an
    error e moves with the pose, and each look around makes it e + P (pull - I e).

    Parameters
    ----------
    pulls : (n, 3, 2) array
        Information-weighted sum of g n^T over the rays of each pose that meet the feature.
    information : (n, 6) array
        Information I of all rays [xx, xy, yy, xt, yt, tt].
    after : (n, 6) array
        Covariance P after each look around; see `way_covariances.covariances`.
    poses, routes
        See `way_covariances.covariances`.
    """
    result = np.zeros((len(poses), 3, 2))
    e, rest = np.zeros((3, 2)), np.zeros((3, 2))
    for r in range(routes.size - 1):
        for i in range(3):
            for j in range(2):
                e[i, j] = 0.0
        for n in range(routes[r], routes[r + 1]):
            if n > routes[r]:
                dx, dy = poses[n, 0] - poses[n - 1, 0], poses[n, 1] - poses[n - 1, 1]
                for j in range(2):
                    e[0, j] -= dy * e[2, j]
                    e[1, j] += dx * e[2, j]
            m, p = information[n], after[n]
            for j in range(2):
                x, y, t = e[0, j], e[1, j], e[2, j]
                rest[0, j] = pulls[n, 0, j] - m[XX] * x - m[XY] * y - m[XT] * t
                rest[1, j] = pulls[n, 1, j] - m[XY] * x - m[YY] * y - m[YT] * t
                rest[2, j] = pulls[n, 2, j] - m[XT] * x - m[YT] * y - m[TT] * t
                x, y, t = rest[0, j], rest[1, j], rest[2, j]
                e[0, j] += p[XX] * x + p[XY] * y + p[XT] * t
                e[1, j] += p[XY] * x + p[YY] * y + p[YT] * t
                e[2, j] += p[XT] * x + p[YT] * y + p[TT] * t
                for i in range(3):
                    result[n, i, j] = e[i, j]
    return result
