"""Noise of a recorded drive's ranges against the map's walls, and beams that something blocks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan._util.checks import check_threads
from locplan._util.intervals import Interval, blocks_along, intervals
from locplan._util.progress import ProgressCallback
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.matching import in_batches
from locplan.recordings._matches import check_enough
from locplan.recordings._recording import Recording
from locplan.robots import FARTHEST_OBJECT, NEAREST_OBJECT, Lidar

FAR = 0.3
"""Difference of a range from the map's as which larger ones count in settling [m]."""
MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


@dataclass(frozen=True)
class ScanNoise:
    """Noise of scans with 95 % intervals over blocks of the drive of 10 m."""

    range_sigma: Interval
    """Scatter of the ranges about the map's walls [m]: the lidar's noise and the map's together."""
    outliers: Interval
    """Share of the beams that end at a random distance, from those that go through walls,
    0..1."""
    blocked: Interval
    """Share of the beams that are shorter than the map says, without outliers, 0..1."""
    occlusion: Interval
    """Share of the scans in which an object stands 0.5 to 2 m away, as in simulation: of those that
    show one, over the chance that it stands before the wall."""
    occlusion_deg: Interval
    """Angle that is blocked in these scans [deg]."""
    moved: float
    """Median distance from the recorded position to the one at which a scan fits best [m]."""
    scans: int
    """Number of scans that were compared."""
    set_apart: int
    """Number of scans that fit the map nowhere near their recorded pose."""

    def settings(self) -> dict[str, float]:
        """The disturbances of a robot that they are, by name."""
        return {
            "outliers": self.outliers.value,
            "occlusion": self.occlusion.value,
            "occlusion_deg": min(360.0, self.occlusion_deg.value),
        }


def scan_noise(
    recording: Recording,
    grid: OccupancyGrid,
    *,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> ScanNoise:
    """Compare ranges with those that the map says, from where each scan fits best.

    A beam's own noise is the scatter of the ranges that end at walls, from their median absolute
    deviation. Beams that go far through walls are outliers; as many, by the distances that the map
    leaves them, are among those that end before the wall, and the others are blocked.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) scans.

    Raises
    ------
    RecordingError
        If too few scans fit the map.
    """
    check_enough(len(recording), len(recording))
    chosen = np.unique(np.linspace(0, len(recording) - 1, 300).round().astype(int))
    walls = SeenWalls(grid, recording)

    def compared(some: NDArray[np.int64]) -> list[tuple[float, Floats]]:
        return [walls.compared(scan) for scan in chosen[some].tolist()]

    results = in_batches(compared, len(chosen), check_threads(threads), progress, batch=1)
    moves, expected = (np.array(each) for each in zip(*results, strict=True))
    measured = recording.ranges[chosen].astype(np.float64)
    reach = recording.lidar.range
    met = np.isfinite(expected)
    walls_at = np.where(met, expected, reach)
    with np.errstate(invalid="ignore"):
        residual = measured - walls_at
        near = met & (np.abs(residual) < FAR)
        fits = near.sum(axis=1) > 0.5 * np.maximum(met.sum(axis=1), 1)
    check_enough(int(fits.sum()), len(chosen))
    of_scans = residual, walls_at, near, np.isfinite(measured)
    residual, walls_at, near, returned = (each[fits] for each in of_scans)
    scans = _Scans.of(residual, walls_at, near, returned, recording.lidar, grid.resolution)
    blocks = blocks_along(recording.poses)[chosen][fits]
    found = intervals(scans.statistics, blocks, 200)
    apart = len(chosen) - int(fits.sum())
    values: list[Any] = [*found, float(np.median(moves[fits])), int(fits.sum()), apart]
    return ScanNoise(*values)


@dataclass(frozen=True, eq=False)
class _Scans:
    """What is summed up of n scans."""

    deviations: Floats
    """Distances of ranges from the map's, in ascending order [m]."""
    of_scan: NDArray[np.int64]
    """The scan of each."""
    through: Floats
    """Number of beams that go through walls, (n,)."""
    room: Floats
    """Number of outliers that would go through walls, if all beams were outliers, (n,)."""
    short: Floats
    """Number of beams that end before the wall, (n,)."""
    before: Floats
    """Number of outliers that would, if all beams were outliers, (n,)."""
    beams: int
    open: Floats
    """Chance that an object 0.5 to 2 m away stands before the wall, (n,)."""
    angle: Floats
    """Angle of the runs of beams that are blocked within 2 m, (n,) [deg]; a wall that differs a
    little from the map shadows others further away, too."""

    @classmethod
    def of(
        cls,
        residual: Floats,
        walls: Floats,
        near: NDArray[np.bool_],
        returned: NDArray[np.bool_],
        lidar: Lidar,
        resolution: float,
    ) -> _Scans:
        """Sums of residuals (n, beams) against walls at these distances, or at the range."""
        deviation = np.abs(residual[near])
        order = np.argsort(deviation)
        sigma = MAD * float(np.median(deviation))
        bound = max(4 * sigma, 3 * resolution)  # up to which a range agrees with the map's
        reach, nearest, farthest = lidar.range, NEAREST_OBJECT, FARTHEST_OBJECT
        short, measured = returned & (residual < -bound), walls + residual
        spacing = math.degrees(abs(lidar.angles[-1] - lidar.angles[0])) / max(1, lidar.beams - 1)
        return cls(
            deviation[order],
            np.nonzero(near)[0][order],
            (returned & (residual > bound)).sum(axis=1).astype(float),
            (np.maximum(reach - walls - bound, 0) / reach).sum(axis=1),
            short.sum(axis=1).astype(float),
            (np.maximum(walls - bound, 0) / reach).sum(axis=1),
            residual.shape[1],
            np.clip((walls - bound - nearest) / (farthest - nearest), 0, 1).mean(axis=1),
            spacing * np.array([_in_runs(each) for each in short & (measured < farthest)], float),
        )

    def statistics(self, weights: Floats) -> Floats:
        """The values of `ScanNoise` that have intervals, with weights of the scans."""
        shares = np.cumsum(weights[self.of_scan])
        middle = self.deviations[np.searchsorted(shares, shares[-1] / 2)]
        outliers = min(1.0, float(weights @ self.through / max(float(weights @ self.room), 1.0)))
        beams = weights.sum() * self.beams
        blocked = max(0.0, float(weights @ self.short - outliers * (weights @ self.before)) / beams)
        seen = weights * (self.angle > 0)
        occlusion = min(1.0, float(seen.sum() / max(float(weights @ self.open), 1e-9)))
        angle = float(seen @ self.angle / seen.sum()) if seen.any() else 0.0
        return np.array([MAD * middle, outliers, blocked, occlusion, angle])


def _in_runs(short: NDArray[np.bool_]) -> int:
    """Number of beams in runs of at least four that are short, as one object's are."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], short.astype(np.int8), [0]])))
    runs = edges[1::2] - edges[::2]
    return int(runs[runs >= 4].sum())


class SeenWalls:
    """The map's walls, as a recording's lidar would see them."""

    def __init__(self, grid: OccupancyGrid, recording: Recording) -> None:
        from locplan._kernels.rays import empty_squares

        lidar = recording.lidar
        self.grid, self.recording = grid, recording
        self.squares = empty_squares(grid.cells == OCCUPIED)
        self.every = max(1, lidar.beams // 61)  # some sixty beams settle a scan
        self.beams = lidar.for_kernels()._replace(min_range=0.0)
        some = np.ascontiguousarray(lidar.angles[:: self.every])
        self.some = self.beams._replace(angles=some)

    def compared(self, scan: int) -> tuple[float, Floats]:
        """How far a scan was moved to fit best [m], and the map's ranges from there (beams,)."""
        start = self.recording.poses[scan]
        pose = self.settled(start, self.recording.ranges[scan, :: self.every])
        return math.dist(pose[:2], start[:2]), self.ranges(pose, self.beams)

    def settled(self, pose: Floats, measured: NDArray[Any]) -> Floats:
        """The pose near the recorded one from which the map's ranges are most like a scan's.

        It moves along x, y and the heading as long as that lessens the mean difference.
        """
        seen = np.isfinite(measured)
        measured = measured[seen].astype(np.float64)

        def loss(trial: Floats) -> float:
            difference = np.abs(self.ranges(trial, self.some)[seen] - measured)
            return float(np.minimum(difference, FAR).mean()) if len(difference) else 0.0

        best = loss(pose)
        steps = ((0.08, 1.5), (0.04, 0.75), (0.02, 0.4), (0.01, 0.2), (0.005, 0.1))  # [m], [deg]
        for step, degrees in steps:
            moves = np.diag([step, step, math.radians(degrees)])
            for _ in range(8):
                before = best
                for move in (*moves, *-moves):
                    found = loss(pose + move)
                    if found < best:
                        pose, best = pose + move, found
                if best == before:
                    break
        return pose

    def ranges(self, pose: Floats, beams: Any) -> Floats:
        """Ranges by the map at a pose in the world, (beams,) [m]; inf where no wall is met."""
        from locplan._kernels.lidar import lever, scan_ends

        row, col = self.grid.world_to_grid(pose[0], pose[1])
        heading, resolution = pose[2] - self.grid.origin[2], self.grid.resolution
        ends = np.empty((beams.angles.size, 2))
        scan_ends(self.squares, resolution, float(row), float(col), heading, beams, ends)
        ends -= lever(beams, heading, resolution)
        ranges = np.hypot(ends[:, 0], ends[:, 1]) * resolution
        return np.where(np.isnan(ranges), np.inf, ranges)
