"""What a robot sees at its poses, and the models of its filter, as the kernels take them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.machine import check_memory
from locplan._util.poses import Poses
from locplan.costs import Path
from locplan.errors import LocplanError
from locplan.field import surface_normals
from locplan.landmarks._objects import Shape
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.robots import OMNIDIRECTIONAL, Amcl, Robot
from locplan.simulation import poses_along

SIGMA = 2.0
"""Standard deviation of what a beam tells, in times of the filter's own sigma_hit [1].

Beams err alike, so that each tells less than by itself: 0.4 m, with the default 0.2 m, ranks
placements best by the errors of simulated drives.
"""
MIN_STEP, MAX_STEP = 0.1, 0.5
"""Least and greatest distance between two looks around [m]; else it is that of two updates."""
MIN_RAYS, MAX_RAYS = 360, 2880
"""Least and greatest number of rays in a full circle."""
RAYS_ACROSS = 2
"""Number of rays that meet the narrowest side of an object at the lidar's full range."""
MIN_VARIANCE = 1e-8
"""Least variance of the first pose [m^2, rad^2]; 0 has no inverse."""


@dataclass(frozen=True)
class Surroundings:
    """Poses of a robot, what it sees there on the map, and its models."""

    rays: Any
    """`landmarks.Rays`: the poses and their rays, in the map's own axes."""
    hits: NDArray[np.float32]
    """Hits of the rays on the map without objects, (n, beams, 4)."""
    routes: NDArray[np.int64]
    """Indices at which the routes begin, and the number of all poses, (r + 1,).

    Poses of a region are one line without an order.
    """
    told: Any
    """`way_covariances.Told`: how much a beam tells the filter from one pose to the next."""
    a_metre: Any
    """The same of 1 m of way."""
    motion: Any
    """`way_covariances.Motion`: how the filter's pose spreads on the way."""


def surroundings(
    grid: OccupancyGrid,
    lines: Sequence[Poses],
    step: float,
    shape: Shape,
    robot: Robot,
) -> Surroundings:
    """Look around on a map at poses in the world, about `step` [m] apart on each line."""
    rays = rays_at(on_own_axes(grid, np.concatenate(lines)), shape, robot, grid.resolution)
    of_looks = partial(told_by, robot, rays.beams, grid.resolution)
    update = max(robot.filter.update_min_d, 1e-3)
    return Surroundings(
        rays,
        hits_on(grid, rays),
        np.cumsum([0, *map(len, lines)]),
        of_looks(step / update),
        of_looks(1.0 / update),
        motion_of(robot),
    )


def lines_along(grid: OccupancyGrid, paths: Mapping[str, Path], step: float) -> list[Poses]:
    """Poses about every `step` [m] along each path.

    Raises
    ------
    LocplanError
        If a path leaves the free cells.
    """
    lines = []
    for name, path in paths.items():
        try:
            lines.append(_every(poses_along(path, grid), step))
        except LocplanError as error:
            raise LocplanError(f"path {name}: {error}") from None
    return lines


def on_own_axes(grid: OccupancyGrid, poses: Poses) -> Poses:
    """Poses in the world, in the map's own axes [m, m, rad]."""
    rows, cols = grid.world_to_grid(*poses[:, :2].T)
    edge = grid.resolution
    return np.column_stack([cols * edge, rows * edge, poses[:, 2] - grid.origin[2]])


def _every(poses: Poses, step: float) -> Poses:
    """Poses of a line about every `step` [m]."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    at = np.searchsorted(way, np.arange(0.0, way[-1] + step / 2, step) - 1e-9)
    kept: Poses = poses[np.unique(at.clip(0, len(poses) - 1))]
    return kept


def rays_at(poses: Poses, shape: Shape, robot: Robot, resolution: float) -> Any:
    """`landmarks.Rays` at poses in the map's own axes, so dense that no object is missed."""
    from locplan._kernels.landmarks import Rays

    lidar, amcl = robot.known_lidar, robot.filter
    reach = amcl.reach(lidar)
    narrow = 2 * min(shape.half_length, shape.half_width)
    round_ = min(max(MIN_RAYS, RAYS_ACROSS * 2 * math.pi * reach / narrow), MAX_RAYS)
    width = math.radians(lidar.field_of_view_deg)
    beams = max(2, math.ceil(round_ * lidar.field_of_view_deg / 360))
    step = width / beams  # rays stand for sectors that are equally wide
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    levers = np.column_stack(
        [cos * lidar.mount_x - sin * lidar.mount_y, sin * lidar.mount_x + cos * lidar.mount_y]
    )
    return Rays(
        np.ascontiguousarray(poses[:, :2]),
        levers,
        poses[:, 2] + lidar.mount_yaw - width / 2 + step / 2,
        step,
        beams,
        lidar.sees_all_round,
        max(lidar.least_range, amcl.laser_min_range, 0.0),
        reach,
        swing_of(amcl, resolution),
    )


def step_of(amcl: Amcl) -> float:
    """Distance between two looks around [m]."""
    return min(max(amcl.update_min_d, MIN_STEP), MAX_STEP)


def swing_of(amcl: Amcl, resolution: float) -> float:
    """How fast beams tell less with their range, see `landmarks.Rays` [1 / m^2].

    It is the variance of the heading in one update over that of a beam's end at which it still
    tells: sums of cubes are narrower than products.
    """
    times = 1 if amcl.robot_model_type == OMNIDIRECTIONAL else 2
    turn = times * amcl.alpha2 * amcl.update_min_d**2
    narrow = 1.0 if amcl.laser_model_type == "likelihood_field_prob" else 3.0
    return narrow * turn / (SIGMA * max(amcl.sigma_hit, resolution)) ** 2


def hits_on(grid: OccupancyGrid, rays: Any) -> NDArray[np.float32]:
    """Hits of rays on a map, (n, beams, 4); see `locplan._kernels.landmarks`."""
    from locplan._kernels.landmarks import hits_of_map
    from locplan._kernels.rays import empty_squares

    count = len(rays.first)
    check_memory(
        f"{count:,} poses with {rays.beams} rays", count * rays.beams * 40, "take shorter routes"
    )
    occupied = grid.cells == OCCUPIED
    hits = np.zeros((count, rays.beams, 4), np.float32)
    squares, normals = empty_squares(occupied), surface_normals(occupied)
    hits_of_map(squares, normals, grid.resolution, rays, 0, count, hits)
    return hits


def told_by(robot: Robot, rays: int, resolution: float, looks: float) -> Any:
    """`way_covariances.Told` of a filter: the curvature of its log-weight, per look around.

    A product of likelihoods adds the curvature of each beam. The other model of Nav2 weighs by
    1 plus the sum of their cubes: the more beams hit, the less each tells.
    """
    from locplan._kernels.way_covariances import Told

    lidar, amcl = robot.known_lidar, robot.filter
    share = math.ceil(lidar.beams / amcl.beam_step(lidar.beams)) / rays
    sigma = SIGMA * max(amcl.sigma_hit, resolution)
    likelihood = amcl.z_hit + amcl.z_rand / amcl.reach(lidar)
    if amcl.laser_model_type == "likelihood_field_prob":
        return Told(looks * share * amcl.z_hit / likelihood / sigma**2, 0.0)
    curvature = 3 * likelihood**2 * amcl.z_hit / sigma**2
    return Told(looks * share * curvature, share * likelihood**3)


def motion_of(robot: Robot) -> Any:
    """`way_covariances.Motion` of a filter with its updates, and of the odometry."""
    from locplan._kernels.way_covariances import Motion

    amcl, odometry, disturbances = robot.filter, robot.odometry, robot.disturbances
    step = amcl.update_min_d
    drift = math.radians(odometry.heading_drift_deg)
    if amcl.robot_model_type == OMNIDIRECTIONAL:
        across, turn = amcl.alpha5 * step, amcl.alpha2 * step
    else:  # it turns before and after it drives
        across, turn = amcl.alpha2 * step**3, 2 * amcl.alpha2 * step
    return Motion(
        amcl.alpha3 * step + odometry.distance_drift**2,
        across,
        turn + drift**2,
        max(disturbances.start_sigma**2, MIN_VARIANCE),
        max(math.radians(disturbances.start_sigma_deg) ** 2, MIN_VARIANCE),
    )
