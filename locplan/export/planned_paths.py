"""Paths of Nav2's planners on a costmap with a mask, and gaps that a mask closes."""

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
    CostmapInflation,
    MaskConversion,
    NavPlanner,
    PlannedPath,
    compute_follower_room,
    compute_mask_density,
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
COMPARISON_DISTANCE = 0.4
"""Distance from the robot's edge at which costs of inflated cells are compared [m]."""


def compute_costmap_costs(
    grid: OccupancyGrid,
    values: NDArray[np.int8] | None = None,
    inflation: CostmapInflation | None = None,
) -> Floats:
    """Return the costs 0..254 of a costmap, (H, W): the larger value of inflation and mask.

    Unknown cells are lethal, as for a planner with ``allow_unknown: false``.
    """
    walls = np.where(grid.cells == OCCUPIED, float(LETHAL), 0.0)
    cost = inflation.compute_costs(grid) if inflation else walls
    if values is not None:
        cost = np.maximum(cost, np.floor(np.maximum(values, 0) * 2.54 + 0.5))
    return np.where(grid.free | (grid.cells == OCCUPIED), cost, LETHAL)


def ignore_robot_radius(costs: Costmap) -> Costmap:
    """Return the costmap without the robot's radius, for paths of smaller robots; walls stay."""
    density = costs.unblocked_density  # zones included
    return Costmap.from_density(costs.grid, np.where(np.isnan(density), np.inf, density))


def simulate_nav2_planner(
    planner: NavPlanner,
    param: float,
    grid: OccupancyGrid,
    costmap_costs: Floats,
    start: Position,
    goal: Position,
) -> Path | None:
    """Return the path of a Nav2 planner on a costmap's costs; None without a path.

    The path is the cheapest by the planner's formula, over neighbouring cells for Smac and at any
    angle for Theta*, and not smoothed.
    """
    density = 1 + planner.compute_excess(np.minimum(costmap_costs, 252), param)
    density[costmap_costs >= INSCRIBED] = np.inf
    costs = Costmap.from_density(grid, density)
    if planner.any_angle:
        return plan(costs, start, goal, planner="any-angle").path
    return plan(costs, start, goal, planner="grid", allow_corner_cutting=True).path


def check_paths(costs: Costmap, paths: Mapping[str, Path]) -> None:
    """Raise a ConfigError if a path has no length or leaves the map's free space."""
    free = ignore_robot_radius(costs)
    for name, path in paths.items():
        if not 0 < path_metrics(free, path).cost < math.inf:
            raise ConfigError(
                f"path {name} has no length, or leaves the map's free space; plan it on this map"
            )


def compare_nav2_paths(
    costs: Costmap,
    values: NDArray[np.int8],
    conversion: MaskConversion,
    paths: Mapping[str, Path],
    layer: CostmapInflation | None,
) -> Iterator[PlannedPath]:
    """Yield the path of a mask's planner between the ends of each recommended path, compared.

    Nothing is yielded for a planner that does not follow masks.
    """
    if conversion.planner.caveat or not paths:
        return
    cost = compute_costmap_costs(costs.grid, values, layer)
    for name, path in paths.items():
        yield compare_nav2_path(
            costs, cost, conversion.planner, conversion.parameter_value, name, path
        )


def suggest_inflation(
    costs: Costmap,
    values: NDArray[np.int8],
    robot: Nav2Robot,
    untaken_paths: Sequence[PlannedPath],
    conversion: MaskConversion,
    paths: Mapping[str, Path],
    layer: CostmapInflation,
) -> str:
    """Return advice for a steeper inflation if a mask's planner then takes more of the paths.

    The advice names the drawback: obstacles that the sensors see inflate less. It is empty if a
    steeper inflation does not help.
    """
    steeper, planner = layer.steeper_layer, conversion.planner
    if steeper is None:
        return ""
    cost = compute_costmap_costs(costs.grid, values, steeper)
    steep_paths = (
        compare_nav2_path(costs, cost, planner, conversion.parameter_value, p.name, paths[p.name])
        for p in untaken_paths
    )
    path_texts = [
        f"{nav2_path.name} ({nav2_path.verdict_text})"
        for nav2_path in steep_paths
        if nav2_path.is_equivalent
    ]
    if not path_texts:
        return ""
    server = robot.parameters.read_node_parameters(PLANNER_SERVER)
    names = [name for name, plugin in robot.planners.items() if plugin == planner.plugin]
    current = (
        server.get(f"{names[0]}.{planner.parameter}", planner.default_parameter) if names else None
    )
    current = planner.default_parameter if not isinstance(current, (int, float)) else float(current)

    def compute_price(inflation: CostmapInflation, parameter: float) -> float:
        return float(
            planner.compute_excess(
                np.array(252 * inflation.compute_cost_share(COMPARISON_DISTANCE)), parameter
            )
        )

    yours, factor = layer.inflation.cost_scaling_factor, steeper.inflation.cost_scaling_factor
    return (
        f"{planner.name} takes {', '.join(path_texts)} if global_costmap has"
        f" {layer.layer}.cost_scaling_factor: {factor:.1f} (yours is {yours:g}). Obstacles that the"
        f" sensors see then inflate less: {COMPARISON_DISTANCE:g} m beyond the robot a cell costs"
        f" {compute_price(steeper, conversion.parameter_value):.2f} per metre instead of"
        f" {compute_price(layer, conversion.parameter_value):.2f}"
        f" ({compute_price(layer, current):.2f} without the mask's {planner.parameter})"
    )


def compare_nav2_path(
    costs: Costmap, costmap_costs: Floats, planner: NavPlanner, param: float, name: str, path: Path
) -> PlannedPath:
    """Return the path that a planner takes between the ends of a recommended path, compared."""
    free, nav2_path = (
        ignore_robot_radius(costs),
        plan_between_ends(costs, costmap_costs, planner, param, path),
    )
    if nav2_path is None:
        return PlannedPath(name, planner.name, math.nan, math.nan, math.nan)
    recommended = path_metrics(free, path).cost
    xy, clearance = sample_clearance(costs.grid, nav2_path)
    narrowest, room = find_narrowest_place(xy, clearance)
    return PlannedPath(
        name,
        planner.name,
        path_metrics(free, nav2_path).cost / recommended,
        float(np.median(clearance)),
        float(clearance.min()),
        narrowest,
        room,
        max(1.0, compute_cost_with_follower_room(costs, path) / recommended),
    )


def plan_between_ends(
    costs: Costmap, costmap_costs: Floats, planner: NavPlanner, param: float, path: Path
) -> Path | None:
    """Return the path of a planner between the ends of another path; None without a path."""
    ends: tuple[Position, Position] = tuple(map(tuple, path.xy[[0, -1]]))  # type: ignore[assignment]
    try:
        return simulate_nav2_planner(planner, param, costs.grid, costmap_costs, *ends)
    except PoseError:  # an end is too close to a wall for Nav2's footprint
        return None


def compute_cost_with_follower_room(costs: Costmap, path: Path) -> float:
    """Return J of the best path with room for a follower between the ends of another path.

    The recommended path may pass places where a follower stops. Without such a path, J is 0.
    """
    density = compute_mask_density(costs)
    density[np.isinf(costs.density) | np.isnan(density)] = np.inf
    roomy = Costmap.from_density(costs.grid, density)
    start, goal = map(tuple, path.xy[[0, -1]])
    try:
        best = plan(roomy, start, goal, planner="grid", allow_corner_cutting=True).path
    except PoseError:
        return 0.0
    return path_metrics(ignore_robot_radius(costs), best).cost if best else 0.0


def sample_clearance(grid: OccupancyGrid, path: Path) -> tuple[Floats, Floats]:
    """Return positions (n, 2) along a path, a cell apart, and their distances from walls [m]."""
    xy = path.resample(grid.resolution).xy
    rows, cols = (values.astype(int) for values in grid.world_to_grid(*xy.T))
    rows, cols = np.clip(rows, 0, grid.shape[0] - 1), np.clip(cols, 0, grid.shape[1] - 1)
    return xy, grid.clearance[rows, cols]


def find_narrowest_place(xy: Floats, clearance: Floats) -> tuple[Position, float]:
    """Return position and wall distance of the narrowest place; infinite on a short path.

    Half a metre at both ends is ignored, because docks are at walls.
    """
    end_distances = np.minimum(np.hypot(*(xy - xy[0]).T), np.hypot(*(xy - xy[-1]).T))
    inner = np.flatnonzero(end_distances > 0.5)
    if not inner.size:
        return (math.nan, math.nan), math.inf
    at = inner[np.argmin(clearance[inner])]
    return (float(xy[at, 0]), float(xy[at, 1])), float(clearance[at])


MAX_GAPS = 8
"""Maximum number of closed gaps."""
MAX_DETOUR = 1.05
"""Maximum ratio of J of a path around a gap to that of the path through it."""
MIN_REGION_AREA = 1.0
"""Minimum area of a region that must stay reachable [m²]."""
LETHAL_VALUE = 100
"""The lethal value of a mask."""

Gap = tuple[float, float, float]
"""Position and wall distance of a gap [m]."""


def close_narrow_gaps(
    costs: Costmap,
    values: NDArray[np.int8],
    conversion: MaskConversion,
    paths: Mapping[str, Path],
    layer: CostmapInflation | None,
) -> tuple[NDArray[np.int8], list[Gap]]:
    """Return a mask with narrow gaps on the planner's paths closed, and these gaps.

    A gap is closed only if the planner then finds a path with more room that costs little more, and
    no region of the free space is cut off.

    Parameters
    ----------
    costs : Costmap
        The costmap of the mask.
    values : (H, W) array of int8
        The mask.
    conversion : MaskConversion
        The planner with its parameter.
    paths : dict of Path
        Recommended paths; the planner plans between their ends.
    layer : CostmapInflation or None
        The inflation of the robot's costmap.
    """
    gaps: list[Gap] = []
    for path in paths.values():
        before = _PlannerTrial(costs, values, conversion, path, layer)
        while before.path and len(gaps) < MAX_GAPS:
            (x, y), clearance = find_narrowest_place(before.xy, before.clearance)
            if not _is_gap(costs, before.xy, (x, y), clearance):
                break
            gap_distances = _compute_distances(costs, (x, y))
            disc = costs.grid.free & (gap_distances <= clearance + 1.5 * costs.grid.resolution)
            if (disc & _find_end_discs(costs, path)).any():
                break
            trial_values = values.copy()
            trial_values[disc] = LETHAL_VALUE
            after = _PlannerTrial(costs, trial_values, conversion, path, layer)
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
    """Yield a note for each path on which a follower lacks room, with the narrowest place.

    Parameters
    ----------
    paths : sequence of PlannedPath
        The paths.
    radius : float
        Radius of the robot, with its margin [m].
    """
    room = compute_follower_room(radius)
    for nav2_path in paths:
        if nav2_path.room < room and not math.isnan(nav2_path.ratio):
            x, y = nav2_path.narrowest
            yield (
                f"{nav2_path.planner}'s path for {nav2_path.name} passes {nav2_path.room:.2f} m"
                f" from walls at ({x:.2f}, {y:.2f}); path followers may stop below {room:.2f} m,"
                " so test this place first"
            )


class _PlannerTrial:
    """A planner's path on a mask, with its cost and its lack of room."""

    def __init__(
        self,
        costs: Costmap,
        values: NDArray[np.int8],
        conversion: MaskConversion,
        path: Path,
        layer: CostmapInflation | None,
    ) -> None:
        cost = compute_costmap_costs(costs.grid, values, layer)
        self.path = plan_between_ends(
            costs, cost, conversion.planner, conversion.parameter_value, path
        )
        if self.path is None:
            return
        self.cost = path_metrics(ignore_robot_radius(costs), self.path).cost
        self.xy, self.clearance = sample_clearance(costs.grid, self.path)
        lacking = compute_follower_room(costs.robot_radius) - self.clearance
        # Squared, because one place of 0.33 m stops a robot more often than three of 0.42 m.
        self.shortfall = float((np.maximum(lacking, 0) ** 2).sum())


def _is_gap(costs: Costmap, xy: Floats, place: tuple[float, float], clearance: float) -> bool:
    """True if the walls on both sides of a place are too close for a follower.

    A path that passes close to a corner has room on the other side, so it is no gap.
    """
    grid, room = costs.grid, compute_follower_room(costs.robot_radius)
    if not clearance < room:
        return False
    index = int(np.argmin(np.hypot(*(xy - place).T)))
    ahead, behind = xy[min(index + 2, len(xy) - 1)], xy[max(index - 2, 0)]
    along = (ahead - behind) / max(float(np.hypot(*(ahead - behind))), 1e-9)
    across = np.array([-along[1], along[0]])
    offsets = np.arange(0, 2 * room + grid.resolution, grid.resolution / 2)
    width = 0.0
    for side in (across, -across):
        rows, cols = grid.world_to_grid(*(np.array(place) + offsets[:, None] * side).T)
        rows = np.clip(rows.astype(int), 0, grid.shape[0] - 1)
        cols = np.clip(cols.astype(int), 0, grid.shape[1] - 1)
        blocked = np.flatnonzero(~grid.free[rows, cols])
        width += float(offsets[blocked[0]]) if blocked.size else np.inf
    return width < 2 * room


def _find_end_discs(costs: Costmap, path: Path) -> Bools:
    """Return a mask of the cells that the robot covers at the ends of a path."""
    return np.asarray(
        np.minimum.reduce([_compute_distances(costs, tuple(xy)) for xy in path.xy[[0, -1]]])
        <= costs.robot_radius + costs.grid.resolution
    )


def _compute_distances(costs: Costmap, xy: tuple[float, ...]) -> Floats:
    """Return the distance of each cell from a position, (H, W) [m]."""
    row, col = costs.grid.world_to_grid(*xy)
    rows, cols = np.ogrid[: costs.grid.shape[0], : costs.grid.shape[1]]
    return np.asarray(np.hypot(rows + 0.5 - row, cols + 0.5 - col) * costs.grid.resolution)


def _cuts_off_region(costs: Costmap, values: NDArray[np.int8], disc: Bools) -> bool:
    """True if closing the cells of a disc cuts off a region of the free space."""
    import cv2

    wide = (
        ~costs.grid.cells_near_walls(costs.robot_radius)
        & costs.grid.free
        & (values != LETHAL_VALUE)
    )
    min_cells = MIN_REGION_AREA / costs.grid.resolution**2

    def count_regions(cells: Bools) -> int:
        _, _, statistics, _ = cv2.connectedComponentsWithStats(
            cells.astype(np.uint8), connectivity=8
        )
        return int((statistics[1:, cv2.CC_STAT_AREA] >= min_cells).sum())

    return count_regions(wide & ~disc) > count_regions(wide)
