"""Scans of a recorded drive that are unlike a map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from locplan.maps import OccupancyGrid
from locplan.recordings._fit import FITS, NEAR, NEAR_CELLS
from locplan.recordings._matches import LEAST_RETURNS
from locplan.recordings._recording import Recording

BLOCK = 512
"""Number of scans that are compared with the map at once, which saves memory."""


def scans_unlike(
    recording: Recording, grid: OccupancyGrid, scans: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Tell which scans of a recorded drive are unlike a map.

    They are those of which fewer than 60 % of the returns end within two cells of a wall, at least
    0.1 m. One with fewer than 10 returns is not judged.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map; the poses are in its world frame.
    scans : (n,) array of int
        Indices of the scans.

    Returns
    -------
    (n,) array of bool
        True for each of these scans that is unlike the map.
    """
    unlike = np.zeros(len(scans), np.bool_)
    near = grid.closer_than(max(NEAR_CELLS * grid.resolution, NEAR))
    for first in range(0, len(scans), BLOCK):
        some = scans[first : first + BLOCK]
        if np.isfinite(recording.ranges[some]).any():
            unlike[first : first + BLOCK] = _unlike(recording[some], grid, near)
    return unlike


def _unlike(some: Recording, grid: OccupancyGrid, near: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether each scan is unlike the map whose cells near walls are given."""
    ends = some.ends()
    returned = np.isfinite(ends[..., 0])
    row, col = grid.world_to_grid(*np.moveaxis(np.where(returned[..., None], ends, 0.0), -1, 0))
    inside = returned & (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    cells = (np.where(inside, each, 0).astype(np.int64) for each in (row, col))
    hits = (inside & near[tuple(cells)]).sum(axis=1)
    count = returned.sum(axis=1)
    unlike: NDArray[np.bool_] = (count >= LEAST_RETURNS) & (hits < FITS * count)
    return unlike
