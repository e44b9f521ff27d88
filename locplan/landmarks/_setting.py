"""What landmarks are placed for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from locplan.costs import Path
from locplan.field import Lidar
from locplan.landmarks._objects import LandmarkObject
from locplan.maps import OccupancyGrid
from locplan.simulation import Amcl, Disturbances


@dataclass(frozen=True, eq=False)
class Setting:
    """What landmarks are placed for: the map, the routes, and the robot."""

    grid: OccupancyGrid
    """The map without the objects that are placed."""
    kind: LandmarkObject
    """The object."""
    routes: Mapping[str, Path]
    """Routes by name."""
    planned: bool
    """Whether the routes are shortest paths, to be planned again among the objects."""
    lidar: Lidar
    amcl: Amcl
    disturbances: Disturbances
    robot_radius: float
    """Radius of the robot [m]."""
