"""Objects that a robot sees along its routes, and their effect on its filter."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from locplan._support.checks import check_memory
from locplan._support.kernels.arrays import Floats, Ints, Singles
from locplan._support.poses import Poses, compute_travel_distances
from locplan.advice.landmark_objects import ObjectShape
from locplan.field.beams import find_surface_normals
from locplan.maps.grid import OccupancyGrid, world_to_map_frame
from locplan.maps.occupancy import OCCUPIED
from locplan.planning.path import Path
from locplan.robots.amcl import OMNIDIRECTIONAL, Amcl
from locplan.robots.robot import Robot
from locplan.simulation.worlds import make_path_poses

SIGMA = 2.0
"""Standard deviation of a beam's end in units of the filter's sigma_hit [1].

Errors of beams are correlated, so each carries less information than alone: 0.4 m, with the default
0.2 m, ranks placements best by the errors of simulated drives.
"""
MIN_STEP, MAX_STEP = 0.1, 0.5
"""Limits of the distance between two looks around [m]; between them it is update_min_d."""
MIN_RAYS, MAX_RAYS = 360, 2880
"""Limits of the number of rays in a full circle."""
MIN_VARIANCE = 1e-8
"""Minimum variance of the first pose [m^2, rad^2]; 0 has no inverse."""


@dataclass(frozen=True)
class RouteViews:
    """Poses of a robot along its routes, its rays there, and the models of its filter."""

    rays: Any
    """`landmarks.Rays`: the poses and their rays, in the map's own axes."""
    routes: Ints
    """Indices at which the routes begin, and the number of all poses, (r + 1,)."""
    sensing_model: Any
    """`objectives.Sensing`: the information of a beam from one pose to the next."""
    motion: Any
    """`objectives.Motion`: how the covariance of the filter's pose grows on the way."""


def make_route_views(
    grid: OccupancyGrid, lines: Sequence[Poses], shape: ObjectShape, robot: Robot
) -> RouteViews:
    """Look around on a map at poses in the world, `compute_look_step` apart on each line."""
    rays = _make_rays(
        world_to_map_frame(grid, np.concatenate(lines)), shape, robot, grid.resolution
    )
    count = len(rays.first)
    check_memory(
        f"{count:,} poses with {rays.beams} rays", count * rays.beams * 40, "take shorter routes"
    )
    update = max(robot.amcl.update_min_d, 1e-3)
    a_step = _make_beam_sensing(
        robot, rays.beams, grid.resolution, compute_look_step(robot) / update
    )
    return RouteViews(rays, np.cumsum([0, *map(len, lines)]), a_step, _make_motion_noise(robot))


def sample_lines(grid: OccupancyGrid, paths: Mapping[str, Path], robot: Robot) -> list[Poses]:
    """Return poses about every `compute_look_step` [m] along each path.

    Raises
    ------
    LocplanError
        If a path leaves the free cells.
    """
    lines, step = [], compute_look_step(robot)
    for name, path in paths.items():
        poses = make_path_poses(path, grid, f"path {name}")
        way = compute_travel_distances(poses)
        at = np.searchsorted(way, np.arange(0.0, way[-1] + step / 2, step) - 1e-9)
        lines.append(poses[np.unique(at.clip(0, len(poses) - 1))])
    return lines


def _make_rays(poses: Poses, shape: ObjectShape, robot: Robot, resolution: float) -> Any:
    """Return rays at poses along the map's rows and columns, dense enough to hit all objects."""
    from locplan.advice.kernels.landmarks import RouteRays

    lidar, amcl = robot.known_lidar, robot.amcl
    reach = amcl.compute_max_range(lidar)
    narrow = 2 * min(shape.half_length, shape.half_width)
    # Number of rays that meet the narrowest side of an object at the lidar's full range.
    round_ = min(max(MIN_RAYS, 2 * 2 * math.pi * reach / narrow), MAX_RAYS)
    width = math.radians(lidar.field_of_view_deg)
    beams = max(2, math.ceil(round_ * lidar.field_of_view_deg / 360))
    step = width / beams  # rays stand for sectors that are equally wide
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    levers = np.column_stack(
        [cos * lidar.mount_x - sin * lidar.mount_y, sin * lidar.mount_x + cos * lidar.mount_y]
    )
    return RouteRays(
        np.ascontiguousarray(poses[:, :2]),
        levers,
        poses[:, 2] + lidar.mount_yaw - width / 2 + step / 2,
        step,
        beams,
        lidar.sees_all_round,
        max(lidar.min_range, amcl.laser_min_range, 0.0),
        reach,
        _compute_range_falloff(amcl, resolution),
    )


def compute_look_step(robot: Robot) -> float:
    """Return the distance between two looks around [m]."""
    return min(max(robot.amcl.update_min_d, MIN_STEP), MAX_STEP)


def _compute_range_falloff(amcl: Amcl, resolution: float) -> float:
    """Return the decrease of a beam's information with its range [1 / m^2].

    It is the ratio of two variances: of the heading in one update, and of a beam's end. Sums of
    cubes are narrower than products.
    """
    times = 1 if amcl.robot_model_type == OMNIDIRECTIONAL else 2
    turn = times * amcl.alpha2 * amcl.update_min_d**2
    narrow = 1.0 if amcl.laser_model_type == "likelihood_field_prob" else 3.0
    return narrow * turn / (SIGMA * max(amcl.sigma_hit, resolution)) ** 2


def _make_beam_sensing(robot: Robot, n_rays: int, resolution: float, looks: float) -> Any:
    """Return the curvature of a filter's log-weight per look around.

    A product of likelihoods adds the curvature of each beam. Nav2's default model weighs by 1 plus
    the sum of their cubes: the more beams hit, the less each counts.
    """
    from locplan.advice.kernels.objectives import BeamSensing

    lidar, amcl = robot.known_lidar, robot.amcl
    share = math.ceil(lidar.beams / amcl.compute_beam_step(lidar.beams)) / n_rays
    sigma = SIGMA * max(amcl.sigma_hit, resolution)
    likelihood = amcl.z_hit + amcl.z_rand / amcl.compute_max_range(lidar)
    if amcl.laser_model_type == "likelihood_field_prob":
        return BeamSensing(looks * share * amcl.z_hit / likelihood / sigma**2, 0.0)
    curvature = 3 * likelihood**2 * amcl.z_hit / sigma**2
    return BeamSensing(looks * share * curvature, share * likelihood**3)


def _make_motion_noise(robot: Robot) -> Any:
    """Return the motion noise of a filter and of the odometry."""
    from locplan.advice.kernels.objectives import MotionNoise

    amcl, odometry, disturbances = robot.amcl, robot.odometry, robot.disturbances
    step = amcl.update_min_d
    drift = math.radians(odometry.heading_drift_deg)
    if amcl.robot_model_type == OMNIDIRECTIONAL:
        across, turn = amcl.alpha5 * step, amcl.alpha2 * step
    else:  # it turns before and after it drives
        across, turn = amcl.alpha2 * step**3, 2 * amcl.alpha2 * step
    return MotionNoise(
        amcl.alpha3 * step + odometry.distance_drift**2,
        across,
        turn + drift**2,
        max(disturbances.start_sigma**2, MIN_VARIANCE),
        max(math.radians(disturbances.start_sigma_deg) ** 2, MIN_VARIANCE),
    )


LOT_SIZE = 64
"""Number of places that a thread takes at a time: near places cost about the same."""


@dataclass
class PlacementObjective:
    """Objects that a robot sees along its routes, and the objective of the placement.

    The objective is the mean of P_xx + P_yy along the routes [m^2], P the covariance of an
    information filter: between two looks around P becomes F P F^T + Q ds, and at each
    (P^-1 + I)^-1, I the information of the beams that the filter compares.
    """

    grid: OccupancyGrid
    """The map without objects."""
    route_views: RouteViews
    shape: ObjectShape
    places: Floats
    """Row, column and heading of each place on the map, (m, 3) [cells, cells, rad]."""
    threads: int
    hits: Singles = field(init=False)
    """Hits of the rays with the objects, (n, beams, 4)."""
    sums: Floats = field(init=False)
    """Weighted sums over the hits of each pose; their number of hits is the map's."""
    sightings: Any = field(init=False)
    """`sightings.Sightings` of the places."""

    def __post_init__(self) -> None:
        from locplan._support.kernels.rays import compute_empty_squares
        from locplan.advice.kernels.landmarks import (
            LandmarkScene,
            MapSurfaces,
            ObjectOutline,
            cast_map_hits,
            sum_hits,
        )

        rays, resolution = self.route_views.rays, self.grid.resolution
        count, occupied = len(rays.first), self.grid.cells == OCCUPIED
        self._hits_of_map = np.zeros((count, rays.beams, 4), np.float32)
        surfaces = MapSurfaces(
            compute_empty_squares(occupied), find_surface_normals(occupied), resolution
        )
        cast_map_hits(surfaces, rays, self._hits_of_map)
        self.candidate_poses = np.ascontiguousarray(
            np.column_stack([self.places[:, [1, 0]] * resolution, self.places[:, 2]])
        )
        self.outline = ObjectOutline(*self.shape)
        self.hits = self._hits_of_map.copy()
        self.sums = sum_hits(self.hits, rays)
        self.scene = LandmarkScene(self.hits, self.sums, rays, self.outline)
        self._sums_of_map = self.sums.copy()
        self._touched = np.zeros(count, bool)
        self.sightings = self._find_sightings()

    def place_objects(self, place_numbers: Ints) -> None:
        """Start over with objects at these places, (k,)."""
        from locplan.advice.kernels.landmarks import HITS, add_object_to_hits, write_hit_sums

        touched, rays = self._touched, self.route_views.rays
        self.hits[touched] = self._hits_of_map[touched]
        self.sums[touched] = self._sums_of_map[touched]
        touched[:] = False
        for x, y, heading in self.candidate_poses[place_numbers]:
            add_object_to_hits(self.hits, rays, self.outline, x, y, heading, touched)
        write_hit_sums(self.hits, rays, touched, self.sums)
        self.sums[:, HITS] = self._sums_of_map[:, HITS]

    def compute_objective(self) -> float:
        """Return the objective with the objects [m^2]."""
        from locplan.advice.kernels.landmarks import XX, YY
        from locplan.advice.kernels.objectives import compute_route_covariances

        route_views = self.route_views
        _, after = compute_route_covariances(
            self.sums,
            route_views.rays.poses,
            route_views.routes,
            route_views.sensing_model,
            route_views.motion,
        )
        return float((after[:, XX] + after[:, YY]).mean())

    def compute_objectives(self, indices: Ints) -> Floats:
        """Return the objective with an object at each of these places as well, (m,) [m^2]."""
        from locplan.advice.kernels.objectives import compute_mean_variances

        route_views = self.route_views
        kernel_arguments = (
            self.sightings,
            self.scene,
            route_views.routes,
            route_views.sensing_model,
            route_views.motion,
        )
        return np.concatenate(
            self._run_in_batches(
                lambda part: compute_mean_variances(self.candidate_poses, part, *kernel_arguments),
                np.asarray(indices, np.int64),
            )
        )

    def _find_sightings(self) -> Any:
        """Find the poses that see each place, and their rays."""
        from locplan.advice.kernels.landmarks import ObjectSightings, find_sightings

        candidate_poses, kernel_arguments = (
            self.candidate_poses,
            (self._hits_of_map, self.route_views.rays, self.outline),
        )
        counts, all_numbers = (
            np.zeros(len(candidate_poses), np.int64),
            np.arange(len(candidate_poses)),
        )

        def fill_sightings(starts: Ints) -> ObjectSightings:
            room = starts[-1]
            new_sightings = ObjectSightings(
                starts, np.empty(room, np.int32), np.empty((room, 2), np.int16)
            )
            self._run_in_batches(
                lambda lot: find_sightings(
                    candidate_poses, lot[0], lot[-1] + 1, *kernel_arguments, new_sightings, counts
                ),
                all_numbers,
            )
            return new_sightings

        fill_sightings(np.zeros(len(candidate_poses) + 1, np.int64))
        starts = np.concatenate([[0], np.cumsum(counts)])
        check_memory(
            f"{starts[-1]:,} sightings of {len(counts):,} places",
            8.0 * starts[-1],
            "take shorter routes",
        )
        return fill_sightings(starts)

    def _run_in_batches(self, run: Callable[[Ints], Any], indices: Ints) -> list[Any]:
        """Return the results of a function for the indices of each lot of places."""
        lots = np.split(indices, range(LOT_SIZE, len(indices), LOT_SIZE))
        with ThreadPoolExecutor(self.threads) as pool:
            return list(pool.map(run, lots))
