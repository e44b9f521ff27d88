"""Poses, rigid moves and ends of beams as plain arrays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]
Poses = NDArray[np.float64]
"""Array of poses (x, y, heading) in the world, (n, 3) [m, m, rad]."""


def ends_in_map(ends: Numbers, poses: Numbers) -> Numbers:
    """Ends (n, beams, 2) on robots at poses (n, 3), in the frame of the poses [m]."""
    cos, sin = (part(poses[:, 2])[:, None] for part in (np.cos, np.sin))
    x = poses[:, 0, None] + cos * ends[..., 0] - sin * ends[..., 1]
    y = poses[:, 1, None] + sin * ends[..., 0] + cos * ends[..., 1]
    return np.stack([x, y], axis=-1)


def moved(poses: Numbers, move: tuple[float, float, float]) -> Numbers:
    """Poses (n, 3) after a rigid move: a turn about the origin, then a shift [m, m, rad]."""
    dx, dy, turn = move
    cos, sin = math.cos(turn), math.sin(turn)
    x, y, heading = poses.T
    return np.column_stack([dx + cos * x - sin * y, dy + sin * x + cos * y, heading + turn])


def way_between(one: Numbers, other: Numbers) -> Numbers:
    """Poses `other` as they are seen from `one`, (..., 3) [m, m, rad]."""
    dx, dy, turn = np.moveaxis(other - one, -1, 0)
    cos, sin = np.cos(one[..., 2]), np.sin(one[..., 2])
    return np.stack([cos * dx + sin * dy, cos * dy - sin * dx, turn], axis=-1)


def after_way(poses: Numbers, ways: Numbers) -> Numbers:
    """The poses to which ways lead from others, (..., 3) [m, m, rad]."""
    ahead, left, turn = np.moveaxis(ways, -1, 0)
    cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    x = poses[..., 0] + cos * ahead - sin * left
    y = poses[..., 1] + sin * ahead + cos * left
    return np.stack([x, y, poses[..., 2] + turn], axis=-1)


def turning(yaw: float) -> Numbers:
    """The turn of x, y, heading by an angle [rad], (3, 3)."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def wrapped(angles: Any) -> Numbers:
    """Angles within -pi to pi [rad]."""
    return np.asarray((np.asarray(angles, np.float64) + np.pi) % (2 * np.pi) - np.pi)


def way_length(poses: Numbers) -> float:
    """Length of the way over poses (n, 3) [m]."""
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())


def way_along(poses: Numbers) -> Numbers:
    """Length of the way from the first of the poses (n, 2) or (n, 3) to each, (n,) [m]."""
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)])
