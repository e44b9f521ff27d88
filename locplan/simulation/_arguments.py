"""Arguments of the drive kernels, made of a map and a robot."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.robots import FARTHEST_OBJECT, NEAREST_OBJECT, OMNIDIRECTIONAL, Amcl, Robot

BAND = 256
"""Number of rows of a map that are processed at once."""


@dataclass(frozen=True)
class DriveArguments:
    """Arguments of the kernels of drives, in the order in which they take them."""

    scores: Any
    """`particles.BeamScores` of the map."""
    lidar: Any
    """`lidar.Lidar` with the beams that AMCL compares."""
    disturbances: Any
    """`measured.BeamDisturbances`: outliers and occlusions."""
    odometry: Any
    """`drives.Odometry`: errors of the reported odometry."""
    start: Any
    """`tracking.Start`: standard deviations of the filter's first pose."""
    filter: Any
    """`particles.Filter`: AMCL's parameters."""

    def __iter__(self) -> Iterator[Any]:
        """The arguments one by one, as the kernels take them."""
        return (getattr(self, each.name) for each in fields(self))


def drive_arguments(
    grid: OccupancyGrid,
    robot: Robot,
    *,
    scores: NDArray[np.float32] | None = None,
) -> DriveArguments:
    """Arguments of the kernels of drives for a map and a robot.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    robot : Robot
        The robot, with its lidar.
    scores : (H + 2, W + 2) array of float32, optional
        What a beam that ends in each cell adds to a particle, for this map, filter and lidar; by
        default it is computed.

    Returns
    -------
    DriveArguments
        The arguments in the kernels' order.
    """
    from locplan._kernels.drives import Odometry
    from locplan._kernels.lidar import Lidar as Beams
    from locplan._kernels.measured import BeamDisturbances
    from locplan._kernels.particles import BeamScores, Filter
    from locplan._kernels.tracking import Start

    lidar, amcl = robot.known_lidar, robot.filter
    odometry, disturbances = robot.odometry, robot.disturbances
    reach = amcl.reach(lidar)
    values = beam_scores(grid, amcl, reach) if scores is None else scores
    return DriveArguments(
        BeamScores(
            values=values.ravel(),
            rows=values.shape[0],
            cols=values.shape[1],
            resolution=grid.resolution,
            product=amcl.laser_model_type == "likelihood_field_prob",
            shift=1.5 if amcl.half_cell else 1.0,
        ),
        Beams(
            angles=np.ascontiguousarray(lidar.angles[:: amcl.beam_step(lidar.beams)]),
            forward=lidar.mount_x,
            left=lidar.mount_y,
            yaw=lidar.mount_yaw,
            sigma=lidar.range_sigma,
            min_range=max(lidar.least_range, amcl.laser_min_range),
            max_range=reach,
        ),
        BeamDisturbances(
            outliers=disturbances.outliers,
            occlusion=disturbances.occlusion,
            width=math.radians(disturbances.occlusion_deg),
            nearest=NEAREST_OBJECT,
            farthest=FARTHEST_OBJECT,
        ),
        Odometry(
            distance_drift=odometry.distance_drift,
            heading_drift=math.radians(odometry.heading_drift_deg),
            turn_drift=math.radians(odometry.turn_drift_deg),
            distance_bias=odometry.distance_bias,
            heading_bias=math.radians(odometry.heading_bias_deg),
            turn_bias=odometry.turn_bias,
        ),
        Start(disturbances.start_sigma, math.radians(disturbances.start_sigma_deg)),
        Filter(
            **{name: getattr(amcl, name) for name in Filter._fields if name != "omnidirectional"},
            omnidirectional=amcl.robot_model_type == OMNIDIRECTIONAL,
        ),
    )


def beam_scores(grid: OccupancyGrid, amcl: Amcl, reach: float) -> NDArray[np.float32]:
    """Score that a beam adds to a particle, for each cell where it may end, by AMCL's models.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    amcl : Amcl
        Parameters of the filter.
    reach : float
        Greatest range of the beams [m].

    Returns
    -------
    (H + 2, W + 2) array of float32
        Cube of the beam's likelihood, or its logarithm for "likelihood_field_prob". The ring
        around the map is for beams that end outside of it.
    """
    import cv2

    occupied = np.asarray(grid.cells == OCCUPIED, np.uint8)
    furthest = amcl.laser_likelihood_max_dist
    beyond = _score(np.float64(furthest), amcl, reach)
    scores = np.full((grid.shape[0] + 2, grid.shape[1] + 2), beyond, np.float32)
    if occupied.any():
        cells = cv2.distanceTransform(1 - occupied, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for top in range(0, len(cells), BAND):  # in parts, which saves memory on a large map
            distance = np.minimum(cells[top : top + BAND] * grid.resolution, furthest)
            scored = _score(distance.astype(np.float64), amcl, reach)
            scores[1 + top : 1 + top + len(scored), 1:-1] = scored
    return scores


def _score(distance: Any, amcl: Amcl, reach: float) -> Any:
    """Score of a beam that ends at a distance from the nearest wall [m], float32."""
    hit = amcl.z_hit * np.exp(-(distance**2) / (2 * amcl.sigma_hit**2))
    likelihood = hit + amcl.z_rand / reach
    if amcl.laser_model_type == "likelihood_field_prob":
        tiny = np.finfo(np.float32).tiny
        return np.log(np.maximum(likelihood, tiny)).astype(np.float32)
    return (likelihood**3).astype(np.float32)
