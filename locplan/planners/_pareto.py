"""All best trade-offs between the length of a path and the integral of u or e along it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from locplan._util.notebook import Pictured
from locplan.costs import Costmap, check_costs
from locplan.errors import ConfigError
from locplan.planners._grid import cells_of, through_centres
from locplan.planners._protocol import Found, Position
from locplan.planners._result import Plan, finished
from locplan.planners._trade_offs import Problem, Search, check_caps, prepare

SUPPORTED = 24
"""How many paths of least weighted sums complete a front at its caps."""
MAX_POINTS = 100_000
"""Of a front."""


@dataclass(frozen=True, eq=False, repr=False)
class ParetoFront(Pictured):
    """Grid paths of which none is better than another in both length and integral.

    Ordered by length; the last has the least integral.
    """

    costs: Costmap
    """What was planned on."""
    start: Position
    """World position [m]."""
    goal: Position
    """World position [m]."""
    objective: str
    """What is integrated: "u" or "e"."""
    length: NDArray[np.float64]
    """Of each path, (n,) [m]."""
    integral: NDArray[np.float64]
    """Of u [m] or e [m^2 rad m] along each path, (n,)."""
    epsilon: float
    """For every grid path one of these is at most 1 + epsilon times as long and as uncertain.

    Zero if the front is exact, which it is unless time or labels ran out.
    """
    labels: int
    """How many partial paths were kept."""
    solve_time: float
    """Time spent, without compilation [s]."""
    _cells: tuple[NDArray[np.int64], ...]
    _drawn_by: ClassVar[str] = "locplan.plotting:front_figure"

    def __repr__(self) -> str:
        if not len(self):
            return "ParetoFront(no path joins start and goal)"
        exact = "exact" if self.epsilon == 0 else f"within {self.epsilon:.2%}"
        return (
            f"ParetoFront({len(self)} paths of {self.length[0]:.2f} to {self.length[-1]:.2f} m,"
            f" {exact}, knee at {self.length[self.knee]:.2f} m)"
        )

    def _repr_png_(self) -> bytes | None:
        return super()._repr_png_() if len(self) else None

    def __len__(self) -> int:
        return len(self.length)

    def plan(self, index: int) -> Plan:
        """One of the paths, measured."""
        path = through_centres(self.costs, self._cells[index], self.start, self.goal)
        return finished("pareto", self.costs, self.start, self.goal, Found(path), self.solve_time)

    @property
    def knee(self) -> int:
        """Index of the path whose length times integral is least.

        Beyond it a per cent of length saves less than a per cent of the integral.

        Raises
        ------
        ConfigError
            If the front is empty.
        """
        if not len(self):
            raise ConfigError("an empty front has no knee: the goal is unreachable")
        return int(np.argmin(self.length * self.integral))


def pareto_front(
    costs: Costmap,
    start: Position,
    goal: Position,
    *,
    objective: str = "u",
    allow_corner_cutting: bool = False,
    time_limit: float = 30.0,
    max_labels: int = 20_000_000,
) -> ParetoFront:
    """The exact front of length against an integral along the path, over 8 neighbours.

    A path goes from the start to its cell's centre, over centres, and from the last to the goal.
    Where time or labels run out, the front is completed by paths of least weighted sums, and
    `epsilon` says how good it is for certain: their values bound what may have been missed.

    Parameters
    ----------
    costs : Costmap
        Made from a field; its weight has no say here.
    start, goal : (x, y)
        World positions [m].
    objective : "u" or "e"
        Degenerate metres, or the integral of e [m^2 rad m]. Each step counts rounded up by
        at most 1/131072 of the greatest rate.
    allow_corner_cutting : bool
        Whether a diagonal step may pass a blocked cell's corner.
    time_limit : float
        Seconds for the exact search.
    max_labels : int
        Partial paths kept at most, of 48 bytes each.

    Returns
    -------
    ParetoFront
        Empty if the goal is unreachable.

    Raises
    ------
    PoseError
        If start or goal lies outside the map or in a blocked cell.
    ConfigError
        If an option is out of its range, or the costmap has no field.
    """
    check_costs(costs)
    check_caps(objective, time_limit, max_labels)
    prepare()
    began = time.perf_counter()
    problem = Problem.between(costs, start, goal, objective, allow_corner_cutting)
    second_to_go, frugal = problem.to_go(0, 1)
    first_to_go, short = problem.to_go(1, 0)
    front, epsilon, labels = _Front(), 0.0, 0
    if short is not None and frugal is not None:
        search = Search(problem, first_to_go, second_to_go, max_labels=max_labels)
        found, to_come = search.run(MAX_POINTS, began + time_limit)
        labels = search.labels
        for label, first, second in zip(found, *search.costs_of(found), strict=True):
            front.add(float(first), float(second), search.cells_of(int(label)))
        if math.isfinite(to_come):
            bounds = _weighted_sums(problem, front, short, frugal)
            epsilon = front.epsilon(to_come, second_to_go[problem.source], bounds)
    points = front.points()
    length, integral = (np.array([point[i] for point in points]) for i in (0, 1))
    return ParetoFront(
        costs=costs,
        start=start,
        goal=goal,
        objective=objective,
        length=np.asarray(problem.length(length)),
        integral=np.asarray(problem.integral(integral)),
        epsilon=epsilon,
        labels=labels,
        solve_time=time.perf_counter() - began,
        _cells=tuple(cells for *_, cells in points),
    )


class _Front:
    """Points met so far, in whole units."""

    def __init__(self) -> None:
        self._points: list[tuple[float, float, NDArray[np.int64]]] = []

    def add(self, first: float, second: float, cells: NDArray[np.int64]) -> None:
        self._points.append((first, second, cells))

    def points(self) -> list[tuple[float, float, NDArray[np.int64]]]:
        """Those that no other dominates, by rising first cost."""
        best: list[tuple[float, float, NDArray[np.int64]]] = []
        for point in sorted(self._points, key=lambda point: point[:2]):
            if not best or point[1] < best[-1][1]:
                best.append(point)
        return best

    def epsilon(
        self, to_come: float, least_second: float, bounds: list[tuple[float, float]]
    ) -> float:
        """How far at most, relatively, any path is better than all points.

        Parameters
        ----------
        to_come : float
            Paths that may have been missed cost first at least this.
        least_second : float
            And second at least this,
        bounds : list of (multiplier, value)
            and first + multiplier * second at least value.
        """
        first, second = (np.array([point[i] for point in self.points()]) for i in (0, 1))
        edges = np.linspace(min(to_come, first[-1]), first[-1], 4001)
        below = np.full(edges.size, float(least_second))
        for multiplier, value in bounds:
            below = np.maximum(below, (value - edges) / multiplier)
        # From one edge to the next the bound on the second cost falls; both ends count at worst.
        over_first = first[:, None] / np.maximum(edges[None, :-1], 1e-300)
        over_second = np.maximum(second[:, None], 1e-9) / np.maximum(below[None, 1:], 1e-9)
        worst = np.maximum(over_first, over_second).min(axis=0).max()
        return max(0.0, float(worst) - 1)


def _weighted_sums(
    problem: Problem, front: _Front, short: NDArray[np.int64], frugal: NDArray[np.int64]
) -> list[tuple[float, float]]:
    """Add paths of least weighted sums to the front, the widest gaps first.

    Returns
    -------
    list of (multiplier, value)
        No path has a lower sum of its first cost and the multiplier times its second.
    """
    bounds: list[tuple[float, float]] = []
    for cells in (short, frugal):
        front.add(*problem.measured(cells), cells_of(cells, problem.columns))
    gaps = [(problem.measured(short), problem.measured(frugal))]
    while gaps and len(bounds) < SUPPORTED:
        gaps.sort(key=lambda gap: (gap[1][0] - gap[0][0]) * (gap[0][1] - gap[1][1]))
        left, right = gaps.pop()
        if not (right[0] > left[0] and left[1] > right[1]):
            continue
        multiplier = (right[0] - left[0]) / (left[1] - right[1])
        to_go, flat = problem.to_go(1, multiplier)
        assert flat is not None
        bounds.append((multiplier, float(to_go[problem.source])))
        middle = problem.measured(flat)
        if middle[0] + multiplier * middle[1] < left[0] + multiplier * left[1] - 0.5:
            front.add(*middle, cells_of(flat, problem.columns))
            gaps += [(left, middle), (middle, right)]
    return bounds
