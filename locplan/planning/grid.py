"""Exact planners on the grid with eight neighbours: Dijkstra, A*, and grid paths."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import check_number
from locplan._support.kernels.arrays import Array, Floats, Ints
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap
from locplan.planning.metrics import path_cost
from locplan.planning.path import Path
from locplan.planning.protocol import PlannerResult, Position

if TYPE_CHECKING:
    from locplan._support.kernels.search import CostScale


def make_grid_path(
    costs: Costmap, cells: Ints, start: Position, goal: Position, allow_corner_cutting: bool = False
) -> Path:
    """Return the path over the centres of cells (n, 2), or the straight line if it costs less."""
    path = make_path_through_centres(costs, cells, start, goal)
    line = find_straight_line(costs, start, goal, allow_corner_cutting)
    return path if line is None or path_cost(costs, path) < path_cost(costs, line) else line


def find_straight_line(
    costs: Costmap, start: Position, goal: Position, allow_corner_cutting: bool = False
) -> Path | None:
    """Return the line from start to goal, which counts as a grid path as paths over centres do.

    It is None if the cells of both do not lie in one row, column or diagonal, if a blocked cell is
    in the way, or if both are centres: then a path over centres is this line.
    """
    from locplan._support.kernels.rays import compute_segment_cost
    from locplan._support.kernels.search import make_bordered_half_density

    xy = np.array([start[:2], goal[:2]], np.float64)
    cells = np.array([costs.find_cell(start[:2]), costs.find_cell(goal[:2])])
    rows, columns = np.abs(cells[1] - cells[0]).tolist()
    centres = [costs.grid.position(*cell) for cell in cells.tolist()]
    off = np.hypot(*(xy - centres).T).max() > 1e-9 * costs.grid.resolution
    if not off or (rows and columns and rows != columns):
        return None
    # The cells around the line: of a large map only these are looked at.
    corner = np.maximum(cells.min(axis=0) - 1, 0)
    (row, col), (bottom, right) = corner.tolist(), (cells.max(axis=0) + 2).tolist()
    half = make_bordered_half_density(costs.density[row:bottom, col:right], 1)
    width = min(right, costs.grid.shape[1]) - col + 2
    ends = np.column_stack(costs.grid.world_to_grid(*xy.T)) - corner + 1
    cost = compute_segment_cost(half, width, *ends[0], *ends[1], allow_corner_cutting)
    return drop_repeated_positions(costs, xy) if np.isfinite(cost) else None


def make_path_through_centres(costs: Costmap, cells: Ints, start: Position, goal: Position) -> Path:
    """Return a path from start over the centres of cells (n, 2) to goal, reduced to its turns.

    Without cells it is the straight line.
    """
    return drop_repeated_positions(
        costs, np.vstack([start, find_turning_centres(costs, cells), goal])
    )


def find_turning_centres(costs: Costmap, cells: Ints) -> Floats:
    """Return the centres (k, 2) of the first and last cell, and of the cells at turns."""
    direction = np.diff(cells, axis=0)
    turns = np.any(direction[1:] != direction[:-1], axis=1)
    turning_cells = cells[np.concatenate([[True], turns, [True]])] if len(cells) > 1 else cells
    return np.column_stack(
        costs.grid.grid_to_world(turning_cells[:, 0] + 0.5, turning_cells[:, 1] + 0.5)
    )


def drop_repeated_positions(costs: Costmap, xy: Floats) -> Path:
    """Return the path over positions (n, 2) [m], without repeated positions."""
    is_new = np.hypot(*np.diff(xy, axis=0).T) > 1e-9 * costs.grid.resolution
    is_new[-1] |= not is_new.any()  # a path has two ends, even in one place
    return Path(xy[np.concatenate([[True], is_new])])


GUIDED_CONTRAST = 12.0
"""Maximum contrast, the mean density of free cells over the least one, at which A* is taken.

Time of A* over that of Dijkstra's algorithm, 4 random queries on each of 24 real maps, u smooth or
rising with the distance from walls: 0.44 and 0.35 at contrast 1 (30 and 18 % of the expansions),
0.54 at about 1.4, 0.75 and 0.69 at 2.6, 0.89 and 0.72 at about 4; 0.98 in the first, above 12 in
single maps up to 1.05. From corner to corner through rooms, where nearly all cells are expanded,
it is 0.49 at contrast 1, 0.84 at 1.2, and 1.06 to 1.09 from 1.5 on.
"""
BAND_CELLS = 2**23
"""Number of cells of a large map that are looked at at once."""


@dataclass(frozen=True, eq=False)
class PaddedCostmap:
    """A costmap as the kernels of searches take it; it can serve for several of them."""

    half: Floats
    """Half of each cell's density, flat, with a blocked border of one cell."""
    columns: int
    """Number of columns with the border."""
    scale: CostScale
    """The scale of the costs."""

    @classmethod
    def from_costmap(cls, costs: Costmap) -> PaddedCostmap:
        """Prepare a costmap.

        Parameters
        ----------
        costs : Costmap
            The costmap.
        """
        from locplan._support.kernels.search import make_bordered_half_density, measure_cost_scale

        half = make_bordered_half_density(costs.density, 1)
        return cls(half, costs.grid.shape[1] + 2, measure_cost_scale(half))

    def unflatten(self, flat: Ints) -> Ints:
        """Return the rows and columns of cells, (n, 2).

        Parameters
        ----------
        flat : (n,) array of int
            Indices of the cells in `half`.
        """
        return cells_from_flat_indices(flat, self.columns)


@dataclass(frozen=True)
class GridPlanner:
    """This planner finds the path of least cost over the centres of neighbouring cells.

    The path leads from the start to the centre of its cell, over centres, and to the goal; or
    straight to the goal if both cells lie in one row, column or diagonal.

    It searches with A* or Dijkstra's algorithm, whichever is quicker at the map's contrast. Both
    are exact and find the same path: where several cost the same, the same one of them.
    """

    allow_corner_cutting: bool = False
    """True lets a diagonal step pass the corner of a blocked cell; set it to compare with a planner
    that does so."""
    name: ClassVar[str] = "grid"
    minimises: ClassVar[str] = "J"
    space: ClassVar[str] = "R2"
    guided: ClassVar[bool | None] = None
    """True for A*, False for Dijkstra's algorithm, None for the one that suits the map."""

    def check(self) -> None:
        """Accept all options, since every combination is valid."""

    def prepare(self) -> None:
        """Compile the search, so that the first plan is not timed with it."""
        self.solve(make_blank_costs(1, 3), (0.5, 0.5), (2.5, 0.5))

    def solve(self, costs: Costmap, start: Position, goal: Position) -> PlannerResult:
        """Plan between two world positions [m] in free cells; the path has exactly these ends.

        See `locplan.planning.Planner.solve`.
        """
        cells, expanded = find_cheapest_cells(
            costs, start, goal, self.allow_corner_cutting, guided=self.guided
        )
        if cells is None:
            return PlannerResult(status="unreachable", expanded=expanded)
        path = make_grid_path(costs, cells, start, goal, self.allow_corner_cutting)
        return PlannerResult(path, expanded=expanded)


@dataclass(frozen=True)
class AStar(GridPlanner):
    """This planner finds the grid planner's path with A*.

    The octile distance times the least density on the map leads it to the goal. That is quicker
    if the density varies little or the goal is near, and up to a tenth slower otherwise.

    Examples
    --------
    >>> from locplan.planning import plan
    >>> costs = make_blank_costs(9, 9)
    >>> plan(costs, (0.5, 4.5), (8.5, 4.5), planner="astar").expanded
    21
    >>> plan(costs, (0.5, 4.5), (8.5, 4.5), planner="dijkstra").expanded
    69
    """

    name: ClassVar[str] = "astar"
    guided: ClassVar[bool | None] = True


@dataclass(frozen=True)
class Dijkstra(GridPlanner):
    """This planner finds the grid planner's path with Dijkstra's algorithm."""

    name: ClassVar[str] = "dijkstra"
    guided: ClassVar[bool | None] = False


def make_blank_costs(rows: int, columns: int) -> Costmap:
    """Return a small free costmap with cells of 1 m, to compile the kernels on."""
    from locplan.maps.grid import OccupancyGrid
    from locplan.maps.occupancy import FREE

    return Costmap.blank(OccupancyGrid(np.full((rows, columns), FREE), 1.0))


def find_cheapest_cells(
    costs: Costmap,
    start: Position,
    goal: Position,
    allow_corner_cutting: bool,
    *,
    guided: bool | None = None,
    bordered: PaddedCostmap | None = None,
    check: Callable[[], None] | None = None,
) -> tuple[Ints | None, int]:
    """Return the cells (n, 2) of (row, col) of the cheapest path, None if there is none.

    The second value is the number of expansions. For `guided` see `GridPlanner`; `bordered` is the
    prepared costmap. `check` is called from time to time; an exception from it ends the search.
    """
    from locplan._support.kernels.search import search_grid
    from locplan._support.kernels.ways import trace_path

    source, target = find_bordered_end_indices(costs, start, goal)
    bordered = bordered or PaddedCostmap.from_costmap(costs)
    half, columns, scale = bordered.half, bordered.columns, bordered.scale
    if guided is None:
        guided = scale.mean <= GUIDED_CONTRAST * scale.cheapest
    ways = half, columns, source, target, allow_corner_cutting
    cost, expanded, _ = search_grid(*ways, scale, guided=guided, check=check)
    if not np.isfinite(cost[target]):
        return None, expanded
    flat = trace_path(half, columns, cost, target, allow_corner_cutting)
    return cells_from_flat_indices(flat, columns), expanded


def label_connected_parts(costs: Costmap) -> tuple[int, NDArray[np.int32]]:
    """Find the connected parts of a costmap's free cells, without cutting corners.

    Parameters
    ----------
    costs : Costmap
        The costmap.

    Returns
    -------
    count : int
        Number of parts, and one for the blocked cells.
    labels : (H, W) array of int32
        Number of the part of each cell; 0 if it is blocked.
    """
    import cv2

    count, labels = cv2.connectedComponents(np.isfinite(costs.density).astype("u1"), connectivity=4)
    return count, labels


def iterate_bands(rows: int, cols: int, overlap: int) -> Iterator[tuple[slice, slice, slice]]:
    """Iterate over bands of rows of a large array, so that work on each takes little memory.

    Parameters
    ----------
    rows, cols : int
        Shape of the array.
    overlap : int
        Number of rows that are read beyond each band.

    Yields
    ------
    band, around, inner : slice
        The rows of a band, the rows with the overlap, and the band's rows within these.
    """
    height = max(BAND_CELLS // cols, 1)
    for top in range(0, rows, height):
        bottom, first = min(top + height, rows), max(top - overlap, 0)
        around = slice(first, min(bottom + overlap, rows))
        yield slice(top, bottom), around, slice(top - first, bottom - first)


def find_map_parts(grid: OccupancyGrid, robot_radius: float) -> tuple[Floats, Array]:
    """Find the connected parts of a map that a robot can reach, in little memory.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    robot_radius : float
        Minimum distance from the robot's centre to an occupied cell [m].

    Returns
    -------
    cells : (n,) array
        Number of cells of each part, the parts in the order of their first cells by bands.
    labels : (H, W) array of the smallest unsigned type
        Number of the part of each cell, from 1 on; 0 if it is blocked.
    """
    import cv2
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    check_number("robot_radius", robot_radius, 0, 1e9)  # as a costmap does
    rows, cols = grid.shape
    near = math.ceil(robot_radius / grid.resolution) + 1
    free = np.empty(grid.shape, np.uint8)
    for band, around, inner in iterate_bands(rows, cols, near):
        part = OccupancyGrid(grid.cells[around], grid.resolution)
        free[band] = np.isfinite(Costmap.blank(part, robot=robot_radius).density[inner])

    def label_bands() -> Iterator[tuple[slice, int, NDArray[np.int32]]]:
        """Label the parts of each band; yield its rows, number of labels with 0, and labels."""
        for band, _, _ in iterate_bands(rows, cols, 0):
            yield band, *cv2.connectedComponents(free[band], connectivity=4)

    # Parts of a band are one where they touch across the seam to the next band.
    sizes, seams, above, total = [], [], np.zeros(cols, np.int64), 0
    for _, count, labels in label_bands():
        sizes.append(np.bincount(labels.ravel(), minlength=count)[1:])
        first, last = (np.where(row > 0, row + total, 0) for row in labels[[0, -1]].astype(int))
        touching = (above > 0) & (first > 0)
        seams.append(np.unique([above[touching], first[touching]], axis=1) - 1)
        above, total = last, total + count - 1
    pairs = np.concatenate(seams, axis=1)
    adjacency = coo_array((np.ones(pairs.shape[1], bool), pairs), (total, total))
    count, part_of = connected_components(adjacency, directed=False) if total else (0, pairs[0])
    cells = np.bincount(part_of, np.concatenate(sizes), count).astype(np.float64)
    number_of, before = part_of + 1, 0
    part_map = np.empty(grid.shape, np.min_scalar_type(count))
    for band, count, labels in label_bands():
        band_numbers = number_of[before : before + count - 1]
        part_map[band] = np.concatenate([[0], band_numbers]).astype(part_map.dtype)[labels]
        before += count - 1
    return cells, part_map


def find_bordered_end_indices(
    costs: Costmap, start: Position, goal: Position, border: int = 1
) -> tuple[int, int]:
    """Return the flat indices, in a grid with a border, of the start's and the goal's cell."""
    source = find_bordered_index(costs, start, "start", border)
    return source, find_bordered_index(costs, goal, "goal", border)


def find_bordered_index(costs: Costmap, xy: Position, role: str, border: int = 1) -> int:
    """Return the flat index, in a grid with a border, of the cell at a world position.

    Parameters
    ----------
    costs : Costmap
        The costmap.
    xy : (x, y)
        A free world position [m].
    role : str
        Name of the position in errors, such as "start".
    border : int, default 1
        Width of the border [cells].
    """
    row, col = costs.find_cell(xy, role)
    return (row + border) * (costs.grid.shape[1] + 2 * border) + col + border


def cells_from_flat_indices(flat: Ints, columns: int, border: int = 1) -> Ints:
    """Return the cells (n, 2) of (row, col) at flat indices in a grid with a border."""
    return np.column_stack([flat // columns - border, flat % columns - border])
