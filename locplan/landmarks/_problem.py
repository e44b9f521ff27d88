"""The arguments of `place_landmarks`, checked and made into what the search needs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import position, shown
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError, LocplanError
from locplan.maps import OccupancyGrid
from locplan.planners import plan
from locplan.robots import Amcl, Disturbances, Lidar

Robot: TypeAlias = tuple[Lidar, Amcl, Disturbances]
"""The robot's lidar, its filter, and the disturbances."""
MAX_PLACES = 8
"""Greatest number of places; all of them are joined by routes."""


def routes_of(
    grid: OccupancyGrid, paths: object, places: object, robot_radius: float
) -> dict[str, Path]:
    """Routes by name: the paths that were given, or the shortest ones between places.

    Raises
    ------
    ConfigError
        If they are none.
    LocplanError
        If the robot cannot stand at a place, or no path joins two.
    """
    if paths is not None:
        return _named_paths(paths)
    named = _named_places(places)
    costs = Costmap.blank(grid, robot_radius=robot_radius)
    routes = {}
    for name, xy in named.items():
        costs.cell_of(xy, name)
    for (one, start), (other, goal) in combinations(named.items(), 2):
        found = plan(costs, start, goal).path
        if found is None:
            raise LocplanError(f"no path leads from {one} to {other}; name places that are joined")
        routes[f"{one} to {other}"] = found
    return routes


def _named_paths(paths: Any) -> dict[str, Path]:
    if isinstance(paths, Path):
        paths = {"path": paths}
    elif not isinstance(paths, Mapping):
        if not isinstance(paths, Iterable) or isinstance(paths, str):
            raise ConfigError(f"paths must be paths by name, not {shown(paths)}")
        paths = {f"path {n}": path for n, path in enumerate(paths, 1)}
    if not paths:
        raise ConfigError("there must be at least one path along which landmarks help")
    return {
        str(name): path if isinstance(path, Path) else Path(np.asarray(path))
        for name, path in paths.items()
    }


def _named_places(places: Any) -> dict[str, tuple[float, float]]:
    if not isinstance(places, Mapping):
        if not isinstance(places, Sequence) or isinstance(places, str):
            raise ConfigError(f"places must be positions x, y in metres, not {shown(places)}")
        places = {f"place {n}": xy for n, xy in enumerate(places, 1)}
    if not 2 <= len(places) <= MAX_PLACES:
        raise ConfigError(
            f"there must be 2 to {MAX_PLACES} places, which routes join, not {len(places)};"
            " give longer lists of routes as paths"
        )
    return {str(name): position(xy, name=f"place {name}") for name, xy in places.items()}


def cells_in(grid: OccupancyGrid, areas: Any, name: str) -> NDArray[np.bool_] | None:
    """Cells of a mask (H, W) or of rectangles in the world, or None without any.

    Raises
    ------
    ConfigError
        If it is neither.
    """
    if areas is None:
        return None
    wrong = ConfigError(
        f"{name} must be a mask (H, W) of bool, or rectangles (x0, y0, x1, y1) in metres"
    )
    try:
        values = np.asarray(areas)
    except ValueError:  # rectangles of unequal length
        raise wrong from None
    if values.dtype == bool:
        if values.shape != grid.shape:
            raise ConfigError(f"{name} has shape {values.shape}, but the map {grid.shape}")
        return values
    if values.size == 0:
        return None
    if values.ndim != 2 or values.shape[1] != 4 or not np.issubdtype(values.dtype, np.number):
        raise wrong
    if not np.isfinite(values).all():
        raise wrong
    rows, cols = np.indices(grid.shape)
    x, y = grid.grid_to_world(rows + 0.5, cols + 0.5)
    inside = np.zeros(grid.shape, bool)
    half = grid.resolution / 2
    for x0, y0, x1, y1 in values.astype(np.float64):
        inside |= (
            (x > min(x0, x1) - half)
            & (x < max(x0, x1) + half)
            & ((y > min(y0, y1) - half) & (y < max(y0, y1) + half))
        )
    return inside
