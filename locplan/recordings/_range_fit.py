"""How the ranges of recorded drives differ from a map's: by a factor, and by the walls' depth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from locplan._kernels.arrays import Floats, Ints
from locplan._util.intervals import Interval, blocks_along, intervals
from locplan.maps import MapFault, OccupancyGrid
from locplan.recordings._recording import Recording
from locplan.recordings._scan_noise import MAD, SeenWalls

SCANS, MIN_BEAMS = 100, 12
"""Number of the scans of a drive that are compared, and of beams that a scan needs."""
FAR, FAR_CELLS, FAR_OFF = 0.2, 4, 0.06
"""Difference of a range from the map's as which larger ones do not count: so many metres or cells,
and this share of the range."""
GRAZING = 2.0
"""Way of a beam's end over the way of the robot across the wall from which on it is not used."""
OFF, SURELY_OFF = 0.007, 0.005
"""Deviations of the factor from 1 from which on a map has another resolution, and which the whole
interval must surpass."""
DEEP = 1.5
"""Depth behind the map's surfaces from which on these are not where the walls are [cells]."""


@dataclass(frozen=True)
class RangeFit:
    """How ranges differ from those that a map says, with 95 % intervals over pieces of 10 m."""

    factor: Interval
    """Ratio of the ranges to the map's."""
    depth: Interval
    """Distance behind the map's surfaces at which beams end, across the walls [m]."""

    @property
    def is_scaled(self) -> bool:
        """True if the map surely has another resolution than its file says."""
        value, low, high = (each - 1 for each in self.factor)
        return abs(value) >= OFF and (low > SURELY_OFF or high < -SURELY_OFF)

    def faults(self, grid: OccupancyGrid) -> Iterator[MapFault]:
        """The faults of the map that they tell.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        """
        if self.is_scaled:
            value, low, high = (100 * (each - 1) for each in self.factor)
            true = grid.resolution * self.factor.value
            yield MapFault(
                "resolution",
                f"ranges are {value:+.1f} [{low:+.1f}, {high:+.1f}] % longer than on the map:"
                f" resolution {grid.resolution:.4g} should be {true:.3g}",
                f"set resolution: {true:.3g} in its YAML, and scale its origin likewise, if the"
                " lidar's ranges are right",
                sure=True,
            )
        cells, low, _ = (each / grid.resolution for each in self.depth)
        if cells >= DEEP and low > 1:
            yield MapFault(
                "deep walls",
                f"beams end {cells:.1f} cells ({100 * self.depth.value:.0f} cm) behind the map's"
                " surfaces: walls are inflated, or smeared by mapping",
                "give the filter a map that is not inflated; this one is not hollowed, since the"
                " truth lies inside of its walls",
                sure=True,
            )


def range_fit(grid: OccupancyGrid, recordings: Sequence[Recording]) -> RangeFit:
    """Compare the ranges of recorded drives with those that a map says, where each scan fits best.

    A range is the map's times a factor, and the depth at which beams end behind its surfaces; what
    the scan's pose may be off by is fitted with it.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    recordings : sequence of Recording
        The drives, with poses that are good to some 0.1 m.
    """
    once, _ = _compared(grid, recordings, 1.0)
    if not once:
        nothing = Interval(math.nan, math.nan, math.nan)
        return RangeFit(nothing, nothing)
    # What a pose took for its own error, it no longer does where the ranges are nearly right.
    first = 1 + float(_solved(once, np.ones(len(once)))[0])
    kept, blocks = _compared(grid, recordings, first)
    factor, depth = intervals(lambda weights: _solved(kept, weights), blocks, 200)
    return RangeFit(Interval(*(first * (1 + value) for value in factor)), depth)


def _compared(
    grid: OccupancyGrid, recordings: Sequence[Recording], factor: float
) -> tuple[list[Floats], Ints]:
    """What the scans say of ranges that are divided by a factor, and the block of each."""
    parts, blocks, first = [], [], 0
    for each in recordings:
        own, of_scan = _equations(grid, each, factor)
        parts += own
        blocks += (first + of_scan).tolist()
        first = max([first, *blocks]) + 1
    kept = _projected(parts)
    for _ in range(2 * bool(parts)):
        # What is off by three deviations is no wall of the map, or a beam that something blocks.
        at = _solved(kept, np.ones(len(kept)))
        off = [np.abs(each[:, 2] - each[:, :2] @ at) for each in kept]
        bound = max(3 * MAD * float(np.median(np.concatenate(off))), 0.5 * grid.resolution)
        parts = [each[far < bound] for each, far in zip(parts, off, strict=True)]
        kept = _projected(parts)
    return kept, np.array(blocks, np.int64)


def _equations(
    grid: OccupancyGrid, recording: Recording, factor: float
) -> tuple[list[Floats], Ints]:
    """Of each scan that shows walls what its beams say, and the scan's block.

    A row is (range, 1, difference, and what it changes by with the pose (x, y, heading)), across
    the wall.
    """
    walls, rows, used = SeenWalls(grid, recording), [], []
    far = max(FAR, FAR_CELLS * grid.resolution)
    chosen = np.unique(np.linspace(0, len(recording) - 1, SCANS).astype(np.int64))
    steps = np.diag([grid.resolution, grid.resolution, math.radians(0.5)])
    for scan in chosen.tolist():
        measured = recording.ranges[scan, :: walls.every].astype(np.float64) / factor
        pose = walls.settled(recording.poses[scan], measured)
        expected = walls.ranges(pose, walls.some)
        with np.errstate(invalid="ignore"):
            ways = np.column_stack(
                [
                    (walls.ranges(pose + step, walls.some) - walls.ranges(pose - step, walls.some))
                    / (2 * step.sum())
                    for step in steps
                ]
            )
            steep, off = np.hypot(ways[:, 0], ways[:, 1]), measured - expected
            good = (steep > 0.9) & (steep < GRAZING) & np.isfinite(ways[:, 2])
            good &= np.abs(off) < far + FAR_OFF * expected
        if good.sum() >= MIN_BEAMS:
            of_beams = np.column_stack([expected, steep, off, ways])[good]
            rows.append(of_beams / steep[good, None])
            used.append(scan)
    return rows, blocks_along(recording.poses)[np.array(used, np.int64)]


def _projected(parts: list[Floats]) -> list[Floats]:
    """The first three columns of each, without what another pose explains."""
    found = []
    for each in parts:
        base, _ = np.linalg.qr(each[:, 3:])
        found.append(each[:, :3] - base @ (base.T @ each[:, :3]))
    return found


def _solved(parts: list[Floats], weights: Floats) -> Floats:
    """Factor minus 1, and depth [m], by least squares of scans with weights, (2,)."""
    sums = np.tensordot(weights, np.array([each.T @ each for each in parts]), 1)
    return np.asarray(np.linalg.lstsq(sums[:2, :2], sums[:2, 2], rcond=None)[0])
