"""The paths that a planner of Nav2 takes on a costmap with a mask, by its own formula."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan.costs import Costmap, Path, path_metrics
from locplan.errors import ConfigError, PoseError
from locplan.export._charges import Conversion, NavPlanner
from locplan.export._costmap import INSCRIBED, LETHAL, CostmapInflation, PlannedPath
from locplan.export._parameters import Robot
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.planners import plan

Position = tuple[float, float]


def costmap_costs(
    grid: OccupancyGrid,
    values: NDArray[np.int8] | None = None,
    inflation: CostmapInflation | None = None,
) -> Floats:
    """The costs 0..254 of a costmap, (H, W): the larger one of the inflation's and the mask's.

    Unknown cells are lethal, as to a planner with ``allow_unknown: false``.
    """
    walls = np.where(grid.cells == OCCUPIED, float(LETHAL), 0.0)
    cost = inflation.costs(grid) if inflation else walls
    if values is not None:
        cost = np.maximum(cost, np.floor(np.maximum(values, 0) * 2.54 + 0.5))
    return np.where(grid.free | (grid.cells == OCCUPIED), cost, LETHAL)


def unblocked(costs: Costmap) -> Costmap:
    """The costmap without the robot's radius, for the paths of a smaller robot; walls stay."""
    density = costs.unblocked_density
    return Costmap.from_density(costs.grid, np.where(np.isnan(density), np.inf, density))


def planned(
    planner: NavPlanner,
    param: float,
    grid: OccupancyGrid,
    cost: Floats,
    start: Position,
    goal: Position,
) -> Path | None:
    """The path that a planner takes between two places on a costmap's costs; None without any.

    It is the cheapest by what Smac and Theta* charge, over neighbouring cells or at any angle, and
    not smoothed.
    """
    density = 1 + planner.excess(np.minimum(cost, 252), param)
    density[cost >= INSCRIBED] = np.inf
    costs = Costmap.from_density(grid, density)
    if planner.any_angle:
        return plan(costs, start, goal, planner="any-angle").path
    return plan(costs, start, goal, planner="grid", allow_corner_cutting=True).path


def checked_paths(
    costs: Costmap,
    values: NDArray[np.int8],
    robot: Robot,
    conversion: Conversion,
    paths: Mapping[str, Path],
) -> Iterator[PlannedPath]:
    """The paths of a mask's planner between the ends of others; none of one without a formula.

    A path that is no way on the map is a ConfigError.
    """
    if not paths:
        return
    free = unblocked(costs)
    for name, path in paths.items():
        if not 0 < path_metrics(free, path).cost < math.inf:
            raise ConfigError(
                f"path {name} is one place, or leaves the map's free space; plan it on this map"
            )
    if conversion.planner.caveat:
        return
    inflation = CostmapInflation.of(robot.file)
    cost = costmap_costs(costs.grid, values, inflation and inflation.below_a_mask)
    for name, path in paths.items():
        yield judged(costs, cost, conversion.planner, conversion.param, name, path)


def judged(
    costs: Costmap, cost: Floats, planner: NavPlanner, param: float, name: str, path: Path
) -> PlannedPath:
    """The path that a planner takes between the ends of a recommended one, beside it."""
    free = unblocked(costs)
    ends: tuple[Position, Position] = tuple(map(tuple, path.xy[[0, -1]]))  # type: ignore[assignment]
    try:
        found = planned(planner, param, costs.grid, cost, *ends)
    except PoseError:  # an end is too close to a wall for Nav2's footprint
        found = None
    if found is None:
        return PlannedPath(name, planner.name, math.nan, math.nan, math.nan)
    ratio = path_metrics(free, found).cost / path_metrics(free, path).cost
    rows, cols = costs.grid.world_to_grid(*found.resampled(costs.grid.resolution).xy.T)
    clearance = costs.grid.clearance[
        np.clip(rows.astype(int), 0, costs.grid.shape[0] - 1),
        np.clip(cols.astype(int), 0, costs.grid.shape[1] - 1),
    ]
    return PlannedPath(
        name, planner.name, ratio, float(np.median(clearance)), float(clearance.min())
    )
