"""The paths that a planner of Nav2 takes on a costmap with a mask, by its own formula."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan.costs import Costmap, Path, path_metrics
from locplan.errors import ConfigError, PoseError
from locplan.export._charges import Conversion, NavPlanner, mask_density
from locplan.export._costmap import INSCRIBED, LETHAL, CostmapInflation, PlannedPath
from locplan.export._parameters import Robot
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.planners import plan
from locplan.robots import PLANNER_SERVER

Position = tuple[float, float]
BEYOND = 0.4
"""Distance beyond the robot at which the prices of inflated cells are compared [m]."""


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


def check_paths(costs: Costmap, paths: Mapping[str, Path]) -> None:
    """Raise a ConfigError if a path is no way on the map."""
    free = unblocked(costs)
    for name, path in paths.items():
        if not 0 < path_metrics(free, path).cost < math.inf:
            raise ConfigError(
                f"path {name} has no length, or leaves the map's free space; plan it on this map"
            )


def checked_paths(
    costs: Costmap,
    values: NDArray[np.int8],
    conversion: Conversion,
    paths: Mapping[str, Path],
    layer: CostmapInflation | None,
) -> Iterator[PlannedPath]:
    """The paths of a mask's planner between the ends of others; none of one without a formula.

    The costmap has this inflation layer.
    """
    if conversion.planner.caveat or not paths:
        return
    cost = costmap_costs(costs.grid, values, layer)
    for name, path in paths.items():
        yield judged(costs, cost, conversion.planner, conversion.param, name, path)


def steeper_inflation(
    costs: Costmap,
    values: NDArray[np.int8],
    robot: Robot,
    left: Sequence[PlannedPath],
    conversion: Conversion,
    paths: Mapping[str, Path],
    layer: CostmapInflation,
) -> str:
    """The steeper inflation with which a mask's planner takes paths that it left, in sentences.

    They name what it costs: obstacles that the sensors see inflate less, too. Empty if no path is
    taken with it.
    """
    steeper, planner = layer.steeper, conversion.planner
    if steeper is None:
        return ""
    cost = costmap_costs(costs.grid, values, steeper)
    again = (judged(costs, cost, planner, conversion.param, p.name, paths[p.name]) for p in left)
    taken = [f"{each.name} ({each.text})" for each in again if each.follows]
    if not taken:
        return ""
    server = robot.parameters.of(PLANNER_SERVER)
    names = [name for name, plugin in robot.planners.items() if plugin == planner.plugin]
    today = server.get(f"{names[0]}.{planner.parameter}", planner.default) if names else None
    today = planner.default if not isinstance(today, (int, float)) else float(today)

    def price(inflation: CostmapInflation, parameter: float) -> float:
        return float(planner.excess(np.array(252 * inflation.share_beyond(BEYOND)), parameter))

    yours, factor = layer.inflation.cost_scaling_factor, steeper.inflation.cost_scaling_factor
    return (
        f"{planner.name} takes {', '.join(taken)} if global_costmap has"
        f" {layer.layer}.cost_scaling_factor: {factor:.1f} (yours is {yours:g}). Obstacles that the"
        f" sensors see then inflate less: {BEYOND:g} m beyond the robot a cell costs"
        f" {price(steeper, conversion.param):.2f} per metre instead of"
        f" {price(layer, conversion.param):.2f} ({price(layer, today):.2f} without the mask's"
        f" {planner.parameter})"
    )


def judged(
    costs: Costmap, cost: Floats, planner: NavPlanner, param: float, name: str, path: Path
) -> PlannedPath:
    """The path that a planner takes between the ends of a recommended one, beside it."""
    free, planned_path = unblocked(costs), route_between(costs, cost, planner, param, path)
    if planned_path is None:
        return PlannedPath(name, planner.name, math.nan, math.nan, math.nan)
    recommended = path_metrics(free, path).cost
    xy, clearance = clearance_along(costs.grid, planned_path)
    narrowest, room = narrowest_of(xy, clearance)
    return PlannedPath(
        name,
        planner.name,
        path_metrics(free, planned_path).cost / recommended,
        float(np.median(clearance)),
        float(clearance.min()),
        narrowest,
        room,
        max(1.0, roomy_cost(costs, path) / recommended),
    )


def route_between(
    costs: Costmap, cost: Floats, planner: NavPlanner, param: float, path: Path
) -> Path | None:
    """The path of a planner between the ends of another; None without any."""
    ends: tuple[Position, Position] = tuple(map(tuple, path.xy[[0, -1]]))  # type: ignore[assignment]
    try:
        return planned(planner, param, costs.grid, cost, *ends)
    except PoseError:  # an end is too close to a wall for Nav2's footprint
        return None


def roomy_cost(costs: Costmap, path: Path) -> float:
    """J of the best path that keeps a follower's room, between the ends of another; 0 without any.

    The recommended path may pass where a follower stops.
    """
    density = mask_density(costs)
    density[np.isinf(costs.density) | np.isnan(density)] = np.inf
    roomy = Costmap.from_density(costs.grid, density)
    start, goal = map(tuple, path.xy[[0, -1]])
    try:
        best = plan(roomy, start, goal, planner="grid", allow_corner_cutting=True).path
    except PoseError:
        return 0.0
    return path_metrics(unblocked(costs), best).cost if best else 0.0


def clearance_along(grid: OccupancyGrid, path: Path) -> tuple[Floats, Floats]:
    """Positions (n, 2) along a path a cell apart, and the distance from walls of each [m]."""
    xy = path.resampled(grid.resolution).xy
    rows, cols = (values.astype(int) for values in grid.world_to_grid(*xy.T))
    rows, cols = np.clip(rows, 0, grid.shape[0] - 1), np.clip(cols, 0, grid.shape[1] - 1)
    return xy, grid.clearance[rows, cols]


def narrowest_of(xy: Floats, clearance: Floats) -> tuple[Position, float]:
    """Position and distance from walls of the narrowest place; infinite on a short path.

    Half a metre at both ends does not count: docks are at walls.
    """
    away = np.minimum(np.hypot(*(xy - xy[0]).T), np.hypot(*(xy - xy[-1]).T))
    inner = np.flatnonzero(away > 0.5)
    if not inner.size:
        return (math.nan, math.nan), math.inf
    at = inner[np.argmin(clearance[inner])]
    return (float(xy[at, 0]), float(xy[at, 1])), float(clearance[at])
