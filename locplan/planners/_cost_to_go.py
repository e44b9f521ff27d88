"""One search from the goal, for paths from any number of starts."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap, Path, check_costs
from locplan.planners._grid import GridPlanner, bordered_index, cells_of, through_centres
from locplan.planners._protocol import Found, Position
from locplan.planners._result import Plan, finished


@dataclass(frozen=True, eq=False, repr=False)
class CostToGo:
    """The least cost from every cell to a goal; made by `plan_field`."""

    costs: Costmap
    """The costmap that was searched."""
    goal: Position
    """Position of the goal in the world [m]."""
    cost: NDArray[np.float64]
    """Cost from each cell's centre to the goal's cell, (H, W) [m]; infinite without a path."""
    allow_corner_cutting: bool
    """True if a diagonal step may pass the corner of a blocked cell."""
    _bordered: NDArray[np.float64]
    _half: NDArray[np.float64]

    def __repr__(self) -> str:
        reached = np.isfinite(self.cost).sum()
        x, y = self.goal[:2]
        return f"CostToGo({self.costs.grid.name or 'map'}, to {x:g},{y:g} m from {reached} cells)"

    def cells(self, start: Position) -> NDArray[np.int64] | None:
        """The cells of the cheapest path.

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
        from locplan._kernels.ways import trace

        columns = self.costs.grid.shape[1] + 2
        source = bordered_index(self.costs, start, "start")
        if not np.isfinite(self._bordered[source]):
            return None
        flat = trace(self._half, columns, self._bordered, source, self.allow_corner_cutting)
        return cells_of(flat[::-1], columns)

    def path(self, start: Position) -> Path | None:
        """The path of least cost over the cells' centres, or None if there is none.

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
        return None if cells is None else through_centres(self.costs, cells, start, self.goal)

    def plan(self, start: Position) -> Plan:
        """The path and its metrics, as `locplan.plan` gives them with the grid planner.

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
        cells, found = self.cells(start), Found(status="unreachable")
        if cells is not None:
            found = Found(through_centres(self.costs, cells, start, self.goal, trim=True))
        return finished("grid", self.costs, start, self.goal, found, time.perf_counter() - began)


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
    from locplan._kernels.search import bordered_half, shortest_costs

    check_costs(costs)
    GridPlanner().prepare()
    rows, columns = costs.grid.shape[0] + 2, costs.grid.shape[1] + 2
    half = bordered_half(costs.density, 1)
    target = bordered_index(costs, goal, "goal")
    bordered = shortest_costs(half, columns, target, -1, allow_corner_cutting)
    cost = bordered.reshape(rows, columns)[1:-1, 1:-1] * costs.grid.resolution
    return CostToGo(costs, goal, cost, allow_corner_cutting, bordered, half)
