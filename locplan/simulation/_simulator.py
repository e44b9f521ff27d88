"""Simulator of robots in worlds that differ from their map: drives with a filter, single scans."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import whole
from locplan._util.machine import check_memory, check_threads
from locplan._util.poses import Poses
from locplan._util.progress import ProgressCallback
from locplan._util.random_streams import random_of
from locplan.field import equipped
from locplan.maps import OCCUPIED, OccupancyGrid, check_grid
from locplan.maps.environments import with_boundary_noise
from locplan.robots import Robot
from locplan.simulation._arguments import DriveArguments, drive_arguments
from locplan.simulation._drives import Drives

MATCH_WINDOW = 2.0
"""Half width of the window in which single scans are matched [m]."""
MATCH_STEP = 0.05
"""Spacing of the window's offsets [m], rounded to whole cells."""
MATCH_ROTATIONS = 61
"""Number of headings in the window, over 120 deg."""
MATCH_SIGMA, MATCH_Z_RAND = 0.1, 0.05
"""Parameters sigma_hit [m] and z_rand of the likelihood field on which scans are matched."""


ARRAYS = 4
"""Number of arrays of all poses that are in memory at once."""
DRIVE, MATCH, WORLD, POINTS, APPROACH, BEAMS = range(6)
"""Streams of random numbers, see `random_of`."""


class Simulator:
    """Simulator of drives and scans on one map.

    Parameters
    ----------
    grid : OccupancyGrid
        The robot's map. Worlds are made of it with `Disturbances.boundary_noise`.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your own, such as `Robot.from_nav2` reads.
    seed : int, default 1
        Seed of all random numbers, >= 0. Drive n has the same ones whatever else is driven.
    threads : int, optional
        Number of threads, at least 1; all cores by default. The results do not depend on it.

    Raises
    ------
    ConfigError
        If seed or threads are out of their range; in its methods, too, if worlds, drives or scans
        take more memory than there is.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        robot: Robot | None = None,
        *,
        seed: int = 1,
        threads: int | None = None,
    ) -> None:
        check_grid(grid)
        whole("seed", seed, 0)
        self.grid, self.seed, self.threads = grid, seed, check_threads(threads)
        self.robot = equipped(robot)
        worlds = self.robot.disturbances.worlds
        check_memory(f"{worlds} worlds", 2 * worlds * grid.cells.size, "set fewer worlds")

    def __repr__(self) -> str:
        return f"Simulator({self.grid.name or 'map'}, {self.robot.title}, seed {self.seed})"

    @cached_property
    def worlds(self) -> list[NDArray[np.uint8]]:
        """Empty squares of each world for its rays, see `locplan._kernels.rays.empty_squares`."""
        from locplan._kernels.rays import empty_squares

        noise = self.robot.disturbances.boundary_noise
        count = self.robot.disturbances.worlds if noise else 1

        def make(number: int) -> NDArray[np.uint8]:
            world = with_boundary_noise(self.grid, noise, seed=self._world_seed(number))
            squares: NDArray[np.uint8] = empty_squares(world.cells == OCCUPIED)
            return squares

        with ThreadPoolExecutor(self.threads) as pool:
            return list(pool.map(make, range(count)))

    def drive(
        self,
        lines: Sequence[Poses],
        *,
        stream: int = 0,
        progress: ProgressCallback | None = None,
    ) -> NDArray[np.float64]:
        """Drive each line once; all lines have the same number of poses.

        Parameters
        ----------
        lines : sequence of (n, 3) arrays
            True poses x, y, heading in the world [m, m, rad], about 0.05 m apart; the lines take
            the worlds in turn.
        stream : int, default 0
            Number of the stream of random numbers; different streams are independent.
        progress : callable, optional
            Called with (done, total) drives.

        Returns
        -------
        (lines, n, 3) array
            The filter's pose minus the true one, in the world [m, m, rad].
        """
        size = len(lines) * lines[0].size * ARRAYS * 8
        check_memory(f"{len(lines)} drives of {len(lines[0])} poses", size, "drive fewer")
        own = [self.on_grid(line) for line in lines]
        errors = np.empty((len(own), *own[0].shape))

        def run(n: int) -> None:
            self._drive(own[n], stream, n, errors[n])

        self._in_threads(run, len(own), progress)
        return _turned(errors, self.grid.origin[2])

    def drive_together(
        self,
        lines: Sequence[Poses],
        drives: int,
        *,
        stream: int = 0,
        enough: Callable[[list[NDArray[np.float64]]], bool] | None = None,
        progress: ProgressCallback | None = None,
    ) -> list[NDArray[np.float64]]:
        """Drive all lines once, then all of them once more, and so on.

        Parameters
        ----------
        lines : sequence of (n, 3) arrays
            True poses of each line in the world [m, m, rad].
        drives : int
            Greatest number of drives of each line; the n-th of all have the same world and seed.
        stream : int, default 0
            Number of the stream of random numbers.
        enough : callable, optional
            Called with what is returned after each round of drives; True ends them.
        progress : callable, optional
            Called with (done, total) drives.

        Returns
        -------
        list of (drives, n, 3) arrays
            Errors of each line as `drive` gives them.
        """
        size = drives * sum(line.size for line in lines) * ARRAYS * 8
        check_memory(f"{drives} drives of {len(lines)} lines", size, "drive fewer")
        errors = [np.empty((drives, *line.shape)) for line in lines]
        own = [self.on_grid(line) for line in lines]

        def run(task: int) -> None:
            drive, line = divmod(task, len(own))
            self._drive(own[line], stream, drive, errors[line][drive])

        def turned(rounds: int) -> list[NDArray[np.float64]]:
            return [_turned(each[:rounds], self.grid.origin[2]) for each in errors]

        def ends(done: int) -> bool:
            rounds, rest = divmod(done, len(own))
            return enough is not None and not rest and enough(turned(rounds))

        done = self._in_threads(run, drives * len(own), progress, ends)
        return turned(done // len(own))

    def _drive(self, line: Poses, stream: int, number: int, errors: NDArray[np.float64]) -> None:
        """Drive a line in the map's own axes, in the world and with the seed of this number."""
        from locplan._kernels.drives import drive

        world = self.worlds[number % len(self.worlds)]
        drive(random_of(self.seed, DRIVE, stream, number), line, world, *self.arguments, errors)

    def drive_along(
        self,
        poses: Poses,
        drives: int,
        *,
        stream: int = 0,
        progress: ProgressCallback | None = None,
    ) -> Drives:
        """Drive one line several times.

        Parameters
        ----------
        poses : (n, 3) array
            True poses x, y, heading in the world [m, m, rad].
        drives : int
            Number of drives, at least 1.
        stream, progress
            See `Simulator.drive`.
        """
        return Drives(poses, self.drive([poses] * drives, stream=stream, progress=progress))

    def match(
        self,
        cells: NDArray[np.int64],
        scans: int,
        *,
        progress: ProgressCallback | None = None,
    ) -> NDArray[np.float64]:
        """Match single scans on the map, by correlation over a window of +-2 m and +-60 deg.

        AMCL's number of beams of each scan is compared, on a likelihood field for matching alone.

        Parameters
        ----------
        cells : (n, 2) array
            Row and column of each place; the robot stands and heads anywhere in the cell.
        scans : int
            Number of scans at each place.
        progress : callable, optional
            Called with (done, total) places.

        Returns
        -------
        (n, scans, 3) array
            The most likely pose minus the true one, in the world [m, m, rad]. Offsets are whole
            cells, about 0.05 m apart, and headings 2 deg apart.
        """
        from locplan._kernels.matches import match
        from locplan._kernels.offsets import make_lattice
        from locplan.field import likelihood_field

        resolution = self.grid.resolution
        step = max(1, round(MATCH_STEP / resolution))
        half_steps = round(MATCH_WINDOW / (step * resolution))
        field = likelihood_field(
            self.grid.cells,
            resolution,
            step,
            half_steps,
            sigma_hit=MATCH_SIGMA,
            z_rand=MATCH_Z_RAND,
        )
        angles = np.linspace(-np.pi / 3, np.pi / 3, MATCH_ROTATIONS)
        lattice = make_lattice(half_steps, angles)
        size = len(cells) * scans * 3 * ARRAYS * 8
        check_memory(f"{scans} scans at each of {len(cells)} places", size, "set fewer scans")
        errors = np.empty((len(cells), scans, 3))

        def run(n: int) -> None:
            random = random_of(self.seed, MATCH, n)
            for scan in range(scans):
                match(
                    random,
                    field,
                    lattice,
                    angles,
                    self.worlds[scan % len(self.worlds)],
                    resolution,
                    int(cells[n, 0]),
                    int(cells[n, 1]),
                    self.arguments.lidar,
                    self.arguments.disturbances,
                    errors[n, scan : scan + 1],
                )

        self._in_threads(run, len(cells), progress)
        errors[..., :2] *= resolution
        return _turned(errors, self.grid.origin[2])

    def on_grid(self, poses: Poses) -> Poses:
        """Poses in the map's own axes, from its origin on, (n, 3) [m, m, rad].

        Parameters
        ----------
        poses : (n, 3) array
            Poses x, y, heading in the world [m, m, rad].
        """
        rows, cols = self.grid.world_to_grid(*poses[:, :2].T)
        heading = poses[:, 2] - self.grid.origin[2]
        return np.column_stack([cols * self.grid.resolution, rows * self.grid.resolution, heading])

    def _world_seed(self, world: int) -> int:
        return int(random_of(self.seed, WORLD, world).integers(2**63))

    @cached_property
    def arguments(self) -> DriveArguments:
        """Arguments of the kernels for the map and the robot."""
        return drive_arguments(self.grid, self.robot)

    def _in_threads(
        self,
        run: Callable[[int], None],
        count: int,
        progress: ProgressCallback | None,
        ends: Callable[[int], bool] = lambda done: False,
    ) -> int:
        """Run tasks in their order until `ends` is true of the number done, which is returned."""
        _ = self.worlds, self.arguments  # made once, not by every thread
        pool = ThreadPoolExecutor(self.threads)
        try:
            tasks = [pool.submit(run, n) for n in range(count)]
            for done, task in enumerate(tasks, 1):
                task.result()
                if progress:
                    progress(done, count)
                if ends(done):
                    return done
        finally:
            pool.shutdown(cancel_futures=True)
        return count


def _turned(errors: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Errors turned from the map's own axes into the world's."""
    if not yaw:
        return errors
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y = errors[..., 0], errors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y, errors[..., 2]], axis=-1)
