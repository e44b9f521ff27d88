"""Depth of walls, and the cells that beams of scans pass and end in."""

from __future__ import annotations

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Bools, Floats, Octets
from locplan._support.kernels.rays import find_crossed_cells


@njit(nogil=True, cache=True, error_model="numpy")
def list_passed_cells(origin: Floats, end: Floats, margin: float) -> tuple[Array, Array]:
    """Return the cells that a beam passes up to a margin before its end; none for short beams.

    Parameters
    ----------
    origin, end : (2,) array
        Row and column of the lidar and of the beam's end [cells].
    margin : float
        The margin [cells].
    """
    way = np.empty((2, 2))
    length = np.hypot(end[0] - origin[0], end[1] - origin[1])
    passed_share = max(0.0, 1.0 - margin / length) if length > 0 else 0.0
    for axis in range(2):
        way[0, axis] = origin[axis]
        way[1, axis] = origin[axis] + passed_share * (end[axis] - origin[axis])
    rows, cols, _ = find_crossed_cells(way)
    return rows, cols


@njit(nogil=True, cache=True)
def count_scans(stops: Bools, origins: Floats, ends: Floats, margin: float) -> tuple[Array, Array]:
    """Return the numbers of scans that pass each cell, and that end in it, (H, W) each.

    Parameters
    ----------
    stops : (H, W) array of bool
        Cells that stop beams: a beam that passes through one is wrong from there on.
    origins : (n, 2) array
        Rows and columns of the lidar at the scans [cells].
    ends : (n, beams, 2) array
        Rows and columns of the beams' ends [cells]; NaN without a return.
    margin : float
        Length before a beam's end in which it passes no cell [cells].
    """
    rows, cols = stops.shape
    passed, hit = np.zeros((rows, cols), np.int32), np.zeros((rows, cols), np.int32)
    # The last scan that passed each cell, or ended in it: each counts once.
    last_passed, last_hit = np.full((rows, cols), -1), np.full((rows, cols), -1)
    for n in range(len(ends)):
        for b in range(ends.shape[1]):
            if np.isnan(ends[n, b, 0]):
                continue
            beam_rows, beam_cols = list_passed_cells(origins[n], ends[n, b], margin)
            for k in range(len(beam_rows)):
                row, col = beam_rows[k], beam_cols[k]
                if not (0 <= row < rows and 0 <= col < cols):
                    continue
                if stops[row, col]:
                    break
                if last_passed[row, col] != n:
                    passed[row, col] += 1
                    last_passed[row, col] = n
            else:
                row, col = int(np.floor(ends[n, b, 0])), int(np.floor(ends[n, b, 1]))
                if 0 <= row < rows and 0 <= col < cols and last_hit[row, col] != n:
                    hit[row, col] += 1
                    last_hit[row, col] = n
    return passed, hit


@njit(nogil=True, cache=True)
def count_deep_faces(cells: Octets, free: int, occupied: int, deep: int) -> tuple[int, int]:
    """Return the number of faces between free and occupied cells, and of deep ones among them.

    Parameters
    ----------
    cells : (H, W) array of uint8
        Levels of the map.
    free, occupied : int
        The levels.
    deep : int
        Number of consecutive occupied cells behind a deep face, including the face's cell.
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
