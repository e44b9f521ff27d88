"""Walls that are black inside: how deep they are, and whether wrong poses gain by them.

Inside of black the distance to a wall is 0, so that a particle there explains every beam of a scan.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from locplan._kernels.arrays import Floats, Octets, Singles


@njit(nogil=True, cache=True, error_model="numpy")
def score_of(scores: Singles, beyond: float, ends: Floats, pose: Floats) -> float:
    """Sum of the scores of the cells where the beams of a scan end at a pose.

    Parameters
    ----------
    scores : (H, W) array of float32
        What a beam that ends in a cell adds.
    beyond : float
        What a beam adds that ends outside.
    ends : (beam, 2) array
        Ends of the beams, ahead and to the left of the robot [cells]; NaN without a return.
    pose : (3,) array
        Row, column [cells] and heading [rad].
    """
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    fit = 0.0
    for b in range(len(ends)):
        if np.isnan(ends[b, 0]):
            continue
        row = int(np.floor(pose[0] + sin * ends[b, 0] + cos * ends[b, 1]))
        col = int(np.floor(pose[1] + cos * ends[b, 0] - sin * ends[b, 1]))
        inside = 0 <= row < scores.shape[0] and 0 <= col < scores.shape[1]
        fit += scores[row, col] if inside else beyond
    return fit


@njit(nogil=True, cache=True, error_model="numpy")
def wrong_pose_wins(
    scores: Singles, beyond: float, ends: Floats, pose: Floats, moves: Floats
) -> bool:
    """Whether a scan fits better after one of the moves (n, 3) than at its true pose.

    The other arguments are those of `score_of`; moves are along rows and columns [cells] and turns
    [rad].
    """
    best, other = score_of(scores, beyond, ends, pose), np.empty(3)
    for n in range(len(moves)):
        for axis in range(3):
            other[axis] = pose[axis] + moves[n, axis]
        if score_of(scores, beyond, ends, other) > best:
            return True
    return False


@njit(nogil=True, cache=True)
def surface_depths(cells: Octets, free: int, occupied: int, deep: int) -> tuple[int, int]:
    """Number of faces between free and occupied cells, and of those with much black behind them.

    Parameters
    ----------
    cells : (H, W) array of uint8
        Levels of the map.
    free, occupied : int
        The levels.
    deep : int
        Number of occupied cells in a row behind a face, its own included, that is much.
    """
    rows, cols = cells.shape
    faces = deep_faces = 0
    for row in range(rows):
        for col in range(cols):
            if cells[row, col] != occupied:
                continue
            for down, right in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                i, j = row - down, col - right
                if not (0 <= i < rows and 0 <= j < cols and cells[i, j] == free):
                    continue
                faces += 1
                behind, i, j = 0, row, col
                while 0 <= i < rows and 0 <= j < cols and cells[i, j] == occupied:
                    behind += 1
                    if behind == deep:
                        deep_faces += 1
                        break
                    i, j = i + down, j + right
    return faces, deep_faces
