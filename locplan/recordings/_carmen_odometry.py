"""Odometry at the scans of a CARMEN log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from locplan._util.poses import Numbers, after_way, way_between, wrapped

Indices = NDArray[np.int64]
SAME = 1e-5
"""Distance [m] and turn [rad] up to which a line of odometry repeats a pose."""
REPEATED = 0.5
"""Share of the scans whose poses are repeated, from which odometry counts as begun anew there."""
OWN = 0.5
"""Share of the scans that must have odometry of their own."""


def odometry_at(
    poses: Numbers, stamps: Numbers, before: Sequence[int], lines: Numbers
) -> Numbers | None:
    """Odometry at n scans; None if the log has none of its own.

    Mapping programs write the corrected pose after each scan as a line of odometry, too, and let
    odometry go on from there: then the ways from each such line to the next scan are put together.

    Parameters
    ----------
    poses : (n, 3) array
        Poses of the robot at the scans [m, m, rad].
    stamps : (n,) array
        Times of the scans [s].
    before : sequence of n int
        Index of the last line of odometry before each scan, -1 if there is none.
    lines : (m, 4) array
        Lines of odometry: x, y [m], heading [rad], time [s].
    """
    if not len(lines):
        return None
    at = np.clip(before, 0, len(lines) - 1)
    after = np.clip(np.asarray(before) + 1, 0, len(lines) - 1)
    off = lines[after, :3] - poses
    off[:, 2] = wrapped(off[:, 2])
    repeated = (np.abs(off) < SAME).all(1)
    if repeated.mean() > REPEATED:
        own = at[1:] > after[:-1]
        if len(own) and own.mean() < OWN:
            return None
        return _put_together(lines, at, np.where(repeated, after, at))
    return _between(lines, at, after, stamps)


def _put_together(lines: Numbers, ends: Indices, begins: Indices) -> Numbers:
    """Odometry from pieces: the k-th leads from the line begins[k] to the line ends[k + 1]."""
    found = np.empty((len(ends), 3))
    found[0] = lines[ends[0], :3]
    for n in range(1, len(ends)):
        begin = min(begins[n - 1], ends[n])
        found[n] = after_way(found[n - 1], way_between(lines[begin, :3], lines[ends[n], :3]))
    return found


def _between(lines: Numbers, before: Indices, after: Indices, stamps: Numbers) -> Numbers:
    """Odometry between the lines around each scan if their stamps tell where; else the former."""
    gap = lines[after, 3] - lines[before, 3]
    inside = (gap > 0) & (stamps >= lines[before, 3]) & (stamps <= lines[after, 3])
    share = np.where(inside, (stamps - lines[before, 3]) / np.where(gap > 0, gap, 1.0), 0.0)
    step = lines[after, :3] - lines[before, :3]
    step[:, 2] = wrapped(step[:, 2])
    found: Numbers = lines[before, :3] + share[:, None] * step
    return found
