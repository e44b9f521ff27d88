"""The arguments of `place_landmarks`, checked and made into what the search needs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import position, shown
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError, LocplanError
from locplan.landmarks._objects import LandmarkObject, filled_cells, on_grid
from locplan.maps import FREE, OccupancyGrid
from locplan.planners import plan

MAX_PLACES = 8
"""Greatest number of places; all of them are joined by routes."""


def routes_of(
    grid: OccupancyGrid, paths: object, places: object, robot_radius: float
) -> dict[str, Path]:
    """Routes by name: the paths that were given, or the shortest ones between places.

    Raises
    ------
    ConfigError
        If neither or both are given, or they are none.
    LocplanError
        If the robot cannot stand at a place, or no path joins two.
    """
    if (paths is None) == (places is None):
        raise ConfigError("give paths, or places that routes lead between, and not both")
    if paths is not None:
        return _named_paths(paths)
    named = _named_places(places)
    costs = Costmap.blank(grid, robot_radius=robot_radius)
    routes = {}
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


def without_objects(
    grid: OccupancyGrid, kind: LandmarkObject, poses: NDArray[np.float64]
) -> OccupancyGrid:
    """Copy of a map without objects that stand in it, whose cells become free.

    Cells beside the drawn shape are freed, too, if they are occupied and the wall does not hold
    them: those within one cell of it.
    """
    import dataclasses

    cells = grid.cells.copy()
    shape = kind.shape
    wider = shape._replace(
        half_length=shape.half_length + grid.resolution,
        half_width=shape.half_width + grid.resolution,
    )
    for row, col, heading in on_grid(grid, poses):
        at = filled_cells(wider, row, col, heading, grid.resolution, grid.shape)
        cells[at] = FREE
    return dataclasses.replace(grid, cells=cells)


def kept_out(grid: OccupancyGrid, keep_out: Any) -> NDArray[np.bool_] | None:
    """Cells that no object may fill, of a mask (H, W) or of rectangles in the world.

    Raises
    ------
    ConfigError
        If it is neither.
    """
    if keep_out is None:
        return None
    values = np.asarray(keep_out)
    if values.dtype == bool:
        if values.shape != grid.shape:
            raise ConfigError(f"keep_out has shape {values.shape}, but the map {grid.shape}")
        return values
    if values.size == 0:
        return None
    if values.ndim != 2 or values.shape[1] != 4 or not np.issubdtype(values.dtype, np.number):
        raise ConfigError(
            "keep_out must be a mask (H, W) of bool, or rectangles (x0, y0, x1, y1) in metres"
        )
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
