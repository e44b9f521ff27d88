"""The paths that Nav2's planners take on a costmap with a mask, by their own formulas."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan._kernels.navfn import FAR, OBSTACLE, navfn_potential
from locplan.costs import Costmap, Path, path_metrics
from locplan.errors import ConfigError, PoseError
from locplan.export._charges import PLANNERS, Conversion, NavPlanner, mask_density
from locplan.export._costmap import (
    INSCRIBED,
    LETHAL,
    CostmapInflation,
    PlannedPath,
)
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

    That of Smac and Theta* is the cheapest by what they charge, over neighbouring cells or at any
    angle, and not smoothed; that of NavFn what its wave and its descent make.
    """
    if planner.caveat:
        return navfn_path(grid, cost, start, goal)
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
    robot: Robot,
    conversion: Conversion,
    paths: Mapping[str, Path],
    layer: CostmapInflation | None,
) -> Iterator[PlannedPath]:
    """The paths of a mask's planner, and of the robot's own ones, between the ends of others.

    The robot's own planners have Nav2's default of the parameter that scales costs. The costmap has
    this inflation layer.
    """
    if not paths:
        return
    cost, chosen = costmap_costs(costs.grid, values, layer), conversion.planner
    own = [each for each in PLANNERS.values() if each.plugin in robot.planners.values()]
    for planner in (chosen, *(each for each in own if each is not chosen)):
        param = conversion.param if planner is chosen else planner.default
        for name, path in paths.items():
            yield judged(costs, cost, planner, param, name, path)


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


def navfn_path(grid: OccupancyGrid, cost: Floats, start: Position, goal: Position) -> Path | None:
    """The path of NavFn, which has cells' centres at their corners; None where it fails.

    From navfn.cpp, branches humble to main: calcNavFnDijkstra, calcPath and gradCell.
    """
    entering = np.where(cost < INSCRIBED, np.trunc(50 + 0.8 * cost), OBSTACLE).astype(np.uint8)
    entering[[0, -1]] = entering[:, [0, -1]] = OBSTACLE
    rows, cols = grid.shape
    (col0, row0), (col, row) = (
        (min(int(col + 0.5), cols - 1), min(int(row + 0.5), rows - 1))
        for row, col in (grid.world_to_grid(*xy) for xy in (start, goal))
    )
    potential = navfn_potential(entering, row0 * cols + col0, row * cols + col, 100.0)
    positions = _descent(potential.astype(np.float64), (row, col), 4 * max(rows, cols))
    if positions is None:
        return None
    way = np.vstack([positions, (row0, col0)])[::-1]
    x, y = grid.grid_to_world(*way.T)
    return Path(np.vstack([np.column_stack([x, y]), goal]))


def _descent(potential: Floats, cell: tuple[int, int], steps: int) -> Floats | None:
    """Positions (n, 2) of rows and columns from a cell down to the start, half a cell apart."""
    found: list[tuple[float, float]] = []
    (row, col), down, right = cell, 0.0, 0.0
    for _ in range(steps):
        near = row + _rounded(down), col + _rounded(right)
        if potential[near] < 50:
            return np.array(found).reshape(-1, 2)
        found.append((row + down, col + right))
        around = potential[row - 1 : row + 2, col - 1 : col + 2]
        if around.shape != (3, 3):
            return None
        if (around >= FAR).any() or (len(found) > 2 and found[-1] == found[-3]):
            lowest = int(np.argmin(around))
            row, col, down, right = row + lowest // 3 - 1, col + lowest % 3 - 1, 0.0, 0.0
            if potential[row, col] >= FAR:
                return None
            continue
        corners = [(row, col), (row, col + 1), (row + 1, col), (row + 1, col + 1)]
        shares = [(1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right]
        y, x = np.dot(shares, [_slope(potential, *corner) for corner in corners])
        if not (y or x):
            return None
        step = 0.5 / math.hypot(y, x)
        row, down = _carried(row, down + y * step)
        col, right = _carried(col, right + x * step)
    return None


def _rounded(value: float) -> int:
    """The nearest whole number, away from zero where two are."""
    return int(math.copysign(math.floor(abs(value) + 0.5), value))


def _carried(cell: int, offset: float) -> tuple[int, float]:
    """A cell and an offset of at most 1 from it."""
    whole = int(offset > 1) - int(offset < -1)
    return cell + whole, offset - whole


def _slope(potential: Floats, row: int, col: int) -> tuple[float, float]:
    """The direction down the potential at a cell, of length 1; 0 where there is none."""
    here = potential[row, col]
    slope = []
    for before, after in (
        (potential[row - 1, col], potential[row + 1, col]),
        (potential[row, col - 1], potential[row, col + 1]),
    ):
        if here >= FAR:
            slope.append(-254.0 if before < FAR else 254.0 if after < FAR else 0.0)
        else:
            slope.append(
                (before - here if before < FAR else 0) + (here - after if after < FAR else 0)
            )
    length = math.hypot(*slope)
    return (slope[0] / length, slope[1] / length) if length else (0.0, 0.0)
