"""The room that masked paths keep from walls, and the paths that planners take on costmaps."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from locplan._kernels.arrays import Floats
from locplan.costs import Costmap
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.robots import Inflation, Nav2Parameters, nav2_inflation

LETHAL, INSCRIBED = 254, 253
AT_WALLS = 2.5
"""Excess at walls for which a mask carries the inflation, beside weight u [m per m]."""
FOLLOWER_ROOM, MIN_ROOM = 0.2, 0.45
"""Room that a path follower needs beyond the robot's radius, and the least from walls [m].

Regulated pure pursuit stopped again and again ("collision ahead") where a plan passed 0.33 m from
walls, beside a robot of 0.22 m whose pose was off by 0.05 m."""
TOO_NARROW = 8.0
"""Excess of cells at the robot's radius from walls, falling to 0 at the follower's room."""
STEEP = 10.0
"""A cost_scaling_factor with which an inflation hides no mask."""


def follower_room(radius: float) -> float:
    """Return the distance from walls that a path follower needs [m].

    Parameters
    ----------
    radius : float
        Radius of the robot, with its margin [m].
    """
    return max(MIN_ROOM, radius + FOLLOWER_ROOM)


def room_excess(costs: Costmap) -> Floats:
    """Return what a mask charges where a follower has too little room, (H, W) [m per m].

    Parameters
    ----------
    costs : Costmap
        The costmap, with the robot's radius.
    """
    room, radius = follower_room(costs.robot_radius), costs.robot_radius
    shortfall: Floats = np.clip((room - costs.grid.clearance) / (room - radius), 0, 1)
    return TOO_NARROW * shortfall


@dataclass(frozen=True)
class CostmapInflation:
    """The inflation layer of a robot's global costmap.

    Nav2 takes the larger one of mask and costmap. So the slope that keeps paths off the walls is
    lost under high values of a mask unless the mask carries the sum of both, and a mask may be
    hidden by a wide and flat inflation.
    """

    layer: str
    """Name of the layer in the costmap's parameters."""
    inflation: Inflation
    """Its settings."""
    inscribed_radius: float
    """Distance from the centre of an occupied cell up to which the robot would touch it [m]."""

    @classmethod
    def of(cls, parameters: Nav2Parameters) -> CostmapInflation | None:
        """That of a robot's parameters, or None where they have none.

        Parameters
        ----------
        parameters : Nav2Parameters
            The parameters of Nav2.
        """
        found = nav2_inflation(parameters)
        return cls(*found) if found else None

    @property
    def steeper(self) -> CostmapInflation | None:
        """The layer with a factor that hides no mask; None if its own factor is as steep."""
        if self.inflation.cost_scaling_factor >= STEEP:
            return None
        inflation = dataclasses.replace(self.inflation, cost_scaling_factor=STEEP)
        return dataclasses.replace(self, inflation=inflation)

    @classmethod
    def carried(cls, costs: Costmap, layer: CostmapInflation | None) -> CostmapInflation | None:
        """Return the inflation that a mask carries, of the costmap's robot; None without any.

        Parameters
        ----------
        costs : Costmap
            The costmap. The inflation of its robot, if it has one, replaces that of the layer.
        layer : CostmapInflation or None
            The layer of the robot's parameters.
        """
        inflation = (costs.robot and costs.robot.inflation) or (layer and layer.inflation)
        name = layer.layer if layer else ""
        return cls(name, inflation, costs.robot_radius) if inflation else None

    def share_beyond(self, distance: float) -> float:
        """Return the cost at a distance beyond the robot's edge, as a share of the highest, 0..1.

        Parameters
        ----------
        distance : float
            The distance [m].
        """
        if distance > self.inflation.inflation_radius - self.inscribed_radius:
            return 0.0
        return math.exp(-self.inflation.cost_scaling_factor * distance)

    def costs(self, grid: OccupancyGrid) -> Floats:
        """The costs 0..254 of a map's cells, (H, W), as inflation_layer.cpp has them.

        Parameters
        ----------
        grid : OccupancyGrid
            The map; its unknown cells are as free ones.
        """
        import cv2

        free = (grid.cells != OCCUPIED).astype(np.uint8)
        away = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        away = np.where(free.all(), np.inf, away.astype(np.float64))
        beyond = away * grid.resolution - self.inscribed_radius
        cost: Floats = np.trunc(
            252 * np.exp(-self.inflation.cost_scaling_factor * np.maximum(beyond, 0))
        )
        cost[away > math.ceil(self.inflation.inflation_radius / grid.resolution)] = 0
        cost[beyond <= 0] = INSCRIBED
        cost[away == 0] = LETHAL
        return cost


@dataclass(frozen=True)
class PlannedPath:
    """The path that a planner of Nav2 takes, beside a recommended one with the same ends."""

    name: str
    """Name of the recommended path."""
    planner: str
    """Name of the planner, as `nav2_keepout` has it."""
    ratio: float
    """J over that of the recommended path; NaN where the planner finds none."""
    clearance: float
    """Median distance from walls along the path [m]."""
    least_clearance: float
    """Least distance from walls along the path [m]."""
    narrowest: tuple[float, float] = (math.nan, math.nan)
    """Position of the least distance, farther than half a metre from both ends [m]."""
    room: float = math.inf
    """Distance from walls there [m]."""
    roomy_ratio: float = 1.0
    """J of the best path that keeps a follower's room, over that of the recommended path."""

    @property
    def follows(self) -> bool:
        """True if the path costs about as much as the recommended one with a follower's room."""
        return self.ratio <= 1.12 * self.roomy_ratio

    @property
    def text(self) -> str:
        """The path in a few words."""
        if math.isnan(self.ratio):
            return "finds no path"
        near = f"clearance {self.clearance:.2f} m, {self.least_clearance:.2f} m at least"
        return f"{self.ratio:.2f} times its J, {near}"
