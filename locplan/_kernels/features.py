"""What a robot sees where parts of a map are away, and how far parts that were moved pull it.

Rays, hits, sums and covariances are those of `landmarks` and `objectives`.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.landmarks import (
    NORMAL_X,
    NORMAL_Y,
    RANGE,
    TT,
    TURN,
    XT,
    XX,
    XY,
    YT,
    YY,
    Rays,
    write_hit,
)


@njit(nogil=True, cache=True, error_model="numpy")
def look(
    squares: NDArray[np.uint8],
    normals: NDArray[np.float32],
    labels: NDArray[np.int32],
    silent: NDArray[np.bool_],
    resolution: float,
    rays: Rays,
    asked: NDArray[np.int64],
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
        Features that stop rays without a return.
    asked : (k,) array
        The rays: pose * beams + beam. A cell is row * W + col.
    """
    for k in range(asked.size):
        n, b = asked[k] // rays.beams, asked[k] % rays.beams
        row, col, counts = write_hit(squares, normals, resolution, rays, n, b, hits[k])
        cells[k] = row * labels.shape[1] + col if row >= 0 else -1
        if counts and labels[row, col] >= 0 and silent[labels[row, col]]:
            hits[k, RANGE] = np.inf
            hits[k, NORMAL_X] = hits[k, NORMAL_Y] = hits[k, TURN] = 0.0


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
        Covariance P after each look around; see `objectives.covariances`.
    poses, routes
        See `objectives.covariances`.
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
