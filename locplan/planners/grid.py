"""The exact planner on the grid: 8 neighbours, least J."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from locplan.costmap import Costmap
from locplan.metrics import path_metrics
from locplan.path import Path


def solve(
    costs: Costmap,
    start: tuple[float, float],
    goal: tuple[float, float],
    *,
    allow_corner_cutting: bool = False,
) -> Path | None:
    """The path of least cost over the centres of neighbouring cells, or None if there is none.

    Parameters
    ----------
    costs : Costmap
        What travel costs.
    start, goal : (x, y)
        World positions [m] in free cells; the path begins and ends exactly there.
    allow_corner_cutting : bool
        Whether a diagonal step may pass a blocked cell's corner.
    """
    from locplan._kernels.search import shortest_costs, trace

    first, last = costs.cell_of(start, "start"), costs.cell_of(goal, "goal")
    if first == last:
        return Path(np.array([start, goal]))
    width = costs.grid.shape[1] + 2
    source, target = ((row + 1) * width + col + 1 for row, col in (first, last))
    cost = shortest_costs(costs.density, source, target, allow_corner_cutting)
    if not np.isfinite(cost[target]):
        return None
    flat = trace(costs.density, cost, target, allow_corner_cutting)
    cells = np.column_stack([flat // width - 1, flat % width - 1])
    return cells_to_path(costs, cells, start, goal)


def prepare() -> None:
    """Compile the search, so that the first plan is not timed with it."""
    from locplan._kernels.search import shortest_costs, trace

    density = np.ones((1, 1))
    trace(density, shortest_costs(density, 4, 4, False), 4, False)


def cells_to_path(
    costs: Costmap, cells: NDArray[np.int64], start: tuple[float, float], goal: tuple[float, float]
) -> Path:
    """A path from start over the cells' centres, (n, 2) of (row, col), to the goal.

    Centres on a straight line between their neighbours are left out, and at either end the one
    beside it if the way without it costs no more.
    """
    direction = np.diff(cells, axis=0)
    turns = np.any(direction[1:] != direction[:-1], axis=1)
    kept = cells[np.concatenate([[True], turns, [True]])] if len(cells) > 1 else cells
    centres = np.column_stack(costs.grid.grid_to_world(kept[:, 0] + 0.5, kept[:, 1] + 0.5))
    xy = np.vstack([start, centres, goal])
    for end, between, beyond in ((0, 1, 2), (-1, -2, -3)):
        if len(xy) > 2:  # not by the centre of the cell at the end, where that is a detour
            direct, around = Path(xy[[end, beyond]]), Path(xy[[end, between, beyond]])
            if path_metrics(costs, direct).cost <= path_metrics(costs, around).cost:
                xy = np.delete(xy, between, axis=0)
    distinct = np.hypot(*np.diff(xy, axis=0).T) > 1e-9 * costs.grid.resolution
    return Path(xy[np.concatenate([[True], distinct])])
