"""Occupancy values of ROS, of masks and of probabilities as the three levels of a grid."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._support.kernels.arrays import Floats, Octets
from locplan.errors import MapError

OCCUPIED, UNKNOWN, FREE = 0, 127, 254
"""The three levels of a cell (the paper's values)."""
FREE_BELOW, OCCUPIED_FROM = 19.6, 65.0
"""Default thresholds of ROS's map_server [per cent]."""


def levels_from_occupancy(occupancy: ArrayLike, *, probabilities: bool) -> Octets:
    """Return the levels of occupancy values, as `OccupancyGrid.from_occupancy` describes them."""
    try:
        values = np.asarray(occupancy)
    except ValueError as error:
        raise MapError(f"occupancy must be an array (H, W): {error}") from None
    if values.dtype == bool:
        return np.where(values, np.uint8(OCCUPIED), np.uint8(FREE))
    per_cent = _per_cent_from_probabilities(values) if probabilities else _check_per_cent(values)
    levels = np.full(values.shape, UNKNOWN, np.uint8)
    levels[(per_cent >= 0) & (per_cent < FREE_BELOW)] = FREE
    levels[per_cent >= OCCUPIED_FROM] = OCCUPIED
    return levels


def _per_cent_from_probabilities(values: NDArray[Any]) -> Floats:
    """Return probabilities in per cent; NaN stays NaN."""
    if not np.issubdtype(values.dtype, np.number) or np.iscomplexobj(values):
        raise MapError(f"probabilities must be numbers, not of type {values.dtype}")
    wrong = values[(values < 0) | (values > 1)]
    if wrong.size:
        raise MapError(
            f"probabilities must be 0.0 to 1.0, or NaN where unknown, but there is {wrong[0]:g}"
        )
    return values * 100.0


def _check_per_cent(values: NDArray[Any]) -> NDArray[Any]:
    """Return values after checking that they are -1 to 100."""
    if not np.issubdtype(values.dtype, np.integer):
        raise MapError(
            f"occupancy of type {values.dtype} is ambiguous: set probabilities=True for 0.0 to 1.0,"
            " or give whole numbers of -1 to 100"
        )
    wrong = values[(values < -1) | (values > 100)]
    if wrong.size:
        raise MapError(
            f"occupancy must be 0 to 100, or -1 where unknown, but there is {wrong[0]}; an image is"
            " read by locplan.load_map with its YAML"
        )
    if values.size and values.max() == 1:
        raise MapError(
            "occupancy of 0 and 1 is ambiguous, since 1 per cent is free: give a bool array, in"
            " which True is occupied, or 100 where it is occupied"
        )
    return values


def parse_grid_message(message: Any) -> tuple[NDArray[Any], float, tuple[float, float, float]]:
    """Return values (H, W), resolution [m] and origin (x, y, yaw) of a nav_msgs/OccupancyGrid."""
    try:
        metadata, pose = message.info, message.info.origin
        values = np.asarray(message.data, np.int64).reshape(
            int(metadata.height), int(metadata.width)
        )
        turn = pose.orientation
        sine = 2 * (turn.w * turn.z + turn.x * turn.y)
        yaw = math.atan2(sine, 1 - 2 * (turn.y**2 + turn.z**2))
        origin = float(pose.position.x), float(pose.position.y), yaw
        return values, float(metadata.resolution), origin
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise MapError(
            f"the message is no nav_msgs/OccupancyGrid with data and info ({error})"
        ) from None
