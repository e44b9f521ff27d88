"""The longest stretch of a recorded drive where the map does not fit the scans, as at a kink."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from locplan._kernels.arrays import Floats
from locplan._util.poses import ends_in_map, way_along
from locplan.errors import RecordingError
from locplan.field import Scan, SearchWindow
from locplan.maps import OccupancyGrid, check_grid
from locplan.recordings._matches import looked_up, match_scans
from locplan.recordings._recording import Recording
from locplan.recordings._scan_steps import RETURNS

SPACING, AWAY, FARTHEST = 0.25, 0.1, 0.5
"""Way between scans that are compared with the map, mean distance of their ends from walls from
which on the map does not fit, and that from which on an end counts as no farther [m]."""


@dataclass(frozen=True)
class MisfitStretch:
    """The longest stretch of a drive where the map does not fit the scans."""

    x: float
    """Recorded position at its middle [m]."""
    y: float
    """Recorded position at its middle [m]."""
    length: float
    """Length of the way [m]; 0 if the map fits all scans."""


def longest_misfit(recording: Recording, grid: OccupancyGrid) -> MisfitStretch:
    """Find the longest stretch of a drive where ends of scans lie away from a map's walls.

    Parameters
    ----------
    recording : Recording
        The drive; poses that are off by up to 0.5 m and 4 deg do no harm.
    grid : OccupancyGrid
        The map.
    """
    check_grid(grid)
    way = way_along(recording.poses)
    scans = np.unique(np.searchsorted(way, [*np.arange(0.0, way[-1], SPACING), way[-1]]))
    chosen, way = recording[scans], way[scans]
    distances = _mean_distances(chosen, chosen.poses, grid)
    for n in np.array_split(far := np.flatnonzero(distances > AWAY), len(far) // 500 + 1):
        if len(n):
            poses = chosen.poses[n] + _best_offsets(chosen[n], grid)
            distances[n] = np.minimum(distances[n], _mean_distances(chosen[n], poses, grid))
    is_away = np.concatenate([[False], distances > AWAY, [False]])
    begins, ends = (np.flatnonzero(np.diff(is_away.astype(int)) == sign) for sign in (1, -1))
    lengths = way[ends - 1] - way[begins]
    if not lengths.any():
        x, y, _ = chosen.poses[0].tolist()
        return MisfitStretch(x, y, 0.0)
    longest = int(np.argmax(lengths))
    x, y, _ = chosen.poses[(begins[longest] + ends[longest]) // 2].tolist()
    return MisfitStretch(x, y, float(lengths[longest]))


def _mean_distances(recording: Recording, poses: Floats, grid: OccupancyGrid) -> Floats:
    """Mean distance of each scan's ends from the walls, (n,) [m]; 0 with too few returns."""
    ends = ends_in_map(recording.ends_on_robot(), poses)
    away = looked_up(grid, grid.clearance, ends, math.inf)
    returns = np.isfinite(ends[..., 0])
    count = returns.sum(axis=1)
    total = np.where(returns, np.minimum(away, FARTHEST), 0.0).sum(axis=1)
    return np.where(count >= RETURNS, total / np.maximum(count, 1), 0.0)


def _best_offsets(recording: Recording, grid: OccupancyGrid) -> Floats:
    """Offsets from the recorded poses at which scans fit the map best, (n, 3) [m, m, rad]."""
    window = SearchWindow(half_width=0.5, step=0.1, half_rotation_deg=4.0, rotation_step_deg=1.0)
    settings = Scan(recording.lidar, window=window, effective_beams=15.0)
    try:
        return match_scans(recording, grid, settings=settings, threads=1).best
    except RecordingError:  # none lies on the map
        return np.zeros((len(recording), 3))
