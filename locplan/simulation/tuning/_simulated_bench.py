"""Drives of settings in simulated worlds, along random shortest paths of a map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from locplan._kernels.arrays import Floats, Ints, Octets
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.maps import OccupancyGrid
from locplan.matching import in_batches
from locplan.planners import plan, random_queries
from locplan.robots import Amcl, Robot
from locplan.simulation._drives import DriveArguments, Line, drive_arguments
from locplan.simulation._simulator import Simulator
from locplan.simulation._worlds import poses_along
from locplan.simulation.tuning._bench import DisturbanceLevel, TuningBench
from locplan.simulation.tuning._recovery import Kidnapping

ONCE, THRICE = DisturbanceLevel("x1", 1.0, 1.0), DisturbanceLevel("x3", 3.0, 2.0)
TEN_TIMES = DisturbanceLevel("x10", 10.0, 1.0)
LEVELS = {
    "usual": (DisturbanceLevel("x1/3", 1 / 3, 0.5), ONCE, THRICE),
    "poor": (ONCE, THRICE, TEN_TIMES),
}
"""The levels of disturbance, by the odometry that settings are to hold for; the names of levels are
those of the factor on odometry's errors."""

KIDNAPPED = 2
"""Number of drives along each path in which the robot is kidnapped."""


class SimulatedBench(TuningBench):
    """Drives of settings in simulated worlds, at some levels of disturbance.

    Parameters
    ----------
    grid, robot, filter_map, seed
        See `Simulator`; all settings have the same worlds and seeds.
    paths : sequence of Path
        The paths that are driven.
    drives : int
        Maximum number of drives along each path, at each level.
    levels : sequence of DisturbanceLevel, optional
        By default a third of, once and three times what was asked for.
    threads : int
        Number of threads.
    lidar, lines
        See `TuningBench`; they follow from these.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        robot: Robot,
        paths: Sequence[Path],
        drives: int,
        *,
        levels: Sequence[DisturbanceLevel] = LEVELS["usual"],
        filter_map: OccupancyGrid | None = None,
        seed: int,
        threads: int | None,
    ) -> None:
        own: Any = {"filter_map": filter_map, "seed": seed, "threads": threads}
        self.simulators = [Simulator(grid, level.of(robot), **own) for level in levels]
        first = self.simulators[0]
        self._lines = [first.line(poses_along(path, grid)) for path in paths]
        self._stages = [[each.stage([line]) for line in self._lines] for each in self.simulators]
        lines, lidar = [each.truth for each in self._lines], first.robot.known_lidar
        super().__init__(grid, first.filter_map, lidar, levels, lines, drives, seed, first.threads)
        self._worlds = lru_cache(self.threads)(
            lambda level, path, drive: self._stages[level][path].world(path, drive)
        )
        self.lengths = np.array([path.length for path in paths])

    @staticmethod
    def paths(costs: Costmap, count: int, seed: int) -> list[Path]:
        """Shortest paths of random queries, or parts of them, of 8 to 16 m where the map allows.

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
        for least in (8.0, 4.0, 2.0):  # the first that the map is large enough for
            try:
                queries = random_queries(costs, count, seed, min_distance=least)
                break
            except ConfigError as error:
                fault = str(error).split(";")[0]
        else:
            raise ConfigError(f"{fault}; give a larger map, or a smaller robot")
        random = np.random.default_rng(seed)
        found = (plan(costs, each.start, each.goal).path for each in queries)
        return [_cut(path, random.random()) for path in found if path is not None]

    def arguments(self, amcl: Amcl) -> list[DriveArguments]:
        scores = self.scores(amcl)
        return [
            drive_arguments(each.filter_map, replace(each.robot, filter=amcl), scores=scores)
            for each in self.simulators
        ]

    def errors(self, level: int, path: int, drive: int, arguments: DriveArguments) -> Floats:
        stage = self._stages[level][path]
        world = self.world(level, path, drive)
        return stage.drive(self._lines[path], world, path, drive, arguments)

    def world(self, level: int, path: int, drive: int) -> Octets:
        return self._worlds(level, path, drive)

    def kidnapped(self, amcl: Amcl, metres: float) -> Floats:
        """Errors after two drives along each path, with the odometry that was asked for.

        Parameters
        ----------
        amcl, metres
            See `TuningBench.kidnapped`.
        """
        level = [each.odometry for each in self.levels].index(1.0)
        arguments = self.arguments(amcl)[level]

        def run(some: Ints) -> list[float]:
            found = []
            for path, drive in (divmod(int(n), KIDNAPPED) for n in some):
                line, stage = self._lines[path], self._stages[level][path]
                if (kidnapping := Kidnapping.on(line.truth, metres)) is None:
                    continue
                truth, reported = line.truth[kidnapping.kept], kidnapping.odometry(line.truth)
                carried = Line(reported, line.cells[kidnapping.kept])
                world = stage.world(path, drive)
                errors = stage.drive(carried, world, path, drive, arguments) + reported - truth
                found.append(float(np.hypot(*errors[-1, :2])))
            return found

        return np.array(in_batches(run, KIDNAPPED * len(self.lines), self.threads, batch=1))


def _cut(path: Path, where: float) -> Path:
    """Part of a path as long as a bench drives; `where` it begins is a number in 0..1."""
    spare = path.length - TuningBench.longest
    if spare <= 0:
        return path
    first, last = where * spare, where * spare + TuningBench.longest
    inner = path.distance[(path.distance > first) & (path.distance < last)]
    at = np.concatenate([[first], inner, [last]])
    return Path(np.column_stack([np.interp(at, path.distance, v) for v in path.xy.T]))
