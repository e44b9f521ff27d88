"""The paths that Nav2's planners take on a costmap with a mask, by their own formulas."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan._kernels.navfn import FAR, OBSTACLE, navfn_potential
from locplan.costs import Costmap, Path, path_metrics
from locplan.errors import ConfigError, PoseError
from locplan.export._charges import PLANNERS, Conversion, NavPlanner
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


def checked_paths(
    costs: Costmap,
    values: NDArray[np.int8],
    robot: Robot,
    conversion: Conversion,
    paths: Mapping[str, Path],
) -> Iterator[PlannedPath]:
    """The paths of a mask's planner, and of the robot's own ones, between the ends of others.

    The robot's own planners have Nav2's default of the parameter that scales costs. A path that is
    no way on the map is a ConfigError.
    """
    if not paths:
        return
    free = unblocked(costs)
    for name, path in paths.items():
        if not 0 < path_metrics(free, path).cost < math.inf:
            raise ConfigError(
                f"path {name} is one place, or leaves the map's free space; plan it on this map"
            )
    inflation, chosen = CostmapInflation.of(robot.file), conversion.planner
    if inflation and not chosen.caveat:
        inflation = inflation.below_a_mask
    cost = costmap_costs(costs.grid, values, inflation)
    own = [each for each in PLANNERS.values() if each.plugin in robot.planners.values()]
    for planner in (chosen, *(each for each in own if each is not chosen)):
        param = conversion.param if planner is chosen else planner.default
        for name, path in paths.items():
            yield judged(costs, cost, planner, param, name, path)


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
