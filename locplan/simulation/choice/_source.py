"""Where the costmap of a choice comes from: it is given, or made of a field."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap, Path
from locplan.field import CovarianceField, FieldConfig, values_at
from locplan.maps import OccupancyGrid
from locplan.planners import planned_near_paths
from locplan.simulation.choice._ask import Ask


class Compute(Protocol):
    """A function that gives the field of a map, or its values at some lattice points."""

    def __call__(
        self, grid: OccupancyGrid, points: NDArray[np.bool_] | None = None, /
    ) -> CovarianceField: ...


@dataclass(frozen=True)
class Source:
    """Where the costmap comes from: it is given, or made of a field."""

    given: Costmap | None
    """The costmap that was given."""
    config: FieldConfig
    """Settings of the field."""
    compute: Compute
    """Gives the field."""

    def blank(self, grid: OccupancyGrid, robot_radius: float) -> Costmap:
        """Costmap on which every metre costs the same, blocked where the given one is."""
        if self.given is None:
            return Costmap.blank(grid, robot_radius=robot_radius)
        density = np.where(np.isfinite(self.given.density), 1.0, np.inf)
        return dataclasses.replace(
            Costmap.from_density(grid, density), robot_radius=self.given.robot_radius
        )

    def costs(
        self, ask: Ask, paths_on: Callable[[Costmap], Iterable[Path]]
    ) -> tuple[Costmap, CovarianceField | None]:
        """The costmap with its field, which is fine near some paths where that takes long."""
        if self.given:
            return self.given, None

        def costmap_of(field: CovarianceField) -> Costmap:
            return Costmap.from_field(
                ask.grid,
                field,
                weight=ask.settings.weight,
                robot_radius=ask.robot.radius,
                criterion=ask.settings.criterion,
            )

        if not self.config.estimator.casts_rays or self.config.stride != FieldConfig.stride:
            field = self.compute(ask.grid)
            return costmap_of(field), field

        def planned(field: CovarianceField) -> tuple[Costmap, list[Path]]:
            costs = costmap_of(field)
            return costs, [*paths_on(costs)]

        field, (costs, _) = planned_near_paths(
            ask.grid,
            self.config,
            lambda points: self.compute(ask.grid, points),
            planned,
            lambda found: found[1],
        )
        return costs, field


def deviation_along(path: Path, field: CovarianceField) -> tuple[float, float]:
    """Mean and greatest of the largest position deviation in a field along a path [m]."""
    grid = field.grid
    at = grid.world_to_grid(*path.resampled(grid.resolution, even=True).xy.T)
    rows, cols = (
        np.clip(np.floor(each).astype(int), 0, size - 1)
        for each, size in zip(at, grid.shape, strict=True)
    )
    found = values_at(field, field.scalar("position_std", headings="mean"), rows, cols)
    found = found[grid.free[rows, cols] & np.isfinite(found)]
    return (float(found.mean()), float(found.max())) if found.size else (math.nan, math.nan)
