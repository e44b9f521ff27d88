"""Grid paths between two positions: over the centres of cells, or straight."""

from __future__ import annotations

import numpy as np

from locplan._kernels.arrays import Floats, Ints
from locplan.costs import Costmap, Path, path_cost
from locplan.planners._protocol import Position


def grid_path(
    costs: Costmap, cells: Ints, start: Position, goal: Position, allow_corner_cutting: bool = False
) -> Path:
    """The cheaper one of the path over the centres of cells (n, 2) and the `straight_line`."""
    path = through_centres(costs, cells, start, goal)
    line = straight_line(costs, start, goal, allow_corner_cutting)
    return path if line is None or path_cost(costs, path) < path_cost(costs, line) else line


def straight_line(
    costs: Costmap, start: Position, goal: Position, allow_corner_cutting: bool = False
) -> Path | None:
    """The line from start to goal, which counts as a grid path beside those over centres.

    It is None if the cells of both do not lie in one row, column or diagonal, if a blocked cell is
    in the way, or if both are centres: then a path over centres is this line.
    """
    from locplan._kernels.rays import segment_cost
    from locplan._kernels.search import bordered_half

    xy = np.array([start[:2], goal[:2]], np.float64)
    cells = np.array([costs.cell_of(start[:2]), costs.cell_of(goal[:2])])
    rows, columns = np.abs(cells[1] - cells[0]).tolist()
    centres = [costs.grid.position(*cell) for cell in cells.tolist()]
    off = np.hypot(*(xy - centres).T).max() > 1e-9 * costs.grid.resolution
    if not off or (rows and columns and rows != columns):
        return None
    # The cells around the line: of a large map only these are looked at.
    corner = np.maximum(cells.min(axis=0) - 1, 0)
    (row, col), (bottom, right) = corner.tolist(), (cells.max(axis=0) + 2).tolist()
    half = bordered_half(costs.density[row:bottom, col:right], 1)
    width = min(right, costs.grid.shape[1]) - col + 2
    ends = np.column_stack(costs.grid.world_to_grid(*xy.T)) - corner + 1
    cost = segment_cost(half, width, *ends[0], *ends[1], allow_corner_cutting)
    return distinct(costs, xy) if np.isfinite(cost) else None


def through_centres(costs: Costmap, cells: Ints, start: Position, goal: Position) -> Path:
    """A path from start over the centres of cells (n, 2) to goal, where it turns.

    Without cells it is the straight line.
    """
    return distinct(costs, np.vstack([start, turning_centres(costs, cells), goal]))


def turning_centres(costs: Costmap, cells: Ints) -> Floats:
    """The centres (k, 2) of the first and the last of the cells, and of those where they turn."""
    direction = np.diff(cells, axis=0)
    turns = np.any(direction[1:] != direction[:-1], axis=1)
    kept = cells[np.concatenate([[True], turns, [True]])] if len(cells) > 1 else cells
    return np.column_stack(costs.grid.grid_to_world(kept[:, 0] + 0.5, kept[:, 1] + 0.5))


def distinct(costs: Costmap, xy: Floats) -> Path:
    """The path over positions (n, 2) [m] without those that repeat the one before."""
    moved = np.hypot(*np.diff(xy, axis=0).T) > 1e-9 * costs.grid.resolution
    moved[-1] |= not moved.any()  # a path has two ends, even in one place
    return Path(xy[np.concatenate([[True], moved])])
