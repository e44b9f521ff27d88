"""Poses along paths, the driven part of a map, and its simulated worlds."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from locplan._support.intervals import make_generator
from locplan._support.kernels.arrays import Bools, Floats, Ints, Octets
from locplan._support.poses import Poses
from locplan.errors import ConfigError, LocplanError
from locplan.maps.grid import OccupancyGrid, check_grid, format_extent
from locplan.planning.path import Path, insert_poses_between
from locplan.robots.parts import Inflation
from locplan.robots.robot import Robot
from locplan.simulation.custom_filters import track_drive
from locplan.simulation.drives import DriveArguments, DrivePoses
from locplan.simulation.levels import Level

POSE_SPACING, MAX_TURN = 0.05, 0.1
"""Maximum distance [m] and turn [rad] between two poses."""
LOOKAHEAD = 0.3
"""Distance ahead on the path to the point that a robot faces if the path has no headings [m]."""


def make_path_poses(path: Path, grid: OccupancyGrid, name: str = "") -> Poses:
    """Return poses every 0.05 m along a path, with its headings or facing 0.3 m ahead.

    Parameters
    ----------
    path : Path
        The path in the world.
    grid : OccupancyGrid
        The map.
    name : str, default ""
        Name of the path in errors.

    Returns
    -------
    (n, 3) array
        Poses x, y, heading in the world [m, m, rad], closer together in turns.

    Raises
    ------
    LocplanError
        If the path has no length, leaves the map, or crosses cells that are not free.
    """
    prefix = f"{name}: " if name else ""
    if path.length <= 0:
        raise LocplanError(f"{prefix}has no length; a path to drive must lead somewhere")
    fine = path.resample(POSE_SPACING, even=True)
    rows, cols = (np.floor(v).astype(np.int64) for v in grid.world_to_grid(*fine.xy.T))
    inside = (rows >= 0) & (rows < grid.shape[0]) & (cols >= 0) & (cols < grid.shape[1])
    free = inside & grid.free[np.where(inside, rows, 0), np.where(inside, cols, 0)]
    if not free.all():
        x, y = fine.xy[np.argmin(free)]
        extent = "" if inside.all() else f", which reaches from {format_extent(grid)},"
        raise LocplanError(
            f"{prefix}leaves the free cells of {grid.name or 'the map'}{extent} at {x:.2f},{y:.2f};"
            " drive a path that was planned on this map"
        )
    if fine.heading is not None:
        return _insert_turns(np.column_stack([fine.xy, fine.heading]))
    return _insert_turns(_make_facing_poses(fine, fine.distance))


def _make_facing_poses(path: Path, path_distances: Floats) -> Poses:
    """Poses at distances along a path, each facing the point `LOOKAHEAD` of it."""
    positions, ahead = (
        np.column_stack([np.interp(distances, path.distance, v) for v in path.xy.T])
        for distances in (path_distances, np.minimum(path_distances + LOOKAHEAD, path.length))
    )
    dx, dy = (ahead - positions).T
    heading = np.arctan2(dy, dx)
    moving = np.flatnonzero(np.hypot(dx, dy) > LOOKAHEAD / 10)
    if moving.size:  # at the end nothing lies ahead: keep the last heading
        last = np.searchsorted(moving, np.arange(len(path_distances)), side="right") - 1
        heading = heading[moving[np.maximum(last, 0)]]
    return np.column_stack([positions, np.unwrap(heading)])


def _insert_turns(poses: Poses) -> Poses:
    """Return poses with further ones inserted in turns by more than `MAX_TURN` at once."""
    return insert_poses_between(poses, np.abs(np.diff(poses[:, 2])) / MAX_TURN)


def add_way_back(poses: Poses) -> Poses:
    """Return poses that lead on to the first one: the robot turns around, and drives back.

    Parameters
    ----------
    poses : (n, 3) array
        Poses x, y, heading [m, m, rad].
    """
    way_back = poses[::-1].copy()
    way_back[:, 2] += math.pi
    return _insert_turns(np.concatenate([poses, way_back]))


DRIVE_STREAM, WORLD_STREAM, FAULT_STREAM = 0, 2, 7
"""Streams of random numbers of drives, of their worlds, and of their levels' faults."""
MARGIN = 2.0
"""Distance beyond the range of the lidar that a part of a map holds [m]."""

Window = tuple[slice, slice]


def make_window_around(grid: OccupancyGrid, cells: Floats, margin: float) -> Window:
    """Rows and columns of a map around positions.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    cells : (n, 2) array
        Row and column of the positions, one at least in the map [cells].
    margin : float
        Distance around them [cells].
    """
    rows, cols = (
        slice(max(0, math.floor(at.min() - margin)), min(size, math.ceil(at.max() + margin)))
        for at, size in zip(cells.T, grid.shape, strict=True)
    )
    return rows, cols


@dataclass(frozen=True)
class WorldRegion:
    """The part of a map that some lines need: the range of the lidar around them, and a margin."""

    resolution: float
    """Edge of a cell [m]."""
    window: Window
    """Rows and columns of the part."""
    stops: Bools
    """Cells that are occupied in the part."""
    boundary: Bools
    """Cells of the part in which worlds may differ from the map."""
    noise: float
    """Share of these cells in which they do."""
    seed: int
    """Seed of all random numbers."""

    def make_world(self, route: int, number: int) -> Octets:
        """Return the empty squares of a drive's world, see
        `locplan._support.kernels.rays.compute_empty_squares`.

        Parameters
        ----------
        route, number : int
            The key of the route, see `locplan.simulation.driver.compute_route_key`, and the drive's
            number.
        """
        from locplan._support.kernels.rays import compute_empty_squares

        squares: Octets = compute_empty_squares(self.find_occupied_cells(route, number))
        return squares

    def find_occupied_cells(self, route: int, number: int) -> Bools:
        """Return the cells of the part that are occupied in a drive's world.

        They equal the cells of the whole map's world, whatever the part is.

        Parameters
        ----------
        route, number : int
            See `make_world`.
        """
        from locplan.simulation.kernels.worlds import flip_cells

        stops = self.stops.copy()
        if self.noise:
            seed = make_generator(self.seed, WORLD_STREAM, route, number).bit_generator.random_raw()
            first = self.window[0].start, self.window[1].start
            flip_cells(stops, self._boundary_cells, *first, self.noise, np.uint64(seed))
        return stops

    @cached_property
    def _boundary_cells(self) -> Ints:
        """Row and column of the boundary's cells in the part, (n, 2)."""
        return np.argwhere(self.boundary)

    def drive(
        self,
        line: DrivePoses,
        world: Octets,
        route: int,
        number: int,
        arguments: DriveArguments,
        level: Level,
    ) -> Floats:
        """Return the filter's errors on a drive, (n, 3) in the axes of its map [m, m, rad].

        Parameters
        ----------
        line : Line
            The poses.
        world : array
            The world of this drive, from `make_world`.
        route, number : int
            See `make_world`.
        arguments : DriveArguments
            Arguments of the kernel.
        level : Level
            The level of disturbance. Its faults have separate random numbers, so that errors of
            odometry are the same at all levels.
        """
        from locplan._support.kernels.drives import DrivenWorld, simulate_drive, simulate_odometry

        cells = line.cells - [self.window[0].start, self.window[1].start, 0.0]
        errors = np.empty_like(line.truth)
        random = make_generator(self.seed, DRIVE_STREAM, route, number)
        reported = simulate_odometry(random, line.ideal_odometry, arguments.odometry)
        faults = make_generator(self.seed, FAULT_STREAM, route, number)
        reported = level.disturb_odometry(reported, line.ideal_odometry, faults)
        follow: Any = track_drive if arguments.scores is None else simulate_drive
        follow(
            random,
            line.truth,
            reported,
            DrivenWorld(world, self.resolution, cells),
            arguments.scores,
            arguments.lidar,
            arguments.disturbances,
            arguments.start,
            arguments.filter,
            errors,
        )
        return errors


def get_inflation(robot: Robot) -> Inflation:
    """Return the robot's inflation, or the inflation of Nav2's bringup.

    Parameters
    ----------
    robot : Robot
        The robot.
    """
    return robot.inflation or Inflation(inflation_radius=0.7, cost_scaling_factor=3.0)


def compute_inflated_density(clearance: Floats, robot: Robot) -> Floats:
    """Density that Nav2's planners see in an inflated costmap: 50 to 252, over 50.

    Parameters
    ----------
    clearance : array
        Distance from walls [m].
    robot : Robot
        The robot.
    """
    inflation = get_inflation(robot)
    cost = 4 * np.exp(-inflation.cost_scaling_factor * (clearance - robot.radius))
    return 1 + np.where(clearance <= inflation.inflation_radius, np.minimum(cost, 4), 0)


def rotate_errors(errors: Floats, yaw: float) -> Floats:
    """Return errors (..., 3) turned from the map's axes into the world's axes."""
    if not yaw:
        return errors
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y = errors[..., 0], errors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y, errors[..., 2]], axis=-1)


def check_filter_map(filter_map: OccupancyGrid | None, grid: OccupancyGrid) -> OccupancyGrid:
    """Return the filter's map, by default the map that is driven in.

    Parameters
    ----------
    filter_map : OccupancyGrid or None
        The filter's map, in the same frame.
    grid : OccupancyGrid
        The map that is driven in.

    Raises
    ------
    ConfigError
        If no free cell of the map lies on the filter's.
    """
    if filter_map is None:
        return grid
    check_grid(filter_map)
    rows, cols = np.nonzero(grid.free)
    at = filter_map.world_to_grid(*grid.grid_to_world(rows + 0.5, cols + 0.5))
    on_both = [
        (coordinates >= 0) & (coordinates < size)
        for coordinates, size in zip(at, filter_map.shape, strict=True)
    ]
    if not np.logical_and(*on_both).any():
        raise ConfigError(
            f"the filter's map ({filter_map.name or 'filter_map'}) and {grid.name or 'the map'} do"
            " not overlap; both must be in the same frame"
        )
    return filter_map


def summarize_filter_map(filter_map: OccupancyGrid | None) -> dict[str, object]:
    """Return the summary of a separate filter map, fit for JSON; empty without one.

    Parameters
    ----------
    filter_map : OccupancyGrid or None
        The filter's map, if it differs from the driven map.
    """
    if filter_map is None:
        return {}
    return {"filter_map": {"name": filter_map.name, "digest": filter_map.digest}}


def check_single_map(filter_map: OccupancyGrid | None, grids: Collection[object]) -> None:
    """Raise a ConfigError if a filter's map is given for several maps.

    Parameters
    ----------
    filter_map : OccupancyGrid or None
        The filter's map.
    grids : collection
        The maps that are driven in.
    """
    if filter_map is not None and len(grids) > 1:
        raise ConfigError(f"a filter's map is of one map, not of {len(grids)}; name the one")
