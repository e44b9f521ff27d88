"""Functions that simulate open-loop and closed-loop drives along paths.

The random numbers of a drive depend on the simulator's seed, on the route and on the number of the
drive only: two commands that drive one route report the same drives. Paths with the
same ends belong to one route, so that their n-th drives are pairs: they have the same world and the
same errors of odometry. Drives on different routes are independent.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from locplan._support.checks import check_memory
from locplan._support.progress import ProgressCallback
from locplan.errors import ConfigError
from locplan.planning.path import Path
from locplan.simulation.arrivals import Arrivals
from locplan.simulation.closed_loop import ClosedLoop
from locplan.simulation.drives import Drives
from locplan.simulation.levels import NO_FAULT, Level, select_affected_paths
from locplan.simulation.simulator import Simulator
from locplan.simulation.worlds import add_way_back, make_path_poses, rotate_errors

FIRST_CHOOSING_DRIVE, FIRST_FRESH_DRIVE = 10_000, 20_000
"""First numbers of the drives that choose among alternatives, and of those that confirm what was
chosen on the drives from 0 on.

Drives from 0 on are those that every command reports, so that reports agree. The drives that choose
an alternative promise too much of it, and must not be those that judge it: they have other
numbers."""
N_POSE_ARRAYS = 4
"""Number of arrays of all poses that are in memory at once."""


def compute_route_key(path: Path | Sequence[Sequence[float]]) -> int:
    """Return the number that stands for a route: a digest of its start and goal, to 1 mm.

    Parameters
    ----------
    path : Path, or sequence of positions
        A path between start and goal, or both [m].

    Examples
    --------
    >>> straight = Path(np.array([[2.0, 3.0], [6.0, 3.0]]))
    >>> compute_route_key(straight) == compute_route_key([(2.0, 3.0), (4.0, 5.0), (6.0, 3.0001)])
    True
    """
    xy = path.xy if isinstance(path, Path) else path
    ends = [[round(1000 * float(value)) for value in xy[end][:2]] for end in (0, -1)]
    return int.from_bytes(hashlib.sha256(repr(ends).encode()).digest()[:8], "little")


def drive_open(
    simulator: Simulator,
    paths: Mapping[str, Path],
    numbers: range,
    *,
    level: Level = NO_FAULT,
    route: int | None = None,
    progress: ProgressCallback | None = None,
) -> dict[str, Drives]:
    """Drive each path with the drives of some numbers, exactly along the path.

    Drive n has the same world at all levels. At a level, paths and settings of a filter have the
    same random numbers, so that their n-th drives are pairs.

    Parameters
    ----------
    simulator : Simulator
        The map, the robot and the seed.
    paths : mapping of str to Path
        The paths by name.
    numbers : range
        Numbers of the drives.
    level : Level, by default the usual one
        The level of disturbance, see `locplan.simulation.levels`.
    route : int, optional
        Key of the route that all paths belong to, see `compute_route_key`; by default each path
        belongs to the route of its ends.
    progress : callable, optional
        Called with (done, total) drives.

    Returns
    -------
    dict of str to Drives
        The drives along each path by its name, without the paths that the level's fault cannot
        affect. With a kink, errors are those on the filter's map. With missing motion, drives lead
        to the goal and back.

    Raises
    ------
    LocplanError
        If a path leaves the free cells, or the drives take more memory than there is.
    """
    poses = {
        name: make_path_poses(path, simulator.grid, f"path {name}") for name, path in paths.items()
    }
    paths = select_affected_paths(level, paths, simulator.grid)
    poses = {name: add_way_back(poses[name]) if level.leads_back else poses[name] for name in paths}
    size = len(numbers) * sum(path_poses.size for path_poses in poses.values()) * N_POSE_ARRAYS * 8
    check_memory(f"{len(numbers)} drives of {len(paths)} paths", size, "drive fewer")
    errors = {
        name: np.empty((len(numbers), *path_poses.shape)) for name, path_poses in poses.items()
    }
    setups = {
        name: simulator.make_level_setups(path, poses[name], level) for name, path in paths.items()
    }
    routes = _group_by_route(paths, route)
    stages = {
        key: simulator.make_world_region([line for name in names for line, _ in setups[name]])
        for key, names in routes.items()
    }
    # A task makes a world for its paths: they are split where tasks are fewer than threads.
    parts = math.ceil(simulator.threads / max(1, len(numbers) * len(routes)))
    tasks = [
        (key, names[part::parts], place)
        for place in range(len(numbers))
        for key, names in routes.items()
        for part in range(min(parts, len(names)))
    ]

    def run_task(task_number: int) -> None:
        key, names, place = tasks[task_number]
        stage, number = stages[key], numbers[place]
        world = stage.make_world(key, number)
        for name in names:
            line, arguments = setups[name][number % len(setups[name])]
            errors[name][place] = stage.drive(line, world, key, number, arguments, level)

    simulator.run_in_threads(run_task, len(tasks), progress, len(numbers) * len(paths))
    yaw = simulator.filter_map.origin[2]
    return {name: Drives(poses[name], rotate_errors(errors[name], yaw)) for name in paths}


def drive_closed(
    simulator: Simulator,
    paths: Mapping[str, Path],
    numbers: range,
    *,
    route: int | None = None,
    replan: float | None = None,
    perfect: bool = False,
    progress: ProgressCallback | None = None,
) -> dict[str, Arrivals]:
    """Drive along each path with the drives of some numbers, steered by the filter's pose.

    Parameters
    ----------
    simulator : Simulator
        The map, the robot and the seed; the robot's outline, speed and goal tolerance count.
    paths, numbers, route
        See `drive_open`.
    replan : float, optional
        Time after which the robot plans again in any case [s]; by default only if an obstacle is
        in the way.
    perfect : bool, default False
        Whether the robot knows its true pose, to test the follower alone.
    progress : callable, optional
        Called with (done, total) drives.

    Returns
    -------
    dict of str to Arrivals
        The drives along each path by its name.

    Raises
    ------
    ConfigError
        If the simulator's world is stretched.
    """
    if simulator.stretch != 1:
        raise ConfigError("closed-loop drives need stretch=1; use drive_open in a stretched world")
    loop = ClosedLoop(simulator, dict(paths), replan, perfect)
    routes = _group_by_route(paths, route)
    tasks = [(key, place) for place in range(len(numbers)) for key in routes]
    arrivals: dict[str, list[Any]] = {name: [None] * len(numbers) for name in paths}

    def run_task(task_number: int) -> None:
        key, place = tasks[task_number]
        world = loop.make_world(key, numbers[place])
        for name in routes[key]:
            arrivals[name][place] = loop.drive(name, world, key, numbers[place])

    _ = loop.planner.density, loop.robot_body  # made once, not by every thread
    simulator.run_in_threads(run_task, len(tasks), progress, len(numbers) * len(paths))
    return {name: Arrivals(tuple(path_arrivals)) for name, path_arrivals in arrivals.items()}


def _group_by_route(paths: Mapping[str, Path], route: int | None) -> dict[int, list[str]]:
    """Return the names of the paths of each route by its key."""
    routes: dict[int, list[str]] = {}
    for name, path in paths.items():
        routes.setdefault(compute_route_key(path) if route is None else route, []).append(name)
    return routes
