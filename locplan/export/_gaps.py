"""Gaps that are too narrow for a path follower, which a mask closes if a wider way is near.

A mask's soft costs cannot do that: they end at 251, and the inflation charges the wider way, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Bools, Floats
from locplan.costs import Costmap, Path, path_metrics
from locplan.export._charges import Conversion
from locplan.export._costmap import CostmapInflation, PlannedPath, follower_room
from locplan.export._planned import (
    clearance_along,
    costmap_costs,
    narrowest_of,
    route_between,
    unblocked,
)

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
            (x, y), clearance = narrowest_of(before.xy, before.clearance)
            if not _is_gap(costs, before.xy, (x, y), clearance):
                break
            away = _distance_from(costs, (x, y))
            disc = costs.grid.free & (away <= clearance + 1.5 * costs.grid.resolution)
            if (disc & _around_ends(costs, path)).any():
                break
            trial_values = values.copy()
            trial_values[disc] = CLOSED
            after = _Trial(costs, trial_values, conversion, path, layer)
            wider = after.path is not None and after.shortfall < 0.8 * before.shortfall
            if not wider or after.cost > MAX_DETOUR * before.cost or _cuts(costs, values, disc):
                break
            values, before = trial_values, after
            gaps.append((x, y, clearance))
    return values, gaps


def narrow_places(paths: Sequence[PlannedPath], radius: float) -> Iterator[str]:
    """Yield a note for each path on which a follower lacks room, with the place.

    Parameters
    ----------
    paths : sequence of PlannedPath
        The paths.
    radius : float
        Radius of the robot, with its margin [m].
    """
    room = follower_room(radius)
    for each in paths:
        if each.room < room and not math.isnan(each.ratio):
            x, y = each.narrowest
            yield (
                f"{each.planner}'s path for {each.name} passes {each.room:.2f} m from walls at"
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
        cost = costmap_costs(costs.grid, values, layer)
        self.path = route_between(costs, cost, conversion.planner, conversion.param, path)
        if self.path is None:
            return
        self.cost = path_metrics(unblocked(costs), self.path).cost
        self.xy, self.clearance = clearance_along(costs.grid, self.path)
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


def _around_ends(costs: Costmap, path: Path) -> Bools:
    """Cells in which the robot stands at the ends of a path."""
    return np.asarray(
        np.minimum.reduce([_distance_from(costs, tuple(xy)) for xy in path.xy[[0, -1]]])
        <= costs.robot_radius + costs.grid.resolution
    )


def _distance_from(costs: Costmap, xy: tuple[float, ...]) -> Floats:
    """Distance of each cell from a position, (H, W) [m]."""
    row, col = costs.grid.world_to_grid(*xy)
    rows, cols = np.ogrid[: costs.grid.shape[0], : costs.grid.shape[1]]
    return np.asarray(np.hypot(rows + 0.5 - row, cols + 0.5 - col) * costs.grid.resolution)


def _cuts(costs: Costmap, values: NDArray[np.int8], disc: Bools) -> bool:
    """True if closed cells cut off a part of the free space."""
    import cv2

    wide = ~costs.grid.closer_than(costs.robot_radius) & costs.grid.free & (values != CLOSED)
    least = LARGE / costs.grid.resolution**2

    def count(cells: Bools) -> int:
        _, _, about, _ = cv2.connectedComponentsWithStats(cells.astype(np.uint8), connectivity=8)
        return int((about[1:, cv2.CC_STAT_AREA] >= least).sum())

    return count(wide & ~disc) > count(wide)
