"""The shortest path whose integral stays within a budget."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import number
from locplan.costs import Costmap
from locplan.planners._grid import cells_of, through_centres
from locplan.planners._protocol import Found, Position
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
    """Greatest integral of u [m], or of e [m^2 rad m], >= 0."""
    objective: Literal["u", "e"] = "u"
    """The layer that is integrated: "u" gives degenerate metres [m], "e" the paper's
    number [m^2 rad m]."""
    allow_corner_cutting: bool = False
    """True lets a diagonal step pass the corner of a blocked cell; set it to compare with a planner
    that does so."""
    time_limit: float = 60.0
    """Time after which the best path so far is returned, with its bound [s]; above 0."""
    max_labels: int = 20_000_000
    """Greatest number of partial paths that are kept, above 0; each takes 48 bytes. Lower it where
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
        within = np.floor(allowed + problem.tolerance(frugal))
        if problem.measured(frugal)[1] > within:
            needed = problem.unrounded(cells_of(frugal, problem.columns))[1]
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


def rounded_up(value: float) -> str:
    """A limit as text of six digits that is not below the value, so that it can be typed in."""
    return f"{value * (1 + 1e-5):.6g}"


@dataclass(frozen=True)
class _Bounds:
    """The bounds that Lagrangian relaxation gives, in whole units."""

    best: NDArray[np.int64]
    """The shortest path found so far that is within the budget, as flat indices of cells."""
    upper: float
    """The first cost of `best`."""
    lower: float
    """Least first cost that a path within the budget can have."""
    joint: tuple[NDArray[np.float64], float, float]
    """Both costs to go, their multiplier, and the greatest sum of a better path, for `Search`."""


def _lagrangian(
    problem: Problem,
    first_to_go: NDArray[np.float64],
    short: NDArray[np.int64],
    frugal: NDArray[np.int64],
    within: float,
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
