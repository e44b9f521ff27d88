"""Jumps of odometry against the recorded poses, as where a driver was started again."""

from __future__ import annotations

import numpy as np

from locplan.recordings._geometry import Numbers, way_between, wrapped

LEAST = (0.5, 0.5)
"""Distance [m] and turn [rad] by which both differ from scan to scan in a jump..."""
SHARE = 0.3
"""...besides this share of the way and the turn."""


def without_jumps(poses: Numbers, odometry: Numbers) -> tuple[Numbers, int]:
    """Odometry that goes on as the poses do where it jumps against them, and the number of jumps.

    One jump would count for more than all the noise of a drive.

    Parameters
    ----------
    poses, odometry : (n, 3) arrays
        Recorded poses and those by odometry [m, m, rad], each in a frame of its own.

    Examples
    --------
    >>> import numpy as np
    >>> poses = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    >>> odometry, jumps = without_jumps(poses, poses + [[5.0, 0, 0], [5.0, 0, 0], [0.0, 0, 0]])
    >>> odometry[:, 0].tolist(), jumps
    ([5.0, 6.0, 7.0], 1)
    """
    true, told = (way_between(each[:-1], each[1:]) for each in (poses, odometry))
    off = told - true
    apart, turned = np.hypot(off[:, 0], off[:, 1]), np.abs(wrapped(off[:, 2]))
    far = apart > LEAST[0] + SHARE * np.hypot(true[:, 0], true[:, 1])
    far |= turned > LEAST[1] + SHARE * np.abs(wrapped(true[:, 2]))
    if not far.any():
        return odometry, 0
    ahead, left, turn = np.where(far[:, None], true, told).T
    heading = odometry[0, 2] + np.append(0.0, np.cumsum(turn))
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    x = odometry[0, 0] + np.append(0.0, np.cumsum(cos * ahead - sin * left))
    y = odometry[0, 1] + np.append(0.0, np.cumsum(sin * ahead + cos * left))
    return np.column_stack([x, y, wrapped(heading)]), int(far.sum())
