"""Arguments of the drive kernels, made of a map and a robot."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._util.poses import Poses
from locplan.errors import ConfigError
from locplan.maps import OccupancyGrid, check_grid
from locplan.robots import (
    FARTHEST_OBJECT,
    NEAREST_OBJECT,
    Amcl,
    Filter,
    Lidar,
    Robot,
    beam_scores,
    filter_settings,
)


class Line(NamedTuple):
    """The poses that a drive leads through."""

    truth: Poses
    """In the own axes of the filter's map, (n, 3) [m, m, rad]."""
    cells: Poses
    """Row and column in the map that is driven in, and heading, (n, 3) [cells, cells, rad]."""


class OwnFilter(NamedTuple):
    """A filter that is not AMCL, with what it is started with."""

    settings: Filter
    grid: OccupancyGrid
    """The filter's map."""
    lidar: Lidar


@dataclass(frozen=True)
class DriveArguments:
    """Arguments of the kernels of drives, in the order in which they take them."""

    scores: Any
    """`particles.BeamScores` of the map; None where the filter is not AMCL."""
    lidar: Any
    """`lidar.Lidar` with the beams that AMCL compares, or with all beams."""
    disturbances: Any
    """`measured.BeamDisturbances`: outliers and occlusions."""
    odometry: Any
    """`drives.Odometry`: errors of the reported odometry."""
    start: Any
    """`tracking.Start`: standard deviations of the filter's first pose."""
    filter: Any
    """`particles.Filter`: AMCL's parameters; or an `OwnFilter`."""

    def __iter__(self) -> Iterator[Any]:
        """The arguments one by one, as the kernels take them."""
        return (getattr(self, each.name) for each in fields(self))


def drive_arguments(
    grid: OccupancyGrid, robot: Robot, *, scores: NDArray[np.float32] | None = None
) -> DriveArguments:
    """Arguments of the kernels of drives for a map and a robot.

    Parameters
    ----------
    grid : OccupancyGrid
        The filter's map.
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
    from locplan._kernels.drives import Odometry, Start
    from locplan._kernels.lidar import BeamDisturbances, Lidar as Beams

    lidar, odometry, disturbances = robot.known_lidar, robot.odometry, robot.disturbances
    start = Start(disturbances.start_sigma, math.radians(disturbances.start_sigma_deg))
    known: Any = None
    settings: Any
    if isinstance(amcl := robot.filter, Amcl):
        known = beam_scores(grid, amcl, lidar, scores)
        angles, settings = lidar.angles[:: amcl.beam_step(lidar.beams)], filter_settings(amcl)
        nearest, farthest = max(lidar.least_range, amcl.laser_min_range), amcl.reach(lidar)
    else:
        angles, nearest, farthest = lidar.angles, lidar.least_range, lidar.range
        settings = OwnFilter(robot.filter, grid, lidar)
    return DriveArguments(
        known,
        Beams(
            angles=np.ascontiguousarray(angles),
            forward=lidar.mount_x,
            left=lidar.mount_y,
            yaw=lidar.mount_yaw,
            sigma=lidar.range_sigma,
            min_range=nearest,
            max_range=farthest,
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
        start,
        settings,
    )


def check_filter_map(filter_map: OccupancyGrid | None, grid: OccupancyGrid) -> OccupancyGrid:
    """The map that a filter has, which is the one that is driven in unless another is given.

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
    on_both = [(each >= 0) & (each < size) for each, size in zip(at, filter_map.shape, strict=True)]
    if not np.logical_and(*on_both).any():
        raise ConfigError(
            f"the filter's map ({filter_map.name or 'filter_map'}) and {grid.name or 'the map'} do"
            " not overlap; both must be in the same frame"
        )
    return filter_map


def about_filter(filter_map: OccupancyGrid | None) -> dict[str, object]:
    """What results say of a filter's own map, fit for JSON; nothing where it has none.

    Parameters
    ----------
    filter_map : OccupancyGrid or None
        The filter's map, where it differs from the one that is driven in.
    """
    if filter_map is None:
        return {}
    return {"filter_map": {"name": filter_map.name, "digest": filter_map.digest}}


def check_of_one_map(filter_map: OccupancyGrid | None, grids: Collection[object]) -> None:
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
