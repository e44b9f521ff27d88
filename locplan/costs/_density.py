"""The density of a costmap: what a metre of travel costs in each cell."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._util.checks import number
from locplan.errors import ConfigError
from locplan.maps import OccupancyGrid

MAX_DENSITY = 1e9
"""Greatest finite density; with a higher one, rounding would swallow a path's short steps."""


def density_of(u: NDArray[np.float64], weight: float) -> NDArray[np.float64]:
    """1 + weight u; infinite where u is NaN."""
    density = u * weight
    density += 1
    np.copyto(density, np.inf, where=np.isnan(u))
    return density


def checked_density(density: ArrayLike, grid: OccupancyGrid) -> NDArray[np.float64]:
    """A copy of a density of one's own, (H, W), infinite where the map is not free.

    Raises
    ------
    ConfigError
        If it has another shape than the map, or holds what is no density.
    """
    values = np.array(density, dtype=np.float64)
    if values.shape != grid.shape:
        raise ConfigError(f"density has shape {values.shape}, but the map {grid.shape}")
    if not ((values >= 1) & ((values <= MAX_DENSITY) | np.isposinf(values))).all():
        raise ConfigError(f"density must lie in 1..{MAX_DENSITY:g} everywhere, or be inf to block")
    values[~grid.free] = np.inf
    return values


def blocked_near(density: NDArray[Any], grid: OccupancyGrid, robot_radius: float) -> NDArray[Any]:
    """The density, infinite closer to occupied cells than a radius [m] as well, read-only."""
    number("robot_radius", robot_radius, 0, MAX_DENSITY)
    density = density if density.flags.writeable else density.copy()
    np.copyto(density, np.inf, where=grid.closer_than(robot_radius - 1e-9))
    return sealed(density)


def check_weight(weight: float) -> None:
    """Check a weight of degenerate metres, before a costmap is made.

    Parameters
    ----------
    weight : float
        The weight, see `Costmap.from_field`.

    Raises
    ------
    ConfigError
        If it is no number, or not from 0 to 1e9.
    """
    number("weight", weight, 0, MAX_DENSITY)


def sealed(layer: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only, and return it."""
    layer.setflags(write=False)
    return layer
