"""What the page shows, as objects of the library: the input of every answer that takes long."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.field import CovarianceField
from locplan.maps import OccupancyGrid
from locplan.planners import AWARE, SHORTEST, Plan, Position, plan_beside_shortest
from locplan.robots import Robot

MAX_DRIVES = 256
"""Greatest number of confirming drives that the page can ask for."""
STEPS = 400
"""Greatest number of steps of a profile along a path."""
DECIMALS = 3
"""Decimals of positions in answers: a millimetre."""


@dataclass(frozen=True, eq=False, repr=False)
class View:
    """The map, its field, and the way that is asked for."""

    grid: OccupancyGrid
    """The map as it was edited."""
    field: CovarianceField
    """The field of this map."""
    costs: Costmap
    """The costmap of the field, at the weight and for the robot radius that the page shows."""
    robot: Robot
    """The robot with its lidar."""
    start: Position
    """Position of the start in the world [m]."""
    goal: Position
    """Position of the goal in the world [m]."""
    via: tuple[Position, ...] = ()
    """Positions to visit on the way, in this order [m]."""
    whole: bool = True
    """False while some values of the field are those from before an edit."""

    def __repr__(self) -> str:
        (x0, y0), (x1, y1) = self.start[:2], self.goal[:2]
        return f"View({self.grid.name or 'map'}, {x0:g},{y0:g} to {x1:g},{y1:g})"

    @property
    def legs(self) -> list[tuple[Position, Position]]:
        """Both ends of each leg of the way."""
        return list(itertools.pairwise([self.start, *self.via, self.goal]))

    @property
    def cost_settings(self) -> dict[str, Any]:
        """Weight of the costmap, and its criterion unless that is the estimator's own."""
        settings, own = self.costs.settings, self.field.config.estimator.criterion
        criterion = settings.criterion if settings else own
        return {"weight": float(self.costs.weight)} | (
            {"criterion": criterion} if criterion != own else {}
        )

    def field_at(
        self, grid: OccupancyGrid, points: NDArray[np.bool_] | None = None, /
    ) -> CovarianceField:
        """The field with values at some lattice points (h, w) alone, as if computed for these."""
        if points is None:
            return self.field
        values = {name: array.copy() for name, array in self.field.values.items()}
        for array in values.values():
            array[~points] = np.nan
        return CovarianceField.of(values, grid, self.field.config)

    def plans(self) -> Mapping[str, Plan]:
        """The localizability-aware plan and the shortest one, by the library's planner."""
        return plan_beside_shortest(self.costs, self.start, self.goal, via=self.via)

    def paths(self) -> tuple[Path, Path]:
        """The aware path and the shortest one; a ConfigError says that there is none."""
        plans = self.plans()
        aware, shortest = plans[AWARE].path, plans[SHORTEST].path
        if aware is None or shortest is None:
            raise ConfigError("no path joins start and goal; move one of them")
        return aware, shortest


def rounded(xy: object) -> list[list[float]]:
    """Positions (n, 2) as lists for JSON, to a millimetre [m]."""
    values: list[list[float]] = np.round(np.asarray(xy, float), DECIMALS).tolist()
    return values
