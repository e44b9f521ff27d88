"""How well each scan of a recorded drive fixes the pose, and how predictions agree with that.

The scan is scored at every offset of a search window about the recorded pose, as `Scan` does with
simulated ones; so the covariance is that of correlative scan matching with the robot's own scans.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan._util.checks import check_threads, instance
from locplan._util.intervals import Interval, Rank, Resamples, draws_of, mean_interval, rank, short
from locplan._util.poses import ends_in_map
from locplan._util.progress import ProgressCallback
from locplan.errors import RecordingError
from locplan.field import Scan, position_axes, scalar
from locplan.maps import OCCUPIED, OccupancyGrid, check_grid
from locplan.matching import Matcher, in_batches
from locplan.recordings._recording import Recording

MIN_RETURNS = 10
"""Number of returns below which a scan tells too little to be judged."""
FITS = 0.6
"""Share of the beams that end at walls from which a map fits. Six real logs have .91 to 1.00 on the
maps made of them, and at most .41 on those of each other, wherever the drive is moved."""


def check_enough(fitting: int, scans: int) -> None:
    """Raise a RecordingError if fewer than ten scans of a drive fit the map."""
    if scans < 10:
        raise RecordingError(
            f"the drive has {scans} scans, too few: 10 are needed; read more of them (every=), or"
            " record a longer one"
        )
    if fitting < 10:
        raise RecordingError(
            f"{fitting} of {scans} scans fit the map and lie in its free space, too few; is it the"
            " right map, and are the poses in its frame? See locplan.recordings.fit_to_map"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Matches:
    """The posteriors of n recorded scans about their recorded poses, in the world's frame."""

    recording: Recording
    """The scans, with their poses."""
    grid: OccupancyGrid
    """The map that they were matched with."""
    settings: Scan
    """The search window, and how a beam's end is scored."""
    mean: Floats
    """Mean offset from the recorded pose, (n, 3) [m, m, rad]."""
    best: Floats
    """Most probable offset, (n, 3) [m, m, rad]."""
    covariance: Floats
    """Covariance about the mean, (n, 3, 3) [m, m, rad]; NaN where a scan tells too little."""
    ambiguity: Floats
    """Probability outside the central mode, (n,), 0..1."""
    entropy: Floats
    """Entropy of the posterior, (n,) [nat]."""
    score: Floats
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

    @cached_property
    def stray(self) -> Floats:
        """Share of the returns that end away from all walls at the most probable offset, (n,).

        Away is beyond three cells, at least 0.25 m, and a fiftieth of the beam's length: so far
        from their cells even walls are met where cells are coarse or beams are long.
        """
        import cv2

        clear = np.asarray(self.grid.cells != OCCUPIED, np.uint8)
        distance = self.grid.resolution * cv2.distanceTransform(clear, cv2.DIST_L2, 5)
        least, share = max(3 * self.grid.resolution, 0.25), np.zeros(len(self))
        for first in range(0, len(self), 512):  # in blocks, which saves memory
            some = slice(first, first + 512)
            ends = self.recording[some].ends_on_robot()
            at = looked_up(
                self.grid,
                distance,
                ends_in_map(ends, self.recording.poses[some] + self.best[some]),
                math.inf,
            )
            away = at > least + np.hypot(*ends.T).T / 50  # False without a return
            share[some] = away.sum(axis=1) / np.maximum(np.isfinite(ends[..., 0]).sum(axis=1), 1)
        return share

    @property
    def position_std(self) -> Floats:
        """Largest standard deviation of the position, (n,) [m]."""
        return scalar(self.covariance, "position_std")

    @property
    def direction(self) -> Floats:
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
    instance("recording", recording, Recording, "read one with locplan.recordings.read_recording")
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

    def match(numbers: NDArray[np.int64]) -> list[int]:
        some = chosen[numbers]
        found = matcher.posteriors(recording[some].ends_on_robot(), recording.poses[some])
        mean[some], covariance[some], best[some], summary[some] = found
        return list(some)

    in_batches(match, chosen.size, workers, progress, batch=64)
    entropy, ambiguity, score = summary.T
    found = mean, best, covariance, ambiguity, entropy, score
    return Matches(recording, grid, settings, *found, returns)


def at_walls(grid: OccupancyGrid) -> tuple[float, NDArray[np.bool_]]:
    """Distance from a wall within which a beam ends at it [m], and the cells so near.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    """
    # A cell's worth is lost by the map's and the end's own rounding, another one by the wall's
    # thickness in a map of many scans; and 0.1 m is three deviations of a lidar's noise.
    distance = max(2 * grid.resolution, 0.1)
    return distance, grid.closer_than(distance)


def looked_up(grid: OccupancyGrid, values: NDArray[Any], xy: Floats, beyond: float) -> Floats:
    """Values of the cells at points (..., 2), and off the map, or where a point is NaN, another."""
    row, col = (np.floor(each) for each in grid.world_to_grid(xy[..., 0], xy[..., 1]))
    inside = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    at = tuple(np.where(inside, each, 0).astype(np.int64) for each in (row, col))
    return np.where(inside, values[at], beyond)


@dataclass(frozen=True)
class Agreement:
    """How well an estimator's deviations agree with the measured ones.

    Intervals are percentiles of a bootstrap over blocks of 10 m of the drive; NaN where it has
    fewer than five.
    """

    rank: Rank
    """Rank correlation, -1..1, and AUC for the worst fifth of the scans, 0..1."""
    aligned: Interval
    """Share of the elongated ellipses whose direction is right to 15 deg, 0..1; NaN without any."""
    factor: Interval
    """Predicted over measured deviation of the position: geometric mean; 1 where they agree."""

    @property
    def texts(self) -> list[str]:
        """The columns of a table: rank correlation, AUC, direction, and factor."""
        aligned = "-" if math.isnan(self.aligned.value) else f"{self.aligned.value:.0%}"
        return [short(self.rank.spearman), short(self.rank.auc), aligned, short(self.factor)]


def agreement(
    values: Floats, predicted: Floats, measured: Floats, blocks: NDArray[np.int64]
) -> Agreement:
    """Agreement of predicted with measured covariances at n scans.

    Parameters
    ----------
    values : (n,) array
        The scalar by which the estimator ranks places.
    predicted, measured : (n, d, d) arrays
        Covariances [m, m, rad].
    blocks : (n,) array of int
        The block of the drive that each scan belongs to.
    """
    drawn = draws_of(blocks)
    major, minor, direction = position_axes(measured)
    own, _, towards = position_axes(predicted)
    turned = np.abs((towards - direction + np.pi / 2) % np.pi - np.pi / 2)
    elongated = (major > 3 * minor).astype(float)  # a rounder ellipse has no direction
    return Agreement(
        rank([values], [major], Resamples([drawn], np.ones((len(drawn), 1)))),
        mean_interval((turned < math.radians(15)).astype(float), blocks, elongated),
        Interval(*np.exp(mean_interval(np.log(own / major), blocks)).tolist()),
    )
