"""Cases of tuning on maps: random shortest paths in simulated worlds, at levels of disturbance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.maps import OccupancyGrid
from locplan.planners import plan, random_queries
from locplan.robots import Amcl, Robot
from locplan.simulation._simulator import Simulator
from locplan.simulation._worlds import poses_along
from locplan.simulation.driver import drive_open
from locplan.simulation.tuning._bench import Case
from locplan.simulation.verdict import DriveSet

LONGEST = 16.0
"""Length of a path beyond which settings are driven along a part of it [m]."""


@dataclass(frozen=True)
class DisturbanceLevel:
    """A level of disturbance, relative to that of the robot."""

    name: str
    """The name, such as x3."""
    odometry: float
    """Factor on the drift and the bias of odometry."""
    clutter: float
    """Factor on the shares of outliers, of occluded scans and of cells that differ."""

    def apply_to(self, robot: Robot) -> Robot:
        """Return the robot at this level.

        Parameters
        ----------
        robot : Robot
            The robot with its own odometry and disturbances.
        """
        odometry = asdict(robot.odometry)
        changes = {name: value * self.odometry for name, value in odometry.items()}
        for name in ("boundary_noise", "outliers", "occlusion"):
            share = getattr(robot.disturbances, name)
            # At most half of everything is disturbed, unless the robot's own share is larger.
            changes[name] = min(share * self.clutter, max(share, 0.5))
        return robot.changed(changes)


USUAL, STRONG = DisturbanceLevel("usual", 1.0, 1.0), DisturbanceLevel("x3", 3.0, 2.0)
"""The level at which drives decide, and the one at which they may only contradict."""


def plan_random_paths(costs: Costmap, count: int, seed: int) -> list[Path]:
    """Return shortest paths of random queries, or parts of them, of 8 to 16 m if the map is large.

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
    paths = (plan(costs, query.start, query.goal).path for query in queries)
    return [_cut(path, random.random()) for path in paths if path is not None]


def simulated_cases(
    grid: OccupancyGrid,
    robot: Robot,
    paths: Sequence[Path],
    *,
    filter_map: OccupancyGrid | None,
    label: str,
    seed: int,
    threads: int | None,
) -> list[Case]:
    """Return a case for each level of disturbance.

    Parameters
    ----------
    grid, robot, filter_map, seed, threads
        See `Simulator`; the robot's filter is replaced by the settings that drive.
    paths : sequence of Path
        The paths.
    label : str
        Name of the map before that of the level; empty for a single map.
    """
    named = {f"{n}": path for n, path in enumerate(paths, 1)}
    lines = [poses_along(path, grid) for path in paths]

    def case_at(level: DisturbanceLevel) -> Case:
        at_level = level.apply_to(robot)

        def drive(amcl: Amcl, numbers: range) -> DriveSet:
            simulator = Simulator(
                grid,
                replace(at_level, filter=amcl),
                filter_map=filter_map,
                seed=seed,
                threads=threads,
            )
            return DriveSet.from_drives(drive_open(simulator, named, numbers).values())

        return Case(f"{label} {level.name}".strip(), lines, drive, decides=level is USUAL)

    return [case_at(USUAL), case_at(STRONG)]


def _cut(path: Path, where: float) -> Path:
    """Return a part of a path that is not too long; it begins at `where` of the rest, 0..1."""
    spare = path.length - LONGEST
    if spare <= 0:
        return path
    first, last = where * spare, where * spare + LONGEST
    inner = path.distance[(path.distance > first) & (path.distance < last)]
    at = np.concatenate([[first], inner, [last]])
    return Path(np.column_stack([np.interp(at, path.distance, values) for values in path.xy.T]))
