"""The poses of a whole map that explain a scan best."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Ints, Singles
from locplan._util.progress import ProgressCallback
from locplan.matching._database import Database
from locplan.matching._matching import STEP, TURNS

Result = TypeVar("Result")
MIN_RETURNS = 5
"""Number of returns below which a scan says nothing about its pose."""
APART, TURNED = 0.8, 0.5
"""Distance [m] and angle [rad] below which two modes are one."""
ENOUGH = 8.0
"""Excess over the best pose up to which all modes are found [nats]."""
AWAY = 2.0
"""Distance from the true position from which on a match is wrong [m]."""


@dataclass(frozen=True, eq=False)
class Modes:
    """The poses that explain a scan best, the best first."""

    poses: Floats
    """x, y [cells] and heading [rad] of each on the map, (n, 3)."""
    losses: Floats
    """Loss of each, (n,) [nats]."""
    returns: int
    """Number of the scan's beams that return; below `MIN_RETURNS` there are no modes."""


@dataclass(frozen=True, eq=False)
class ScanOnMap:
    """A scan, and the whole map that it is matched with.

    Poses are x, y [cells] and heading [rad] on the map.
    """

    database: Database
    """What the lidar sees on the map, from `make_database`."""
    ranges: Floats
    """Ranges of the beams in `Matching.bearings`, (96,) [m]: infinite without a return, NaN where
    nothing is known. A beam that is neither is compared."""

    @cached_property
    def returns(self) -> Bools:
        """Mask of the beams that return, (96,)."""
        return np.isfinite(self.ranges)

    @cached_property
    def ends(self) -> Singles:
        """Ends of the beams that return, ahead and to the left of the robot, (2, k) [cells]."""
        database = self.database
        bearing = database.matching.bearings[self.returns]
        away = self.ranges[self.returns] / database.grid.resolution
        forward, left = database.lever
        ends = np.array([forward + away * np.cos(bearing), left + away * np.sin(bearing)])
        return ends.astype(np.float32)

    @cached_property
    def lever(self) -> float:
        """Root mean square of the ranges, which makes turns comparable with moves [cells]."""
        away = self.ranges[self.returns] / self.database.grid.resolution
        return max(1.0, math.sqrt(float((away**2).mean())))

    @property
    def _nats(self) -> float:
        """Nats of one step of a kernel's loss."""
        from locplan._kernels.scan_losses import TOP

        return self.database.matching.nats_a_loss / TOP

    def modes(self, home: Floats | None = None) -> Modes:
        """Match the scan with the whole map.

        Parameters
        ----------
        home : (3,) array, optional
            A pose from which the search begins, too. The best mode more than 2 m from it is found
            whatever its loss.
        """
        return self.refined(self.shortlisted(), home)

    def shortlisted(self) -> Floats:
        """Poses of the robot whose ranges are nearest to the scan's, (n, 3)."""
        from locplan._kernels.matches import shortlist
        from locplan._kernels.scan_losses import unlike

        database, returns = self.database, self.returns
        matching, resolution = database.matching, database.grid.resolution
        if returns.sum() < MIN_RETURNS:
            return np.empty((0, 3))
        # Every fourth beam first, so that a part of them covers all directions.
        order = np.concatenate([np.arange(first, TURNS, 4) for first in (0, 2, 1, 3)])
        compared = order[returns[order]]
        codes = database.codes_of(self.ranges)[compared]
        count = len(database.positions)
        # From a difference of eight codes on, half a metre, a beam costs no more.
        _, where = shortlist(database.codes, count, compared, codes, 8, matching.shortlisted)
        place, turn = np.divmod(where, TURNS)
        heading = turn * STEP
        forward, left = database.lever
        cos, sin = np.cos(heading), np.sin(heading)
        levers = np.column_stack([cos * forward - sin * left, sin * forward + cos * left])
        starts = np.column_stack([database.positions[place] - levers, heading])
        # A pair within 0.6 m and 0.25 rad of a better one is not refined.
        return np.asarray(starts[unlike(starts, np.arange(len(starts)), 0.6 / resolution, 0.25)])

    def refined(self, starts: Floats, home: Floats | None = None) -> Modes:
        """Modes to which some poses lead.

        Parameters
        ----------
        starts : (n, 3) array
            The poses, as `shortlisted` gives them.
        home : (3,) array, optional
            See `modes`.
        """
        from locplan._kernels.scan_losses import modes

        resolution = self.database.grid.resolution
        count = int(self.returns.sum())
        if count < MIN_RETURNS:
            return Modes(np.empty((0, 3)), np.empty(0), count)
        poses, losses = modes(
            self.database.tables,
            self.ends,
            starts if home is None else np.concatenate([home[None], starts]),
            self.lever,
            ENOUGH / self._nats,
            8 / self._nats,  # the widest deviation's refinement lowers a start's loss by no more
            np.full(2, np.nan) if home is None else home[:2],
            AWAY / resolution,
            APART / resolution,
            TURNED,
        )
        losses = losses * self._nats
        order = np.argsort(losses, kind="stable")
        return Modes(poses[order], losses[order], count)


def in_batches(
    work: Callable[[Ints], Sequence[Result]],
    count: int,
    threads: int,
    progress: ProgressCallback | None = None,
    batch: int = 16,
) -> list[Result]:
    """Results of numbers 0 to count - 1, which threads work at in batches.

    Parameters
    ----------
    work : callable
        Gives the results of some of the numbers.
    count : int
        How many there are.
    threads : int
        Number of threads.
    progress : callable, optional
        Called with (done, total) numbers.
    batch : int, default 16
        How many a thread takes at a time.
    """
    found: list[Result] = []
    batches = np.array_split(np.arange(count), max(1, -(-count // batch)))
    with ThreadPoolExecutor(threads) as pool:
        for some in pool.map(work, batches):
            found.extend(some)
            if progress:
                progress(len(found), count)
    return found
