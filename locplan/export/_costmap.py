"""The inflation of Nav2's costmap, and the paths that planners take on it."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from locplan._kernels.arrays import Floats
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.robots import Inflation, nav2_inflation

LETHAL, INSCRIBED = 254, 253
AT_WALLS = 2.5
"""Excess at walls for which a mask carries the inflation, beside weight u [m per m]."""


@dataclass(frozen=True)
class CostmapInflation:
    """The inflation layer of a robot's global costmap.

    Nav2 takes the larger one of mask and costmap. So the slope that keeps paths off the walls is
    lost under high values of a mask, and a mask under that of a wide inflation, unless the mask
    carries the sum of both and the layer alone is steep.
    """

    layer: str
    """Name of the layer in the costmap's parameters."""
    inflation: Inflation
    """Its settings."""
    inscribed_radius: float
    """Distance from the centre of an occupied cell up to which the robot would touch it [m]."""

    @classmethod
    def of(cls, params: str | Path | None) -> CostmapInflation | None:
        """That of a parameter file, or None where it has none.

        Parameters
        ----------
        params : path, optional
            The parameter file of Nav2; None for none.
        """
        found = nav2_inflation(params) if params else None
        return cls(*found) if found else None

    @property
    def below_a_mask(self) -> CostmapInflation:
        """The layer as it has to be below a mask: as steep, or steeper."""
        # A wide and flat inflation would hide the mask below it.
        factor = max(self.inflation.cost_scaling_factor, 10.0)
        inflation = dataclasses.replace(self.inflation, cost_scaling_factor=factor)
        return dataclasses.replace(self, inflation=inflation)

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

    @property
    def follows(self) -> bool:
        """Whether the path costs about as much as the recommended one."""
        return self.ratio <= 1.12

    @property
    def text(self) -> str:
        """The path in a few words."""
        if math.isnan(self.ratio):
            return "finds no path"
        near = f"clearance {self.clearance:.2f} m, {self.least_clearance:.2f} m at least"
        return f"{self.ratio:.2f} times its J, {near}"
