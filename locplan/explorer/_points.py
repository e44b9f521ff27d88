"""What is known about a place: the ellipse under the cursor."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._util.checks import FARTHEST, number
from locplan._util.tables import finite
from locplan.explorer._session import Session
from locplan.explorer._wire import Ask
from locplan.field import position_axes, scalar
from locplan.maps import OCCUPIED, OccupancyGrid

if TYPE_CHECKING:
    from locplan.explorer._asks import Work


FAR = 5.0
"""Largest clearance that is shown [m]."""


def at(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Answer what the field knows about a place: its error ellipse, with axes [cm] and angle."""
    x, y = (number(name, ask.values.get(name), -FARTHEST, FARTHEST) for name in ("x", "y"))
    scene = session.scene
    grid = scene.costs.grid
    about: dict[str, Any] = {"x": x, "y": y, "known": False, "clearance": None}
    cell = grid.world_to_cell(x, y)
    if not grid.contains(*cell):
        return about
    about["clearance"] = clearance_at(grid, *cell)
    covariance = np.array(np.nan) if scene.field is None else scene.field.at(x, y)
    if np.isnan(covariance).any():
        return finite(about)
    major, minor, angle = (float(value) for value in position_axes(covariance))
    known = {
        "known": True,
        "axes": [100 * major, 100 * minor],
        "angle": angle,
        "heading_deg": math.degrees(float(scalar(covariance, "heading_std"))),
        "u": float(scene.costs.u[cell]),
        "e": float(scalar(covariance, "e")),
    }
    return finite(about | known)


def clearance_at(grid: OccupancyGrid, row: int, col: int) -> float:
    """Distance from a cell's centre to the nearest occupied cell's edge [m]; NaN beyond `FAR`.

    Where it is near this is `OccupancyGrid.clearance`, without the array of the whole map.
    """
    if "clearance" in vars(grid):
        near = float(grid.clearance[row, col])
        return near if near <= FAR else math.nan
    reach = math.ceil(FAR / grid.resolution) + 1
    top, left = max(0, row - reach), max(0, col - reach)
    window = grid.cells[top : row + reach + 1, left : col + reach + 1]
    rows, cols = np.nonzero(window == OCCUPIED)
    if not rows.size:
        return math.nan
    # In halves of a cell, from the centre to the edges of the others.
    down, aside = np.maximum(2 * np.abs([rows + top - row, cols + left - col]) - 1, 0)
    near = math.sqrt(int((down * down + aside * aside).min())) * (grid.resolution / 2)
    return near if near <= FAR else math.nan
