"""How well each scan of a recorded drive fixes the pose: its posterior on the map.

The scan is scored at every offset of a search window about the recorded pose, as `Scan` does with
simulated ones; so the covariance is that of correlative scan matching with the robot's own scans.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import check_threads, instance
from locplan._util.poses import Numbers
from locplan._util.progress import ProgressCallback
from locplan.errors import RecordingError
from locplan.field import Scan, position_axes, scalar
from locplan.maps import OccupancyGrid, check_grid
from locplan.matching import Matcher
from locplan.recordings._recording import Recording

BATCH = 64
"""Number of scans that a thread matches at a time."""
MIN_RETURNS = 10
"""Number of returns below which a scan tells too little to be judged."""


@dataclass(frozen=True, eq=False, repr=False)
class Matches:
    """The posteriors of n recorded scans about their recorded poses, in the world's frame."""

    recording: Recording
    """The scans, with their poses."""
    grid: OccupancyGrid
    """The map that they were matched with."""
    settings: Scan
    """The search window, and how a beam's end is scored."""
    mean: Numbers
    """Mean offset from the recorded pose, (n, 3) [m, m, rad]."""
    best: Numbers
    """Most probable offset, (n, 3) [m, m, rad]."""
    covariance: Numbers
    """Covariance about the mean, (n, 3, 3) [m, m, rad]; NaN where a scan tells too little."""
    ambiguity: Numbers
    """Probability outside the central mode, (n,), 0..1."""
    entropy: Numbers
    """Entropy of the posterior, (n,) [nat]."""
    score: Numbers
    """Log-likelihood a return at the most probable offset, (n,): 0 where all ends lie on walls."""
    returns: NDArray[np.int64]
    """Number of returns among the beams that were compared, (n,)."""

    def __repr__(self) -> str:
        median = float(np.nanmedian(self.position_std)) if self.judged.any() else math.nan
        return f"Matches({len(self)} scans, median position_std {100 * median:.1f} cm)"

    def __len__(self) -> int:
        return len(self.score)

    @property
    def judged(self) -> NDArray[np.bool_]:
        """Mask of the scans with enough returns, on the map, (n,)."""
        return np.asarray(np.isfinite(self.covariance[:, 0, 0]))

    @property
    def position_std(self) -> Numbers:
        """Largest standard deviation of the position, (n,) [m]."""
        return scalar(self.covariance, "position_std")

    @property
    def direction(self) -> Numbers:
        """Direction of that deviation in the world, (n,) [rad]."""
        return position_axes(self.covariance)[2]


def match_scans(
    recording: Recording,
    grid: OccupancyGrid,
    *,
    settings: Scan | None = None,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Matches:
    """Match the scans of a drive with a map, each about its recorded pose.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map; the poses are in its world frame.
    settings : Scan, optional
        The search window and the likelihood of beams; its `lidar` must be the recording's. By
        default +-1.5 m in 0.1 m and +-4 deg in 1 deg, 180 beams that tell as much as 15.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) scans.

    Returns
    -------
    Matches
        The posterior of each scan; NaN where it has fewer than 10 returns or lies off the map.

    Raises
    ------
    RecordingError
        If no scan with enough returns was taken on the map.
    """
    instance("recording", recording, Recording, "read one with locplan.recordings.read_drive")
    check_grid(grid)
    workers = check_threads(threads)
    matcher = Matcher(grid, settings) if settings else Matcher.of(grid, recording.lidar)
    settings = matcher.settings
    count, beams = len(recording), settings.beams_compared
    row, col = grid.world_to_grid(*recording.poses[:, :2].T)
    cells = np.column_stack([np.floor(row), np.floor(col)])
    mean, covariance = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    best, summary = np.zeros((count, 3)), np.full((count, 3), np.nan)
    returns = np.isfinite(recording.ranges[:, settings.beam_numbers]).sum(axis=1)
    inside = ((cells >= 0) & (cells < grid.shape)).all(axis=1)
    chosen = np.flatnonzero(inside & (returns >= min(MIN_RETURNS, beams)))
    if not chosen.size:
        raise RecordingError(
            "no scan with enough returns was taken on this map; is it the right one? See"
            " locplan.recordings.fit_to_map"
        )
    _ = matcher.prepared  # now, once for all threads

    def match(some: NDArray[np.int64]) -> int:
        found = matcher.posteriors(recording[some].ends_on_robot(), recording.poses[some])
        mean[some], covariance[some], best[some], summary[some] = found
        return len(some)

    with ThreadPoolExecutor(workers) as pool:
        done = 0
        for size in pool.map(match, np.array_split(chosen, -(-chosen.size // BATCH))):
            done += size
            if progress:
                progress(done, chosen.size)
    return Matches(
        recording,
        grid,
        settings,
        mean=mean,
        best=best,
        covariance=covariance,
        entropy=summary[:, 0],
        ambiguity=summary[:, 1],
        score=summary[:, 2],
        returns=returns,
    )
