"""Cases in which settings are driven: paths in simulated worlds, at levels of disturbance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from locplan._kernels.arrays import Floats
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.maps import OccupancyGrid
from locplan.planners import plan, random_queries
from locplan.robots import Amcl, Robot
from locplan.simulation._simulator import Simulator
from locplan.simulation.driver import drive_open
from locplan.simulation.levels import USUAL, Level, levels_for, select_paths
from locplan.simulation.tuning._choose_preset import LEVEL_DRIVES, Case
from locplan.simulation.verdict import DriveSet

LONGEST = 40.0
"""Length of a path beyond which settings are driven along a part of it [m]."""
LEVEL_LOOKS = (16, 32)
"""Numbers of drives along all paths together after which a level may be decided."""
DISTANCES = (20.0, 8.0, 4.0, 2.0)
"""Least distances between the ends of paths, of which the first is taken that the map is large
enough for [m]. After 2 m of standstill most filters need 10 m or more to return: shorter drives end
before."""


def plan_random_paths(costs: Costmap, count: int, seed: int) -> list[Path]:
    """Return shortest paths of random queries, of 20 to 40 m if the map is large.

    Parameters
    ----------
    costs : Costmap
        Costmap that is blocked where the robot does not fit.
    count : int
        Number of paths.
    seed : int
        Seed of the random numbers.

    Raises
    ------
    ConfigError
        If no two positions of the map that are joined lie 2 m apart.
    """
    for least in DISTANCES:
        try:
            queries = random_queries(costs, count, seed, min_distance=least)
            break
        except ConfigError as error:
            fault = str(error).split(";")[0]
    else:
        raise ConfigError(f"{fault}; give a larger map, or a smaller robot")
    random = np.random.default_rng(seed)
    paths = (plan(costs, query.start, query.goal).path for query in queries)
    return [cut_path(path, random.random()) for path in paths if path is not None]


def simulated_cases(
    grid: OccupancyGrid,
    robot: Robot,
    paths: Sequence[Path],
    levels: Sequence[Level],
    *,
    drives: int = 1,
    label: str = "",
    filter_map: OccupancyGrid | None = None,
    stretch: float = 1.0,
    seed: int = 1,
    threads: int | None = None,
) -> list[Case]:
    """Return a case for each level of disturbance that can affect the paths.

    Parameters
    ----------
    grid, robot, filter_map, stretch, seed, threads
        See `Simulator`; the robot's filter is replaced by the settings that drive.
    paths : sequence of Path
        The paths.
    levels : sequence of Level
        The levels.
    drives : int, default 1
        Number of drives along each path at the usual level. At the others there are as many, and 64
        along all paths at least.
    label : str, default ""
        Name of the map before that of the level; empty for a single map.
    """
    named = {f"{n}": path for n, path in enumerate(paths, 1)}

    @cache
    def simulator_with(amcl: Amcl) -> Simulator:
        return Simulator(
            grid,
            replace(robot, filter=amcl),
            filter_map=filter_map,
            seed=seed,
            threads=threads,
            stretch=stretch,
        )

    def case_at(level: Level) -> Case:
        is_usual = level == USUAL
        affected = select_paths(level, named, grid)
        least = 0 if is_usual else math.ceil(LEVEL_DRIVES / len(affected))
        count = max(drives, least)
        looks = {min(count, math.ceil(n / len(affected))) for n in LEVEL_LOOKS}

        def drive(amcl: Amcl, numbers: range) -> DriveSet:
            driven = drive_open(simulator_with(amcl), affected, numbers, level=level)
            return DriveSet.from_drives(driven.values())

        return Case(
            f"{label} {level.name}".strip(),
            drive,
            (count,) if is_usual else (*sorted(looks - {count}), count),
            "" if is_usual else level.phrase,
        )

    return [case_at(level) for level in levels_for(paths, grid, levels)]


def cut_path(path: Path, where: float) -> Path:
    """Return a part of a path of at most 40 m.

    Parameters
    ----------
    path : Path
        The path.
    where : float
        Where the part begins: 0 at the start of the path, 1 so that it ends at the goal.
    """
    spare = path.length - LONGEST
    if spare <= 0:
        return path
    first, last = where * spare, where * spare + LONGEST
    inner = (path.distance > first) & (path.distance < last)

    def cut(values: Floats) -> Floats:
        ends = np.interp([first, last], path.distance, values)
        return np.concatenate([ends[:1], values[inner], ends[1:]])

    heading = None if path.heading is None else cut(np.unwrap(path.heading))
    return Path(np.column_stack([cut(values) for values in path.xy.T]), heading)
