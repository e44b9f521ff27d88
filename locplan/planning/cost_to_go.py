"""One search from the goal, for paths from any number of starts, and places far apart by it."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from locplan._support.kernels.arrays import Array, Bools, Floats, Ints
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE, UNKNOWN
from locplan.planning.costmap import Costmap, check_costs
from locplan.planning.grid import (
    GridPlanner,
    cells_from_flat_indices,
    find_bordered_index,
    iterate_bands,
    make_grid_path,
)
from locplan.planning.path import Path
from locplan.planning.protocol import PlannerResult, Position
from locplan.planning.results import Plan, make_plan
from locplan.planning.robot_fit import describe_ignored_constraints


@dataclass(frozen=True, eq=False, repr=False)
class CostToGo:
    """The least cost from every cell to a goal; made by `plan_field`."""

    costs: Costmap
    """The costmap that was searched."""
    goal: Position
    """Position of the goal in the world [m]."""
    cost: Floats
    """Cost from each cell's centre to the goal's cell, (H, W) [m]; infinite without a path."""
    allow_corner_cutting: bool
    """True if a diagonal step may pass the corner of a blocked cell."""
    _bordered: Floats
    _half: Floats

    def __repr__(self) -> str:
        reached = np.isfinite(self.cost).sum()
        x, y = self.goal[:2]
        return f"CostToGo({self.costs.grid.name or 'map'}, to {x:g},{y:g} m from {reached} cells)"

    def cells(self, start: Position) -> Ints | None:
        """Return the cells of the cheapest path.

        Parameters
        ----------
        start : (x, y)
            Position of the start in the world [m].

        Returns
        -------
        (n, 2) array of int, or None
            Row and column of each cell from the start's to the goal's; None if no path joins them.

        Raises
        ------
        PoseError
            If the start lies outside the map or in a blocked cell.
        """
        from locplan._support.kernels.ways import trace_path

        columns = self.costs.grid.shape[1] + 2
        source = find_bordered_index(self.costs, start, "start")
        if not np.isfinite(self._bordered[source]):
            return None
        flat = trace_path(self._half, columns, self._bordered, source, self.allow_corner_cutting)
        return cells_from_flat_indices(flat[::-1], columns)

    def path(self, start: Position) -> Path | None:
        """Return the grid planner's path of least cost, or None if there is none.

        Parameters
        ----------
        start : (x, y)
            Position of the start in the world [m].

        Raises
        ------
        PoseError
            If the start lies outside the map or in a blocked cell.
        """
        cells = self.cells(start)
        return None if cells is None else self._path_from_cells(cells, start)

    def plan(self, start: Position) -> Plan:
        """Return the path and its metrics, as `locplan.plan` gives them with the grid planner.

        Parameters
        ----------
        start : (x, y)
            Position of the start in the world [m].

        Returns
        -------
        Plan
            The plan, with status "unreachable" if no path joins start and goal.

        Raises
        ------
        PoseError
            If the start lies outside the map or in a blocked cell.
        """
        began = time.perf_counter()
        cells, planner_result = self.cells(start), PlannerResult(status="unreachable")
        if cells is not None:
            note = describe_ignored_constraints("grid", self.costs.robot)
            planner_result = PlannerResult(self._path_from_cells(cells, start), note=note)
        return make_plan(
            "grid", self.costs, start, self.goal, planner_result, time.perf_counter() - began
        )

    def _path_from_cells(self, cells: Ints, start: Position) -> Path:
        """Return the path over cells (n, 2) from a start."""
        return make_grid_path(self.costs, cells, start, self.goal, self.allow_corner_cutting)


def plan_field(costs: Costmap, goal: Position, *, allow_corner_cutting: bool = False) -> CostToGo:
    """Search from the goal once; then paths from any start take microseconds.

    Parameters
    ----------
    costs : Costmap
        The costmap to search.
    goal : (x, y)
        Position of the goal in the world [m].
    allow_corner_cutting : bool, default False
        True lets a diagonal step pass the corner of a blocked cell. Set it to compare with a
        planner that does so.

    Returns
    -------
    CostToGo
        The cost from every cell to the goal, and the paths there.

    Raises
    ------
    PoseError
        If the goal lies outside the map or in a blocked cell.

    Examples
    --------
    >>> from locplan.maps import FREE, OccupancyGrid
    >>> costs = Costmap.blank(OccupancyGrid(np.full((4, 4), FREE), resolution=1.0))
    >>> to_goal = plan_field(costs, (3.5, 3.5))
    >>> to_goal.cost[0].round(2).tolist()
    [4.24, 3.83, 3.41, 3.0]
    >>> to_goal.path((0.5, 2.5)).xy.tolist()
    [[0.5, 2.5], [2.5, 2.5], [3.5, 3.5]]
    """
    from locplan._support.kernels.search import compute_shortest_costs, make_bordered_half_density

    check_costs(costs)
    GridPlanner().prepare()
    rows, columns = costs.grid.shape[0] + 2, costs.grid.shape[1] + 2
    half = make_bordered_half_density(costs.density, 1)
    target = find_bordered_index(costs, goal, "goal")
    bordered = compute_shortest_costs(half, columns, target, -1, allow_corner_cutting)
    cost = bordered.reshape(rows, columns)[1:-1, 1:-1] * costs.grid.resolution
    return CostToGo(costs, goal, cost, allow_corner_cutting, bordered, half)


MAX_ROOM_CELLS = 1_000_000
"""Most cells of the grid on which distances are measured; larger rooms are coarsened to it."""
DEEP = 256
"""Depth in a room, counted in cells, from which on it matters no more in large rooms."""


@dataclass(frozen=True)
class NamedPlace:
    """A place that suits as a start or a goal."""

    name: str
    """Name: A, B, C and so on."""
    x: float
    """World x [m], rounded as far as the place stays in its room."""
    y: float
    """World y [m], rounded likewise."""
    room: int
    """Number of the room, from 1 on."""

    @property
    def position_argument(self) -> str:
        """The position as the command line takes it [m]."""
        return f"{self.x!r},{self.y!r}"


@dataclass(frozen=True)
class PlacePair:
    """Two places of one room."""

    start: NamedPlace
    """One place."""
    goal: NamedPlace
    """The other."""
    distance: float
    """Length of the shortest path on the grid [m]."""


def find_farthest_pairs(
    grid: OccupancyGrid,
    room_of_cell: Array,
    room: int,
    names: Sequence[str],
    min_distance: float,
    part: Bools | None = None,
) -> list[PlacePair]:
    """Find the places in a room that are farthest apart by path length, as pairs.

    Each further place is the farthest from all previous places, and is paired with the farthest of
    these. The first pair is the farthest apart. Distances are accurate within a few cells; a room
    of more than `MAX_ROOM_CELLS` cells is measured on a coarser grid.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    room_of_cell : (H, W) array of int
        Number of the room that each cell belongs to.
    room : int
        Number of the room.
    names : sequence of str
        Names of the places, at most one for each place; a small room gets fewer places.
    min_distance : float
        Minimum distance of any two places [m].
    part : (H, W) array of bool, optional
        The part of the room that places lie in; paths between them may leave it.
    """
    coarse_room = _CoarseRoom(grid, room_of_cell, room, part)
    place_cells = [
        coarse_room.find_farthest_cell(coarse_room.compute_distances(coarse_room.deepest))
    ]
    distances = [coarse_room.compute_distances(place_cells[0])]
    while len(place_cells) < len(names):
        nearest = np.minimum.reduce(distances)
        place = coarse_room.find_farthest_cell(nearest)
        spacing = 0.2 * distances[0][place_cells[1]] if len(place_cells) > 1 else 0.0
        if nearest[place] <= max(min_distance, spacing):
            break
        place_cells.append(place)
        distances.append(coarse_room.compute_distances(place))
    ends = sorted(
        place_cells[:2], key=coarse_room.find_world_position
    )  # A is the left one of the first pair
    order = [*ends, *place_cells[2:]]
    from_places = [distances[place_cells.index(place)] for place in order]
    places = [
        NamedPlace(name, *coarse_room.find_world_position(place), room)
        for name, place in zip(names, order, strict=False)
    ]
    pairs = []
    for n, place in enumerate(order[1:], 1):
        before = max(range(n), key=lambda k: float(from_places[k][place]))
        pairs.append(PlacePair(places[before], places[n], float(from_places[before][place])))
    return pairs


class _CoarseRoom:
    """A room on a grid that is coarse enough to measure distances on quickly.

    Its cells are counted row by row; a coarse cell is free if any of its cells is in the room.
    """

    def __init__(
        self, grid: OccupancyGrid, room_of_cell: Array, room: int, part: Bools | None
    ) -> None:
        import cv2

        self._grid, self._room_of_cell, self._room = grid, room_of_cell, room
        inside = room_of_cell == room
        (top, bottom), (left, right) = (
            np.flatnonzero(inside.any(axis=axis))[[0, -1]].tolist() for axis in (1, 0)
        )
        rows, cols = bottom + 1 - top, right + 1 - left
        factor = math.ceil(math.sqrt(rows * cols / MAX_ROOM_CELLS))
        self._top, self._left, self._factor = top, left, factor
        coarse = -(-rows // factor), -(-cols // factor)
        deepest, self._place = np.empty(coarse, np.float32), np.empty(coarse, np.int64)
        inside = inside[top : bottom + 1, left : right + 1]
        for band, around, inner in iterate_bands(
            coarse[0], coarse[1] * factor**2, -(-DEEP // factor)
        ):
            inside_band = inside[around.start * factor : around.stop * factor]
            # With a border, which is outside; in large rooms it ends depths beyond `DEEP`.
            height, width = factor * (around.stop - around.start), factor * coarse[1]
            bordered = np.zeros((height + 2, width + 2), np.uint8)
            bordered[1 : len(inside_band) + 1, 1 : cols + 1] = inside_band
            depth = np.asarray(cv2.distanceTransform(bordered, cv2.DIST_L2, cv2.DIST_MASK_5))[
                1:-1, 1:-1
            ]
            blocks = depth.reshape(-1, factor, coarse[1], factor)[inner].swapaxes(1, 2)
            blocks = blocks.reshape(-1, coarse[1], factor**2)
            deepest[band], self._place[band] = blocks.max(axis=2), blocks.argmax(axis=2)
        self._depth = deepest.ravel() * grid.resolution
        free = self._depth > 0
        cells = np.where(free, FREE, UNKNOWN).astype(np.uint8).reshape(coarse)
        edge = grid.resolution * factor
        self._costs = Costmap.blank(OccupancyGrid(cells, edge), robot=0.0)
        # A place keeps half a metre from all that the robot must not touch, where the room allows.
        suits = free if part is None else free & self._mark_part(part)
        self._clear = suits & (self._depth >= min(float(np.median(self._depth[suits])), 0.5))
        self.deepest = int(np.where(suits, self._depth, -1.0).argmax())

    def _mark_part(self, part: Bools) -> Bools:
        """Mark the coarse cells whose deepest cell lies in a part of the map, flat."""
        coarse_rows, coarse_cols = np.indices(self._place.shape)
        deep_rows, deep_cols = np.divmod(self._place, self._factor)
        rows = self._top + coarse_rows * self._factor + deep_rows
        cols = self._left + coarse_cols * self._factor + deep_cols
        height, width = part.shape
        return np.asarray(part[np.minimum(rows, height - 1), np.minimum(cols, width - 1)]).ravel()

    def compute_distances(self, coarse_cell: int) -> Floats:
        """Return the length of the shortest path from a cell to every cell, flat [m]."""
        row, col = divmod(coarse_cell, self._costs.grid.shape[1])
        xy = self._costs.grid.position(row, col)
        return plan_field(self._costs, xy).cost.ravel()

    def find_farthest_cell(self, distance: Floats) -> int:
        """Return the clearest of the cells that are almost as far as the farthest clear one."""
        reached = np.where(self._clear, distance, -1.0)
        far = np.flatnonzero(reached >= 0.95 * reached.max())
        return int(far[np.lexsort((-reached[far], -self._depth[far]))[0]])

    def find_world_position(self, coarse_cell: int) -> tuple[float, float]:
        """Return x, y [m] of a coarse cell's deepest cell, rounded if that stays in the room."""
        row, col = divmod(coarse_cell, self._costs.grid.shape[1])
        deep_row, deep_col = divmod(int(self._place[row, col]), self._factor)
        row = self._top + row * self._factor + deep_row
        col = self._left + col * self._factor + deep_col
        x, y = self._grid.position(row, col)
        for decimals in range(1, 6):
            rounded = round(x, decimals) + 0.0, round(y, decimals) + 0.0
            cell = self._grid.cell(rounded)
            if self._grid.contains(*cell) and self._room_of_cell[cell] == self._room:
                return rounded
        return x, y
