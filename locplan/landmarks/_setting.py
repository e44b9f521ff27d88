"""What landmarks are placed for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Path
from locplan.landmarks._objects import LandmarkObject
from locplan.maps import OccupancyGrid
from locplan.robots import Robot


@dataclass(frozen=True, eq=False)
class Setting:
    """What landmarks are placed for: the map, the routes, and the robot."""

    grid: OccupancyGrid
    """The map without the objects that are placed."""
    kind: LandmarkObject
    """The object, of which several are placed."""
    routes: Mapping[str, Path]
    """Routes of the robot by name; of a region, those across it that are driven."""
    region: NDArray[np.bool_] | None
    """Cells in which the robot may be anywhere, (H, W), or None where it drives the routes."""
    planned: bool
    """True if the routes are shortest paths, to be planned again among the objects."""
    robot: Robot
    """The robot that was simulated."""
