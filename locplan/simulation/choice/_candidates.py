"""Candidates of a choice: paths of least cost on a few densities of a map, with a field or none."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap, Path
from locplan.field import CovarianceField, FieldConfig, values_at
from locplan.maps import OccupancyGrid
from locplan.planners import SHORTEST, planned_near_paths
from locplan.robots import Inflation
from locplan.simulation._worlds import Window, window_about
from locplan.simulation.choice._ask import Ask, Own, distances_to


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
            return Costmap.blank(grid, robot=robot_radius)
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
                robot=ask.robot,
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


MARGIN = 3.0
"""Margin of the part of the map that paths are planned on; clearance counts up to there [m]."""
WEIGHTS = (4.0, 8.0, 12.0)
"""Weights of the degeneracy u of the aware paths."""


@dataclass(frozen=True)
class Part:
    """The part of a map that paths between two places may take, and what is known there."""

    costs: Costmap
    """Costmap of the whole map, with a field or without one."""
    window: Window
    """Rows and columns of the part."""
    grid: OccupancyGrid
    """The part."""
    ask: Ask
    """What is asked."""
    longest: float
    """Maximum length of a candidate [m]."""
    accepted: dict[str, Path]
    """Candidates until now, the shortest first."""

    @classmethod
    def about(cls, costs: Costmap, shortest: Path, longest: float, ask: Ask) -> Part:
        """The part of a costmap in which all paths up to a greatest length lie [m]."""
        start, goal = shortest.xy[0], shortest.xy[-1]
        # They lie in an ellipse about both ends, of which a and b are half the axes.
        a = longest / 2
        b = math.sqrt(max(0.0, a**2 - float(np.sum((goal - start) ** 2)) / 4))
        turn, round_it = math.atan2(*(goal - start)[::-1]), np.linspace(0, 2 * np.pi, 64)
        along, across = a * np.cos(round_it), b * np.sin(round_it)
        x = along * math.cos(turn) - across * math.sin(turn)
        y = along * math.sin(turn) + across * math.cos(turn)
        xy = (start + goal) / 2 + np.column_stack([x, y])
        cells = np.column_stack(costs.grid.world_to_grid(*xy.T))
        window = window_about(costs.grid, cells, MARGIN / costs.grid.resolution)
        return cls(costs, window, costs.grid.part(*window), ask, longest, {SHORTEST: shortest})

    @cached_property
    def clearance(self) -> NDArray[np.float64]:
        """Distance of each cell to the nearest wall [m]."""
        return self.grid.clearance

    @cached_property
    def u(self) -> NDArray[np.float64]:
        """Degeneracy of each cell."""
        return self.costs.u[self.window]

    @cached_property
    def clear(self) -> NDArray[np.float64]:
        """Density that keeps off the walls."""
        return 1 + 3 * np.exp(-(self.clearance - self.ask.robot.radius) / 0.4)

    @property
    def inflated(self) -> NDArray[np.float64]:
        """Density that Nav2's planners see in an inflated costmap: 50 to 252, over 50."""
        nav2s = Inflation(inflation_radius=0.7, cost_scaling_factor=3.0)  # of its bringup
        inflation = self.ask.robot.inflation or nav2s
        beyond = self.clearance - self.ask.robot.radius
        cost = 4 * np.exp(-inflation.cost_scaling_factor * beyond)
        return 1 + np.where(self.clearance <= inflation.inflation_radius, np.minimum(cost, 4), 0)

    @property
    def beside(self) -> NDArray[np.float64]:
        """1 on the candidates until now, falling to 1/e at 1 m from them."""
        return np.exp(-(self._distance_to(*self.accepted.values()) ** 2))

    @property
    def cut(self) -> NDArray[np.bool_]:
        """Cells within 1.5 m of the middle of the shortest path."""
        shortest = self.accepted[SHORTEST]
        middle = [np.interp(shortest.length / 2, shortest.distance, v) for v in shortest.xy.T]
        return self._distance_to(Path(np.array([middle]))) < 1.5

    def planned(self, density: NDArray[np.float64]) -> Path | None:
        """The path of least cost on a density of the part, if it keeps all limits."""
        costs, asked = self.costs, self.ask.settings
        blocked = ~np.isfinite(costs.density[self.window])
        if asked.max_e is not None:
            blocked |= costs.e[self.window] > asked.max_e
        layer = Costmap.from_density(self.grid, np.where(blocked, np.inf, density))
        path = self.ask.planned(layer, limited=False).path
        if path is None or path.length > self.longest or self.ask.fault_of(path, costs):
            return None
        return path

    def aware_paths(self, weights: Iterable[float]) -> list[Path]:
        """The shortest path, and the aware paths of some weights."""
        found = [self.planned(1 + weight * self.u) for weight in weights]
        return [self.accepted[SHORTEST], *(path for path in found if path is not None)]

    def _distance_to(self, *paths: Path) -> NDArray[np.float64]:
        import cv2

        away = np.ones(self.grid.shape, np.uint8)
        for path in paths:
            fine = path.resampled(self.grid.resolution / 2) if path.length else path
            cells = np.floor(self.grid.world_to_grid(*fine.xy.T)).astype(np.int64)
            away[tuple(np.clip(cells, 0, np.array(away.shape)[:, None] - 1))] = 0
        cells = cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return np.asarray(cells * self.grid.resolution, np.float64)


Density: TypeAlias = Callable[[Part], NDArray[np.float64]]
"""Cost per metre of each cell of a part of a map."""


def _aware(weight: float) -> dict[str, Density]:
    return {f"aware, weight {weight:g}": lambda part: 1 + weight * part.u}


INFLATED: dict[str, Density] = {"inflated": lambda part: part.inflated}
"""That of the robot's own inflated costmap, on which its navigation would plan."""
DENSITIES: dict[str, Density] = {
    "clear of walls": lambda part: part.clear,
    "along walls": lambda part: 1 + 3 * np.minimum(abs(part.clearance - 0.6), 1.5),
    "a metre off walls": lambda part: 1 + 2 * np.minimum(abs(part.clearance - 1), 2),
    "detour": lambda part: part.clear + 50 * part.cut,
    "way around 1": lambda part: 1 + 1.2 * part.beside,
    "way around 2": lambda part: 1 + 2.5 * part.beside,
    "clear way around 1": lambda part: part.clear + 1.2 * part.beside,
    "clear way around 2": lambda part: part.clear + 2.5 * part.beside,
}
"""Those that need no field, whose paths must be others than those before. They were found to lower
the error of filters; the first is the best of them."""
AWARE: dict[str, Density] = {
    **{name: density for weight in WEIGHTS for name, density in _aware(weight).items()},
    "aware and clear": lambda part: part.clear + 8 * part.u,
}
"""Those that need a field, whose paths are candidates however near another one they are."""


def candidates_of(part: Part, own: Own) -> tuple[dict[str, Path], dict[str, str]]:
    """All candidates by name, the shortest first, and why others are none."""
    found, weight = part.accepted, part.ask.settings.weight
    densities = {**INFLATED, **DENSITIES}
    if not math.isnan(part.costs.weight):
        densities |= AWARE
        if weight is not None:
            densities |= _aware(weight)
    for name, density in densities.items():
        path = part.planned(density(part))
        if path is None or not is_beside(path, found.values(), 0.1, 0.0):
            continue
        # Up to 0.1 m two paths are one; another one has a tenth of its points 0.35 m off all.
        # What Nav2 would drive is shown beside, and takes no other path's place.
        others = [each for label, each in found.items() if label not in INFLATED]
        if name not in DENSITIES or is_beside(path, others, 0.35, 0.1):
            found[name] = path
    left_out: dict[str, str] = {}
    reserved = {**INFLATED, **DENSITIES, **AWARE}
    own.add_to(found, left_out, part.costs, part.ask, reserved=reserved)
    return found, left_out


def is_beside(path: Path, others: Iterable[Path], distance: float, share: float) -> bool:
    """Whether more than a share of a path's points are farther from each other path [m]."""
    points = path.resampled(0.25, even=True).xy
    return all(float((distances_to(points, each) > distance).mean()) > share for each in others)
