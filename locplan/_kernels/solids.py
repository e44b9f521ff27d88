"""Walls that are black inside: how deep they are."""

from __future__ import annotations

from numba import njit

from locplan._kernels.arrays import Octets


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
