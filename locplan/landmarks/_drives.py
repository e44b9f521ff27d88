"""Drives on maps with landmarks, and in worlds that lack features, and matches on the way."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import random_of
from locplan._util.progress import ProgressCallback
from locplan.costs import Costmap, Path
from locplan.errors import LocplanError
from locplan.field import CovarianceField, FieldConfig, Fused, covariance_field, points_near, scalar
from locplan.landmarks._objects import with_objects
from locplan.landmarks._outcomes import Profile
from locplan.landmarks._routes import Setting
from locplan.landmarks._search import Search, in_world
from locplan.maps import FREE, OccupancyGrid
from locplan.planners import plan
from locplan.robots import Robot
from locplan.simulation import Drives, Simulator, drive_paths

Cells: TypeAlias = NDArray[np.int64]
"""Rows and columns of a feature's cells, (k, 2)."""


def drive_on(
    setting: Setting,
    grid: OccupancyGrid,
    drives: int,
    seed: int,
    threads: int | None,
    progress: ProgressCallback | None,
) -> tuple[Drives, ...]:
    """Drives of each route on a map that the robot's filter has, too."""
    simulator = Simulator(grid, robot=setting.robot, seed=seed, threads=threads)
    return tuple(
        drive_paths(simulator, paths_on(setting, grid), drives, progress=progress).values()
    )


def drive_without(
    grid: OccupancyGrid,
    lacking: Sequence[Cells],
    routes: Mapping[str, Path],
    robot: Robot,
    drives: int,
    seed: int,
    threads: int | None,
    progress: ProgressCallback | None,
) -> tuple[Drives, ...]:
    """Drives of each route in worlds that lack features, which the robot's map still shows."""
    cells = grid.cells.copy()
    if lacking:
        cells[tuple(np.concatenate(lacking).T)] = FREE
    world = dataclasses.replace(grid, cells=cells)
    simulator = Simulator(world, robot, filter_map=grid, seed=seed, threads=threads)
    return tuple(drive_paths(simulator, routes, drives, progress=progress).values())


def paths_on(setting: Setting, grid: OccupancyGrid) -> Mapping[str, Path]:
    """The routes that were given, or the shortest paths between their ends on a map."""
    if not setting.planned:
        return setting.routes
    costs = Costmap.blank(grid, robot_radius=setting.robot.radius)
    paths = {}
    for name, path in setting.routes.items():
        (x0, y0), (x1, y1) = path.xy[[0, -1]].tolist()
        found = plan(costs, (x0, y0), (x1, y1)).path
        if found is None:
            raise LocplanError(
                f"no path of the robot leads along {name} on the map"
                f" {'with' if grid is not setting.grid else 'without'} landmarks"
            )
        paths[name] = found
    return paths


def random_maps(
    setting: Setting, search: Search, count: int, sets: int, seed: int
) -> list[OccupancyGrid]:
    """Maps with `count` objects at random places of those that are allowed."""
    maps = []
    for n in range(sets):
        # Stream of random numbers of places at random, beside those of `Simulator`.
        chosen = search.at_random(count, random_of(seed, 100, n))
        if not chosen:
            return []
        poses = in_world(setting.grid, search.places[chosen])
        maps.append(with_objects(setting.grid, setting.kind, poses))
    return maps


def fields_along(
    setting: Setting, maps: tuple[OccupancyGrid, OccupancyGrid], threads: int | None
) -> dict[str, tuple[Profile, Profile]]:
    """Deviations of a match by `Fused` along each route on the maps before and after.

    The field is computed near the routes only, and updated where the second map differs.
    """
    config = FieldConfig(Fused.of(setting.robot.known_lidar))
    routes = [paths_on(setting, grid) for grid in maps]
    before, after = (
        _near(grid, config, paths.values()) for grid, paths in zip(maps, routes, strict=True)
    )
    field = covariance_field(maps[0], config, points=before, threads=threads)
    found = {name: _along(field, path) for name, path in routes[0].items()}
    field = field.update(maps[1], points=after, threads=threads)
    return {name: (found[name], _along(field, path)) for name, path in routes[1].items()}


def _near(grid: OccupancyGrid, config: FieldConfig, paths: Iterable[Path]) -> NDArray[np.bool_]:
    """Lattice points that are read along some paths."""
    stride = config.stride_cells(grid.resolution)
    xy = np.concatenate([path.resampled(grid.resolution * stride / 2).xy for path in paths])
    cells = np.column_stack(grid.world_to_grid(*xy.T)) - 0.5
    return points_near(config.lattice_points(grid), stride, cells, 1.5 * stride)


def _along(field: CovarianceField, path: Path) -> Profile:
    """A field's largest deviation of the position along a path; NaN where it has none."""
    # Distance between the positions along a route at which the field is read [m].
    fine = path.resampled(0.5, even=True)
    covariances = np.array([field.at(x, y) for x, y in fine.xy.tolist()])
    return np.column_stack([fine.distance, scalar(covariances, "position_std")])
