"""The way that a page asks for, with what it is planned and driven by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from locplan._support.kernels.arrays import Bools
from locplan.errors import ConfigError
from locplan.field.field import CovarianceField
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path
from locplan.planning.plans import AWARE, plan_beside_shortest
from locplan.planning.protocol import Position
from locplan.planning.registry import DEFAULT
from locplan.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class View:
    """The map, its field, and the way that is asked for."""

    field: CovarianceField
    """The field of the map as it was edited."""
    costs: Costmap
    """The costmap of the field, at the weight and for the robot radius that the page shows."""
    robot: Robot
    """The robot with its lidar."""
    stops: Sequence[Position]
    """Positions of the start, of what is visited on the way, and of the goal in the world [m]."""
    whole: bool
    """False while some values of the field are those from before an edit."""

    @property
    def grid(self) -> OccupancyGrid:
        """The map as it was edited."""
        return self.costs.grid

    @property
    def cost_settings(self) -> dict[str, Any]:
        """Weight of the costmap, and its criterion unless that is the estimator's own."""
        settings, own = self.costs.settings, self.field.config.estimator.criterion
        criterion = settings.criterion if settings else own
        return {"weight": float(self.costs.weight)} | (
            {"criterion": criterion} if criterion != own else {}
        )

    def field_at(self, grid: OccupancyGrid, points: Bools | None = None, /) -> CovarianceField:
        """The field with values at some lattice points (h, w) alone, as if computed for these."""
        if points is None:
            return self.field
        values = {name: array.copy() for name, array in self.field.values.items()}
        for array in values.values():
            array[~points] = np.nan
        return CovarianceField.of(values, grid, self.field.config)

    def path(self) -> Path:
        """The localizability-aware path; a ConfigError says that there is none."""
        start, *via, goal = self.stops
        # As the page's paths: those of a circle.
        path = plan_beside_shortest(self.costs, start, goal, via=via, planner=DEFAULT)[AWARE].path
        if path is None:
            raise ConfigError("no path joins start and goal; move one of them")
        return path
