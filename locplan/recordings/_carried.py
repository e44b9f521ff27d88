"""Poses that are told now and then, carried by odometry to the scans in between."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from locplan._util.poses import Numbers, after_way, way_between, wrapped
from locplan.recordings._frames import Track, in_plane

CARRIED = 1.0
"""Way over which odometry carries a pose to a scan [m]."""


def carried_poses(
    times: Sequence[float], track: Track, reported_at: Sequence[float], reported: Numbers
) -> Numbers:
    """Poses at n times that odometry carries there from the samples before and after.

    AMCL tells a pose only once the robot has moved on; between two of them it may have turned back.

    Parameters
    ----------
    times : sequence of n floats
        Times of the scans [s].
    track : Track
        Samples of the pose.
    reported_at : sequence of m floats
        Times of the odometry, those of the samples among them [s].
    reported : (m, 3) array
        Poses by odometry, NaN where unknown.

    Returns
    -------
    (n, 3) array
        NaN where a scan is further than `CARRIED` from both samples.
    """
    at, knots = np.asarray(times), np.asarray(reported_at)
    now = reported[np.searchsorted(knots, at)]
    guesses, weights = [], []
    for samples in track.samples():
        then = samples[:, 0]
        index = np.searchsorted(knots, np.where(np.isfinite(then), then, knots[0]))
        way = way_between(reported[index], now)
        near = np.isfinite(then) & (np.hypot(way[:, 0], way[:, 1]) < CARRIED)
        guesses.append(after_way(in_plane(samples[:, 1:]), way))
        # The nearer sample in time counts for more; one that is too far for nothing.
        weights.append(np.where(near, 1.0 / np.maximum(np.abs(at - then), 1e-9), 0.0))
    (one, other), (first, second) = guesses, weights
    one, other = np.where(first[:, None] > 0, one, other), np.where(second[:, None] > 0, other, one)
    total = first + second
    share = np.divide(second, total, out=np.full(len(at), np.nan), where=total > 0)
    step = other - one
    step[:, 2] = wrapped(step[:, 2])
    found: Numbers = one + share[:, None] * step
    return found
