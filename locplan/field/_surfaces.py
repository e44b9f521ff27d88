"""The normals of an occupancy grid's walls, and the wall cells that a beam can end at."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLUR = 1.0
"""Standard deviation of the Gaussian that smooths the steps of slanting walls [cells]."""
LEVELS = 100
"""Number of levels of the smoothed map, so few that all sums over windows are exact."""
WIDTHS = 3, 9, 27, 81
"""Edge lengths of the windows that a normal is averaged over, one after the other [cells]."""
NORMAL_REACH = 3 + 1 + sum(width // 2 for width in WIDTHS)
"""Distance from a cell within which the map decides its normal [cells]."""
BAND = 1 << 20
"""Number of cells that are processed at once, which bounds the memory."""
STRAIGHT = 0.8
"""Least agreement of a straight surface's slopes on one axis: (l1 - l2) / (l1 + l2)."""
TURN = math.radians(18)
"""Greatest angle by which a wider window may turn the axis [rad]."""
POST = 1e-3
"""Agreement in the narrowest window up to which a cell has no normal, such as a lone post."""


def surface_normals(occupied: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Find the unit normal of the surface at each occupied cell, without a sign.

    It is the main axis of the structure tensor (Bigün and Granlund, 1987) over the widest window
    in which the surface is straight and faces the same way as in the narrower ones. The steps of
    slanting walls turn a narrow window's axis by degrees, so that a bare slanting corridor would
    seem to fix the position along it. A wide window alone would smooth away real door frames.

    A part of a map gives the same normals at `NORMAL_REACH` or more cells from its edges.

    Parameters
    ----------
    occupied : (H, W) array of bool
        The occupied cells.

    Returns
    -------
    (H, W, 2) array
        The components (row, col), zero where a cell is not occupied or has no direction.
    """
    rows, cols = occupied.shape
    normals = np.zeros((*occupied.shape, 2), np.float32)
    band = max(2 * NORMAL_REACH, BAND // cols)
    for top in range(0, rows, band):
        bottom, above = min(top + band, rows), max(0, top - NORMAL_REACH)
        part = _normals(occupied[above : min(rows, bottom + NORMAL_REACH)])
        normals[top:bottom] = part[top - above : bottom - above]
    return normals


def wall_cells(occupied: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Mark the occupied cells that have one of their 8 neighbours not occupied.

    Parameters
    ----------
    occupied : (H, W) array of bool
        The occupied cells.

    Returns
    -------
    (H, W) array of uint8
        1 at such cells, 0 elsewhere.
    """
    import cv2

    solid = occupied.astype(np.uint8)
    around = np.ones((3, 3), np.uint8)
    enclosed = cv2.erode(solid, around, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(solid - enclosed)


def _normals(occupied: NDArray[np.bool_]) -> NDArray[np.float32]:
    import cv2

    edge: Any = {"borderType": cv2.BORDER_REPLICATE}
    soft = cv2.GaussianBlur(occupied.astype(np.uint8) * LEVELS, (0, 0), BLUR, **edge)
    # Slopes along the columns (dx) and along the rows (dy).
    dx, dy = (cv2.Scharr(soft, cv2.CV_64F, *order, **edge) for order in ((1, 0), (0, 1)))
    # The tensor in whole numbers: its main axis as (cos, sin) of the doubled angle, and its trace.
    tensor = np.stack([(dx - dy) * (dx + dy), 2 * dx * dy, dx**2 + dy**2], axis=-1)
    tensor = _summed(tensor, WIDTHS[0])
    axis, agreement = _main_axes(tensor[occupied])
    faces = agreement > POST
    for width in WIDTHS[1:]:
        tensor = _summed(tensor, width)
        wider, agreement = _main_axes(tensor[occupied])
        alike = (axis * wider).sum(axis=1) > math.cos(2 * TURN)
        better = alike & (agreement > STRAIGHT)
        axis[better] = wider[better]
    # Halving the angle by roots keeps the normals of walls along the axes free of rounding.
    double_cos, double_sin = axis.T
    row = np.copysign(np.sqrt(np.clip((1 - double_cos) / 2, 0, 1)), double_sin)
    col = np.sqrt(np.clip((1 + double_cos) / 2, 0, 1))
    normals = np.zeros((*occupied.shape, 2), np.float32)
    normals[occupied] = np.stack([row * faces, col * faces], axis=-1)
    return normals


def _summed(tensor: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    import cv2

    edge: Any = {"borderType": cv2.BORDER_REPLICATE}
    return np.asarray(cv2.boxFilter(tensor, -1, (width, width), normalize=False, **edge))


def _main_axes(tensors: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors of the axes' doubled angles, (n, 2), and agreement of the slopes, 0..1."""
    length = np.hypot(tensors[:, 0], tensors[:, 1])
    axes = tensors[:, :2] / np.maximum(length, 1.0)[:, None]
    return axes, length / np.maximum(tensors[:, 2], 1.0)
