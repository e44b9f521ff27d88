"""Paths that a planner of Nav2 takes on a costmap with a mask, and gaps that a mask closes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from locplan._support.kernels.arrays import Bools, Floats
from locplan.errors import ConfigError, PoseError
from locplan.export.masks import (
    INSCRIBED,
    LETHAL,
    Conversion,
    CostmapInflation,
    NavPlanner,
    PlannedPath,
    follower_room,
    mask_density,
)
from locplan.export.parameters import Nav2Robot
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import OCCUPIED
from locplan.planning.costmap import Costmap
from locplan.planning.metrics import path_metrics
from locplan.planning.path import Path
from locplan.planning.plans import plan
from locplan.robots.parameters import PLANNER_SERVER

Position = tuple[float, float]
PRICE_DISTANCE = 0.4
"""Distance beyond the robot at which the prices of inflated cells are compared [m]."""


def compute_costmap_costs(
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


def unblock_costmap(costs: Costmap) -> Costmap:
    """The costmap without the robot's radius, for the paths of a smaller robot; walls stay."""
    density = costs.unblocked_density  # zones included
    return Costmap.from_density(costs.grid, np.where(np.isnan(density), np.inf, density))


def simulate_nav2_planner(
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
    free = unblock_costmap(costs)
    for name, path in paths.items():
        if not 0 < path_metrics(free, path).cost < math.inf:
            raise ConfigError(
                f"path {name} has no length, or leaves the map's free space; plan it on this map"
            )


def compare_nav2_paths(
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
    cost = compute_costmap_costs(costs.grid, values, layer)
    for name, path in paths.items():
        yield compare_nav2_path(costs, cost, conversion.planner, conversion.param, name, path)


def suggest_inflation(
    costs: Costmap,
    values: NDArray[np.int8],
    robot: Nav2Robot,
    untaken_paths: Sequence[PlannedPath],
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
    cost = compute_costmap_costs(costs.grid, values, steeper)
    steep_paths = (
        compare_nav2_path(costs, cost, planner, conversion.param, p.name, paths[p.name])
        for p in untaken_paths
    )
    path_texts = [
        f"{nav2_path.name} ({nav2_path.text})" for nav2_path in steep_paths if nav2_path.follows
    ]
    if not path_texts:
        return ""
    server = robot.parameters.read_node_parameters(PLANNER_SERVER)
    names = [name for name, plugin in robot.planners.items() if plugin == planner.plugin]
    today = server.get(f"{names[0]}.{planner.parameter}", planner.default) if names else None
    today = planner.default if not isinstance(today, (int, float)) else float(today)

    def price(inflation: CostmapInflation, parameter: float) -> float:
        return float(
            planner.excess(np.array(252 * inflation.share_beyond(PRICE_DISTANCE)), parameter)
        )

    yours, factor = layer.inflation.cost_scaling_factor, steeper.inflation.cost_scaling_factor
    return (
        f"{planner.name} takes {', '.join(path_texts)} if global_costmap has"
        f" {layer.layer}.cost_scaling_factor: {factor:.1f} (yours is {yours:g}). Obstacles that the"
        f" sensors see then inflate less: {PRICE_DISTANCE:g} m beyond the robot a cell costs"
        f" {price(steeper, conversion.param):.2f} per metre instead of"
        f" {price(layer, conversion.param):.2f} ({price(layer, today):.2f} without the mask's"
        f" {planner.parameter})"
    )


def compare_nav2_path(
    costs: Costmap, cost: Floats, planner: NavPlanner, param: float, name: str, path: Path
) -> PlannedPath:
    """The path that a planner takes between the ends of a recommended one, beside it."""
    free, nav2_path = unblock_costmap(costs), plan_between_ends(costs, cost, planner, param, path)
    if nav2_path is None:
        return PlannedPath(name, planner.name, math.nan, math.nan, math.nan)
    recommended = path_metrics(free, path).cost
    xy, clearance = measure_clearance(costs.grid, nav2_path)
    narrowest, room = find_narrowest(xy, clearance)
    return PlannedPath(
        name,
        planner.name,
        path_metrics(free, nav2_path).cost / recommended,
        float(np.median(clearance)),
        float(clearance.min()),
        narrowest,
        room,
        max(1.0, compute_roomy_cost(costs, path) / recommended),
    )


def plan_between_ends(
    costs: Costmap, cost: Floats, planner: NavPlanner, param: float, path: Path
) -> Path | None:
    """The path of a planner between the ends of another; None without any."""
    ends: tuple[Position, Position] = tuple(map(tuple, path.xy[[0, -1]]))  # type: ignore[assignment]
    try:
        return simulate_nav2_planner(planner, param, costs.grid, cost, *ends)
    except PoseError:  # an end is too close to a wall for Nav2's footprint
        return None


def compute_roomy_cost(costs: Costmap, path: Path) -> float:
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
    return path_metrics(unblock_costmap(costs), best).cost if best else 0.0


def measure_clearance(grid: OccupancyGrid, path: Path) -> tuple[Floats, Floats]:
    """Positions (n, 2) along a path a cell apart, and the distance from walls of each [m]."""
    xy = path.resample(grid.resolution).xy
    rows, cols = (values.astype(int) for values in grid.world_to_grid(*xy.T))
    rows, cols = np.clip(rows, 0, grid.shape[0] - 1), np.clip(cols, 0, grid.shape[1] - 1)
    return xy, grid.clearance[rows, cols]


def find_narrowest(xy: Floats, clearance: Floats) -> tuple[Position, float]:
    """Position and distance from walls of the narrowest place; infinite on a short path.

    Half a metre at both ends does not count: docks are at walls.
    """
    end_distances = np.minimum(np.hypot(*(xy - xy[0]).T), np.hypot(*(xy - xy[-1]).T))
    inner = np.flatnonzero(end_distances > 0.5)
    if not inner.size:
        return (math.nan, math.nan), math.inf
    at = inner[np.argmin(clearance[inner])]
    return (float(xy[at, 0]), float(xy[at, 1])), float(clearance[at])


MAX_GAPS = 8
"""Maximum number of gaps that are closed for a path."""
MAX_DETOUR = 1.05
"""Maximum J of a path without a gap, over that of the path through it."""
LARGE = 1.0
"""Size of a part of the free space that must stay reachable [m²]."""
CLOSED = 100
"""Value of a mask that is lethal."""

Gap = tuple[float, float, float]
"""Position of a gap, and its distance from walls [m]."""


def close_gaps(
    costs: Costmap,
    values: NDArray[np.int8],
    conversion: Conversion,
    paths: Mapping[str, Path],
    layer: CostmapInflation | None,
) -> tuple[NDArray[np.int8], list[Gap]]:
    """Return a mask without the gaps in which a follower of planned paths stops, and these gaps.

    A gap is closed only if the planner then takes a path with more room that costs little more,
    and no part of the free space is cut off.

    Parameters
    ----------
    costs : Costmap
        The costmap of the mask.
    values : (H, W) array of int8
        The mask.
    conversion : Conversion
        The planner with its parameter.
    paths : dict of Path
        Recommended paths, between whose ends the planner plans.
    layer : CostmapInflation or None
        The inflation of the robot's costmap.
    """
    gaps: list[Gap] = []
    for path in paths.values():
        before = _Trial(costs, values, conversion, path, layer)
        while before.path and len(gaps) < MAX_GAPS:
            (x, y), clearance = find_narrowest(before.xy, before.clearance)
            if not _is_gap(costs, before.xy, (x, y), clearance):
                break
            gap_distances = _compute_distances(costs, (x, y))
            disc = costs.grid.free & (gap_distances <= clearance + 1.5 * costs.grid.resolution)
            if (disc & _find_end_cells(costs, path)).any():
                break
            trial_values = values.copy()
            trial_values[disc] = CLOSED
            after = _Trial(costs, trial_values, conversion, path, layer)
            wider = after.path is not None and after.shortfall < 0.8 * before.shortfall
            if (
                not wider
                or after.cost > MAX_DETOUR * before.cost
                or _cuts_off_region(costs, values, disc)
            ):
                break
            values, before = trial_values, after
            gaps.append((x, y, clearance))
    return values, gaps


def note_narrow_places(paths: Sequence[PlannedPath], radius: float) -> Iterator[str]:
    """Yield a note for each path on which a follower lacks room, with the place.

    Parameters
    ----------
    paths : sequence of PlannedPath
        The paths.
    radius : float
        Radius of the robot, with its margin [m].
    """
    room = follower_room(radius)
    for nav2_path in paths:
        if nav2_path.room < room and not math.isnan(nav2_path.ratio):
            x, y = nav2_path.narrowest
            yield (
                f"{nav2_path.planner}'s path for {nav2_path.name} passes {nav2_path.room:.2f} m"
                " from walls at"
                f" ({x:.2f}, {y:.2f}); path followers may stop below {room:.2f} m, so try this"
                " place first"
            )


class _Trial:
    """The path that a planner takes on a mask."""

    def __init__(
        self,
        costs: Costmap,
        values: NDArray[np.int8],
        conversion: Conversion,
        path: Path,
        layer: CostmapInflation | None,
    ) -> None:
        cost = compute_costmap_costs(costs.grid, values, layer)
        self.path = plan_between_ends(costs, cost, conversion.planner, conversion.param, path)
        if self.path is None:
            return
        self.cost = path_metrics(unblock_costmap(costs), self.path).cost
        self.xy, self.clearance = measure_clearance(costs.grid, self.path)
        lacking = follower_room(costs.robot_radius) - self.clearance
        # Narrow places count more than proportionally: one of 0.33 m stops a robot more often
        # than three of 0.42 m.
        self.shortfall = float((np.maximum(lacking, 0) ** 2).sum())


def _is_gap(costs: Costmap, xy: Floats, at: tuple[float, float], clearance: float) -> bool:
    """True if walls on both sides of a place on a path are too close for a follower.

    A path that only passes a corner closely has room on its other side.
    """
    grid, room = costs.grid, follower_room(costs.robot_radius)
    if not clearance < room:
        return False
    index = int(np.argmin(np.hypot(*(xy - at).T)))
    ahead, behind = xy[min(index + 2, len(xy) - 1)], xy[max(index - 2, 0)]
    along = (ahead - behind) / max(float(np.hypot(*(ahead - behind))), 1e-9)
    across = np.array([-along[1], along[0]])
    offsets = np.arange(0, 2 * room + grid.resolution, grid.resolution / 2)
    width = 0.0
    for side in (across, -across):
        rows, cols = grid.world_to_grid(*(np.array(at) + offsets[:, None] * side).T)
        rows = np.clip(rows.astype(int), 0, grid.shape[0] - 1)
        cols = np.clip(cols.astype(int), 0, grid.shape[1] - 1)
        blocked = np.flatnonzero(~grid.free[rows, cols])
        width += float(offsets[blocked[0]]) if blocked.size else np.inf
    return width < 2 * room


def _find_end_cells(costs: Costmap, path: Path) -> Bools:
    """Cells in which the robot stands at the ends of a path."""
    return np.asarray(
        np.minimum.reduce([_compute_distances(costs, tuple(xy)) for xy in path.xy[[0, -1]]])
        <= costs.robot_radius + costs.grid.resolution
    )


def _compute_distances(costs: Costmap, xy: tuple[float, ...]) -> Floats:
    """Distance of each cell from a position, (H, W) [m]."""
    row, col = costs.grid.world_to_grid(*xy)
    rows, cols = np.ogrid[: costs.grid.shape[0], : costs.grid.shape[1]]
    return np.asarray(np.hypot(rows + 0.5 - row, cols + 0.5 - col) * costs.grid.resolution)


def _cuts_off_region(costs: Costmap, values: NDArray[np.int8], disc: Bools) -> bool:
    """True if closed cells cut off a part of the free space."""
    import cv2

    wide = ~costs.grid.cells_near_walls(costs.robot_radius) & costs.grid.free & (values != CLOSED)
    min_cells = LARGE / costs.grid.resolution**2

    def count_regions(cells: Bools) -> int:
        _, _, statistics, _ = cv2.connectedComponentsWithStats(
            cells.astype(np.uint8), connectivity=8
        )
        return int((statistics[1:, cv2.CC_STAT_AREA] >= min_cells).sum())

    return count_regions(wide & ~disc) > count_regions(wide)
