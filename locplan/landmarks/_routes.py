"""What landmarks are placed for, a robot's routes or a region, and drives along the routes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from locplan._kernels.arrays import Bools
from locplan._util.checks import position, shown
from locplan._util.poses import Poses
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError, LocplanError
from locplan.field import FieldConfig, Fused, covariances_along, scalar
from locplan.landmarks._objects import LandmarkObject
from locplan.landmarks._outcomes import Profile
from locplan.maps import OccupancyGrid
from locplan.planners import plan
from locplan.robots import Lidar, Robot


@dataclass(frozen=True, eq=False)
class Setting:
    """What landmarks are placed for: the map, the routes, and the robot."""

    grid: OccupancyGrid
    """The map without the objects that are placed."""
    kind: LandmarkObject
    """The object, of which several are placed."""
    routes: Mapping[str, Path]
    """Routes of the robot by name; of a region, those across it that are driven."""
    region: Bools | None
    """Cells in which the robot may be anywhere, (H, W), or None where it drives the routes."""
    planned: bool
    """True if the routes are shortest paths, to be planned again among the objects."""
    robot: Robot
    """The robot that was simulated."""

    def on(self, grid: OccupancyGrid) -> Mapping[str, Path]:
        """The routes that were given, or the shortest paths between their ends on a map.

        Parameters
        ----------
        grid : OccupancyGrid
            The map, with landmarks or without.

        Raises
        ------
        LocplanError
            If the landmarks close a way.
        """
        if not self.planned:
            return self.routes
        costs = Costmap.blank(grid, robot=self.robot)
        paths = {}
        for name, path in self.routes.items():
            (x0, y0), (x1, y1) = path.xy[[0, -1]].tolist()
            found = plan(costs, (x0, y0), (x1, y1)).path
            if found is None:
                raise LocplanError(
                    f"no path of the robot leads along {name} on the map"
                    f" {'with' if grid is not self.grid else 'without'} landmarks"
                )
            paths[name] = found
        return paths


MAX_PLACES = 8
"""Maximum number of places; all of them are joined by routes."""


def routes_of(grid: OccupancyGrid, paths: Any, places: Any, robot_radius: float) -> dict[str, Path]:
    """Routes by name: the paths that were given, or the shortest ones between places.

    Raises
    ------
    ConfigError
        If they are none.
    LocplanError
        If the robot cannot stand at a place, or no path joins two.
    """
    if paths is not None:
        given = {"path": paths} if isinstance(paths, Path) else paths
        named = _named(given, "path", "paths by name")
        if not named:
            raise ConfigError("there must be at least one path along which landmarks help")
        return {
            str(name): path if isinstance(path, Path) else Path(np.asarray(path))
            for name, path in named.items()
        }
    named = _named(places, "place", "positions x, y in metres")
    if not 2 <= len(named) <= MAX_PLACES:
        raise ConfigError(
            f"there must be 2 to {MAX_PLACES} places, which routes join, not {len(named)};"
            " give longer lists of routes as paths"
        )
    ends = {str(name): position(xy, name=f"place {name}") for name, xy in named.items()}
    costs = Costmap.blank(grid, robot=robot_radius)
    for name, xy in ends.items():
        costs.cell_of(xy, name)
    routes = {}
    for (one, start), (other, goal) in combinations(ends.items(), 2):
        found = plan(costs, start, goal).path
        if found is None:
            raise LocplanError(f"no path leads from {one} to {other}; name places that are joined")
        routes[f"{one} to {other}"] = found
    return routes


def _named(values: Any, word: str, what: str) -> Mapping[Any, Any]:
    """What has names already, or is numbered from 1."""
    if isinstance(values, Mapping):
        return values
    if not isinstance(values, Iterable) or isinstance(values, str):
        raise ConfigError(f"{word}s must be {what}, not {shown(values)}")
    return {f"{word} {n}": value for n, value in enumerate(values, 1)}


def cells_in(grid: OccupancyGrid, areas: Any, name: str) -> Bools | None:
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
    numbers = np.issubdtype(values.dtype, np.number) and np.isfinite(values).all()
    if values.ndim != 2 or values.shape[1] != 4 or not numbers:
        raise wrong
    rows, cols = np.indices(grid.shape)
    at = np.stack(grid.grid_to_world(rows + 0.5, cols + 0.5), axis=-1)
    inside = np.zeros(grid.shape, bool)
    half = grid.resolution / 2
    for corners in values.reshape(-1, 2, 2).astype(np.float64):
        low, high = corners.min(axis=0) - half, corners.max(axis=0) + half
        inside |= ((at > low) & (at < high)).all(axis=-1)
    return inside


def where_robot_is(grid: OccupancyGrid, region: Bools | None, robot_radius: float) -> Bools:
    """Cells of a region where the robot's centre can be, all joined by ways on the map, (H, W).

    Raises
    ------
    ConfigError
        If there is no such cell.
    """
    import cv2

    if region is None:
        raise ConfigError("the region must hold at least one rectangle (x0, y0, x1, y1) in metres")
    space = grid.free & ~grid.closer_than(robot_radius - 1e-9)
    _, parts = cv2.connectedComponents(space.astype(np.uint8), connectivity=4)
    counts = np.bincount(parts[space & region], minlength=1)
    if not counts.any():
        raise ConfigError(
            f"a robot of {robot_radius:g} m radius cannot be anywhere in the region; give one with"
            " free cells"
        )
    return np.asarray(region & (parts == int(counts.argmax())))


def poses_in(grid: OccupancyGrid, cells: Bools, lidar: Lidar) -> Poses:
    """Poses in the world on a lattice over cells, with headings all round, (n, 3).

    The fewer a lidar sees at once, the more headings there are: any direction is seen twice.
    """
    headings = 1
    if not lidar.sees_all_round:
        # Greatest number of headings at a position, for a narrow field of view.
        headings = min(math.ceil(720 / lidar.field_of_view_deg), 8)
    area = cells.sum() * grid.resolution**2
    # Number of poses, about, from which on they are farther apart.
    step = max(0.5, math.sqrt(area * headings / 1200))
    edge = max(round(step / grid.resolution), 1)
    # Of each square of the lattice, the cell that is nearest to its middle.
    rows, cols = np.nonzero(cells)
    away = np.hypot(rows % edge - (edge - 1) / 2, cols % edge - (edge - 1) / 2)
    order = np.lexsort((away, cols // edge, rows // edge))
    square = rows[order] // edge * (grid.shape[1] + 1) + cols[order] // edge
    _, firsts = np.unique(square, return_index=True)
    x, y = grid.grid_to_world(rows[order][firsts] + 0.5, cols[order][firsts] + 0.5)
    turns = np.tile(np.arange(headings) * 2 * math.pi / headings, len(firsts))
    return np.column_stack([np.repeat(x, headings), np.repeat(y, headings), turns])


def routes_across(grid: OccupancyGrid, cells: Bools, robot_radius: float) -> dict[str, Path]:
    """Shortest paths between places in a region, of which each is far from those before it.

    Raises
    ------
    ConfigError
        If the region is too small for two places.
    """
    rows, cols = np.nonzero(cells)
    xy = np.column_stack(grid.grid_to_world(rows + 0.5, cols + 0.5))
    clear = grid.clearance[rows, cols]
    ends = [int(np.argmax(np.hypot(*(xy - xy.mean(axis=0)).T)))]
    apart = np.full(len(xy), np.inf)
    while len(ends) < 6:
        apart = np.minimum(apart, np.hypot(*(xy - xy[ends[-1]]).T))
        # Rather in the open than in a corner.
        ends.append(int(np.argmax(apart + np.minimum(clear, 1.0))))
    left: list[int] = []
    for end in ends:  # the clearest place within 1 m
        near = np.flatnonzero(np.hypot(*(xy - xy[end]).T) <= 1.0)
        left.append(int(near[np.argmax(clear[near])]))
    left = list(dict.fromkeys(left))
    costs = Costmap.blank(grid, robot=robot_radius)
    routes: dict[str, Path] = {}
    while len(left) > 1:
        one = left.pop(0)
        other = max(left, key=lambda n: float(np.hypot(*(xy[n] - xy[one]))))
        left.remove(other)
        found = plan(costs, tuple(xy[one]), tuple(xy[other])).path
        if found is not None and found.length > 2 * robot_radius:
            routes[f"across {len(routes) + 1}"] = found
    if not routes:
        raise ConfigError("the region is too small to drive in; give a larger one")
    return routes


def fields_along(
    setting: Setting, maps: tuple[OccupancyGrid, OccupancyGrid], threads: int | None
) -> dict[str, tuple[Profile, Profile]]:
    """Deviations of a match by `Fused` along each route on the maps before and after."""
    config = FieldConfig(Fused(setting.robot.known_lidar))

    def along(grid: OccupancyGrid, path: Path) -> Profile:
        fine = path.resampled(0.5, even=True)
        covariances = covariances_along(grid, config, fine.xy, threads=threads)
        return np.column_stack([fine.distance, scalar(covariances, "position_std")])

    before, after = (
        {name: along(grid, path) for name, path in setting.on(grid).items()} for grid in maps
    )
    return {name: (profile, after[name]) for name, profile in before.items()}
