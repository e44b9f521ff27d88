"""Drives of many settings of AMCL along the same paths, in the same worlds, with the same seeds."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan._util.checks import FARTHEST
from locplan._util.poses import Poses, updates_of, way_length
from locplan._util.progress import ProgressCallback
from locplan.maps import OccupancyGrid
from locplan.robots import Amcl, Lidar, Robot, score_values
from locplan.simulation._drives import FLOOR, LOST, OFF, Drives


@dataclass(frozen=True)
class DisturbanceLevel:
    """A level of disturbance, relative to the one that was asked for."""

    name: str
    """The name, such as x3."""
    odometry: float
    """Factor on the drift and the bias of odometry."""
    clutter: float
    """Factor on the shares of outliers, of occluded scans and of cells that differ."""

    def of(self, robot: Robot) -> Robot:
        """The robot at this level.

        Parameters
        ----------
        robot : Robot
            The robot, with the odometry and the disturbances that were asked for.
        """
        odometry = asdict(robot.odometry)
        changes = {name: value * self.odometry for name, value in odometry.items()}
        for name in ("boundary_noise", "outliers", "occlusion"):
            share = getattr(robot.disturbances, name)
            # At most half of everything is disturbed, unless more was asked for.
            changes[name] = min(share * self.clutter, max(share, 0.5))
        return robot.changed(changes)

    def to_json(self) -> str:
        """The name, which files have for it."""
        return self.name


@dataclass(frozen=True, eq=False)
class Driven:
    """What came of the drives of one setting: (levels, paths, drives), NaN where not driven."""

    squares: Floats
    """Mean square of each drive's position error [m^2]."""
    lost: Floats
    """1 for each drive that was off by more than 1 m at some time, else 0."""
    off: Floats
    """1 for each drive that was off by more than 0.5 m at the end, else 0."""
    seconds: Floats
    """CPU time of each drive [s]."""
    errors: dict[tuple[int, int, int], NDArray[np.float32]]
    """Position error [m] at every eighth pose, by level, path and drive."""

    @property
    def scores(self) -> Floats:
        """Logarithm of each drive's root mean square error, and 1 more if it was lost."""
        return np.asarray(0.5 * np.log(self.squares + FLOOR) + self.lost)


@dataclass(eq=False, repr=False)
class TuningBench(ABC):
    """Drives of settings at some levels of disturbance; what was driven once is remembered."""

    grid: OccupancyGrid
    """The map that is driven in."""
    filter_map: OccupancyGrid
    """The filter's map."""
    lidar: Lidar
    """The robot's lidar."""
    levels: Sequence[DisturbanceLevel]
    """The levels of disturbance; most settings are worst at the last one."""
    lines: Sequence[Poses]
    """The poses along each path, (n, 3), in the own axes of the filter's map [m, m, rad]."""
    drives: int
    """Maximum number of drives along each path, at each level."""
    seed: int
    """Seed of all random numbers; all settings have the same."""
    threads: int
    """Number of threads."""

    longest: ClassVar[float] = 16.0
    """Length of a path beyond which settings are driven along a part of it [m]."""
    fewest_paths: ClassVar[int] = 5
    """Minimum number of paths, for intervals."""
    at_once: ClassVar[int] = 8
    """Number of settings that drive at once: each may hold scores as large as the map."""

    grids: tuple[OccupancyGrid, ...] = field(init=False)
    """The maps, of which `grid` is the first."""
    parts: Sequence[str] = field(init=False)
    """Names of the benches that are joined in this one; an empty one if it is one."""

    def __post_init__(self) -> None:
        self.lengths = np.array([way_length(each) for each in self.lines])
        self.driven: dict[Amcl, Driven] = {}
        self.grids, self.parts = (self.grid,), ("",)
        # Nearly every setting is worst there; other levels are driven where they can matter.
        self.strongest = [len(self.levels) - 1]
        self._shape = len(self.levels), len(self.lines), self.drives
        # As many as drive at once: each may be as large as the map.
        self._scores = lru_cache(self.at_once)(
            lambda amcl: score_values(self.filter_map, amcl, self.lidar)
        )

    @abstractmethod
    def arguments(self, amcl: Amcl) -> list[Any]:
        """What `errors` needs of a setting at each level; it is made once for all drives.

        Parameters
        ----------
        amcl : Amcl
            The setting.
        """

    @abstractmethod
    def errors(self, level: int, path: int, drive: int, arguments: Any) -> Floats:
        """Errors (n, 3) of one drive along a path [m, m, rad].

        Parameters
        ----------
        level, path, drive : int
            Indices of the level, the path and the drive.
        arguments : object
            What `arguments` gave for the level.
        """

    def world(self, level: int, path: int, drive: int) -> Any:
        """The world of a drive, which `errors` makes but once for settings in turn.

        Parameters
        ----------
        level, path, drive : int
            Indices of the level, the path and the drive.
        """
        return None

    def whole(self, amcl: Amcl) -> list[Drives]:
        """Replays of all of each recorded drive from its beginning; none of simulated paths.

        Parameters
        ----------
        amcl : Amcl
            The setting.
        """
        return []

    def kidnapped(self, amcl: Amcl, metres: float) -> Floats:
        """Position errors 10 m after kidnappings, (n,) [m]; none of a bench that has no worlds.

        Parameters
        ----------
        amcl : Amcl
            The setting.
        metres : float
            Distance by which the robot is kidnapped [m].
        """
        return np.empty(0)

    def scores(self, amcl: Amcl) -> NDArray[np.float32]:
        """Scores of beams on the map, which many settings share, for `drive_arguments`.

        Parameters
        ----------
        amcl : Amcl
            The setting.
        """
        names = ("laser_model_type", "laser_likelihood_max_dist", "sigma_hit", "z_hit", "z_rand")
        read = {name: getattr(amcl, name) for name in (*names, "laser_max_range")}
        return self._scores(replace(Amcl(), **read))

    def drive(
        self,
        settings: Sequence[Amcl],
        paths: int,
        drives: int,
        levels: Sequence[int] | None = None,
        progress: ProgressCallback | None = None,
    ) -> None:
        """Drive each setting along the first of the paths, so often each, at some levels or all.

        Parameters
        ----------
        settings : sequence of Amcl
            The settings.
        paths, drives : int
            Number of paths, and of drives along each.
        levels : sequence of int, optional
            Indices of the levels; all by default.
        progress : callable, optional
            Called with (done, total) drives.
        """
        pending = []
        left_out = [n for n in range(len(self.levels)) if levels is not None and n not in levels]
        for amcl in dict.fromkeys(settings):
            if amcl not in self.driven:
                squares, lost, off, seconds = (np.full(self._shape, np.nan) for _ in range(4))
                self.driven[amcl] = Driven(squares, lost, off, seconds, {})
            missing = np.isnan(self.driven[amcl].squares[:, :paths, :drives])
            missing[left_out] = False
            if missing.any():
                pending.append((amcl, missing))
        total, done = sum(int(missing.sum()) for _, missing in pending), 0
        pool = ThreadPoolExecutor(self.threads)
        try:
            for first in range(0, len(pending), self.at_once):
                some = [
                    (amcl, missing, self.arguments(amcl))
                    for amcl, missing in pending[first : first + self.at_once]
                ]
                tasks = []
                for level, path, n in np.argwhere(np.any([each[1] for each in some], 0)).tolist():
                    at = level, path, n
                    own = [
                        (self.driven[a], args[level]) for a, missing, args in some if missing[at]
                    ]
                    tasks.append(pool.submit(self._run, at, own))
                for finished in as_completed(tasks):
                    done += finished.result()
                    if progress:
                        progress(done, total)
        finally:
            pool.shutdown(cancel_futures=True)

    def means(self, amcl: Amcl, paths: int, drives: int) -> Floats:
        """Mean score of the drives, (levels,); NaN at levels that were not driven.

        Parameters
        ----------
        amcl : Amcl
            The setting.
        paths, drives : int
            Number of the paths, and of the drives along each, that count.
        """
        return np.asarray(self.driven[amcl].scores[:, :paths, :drives].mean(axis=(1, 2)))

    def updates(self, amcl: Amcl) -> float:
        """Updates of the filter in one drive along every path, without errors of odometry.

        Parameters
        ----------
        amcl : Amcl
            The setting.
        """
        least = amcl.update_min_d, amcl.update_min_a
        return sum(len(updates_of(line, *least)) for line in self.lines)

    def _run(self, at: tuple[int, int, int], settings: Sequence[tuple[Driven, Any]]) -> int:
        """Drive some settings once at a level, along a path; it returns their number."""
        self.world(*at)  # not in the time of the first of them
        for into, arguments in settings:
            started = time.thread_time()
            errors = self.errors(*at, arguments)
            into.seconds[at] = time.thread_time() - started
            position = np.nan_to_num(np.hypot(errors[:, 0], errors[:, 1]), nan=FARTHEST)
            into.lost[at] = position.max() > LOST
            into.off[at] = position[-1] > OFF
            into.squares[at] = (position**2).mean()
            into.errors[at] = position[::8].astype(np.float32)
        return len(settings)
