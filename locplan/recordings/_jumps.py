"""Jumps of odometry against the recorded poses, as where a driver was started again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from locplan._util.poses import Numbers, way_between, wrapped

LEAST = (0.5, 0.5)
"""Distance [m] and turn [rad] by which both differ from scan to scan in a jump..."""
SHARE = 0.3
"""...besides this share of the way and the turn."""


def without_jumps(poses: Numbers, odometry: Numbers) -> tuple[Numbers, Numbers, int]:
    """Poses and odometry that both stand still where they jump apart, and the number of jumps.

    One jump would count for more than all the noise of a drive.

    Parameters
    ----------
    poses, odometry : (n, 3) arrays
        Recorded poses and those by odometry [m, m, rad], each in a frame of its own.

    Examples
    --------
    >>> poses = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    >>> still, odometry, jumps = without_jumps(poses, poses + [[5.0, 0, 0], [5.0, 0, 0], [0, 0, 0]])
    >>> still[:, 0].tolist(), odometry[:, 0].tolist(), jumps
    ([0.0, 1.0, 1.0], [5.0, 6.0, 6.0], 1)
    """
    true, told = (way_between(each[:-1], each[1:]) for each in (poses, odometry))
    off = told - true
    apart, turned = np.hypot(off[:, 0], off[:, 1]), np.abs(wrapped(off[:, 2]))
    far = apart > LEAST[0] + SHARE * np.minimum(_way(true), _way(told))
    far |= turned > LEAST[1] + SHARE * np.abs(wrapped(true[:, 2]))
    if not far.any():
        return poses, odometry, 0
    joined = _joined(poses[0], true, far), _joined(odometry[0], told, far)
    return *joined, int(far.sum())


def _way(ways: Numbers) -> Numbers:
    return np.hypot(ways[:, 0], ways[:, 1])


def _joined(first: Numbers, ways: Numbers, left_out: NDArray[np.bool_]) -> Numbers:
    """The poses to which ways lead from the first one, but for those that are left out."""
    ahead, left, turn = np.where(left_out[:, None], 0.0, ways).T
    heading = first[2] + np.append(0.0, np.cumsum(turn))
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    x = first[0] + np.append(0.0, np.cumsum(cos * ahead - sin * left))
    y = first[1] + np.append(0.0, np.cumsum(sin * ahead + cos * left))
    return np.column_stack([x, y, wrapped(heading)])
