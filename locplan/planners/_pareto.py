"""The best trade-offs of length against an integral along the path: all, or one within a budget."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import numpy as np

from locplan._kernels.arrays import Floats, Ints
from locplan._util.checks import number
from locplan._util.tables import rounded_up
from locplan.costs import Costmap, check_costs
from locplan.planners._grid import cells_of
from locplan.planners._grid_paths import through_centres
from locplan.planners._protocol import Found, Position
from locplan.planners._result import ParetoFront
from locplan.planners._trade_offs import (
    GAIN,
    OutOfTime,
    Problem,
    Search,
    check_front_limits,
    prepare,
)


@dataclass(frozen=True)
class BudgetPlanner:
    """This planner finds the shortest grid path whose integral of u or e is within a budget.

    The path is exact: Lagrangian bounds keep a bi-objective search small. An integral is within
    the budget if it exceeds it by no more than 1e-9 of the layer's greatest value on the map times
    the length of the path of least integral. So each path of a `ParetoFront` is found again by its
    own integral, be it the front's or the metrics'.
    """

    budget: float
    """Maximum integral of u [m], or of e [m^2 rad m], >= 0."""
    objective: Literal["u", "e"] = "u"
    """The layer that is integrated: "u" gives degenerate metres [m], "e" the paper's
    number [m^2 rad m]."""
    allow_corner_cutting: bool = False
    """True lets a diagonal step pass the corner of a blocked cell; set it to compare with a planner
    that does so."""
    time_limit: float = 60.0
    """Time after which the best path so far is returned, with its bound [s]; above 0."""
    max_labels: int = 20_000_000
    """Maximum number of partial paths that are kept, above 0; each takes 48 bytes. Lower it where
    memory is short."""
    name: ClassVar[str] = "grid"
    minimises: ClassVar[str] = "length"
    space: ClassVar[str] = "R2"

    def check(self) -> None:
        """Raise a ConfigError unless the options are within their ranges."""
        number("budget", self.budget, 0)
        check_front_limits(self.objective, self.time_limit, self.max_labels)

    def prepare(self) -> None:
        """Compile the kernels, so that no time limit is spent on that."""
        prepare()

    def solve(self, costs: Costmap, start: Position, goal: Position) -> Found:
        """Plan between two world positions [m] in free cells.

        See `locplan.planners.Planner.solve`. The status is "infeasible", with the least budget that
        would do, if no grid path is within the budget.

        Raises
        ------
        PoseError
            If start or goal lies outside the map or in a blocked cell.
        ConfigError
            If the costmap has no field.
        """
        began = time.perf_counter()
        cutting, until = self.allow_corner_cutting, began + self.time_limit
        problem = Problem.between(costs, start, goal, self.objective, cutting, until)
        try:
            second_to_go, frugal = problem.to_go(0, 1)
            first_to_go, short = problem.to_go(1, 0)
        except OutOfTime:
            note = f"the bounds of the search take longer than {self.time_limit:g} s on this map"
            return Found(status="timeout", note=note)
        if frugal is None:
            return Found(status="unreachable")
        allowed = (self.budget - problem.ends[1]) * problem.per_integral
        within, line = np.floor(allowed + problem.tolerance(frugal)), problem.line
        if line is not None and line.units[1] <= within:
            return Found(line.path, bound=line.path.length)
        if problem.measured(frugal)[1] > within:
            needed = problem.unrounded(cells_of(frugal, problem.columns))[1]
            if line is not None:
                needed = min(needed, line.measures[1])
            note = (
                f"no path over the grid has an integral of {self.objective} within {self.budget:g};"
                f" the least is {rounded_up(needed)}"
            )
            return Found(status="infeasible", feasible_from=needed, note=note)
        assert short is not None  # because there is a frugal one
        bounds = _lagrangian(problem, first_to_go, short, frugal, within)
        lower = bounds.upper
        if bounds.upper > bounds.lower:
            search = Search(
                problem, first_to_go, second_to_go, self.max_labels, within, bounds.joint
            )
            found, to_come = search.run(1, until)
            if found.size:
                path = through_centres(costs, search.cells_of(int(found[0])), start, goal)
                return Found(path, bound=path.length)
            lower = min(max(to_come, bounds.lower), bounds.upper)
        best = through_centres(costs, cells_of(bounds.best, problem.columns), start, goal)
        return Found(best, bound=min(problem.length(lower), best.length))


@dataclass(frozen=True)
class _Bounds:
    """The bounds that Lagrangian relaxation gives, in whole units."""

    best: Ints
    """The shortest path found so far that is within the budget, as flat indices of cells."""
    upper: float
    """The first cost of `best`."""
    lower: float
    """Minimum first cost that a path within the budget can have."""
    joint: tuple[Floats, float, float]
    """Both costs to go, their multiplier, and the greatest sum of a better path, for `Search`."""


def _lagrangian(
    problem: Problem, first_to_go: Floats, short: Ints, frugal: Ints, within: float
) -> _Bounds:
    """Raise the multiplier to where the bound is greatest (Handler and Zang, 1980)."""
    beyond_first, beyond_second = problem.measured(short)
    if beyond_second <= within:
        return _Bounds(short, beyond_first, beyond_first, (first_to_go, 0.0, np.inf))
    best, (best_first, best_second) = frugal, problem.measured(frugal)
    lower, joint = beyond_first, (first_to_go, 0.0, np.inf)
    while True:
        multiplier = (best_first - beyond_first) / (beyond_second - best_second)
        try:
            both_to_go, cells = problem.to_go(1, multiplier)
        except OutOfTime:
            return _Bounds(best, best_first, lower, joint)
        assert cells is not None
        lower = max(lower, both_to_go[problem.source] - multiplier * within)
        first, second = problem.measured(cells)
        line = beyond_first + multiplier * beyond_second
        closer = line - (first + multiplier * second) > GAIN * line
        if second <= within and first < best_first:
            best, best_first, best_second = cells, first, second
        elif within < second < beyond_second:
            beyond_first, beyond_second = first, second
        else:
            closer = False
        if not closer:  # no path lies below the line between the two
            joint = both_to_go, multiplier, best_first + multiplier * within
            return _Bounds(best, best_first, lower, joint)


SUPPORTED = 24
"""Number of paths of least weighted sums that complete a front whose search was cut short."""
Point: TypeAlias = tuple[float, float, Ints]
"""Both costs of a path in whole units, and its cells (n, 2)."""


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

    The paths are those of the grid planner: from the start to the centre of its cell, over
    centres, and to the goal; or straight to the goal, where the cells of both lie in one row,
    column or diagonal. So each of the grid planner's paths, with any weight, is on the front, or
    is dominated by one that is.

    Where time or labels run out, paths of least weighted sums complete the front, and `epsilon`
    says how good it is for certain. Before the exact search come two searches over all cells, for
    the front's ends; if the time does not suffice for these, the front is empty, with the status
    "timeout".

    Parameters
    ----------
    costs : Costmap
        Costmap made from a field; its weight does not matter.
    start, goal : (x, y)
        Positions in the world [m].
    objective : str, default "u"
        The layer to integrate: "u" gives degenerate metres [m], "e" gives [m^2 rad m].
    allow_corner_cutting : bool, default False
        True lets a diagonal step pass the corner of a blocked cell. Set it to compare with a
        planner that does so.
    time_limit : float, default 30.0
        Time for all searches together [s], above 0; of it, at most a quarter is kept for
        completing the front. It may be exceeded by a tenth of a second. Raise it on a large map
        where `epsilon` is above 0.
    max_labels : int, default 20_000_000
        Maximum number of partial paths that are kept, above 0; each takes 48 bytes. Lower it
        where memory is short.

    Returns
    -------
    ParetoFront
        The front, empty if the goal is unreachable or time ran out at once. Its lengths and
        integrals are those of the plans' metrics. Paths that lower the integral by no more than
        1e-9 of the layer's greatest value times the length of the path of least integral are left
        out, which is also how far a path may exceed a budget.

    Raises
    ------
    PoseError
        If start or goal lies outside the map or in a blocked cell.
    ConfigError
        If an option is out of its range, or the costmap has no field.
    """
    check_costs(costs)
    check_front_limits(objective, time_limit, max_labels)
    prepare()
    began = time.perf_counter()
    until = began + time_limit
    problem = Problem.between(costs, start, goal, objective, allow_corner_cutting, until)
    searching = time.perf_counter()
    points: list[Point] = []
    epsilon, labels = 0.0, 0
    short = frugal = None
    try:
        second_to_go, frugal = problem.to_go(0, 1)
        first_to_go, short = problem.to_go(1, 0)
    except OutOfTime:
        epsilon = math.inf
    if short is not None and frugal is not None:
        search = Search(problem, first_to_go, second_to_go, max_labels=max_labels)
        completing = SUPPORTED * (time.perf_counter() - searching) / 2
        completing = min(completing, time_limit / 4)
        found, to_come = search.run(100_000, until - completing)
        labels = search.labels
        for label, first, second in zip(found, *search.costs_of(found), strict=True):
            points.append((float(first), float(second), search.cells_of(int(label))))
        if problem.line is not None:
            points.append((*problem.line.units, np.empty((0, 2), np.int64)))
        exact = math.isinf(to_come)
        bounds = [] if exact else _weighted_sums(problem, points, short, frugal)
        longest = problem.measured(frugal)[0]
        points = _undominated(points, longest, problem.tolerance(frugal))
        epsilon = 0.0 if exact else _epsilon(points, to_come, second_to_go[problem.source], bounds)
    measures = np.reshape([problem.unrounded(cells) for *_, cells in points], (-1, 2))
    return ParetoFront(
        costs=costs,
        start=start,
        goal=goal,
        objective=objective,
        length=measures[:, 0],
        integral=measures[:, 1],
        epsilon=epsilon,
        labels=labels,
        solve_time=time.perf_counter() - began,
        cells=tuple(cells for *_, cells in points),
    )


def _undominated(points: list[Point], longest: float, tolerance: float) -> list[Point]:
    """The points that no other dominates, by rising first cost up to `longest`.

    A second cost must be less than that of every shorter path by more than the tolerance, so that
    a budget of that much never lets one of them in.
    """
    best: list[Point] = []
    least = math.inf
    for point in sorted(points, key=lambda point: point[:2]):
        if point[0] <= longest and point[1] < least - tolerance:
            best.append(point)
        least = min(least, point[1])
    return best


def _epsilon(
    points: list[Point], to_come: float, min_second: float, bounds: list[tuple[float, float]]
) -> float:
    """The greatest relative gain over all points of a path that may have been missed.

    Its first cost is at least `to_come`, its second at least `min_second`, and first +
    multiplier * second at least value, for each (multiplier, value) of `bounds`.
    """
    first, second = (np.array([point[i] for point in points]) for i in (0, 1))
    edges = np.linspace(min(to_come, first[-1]), first[-1], 4001)
    below = np.full(edges.size, float(min_second))
    for multiplier, value in bounds:
        below = np.maximum(below, (value - edges) / multiplier)
    # From one edge to the next the bound on the second cost falls; both ends count at worst.
    over_first = first[:, None] / np.maximum(edges[None, :-1], 1e-300)
    over_second = np.maximum(second[:, None], 1e-9) / np.maximum(below[None, 1:], 1e-9)
    worst = np.maximum(over_first, over_second).min(axis=0).max()
    return max(0.0, float(worst) - 1)


def _weighted_sums(
    problem: Problem, points: list[Point], short: Ints, frugal: Ints
) -> list[tuple[float, float]]:
    """Add paths of least weighted sums to the points, the widest gaps first.

    For each (multiplier, value) that is returned, all paths have first + multiplier * second of at
    least value.
    """
    bounds: list[tuple[float, float]] = []
    left, right = problem.measured(short), problem.measured(frugal)
    points.append((*left, cells_of(short, problem.columns)))
    points.append((*right, cells_of(frugal, problem.columns)))
    gaps = [(left, right)]
    while gaps and len(bounds) < SUPPORTED and not (bounds and time.perf_counter() > problem.until):
        gaps.sort(key=lambda gap: (gap[1][0] - gap[0][0]) * (gap[0][1] - gap[1][1]))
        left, right = gaps.pop()
        if not (right[0] > left[0] and left[1] > right[1]):
            continue
        multiplier = (right[0] - left[0]) / (left[1] - right[1])
        try:
            to_go, flat = problem.to_go(1, multiplier)
        except OutOfTime:
            break
        assert flat is not None
        bounds.append((multiplier, float(to_go[problem.source])))
        middle = problem.measured(flat)
        line = left[0] + multiplier * left[1]
        if line - (middle[0] + multiplier * middle[1]) > GAIN * line:
            points.append((*middle, cells_of(flat, problem.columns)))
            gaps += [(left, middle), (middle, right)]
    return bounds
