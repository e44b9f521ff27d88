"""What is known about a place: the ellipse under the cursor."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
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
"""Greatest clearance that is told [m]."""


@dataclass(frozen=True)
class PointAnswer:
    """The uncertainty of a pose match at a place; NaN where nothing is known."""

    x: float
    """World x [m]."""
    y: float
    """World y [m]."""
    known: bool = False
    """Whether there is a covariance."""
    axes: tuple[float, float] = (math.nan, math.nan)
    """Standard deviations along the axes of the error ellipse, the greater first [cm]."""
    angle: float = math.nan
    """Direction of the first axis in the world, counter-clockwise from x [rad]."""
    heading_deg: float = math.nan
    """Standard deviation of the heading [deg]."""
    u: float = math.nan
    """Degeneracy, 0..1."""
    e: float = math.nan
    """e [m^2 rad]."""
    clearance: float = math.nan
    """Distance to the nearest occupied cell, up to 5 m [m]."""


def point_answer(session: Session, x: float, y: float) -> PointAnswer:
    """What the session's field knows about a position [m]."""
    scene = session.scene
    grid = scene.costs.grid
    cell = grid.world_to_cell(x, y)
    if not grid.contains(*cell):
        return PointAnswer(x, y)
    clearance = clearance_at(grid, *cell)
    if scene.field is None:
        return PointAnswer(x, y, clearance=clearance)
    covariance = scene.field.at(x, y)
    if np.isnan(covariance).any():
        return PointAnswer(x, y, clearance=clearance)
    major, minor, angle = (float(value) for value in position_axes(covariance))
    return PointAnswer(
        x,
        y,
        True,
        (100 * major, 100 * minor),
        angle,
        math.degrees(float(scalar(covariance, "heading_std"))),
        float(scene.costs.u[cell]),
        float(scalar(covariance, "e")),
        clearance,
    )


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


def at(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Answer what is known about a place."""
    x, y = (number(name, ask.values.get(name), -FARTHEST, FARTHEST) for name in ("x", "y"))
    return finite(asdict(point_answer(session, x, y)))
