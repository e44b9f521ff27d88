"""Simulator of robots in worlds that differ from their map: drives with a filter, single scans."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Octets
from locplan._util.checks import check_memory, check_threads, whole
from locplan._util.intervals import random_of
from locplan._util.poses import Poses
from locplan._util.progress import ProgressCallback
from locplan.field import equipped
from locplan.maps import OCCUPIED, OccupancyGrid, check_grid, own_axes
from locplan.maps.environments import boundary_cells, with_boundary_noise
from locplan.robots import Robot
from locplan.simulation._drives import DriveArguments, Drives, Line, drive_arguments
from locplan.simulation._worlds import MARGIN, Stage, Window, check_filter_map, turned, window_about

ARRAYS = 4
"""Number of arrays of all poses that are in memory at once."""
DRIVE, WORLD, BEAMS, CLOSED = 0, 2, 5, 6
"""Streams of random numbers, see `random_of`; drives and their worlds have further numbers."""


class Simulator:
    """Simulator of drives and scans on one map.

    Parameters
    ----------
    grid : OccupancyGrid
        The robot's map.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your own, such as `Robot.from_nav2` reads.
    filter_map : OccupancyGrid, optional
        The filter's map in the same frame, where it differs, as one does that was made before
        something was moved. Its resolution, origin and size may differ, too. Single scans are
        matched on `grid`.
    seed : int, default 1
        Seed of all random numbers, >= 0. Drive n has the same ones on all lines that are driven
        together. In the open loop its world is that of the part of the map around these lines, in
        the closed loop that of the whole map, for a lost robot may drive anywhere.
    threads : int, optional
        Number of threads, at least 1; all cores by default. The results do not depend on it.

    Raises
    ------
    ConfigError
        If seed or threads are out of their range, or the maps do not overlap; in its methods, too,
        if worlds, drives or scans take more memory than there is.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        robot: Robot | None = None,
        *,
        filter_map: OccupancyGrid | None = None,
        seed: int = 1,
        threads: int | None = None,
    ) -> None:
        check_grid(grid)
        self.filter_map = check_filter_map(filter_map, grid)
        whole("seed", seed, 0)
        self.grid, self.seed, self.threads = grid, seed, check_threads(threads)
        self.robot = equipped(robot)

    def __repr__(self) -> str:
        return f"Simulator({self.grid.name or 'map'}, {self.robot.title}, seed {self.seed})"

    @cached_property
    def worlds(self) -> list[Octets]:
        """Empty squares of each world for the rays of single scans, which share some worlds.

        See `locplan._kernels.rays.empty_squares`.
        """
        from locplan._kernels.rays import empty_squares

        noise = self.robot.disturbances.boundary_noise
        count = self.robot.disturbances.worlds if noise else 1
        check_memory(f"{count} worlds", 2 * count * self.grid.cells.size, "set fewer worlds")

        def make(number: int) -> Octets:
            seed = int(random_of(self.seed, WORLD, number).integers(2**63))
            world = with_boundary_noise(self.grid, noise, seed=seed)
            squares: Octets = empty_squares(world.cells == OCCUPIED)
            return squares

        with ThreadPoolExecutor(self.threads) as pool:
            return list(pool.map(make, range(count)))

    def drive(
        self, lines: Sequence[Poses], *, stream: int = 0, progress: ProgressCallback | None = None
    ) -> Floats:
        """Drive each line once, in a world of its own; all have the same number of poses.

        Parameters
        ----------
        lines : sequence of (n, 3) arrays
            True poses x, y, heading in the world [m, m, rad], about 0.05 m apart.
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
        own = [self.line(poses) for poses in lines]
        errors = np.empty((len(own), *lines[0].shape))

        def run(n: int) -> None:
            stage = self.stage(own[n : n + 1])
            errors[n] = stage.drive(own[n], stage.world(stream, n), stream, n, self.arguments)

        self.in_threads(run, len(own), progress)
        return turned(errors, self.filter_map.origin[2])

    def drive_together(
        self,
        lines: Sequence[Poses],
        drives: int | range,
        *,
        stream: int = 0,
        progress: ProgressCallback | None = None,
    ) -> list[Floats]:
        """Drive each line several times; the n-th drives of all have one world and one seed.

        Parameters
        ----------
        lines : sequence of (n, 3) arrays
            True poses of each line in the world [m, m, rad].
        drives : int or range
            Number of drives of each line, or the numbers of the drives.
        stream : int, default 0
            Number of the stream of random numbers.
        progress : callable, optional
            Called with (done, total) drives.

        Returns
        -------
        list of (drives, n, 3) arrays
            Errors of each line as `drive` gives them.
        """
        numbers = range(drives) if isinstance(drives, int) else drives
        size = len(numbers) * sum(line.size for line in lines) * ARRAYS * 8
        check_memory(f"{len(numbers)} drives of {len(lines)} lines", size, "drive fewer")
        errors = [np.empty((len(numbers), *line.shape)) for line in lines]
        own = [self.line(poses) for poses in lines]
        stage = self.stage(own)

        # A task makes a world for its lines: they are split where drives are fewer than threads.
        parts = min(len(own), math.ceil(self.threads / max(1, len(numbers))))

        def run(task: int) -> None:
            n, part = divmod(task, parts)
            world = stage.world(stream, numbers[n])
            for line, made in zip(own[part::parts], errors[part::parts], strict=True):
                made[n] = stage.drive(line, world, stream, numbers[n], self.arguments)

        steps = len(numbers) * len(own)
        self.in_threads(run, len(numbers) * parts, progress, steps)
        return [turned(each, self.filter_map.origin[2]) for each in errors]

    def line(self, poses: Poses) -> Line:
        """Poses in the own axes of both maps, as drives take them.

        Parameters
        ----------
        poses : (n, 3) array
            Poses x, y, heading in the world [m, m, rad].
        """
        x, y, heading = own_axes(self.grid, poses).T
        resolution = self.grid.resolution
        cells = np.column_stack([y / resolution, x / resolution, heading])
        return Line(own_axes(self.filter_map, poses), cells)

    def stage(self, lines: Sequence[Line] = ()) -> Stage:
        """The part of the map that drives along some lines need; by default the whole map.

        Parameters
        ----------
        lines : sequence of Line, default ()
            The lines, as `line` gives them.
        """
        window: Window = slice(0, self.grid.shape[0]), slice(0, self.grid.shape[1])
        if lines:
            reach = (self.robot.known_lidar.range + MARGIN) / self.grid.resolution
            cells = np.concatenate([line.cells[:, :2] for line in lines])
            window = window_about(self.grid, cells, reach)
        stops, boundary = self.grid.cells[window] == OCCUPIED, self.boundary[window]
        noise = self.robot.disturbances.boundary_noise
        return Stage(self.grid.resolution, window, stops, boundary, noise, self.seed)

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
        errors = self.drive_together([poses], drives, stream=stream, progress=progress)
        return Drives(poses, errors[0])

    @cached_property
    def boundary(self) -> Bools:
        """Cells in which worlds may differ from the map, (H, W)."""
        return boundary_cells(self.grid)

    @cached_property
    def arguments(self) -> DriveArguments:
        """Arguments of the kernels for the filter's map and the robot."""
        return drive_arguments(self.filter_map, self.robot)

    def in_threads(
        self,
        run: Callable[[int], None],
        count: int,
        progress: ProgressCallback | None,
        steps: int | None = None,
    ) -> None:
        """Run tasks in their order, in the simulator's threads.

        Parameters
        ----------
        run : callable
            Called with the number of each task.
        count : int
            Number of tasks.
        progress : callable or None
            Called with (done, total) steps.
        steps : int, optional
            Number of steps that the tasks are reported as; by default one each.
        """
        steps = steps or count
        _ = self.arguments, self.boundary  # made once, not by every thread
        pool = ThreadPoolExecutor(self.threads)
        try:
            tasks = [pool.submit(run, n) for n in range(count)]
            for done, task in enumerate(tasks):
                task.result()
                for step in range(done * steps // count, (done + 1) * steps // count):
                    if progress:
                        progress(step + 1, steps)
        finally:
            pool.shutdown(cancel_futures=True)
