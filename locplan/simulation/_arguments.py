"""What the kernels of a drive take of a map, of AMCL, and of what it is up against."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan.field import Lidar
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.simulation._settings import Amcl, Disturbances

NEAREST, FARTHEST = 0.5, 2.0
"""How far from the lidar something may stand before it [m]."""


class Arguments(NamedTuple):
    """In the order in which `locplan._kernels.drives.drive` takes them."""

    scores: Any
    """`particles.BeamScores` of the map."""
    lidar: Any
    """`lidar.Lidar` with the beams that AMCL compares."""
    disturbances: Any
    """`measured.BeamDisturbances`."""
    odometry: Any
    """`drives.Odometry`."""
    start: Any
    """`drives.Start`."""
    filter: Any
    """`particles.Filter`."""


def arguments_of(
    grid: OccupancyGrid, lidar: Lidar, amcl: Amcl, disturbances: Disturbances
) -> Arguments:
    """The arguments for a map, a lidar, a filter and what it is up against."""
    from locplan._kernels.drives import Odometry, Start
    from locplan._kernels.lidar import Lidar as Beams
    from locplan._kernels.measured import BeamDisturbances
    from locplan._kernels.particles import BeamScores, Filter

    most = amcl.laser_max_range
    reach = min(lidar.range, most) if most > 0 else lidar.range
    values = beam_scores(grid, amcl, reach)
    return Arguments(
        BeamScores(
            values=values.ravel(),
            rows=values.shape[0],
            cols=values.shape[1],
            resolution=grid.resolution,
            product=amcl.laser_model_type == "likelihood_field_prob",
        ),
        Beams(
            angles=compared_beams(lidar.angles, amcl),
            forward=lidar.mount_x,
            left=lidar.mount_y,
            yaw=lidar.mount_yaw,
            sigma=lidar.range_sigma,
            max_range=reach,
        ),
        BeamDisturbances(
            outliers=disturbances.outliers,
            occlusion=disturbances.occlusion,
            width=math.radians(disturbances.occlusion_deg),
            nearest=NEAREST,
            farthest=FARTHEST,
        ),
        Odometry(
            distance_drift=disturbances.distance_drift,
            heading_drift=math.radians(disturbances.heading_drift_deg),
            turn_drift=math.radians(disturbances.turn_drift_deg),
            distance_bias=disturbances.distance_bias,
            heading_bias=math.radians(disturbances.heading_bias_deg),
            turn_bias=disturbances.turn_bias,
        ),
        Start(disturbances.start_sigma, math.radians(disturbances.start_sigma_deg)),
        Filter(*(getattr(amcl, name) for name in Filter._fields)),
    )


def compared_beams(angles: NDArray[np.float64], amcl: Amcl) -> NDArray[np.float64]:
    """Those of a scan's beams that AMCL compares; its two models thin them out in two ways."""
    if amcl.laser_model_type == "likelihood_field_prob":
        every = math.ceil(len(angles) / amcl.max_beams)
    else:
        every = max(1, (len(angles) - 1) // (amcl.max_beams - 1))
    return np.ascontiguousarray(angles[::every])


def beam_scores(grid: OccupancyGrid, amcl: Amcl, reach: float) -> NDArray[np.float32]:
    """What a beam that ends in each cell adds to a particle's score, as AMCL's models have it.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    amcl : Amcl
        The filter.
    reach : float
        Of the beams [m].

    Returns
    -------
    (H + 2, W + 2) array of float32
        In a ring of what lies outside: the cube of the beam's likelihood, or for
        "likelihood_field_prob" its logarithm.
    """
    import cv2

    occupied = np.asarray(grid.cells == OCCUPIED, np.uint8)
    furthest = amcl.laser_likelihood_max_dist
    distance = np.full((grid.shape[0] + 2, grid.shape[1] + 2), furthest)
    if occupied.any():
        cells = cv2.distanceTransform(1 - occupied, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        distance[1:-1, 1:-1] = np.minimum(cells * grid.resolution, furthest)
    hit = amcl.z_hit * np.exp(-(distance**2) / (2 * amcl.sigma_hit**2))
    likelihood = hit + amcl.z_rand / reach
    if amcl.laser_model_type == "likelihood_field_prob":
        tiny = np.finfo(np.float32).tiny
        return np.log(np.maximum(likelihood, tiny)).astype(np.float32)
    return (likelihood**3).astype(np.float32)
