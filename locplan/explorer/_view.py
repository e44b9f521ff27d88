"""The way that a page asks for, with what it is planned and driven by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._kernels.arrays import Bools
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.field import CovarianceField
from locplan.maps import OccupancyGrid
from locplan.planners import AWARE, DEFAULT, LATTICE, Position, plan_beside_shortest
from locplan.robots import Robot

if TYPE_CHECKING:
    from locplan.explorer._asks import Ask


def headed(ask: Ask, stops: Sequence[Position]) -> list[Position]:
    """The stops with the headings that the ends are asked to have, for planners with headings."""
    found = list(stops)
    for n, name in ((0, "start_heading"), (-1, "goal_heading")):
        heading = ask.number(name, -7.0, 7.0, None)
        if heading is not None:
            found[n] = (*found[n][:2], heading)
    return found


def can_turn(robot: Robot) -> bool:
    """Whether a circle that turns on the spot says too little of a robot."""
    return bool(robot.outline or robot.kinematics.turning_radius)


def planner_of(ask: Ask) -> str | None:
    """The planner of a question: "lattice", or None for the usual one."""
    return ask.one_of("planner", (LATTICE,), None)


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
    planner: str | None = None
    """Name of the planner, where it is not the usual one; its stops may have headings."""
    filter_map: OccupancyGrid | None = None
    """The mended map that the filter has; None for the map itself."""

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
        planner = self.planner or DEFAULT  # drafts are paths of a circle
        path = plan_beside_shortest(self.costs, start, goal, via=via, planner=planner)[AWARE].path
        if path is None:
            raise ConfigError("no path joins start and goal; move one of them")
        return path
