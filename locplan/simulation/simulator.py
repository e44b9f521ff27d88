"""Simulator of robots in worlds that differ from their map: drives with a filter, single scans."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import numpy as np

from locplan._support.checks import check_integer, check_memory, check_positive, check_threads
from locplan._support.intervals import make_generator
from locplan._support.kernels.arrays import Bools, Octets
from locplan._support.poses import Poses
from locplan._support.progress import ProgressCallback
from locplan.field.config import equip_robot
from locplan.maps.environments import boundary_cells, with_boundary_noise
from locplan.maps.grid import OccupancyGrid, check_grid, world_to_map_frame
from locplan.maps.occupancy import OCCUPIED
from locplan.maps.zones import Zones, normalize_zones
from locplan.planning.path import Path
from locplan.robots.robot import Robot
from locplan.simulation.drives import DriveArguments, DrivePoses, make_drive_arguments
from locplan.simulation.levels import Level, find_kink
from locplan.simulation.worlds import (
    MARGIN,
    Window,
    WorldRegion,
    check_filter_map,
    make_window_around,
)

WORLD_STREAM, BEAM_STREAM, CLOSED_LOOP_STREAM = 2, 5, 6
"""Streams of random numbers, see `random_of`; those of closed-loop drives have further numbers."""


class Simulator:
    """Simulator of drives and scans on one map.

    Parameters
    ----------
    grid : OccupancyGrid
        The robot's map.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your robot, such as from `Robot.load`.
    filter_map : OccupancyGrid, optional
        The filter's map, in the frame of `grid`, if it differs, such as a map from before shelves
        were moved. Resolution, origin and size may also differ. Single scans are matched on
        `grid`.
    seed : int, default 1
        Seed of all random numbers, >= 0. Drive n depends on the seed, the route and n only, see
        `locplan.simulation.driver`.
    threads : int, optional
        Number of threads, at least 1; all cores by default. The results do not depend on it.
    stretch : float, default 1.0
        Ratio of the world's lengths to the map's lengths: not 1 if the map's resolution is wrong.
        Open-loop drives only.
    zones : Zones, optional
        The zones: a robot that plans again in a closed-loop drive keeps out of the no-go ones.

    Raises
    ------
    ConfigError
        If seed or threads are out of their range, or the maps do not overlap. Its methods raise it
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
        stretch: float = 1.0,
        zones: Zones | None = None,
    ) -> None:
        check_grid(grid)
        self.filter_map = check_filter_map(filter_map, grid)
        check_integer("seed", seed, 0)
        self.grid, self.seed, self.threads = grid, seed, check_threads(threads)
        self.robot, self.stretch = equip_robot(robot), check_positive("stretch", stretch)
        self.zones = normalize_zones(zones)

    def __repr__(self) -> str:
        return f"Simulator({self.grid.name or 'map'}, {self.robot.title}, seed {self.seed})"

    @cached_property
    def worlds(self) -> list[Octets]:
        """Empty squares of each world for the rays of single scans, which share some worlds.

        A ray crosses a square without walls in one step.
        """
        from locplan._support.kernels.rays import compute_empty_squares

        noise = self.robot.disturbances.boundary_noise
        count = self.robot.disturbances.worlds if noise else 1
        check_memory(f"{count} worlds", 2 * count * self.grid.cells.size, "set fewer worlds")

        def make_world_squares(number: int) -> Octets:
            seed = int(make_generator(self.seed, WORLD_STREAM, number).integers(2**63))
            world = with_boundary_noise(self.grid, noise, seed=seed)
            squares: Octets = compute_empty_squares(world.cells == OCCUPIED)
            return squares

        with ThreadPoolExecutor(self.threads) as pool:
            return list(pool.map(make_world_squares, range(count)))

    def make_drive_poses(self, poses: Poses) -> DrivePoses:
        """Return poses in the axes of both maps, as drives take them.

        Parameters
        ----------
        poses : (n, 3) array
            Poses x, y, heading in the world [m, m, rad].
        """
        x, y, heading = world_to_map_frame(self.grid, poses).T
        resolution = self.grid.resolution
        cells = np.column_stack([y / resolution, x / resolution, heading])
        truth = world_to_map_frame(self.filter_map, poses)
        return DrivePoses(truth, cells, truth)

    def make_level_setups(
        self, path: Path, poses: Poses, level: Level
    ) -> tuple[tuple[DrivePoses, DriveArguments], ...]:
        """Return pairs of line and kernel arguments of a path at a level, for drives in turn.

        Parameters
        ----------
        path : Path
            A path that the level can affect.
        poses : (n, 3) array
            The poses along it in the world [m, m, rad].
        level : Level
            The level of disturbance.
        """
        line = self.make_drive_poses(poses)
        odometry = level.change_odometry(self.robot.odometry).to_kernel_settings()
        kink = find_kink(path, self.grid) if level.kink_deg else None
        if kink is None:
            return ((line, self.arguments._replace(odometry=odometry)),)
        setups = []
        for angle in (math.radians(level.kink_deg), -math.radians(level.kink_deg)):
            kinked = kink.turn_map(self.filter_map, angle)
            truth = world_to_map_frame(kinked, kink.turn_poses(poses, angle))
            arguments = make_drive_arguments(kinked, self.robot)._replace(odometry=odometry)
            setups.append((line._replace(truth=truth), arguments))
        return tuple(setups)

    def make_world_region(self, lines: Sequence[DrivePoses] = ()) -> WorldRegion:
        """The part of the map that drives along some lines need; by default the whole map.

        Parameters
        ----------
        lines : sequence of Line, default ()
            The lines, as `make_drive_poses` gives them.
        """
        window: Window = slice(0, self.grid.shape[0]), slice(0, self.grid.shape[1])
        if lines:
            reach = (self.robot.known_lidar.range + MARGIN) / self.grid.resolution
            cells = np.concatenate([line.cells[:, :2] for line in lines])
            window = make_window_around(self.grid, cells, reach)
        noise = self.robot.disturbances.boundary_noise
        stops, boundary = self.is_occupied[window], self.boundary[window]
        resolution = self.grid.resolution * self.stretch
        return WorldRegion(resolution, window, stops, boundary, noise, self.seed)

    @cached_property
    def is_occupied(self) -> Bools:
        """Occupied cells of the map, (H, W)."""
        return np.asarray(self.grid.cells == OCCUPIED)

    @cached_property
    def boundary(self) -> Bools:
        """Cells in which worlds may differ from the map, (H, W)."""
        return boundary_cells(self.grid)

    @cached_property
    def arguments(self) -> DriveArguments:
        """Arguments of the kernels for the filter's map and the robot."""
        return make_drive_arguments(self.filter_map, self.robot)

    def run_in_threads(
        self,
        run_task: Callable[[int], None],
        n_tasks: int,
        progress: ProgressCallback | None,
        n_steps: int | None = None,
    ) -> None:
        """Run tasks in their order, in the simulator's threads.

        Parameters
        ----------
        run_task : callable
            Called with the number of each task.
        n_tasks : int
            Number of tasks.
        progress : callable or None
            Called with (done, total) steps.
        n_steps : int, optional
            Number of steps that the tasks are reported as; by default one each.
        """
        n_steps = n_steps or n_tasks
        _ = self.arguments, self.is_occupied, self.boundary  # made once, not by every thread
        pool = ThreadPoolExecutor(self.threads)
        try:
            tasks = [pool.submit(run_task, n) for n in range(n_tasks)]
            for n_done, task in enumerate(tasks):
                task.result()
                for step in range(n_done * n_steps // n_tasks, (n_done + 1) * n_steps // n_tasks):
                    if progress:
                        progress(step + 1, n_steps)
        finally:
            pool.shutdown(cancel_futures=True)
