"""The shortest path whose integral stays within a budget."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.planners._grid import cells_of, through_centres
from locplan.planners._trade_offs import Problem, Search, check_caps, prepare


@dataclass(frozen=True)
class WithinBudget:
    """What `shortest_within` found."""

    path: Path | None
    """The shortest path within the budget, or None if there is none."""
    bound: float
    """No path within the budget is shorter [m]: its own length, unless time or labels ran out."""
    least: float
    """The least integral of any path; infinite if the goal is unreachable."""


def shortest_within(
    costs: Costmap,
    start: Sequence[float],
    goal: Sequence[float],
    budget: float,
    *,
    objective: str = "u",
    allow_corner_cutting: bool = False,
    time_limit: float = 60.0,
    max_labels: int = 20_000_000,
) -> WithinBudget:
    """The shortest grid path whose integral of u [m], or of e [m^2 rad m], is within the budget.

    Exact: Lagrangian bounds first, then a bi-objective search that they keep small. Integrals
    count rounded up by at most 1/131072 of their greatest rate at each step.

    Raises
    ------
    ConfigError
        If the budget is negative, or the costmap has no field.
    """
    check_budget(budget, objective, time_limit, max_labels)
    prepare()
    began = time.perf_counter()
    problem = Problem.between(costs, start, goal, objective, allow_corner_cutting)
    second_to_go, frugal = problem.to_go(0, 1)
    if frugal is None:
        return WithinBudget(None, np.inf, np.inf)
    least = float(problem.integral(problem.measured(frugal)[1]))
    within = np.floor((budget - problem.ends[1]) * problem.per_integral + 1e-3)
    if problem.measured(frugal)[1] > within:
        return WithinBudget(None, np.inf, least)
    first_to_go, short = problem.to_go(1, 0)
    assert short is not None  # as there is a frugal one
    bounds = _lagrangian(problem, first_to_go, short, frugal, within)
    if bounds.gap > 0:
        search = Search(
            problem,
            first_to_go,
            second_to_go,
            within=within,
            both_to_go=bounds.both_to_go,
            multiplier=bounds.multiplier,
            most=bounds.most,
            max_labels=max_labels,
        )
        found, to_come = search.run(1, began + time_limit)
        if found.size:
            path = through_centres(costs, search.cells_of(int(found[0])), start, goal)
            return WithinBudget(path, path.length, least)
        lower = min(max(to_come, bounds.lower), bounds.upper)
    else:
        lower = bounds.upper
    best = through_centres(costs, cells_of(bounds.best, problem.columns), start, goal)
    return WithinBudget(best, min(float(problem.length(lower)), best.length), least)


def check_budget(
    budget: float,
    objective: str = "u",
    time_limit: float = 60.0,
    max_labels: int = 20_000_000,
    allow_corner_cutting: bool = False,
) -> None:
    """Raise a ConfigError unless these arguments of `shortest_within` are within their ranges."""
    if not (isinstance(budget, Real) and budget >= 0):
        raise ConfigError(f"budget must be at least 0, not {budget!r}")
    check_caps(objective, time_limit, max_labels)


@dataclass(frozen=True)
class _Bounds:
    """What Lagrangian relaxation tells, in whole units."""

    best: NDArray[np.int64]
    """The shortest path met that is within the budget."""
    upper: float
    """Its first cost."""
    lower: float
    """No path within the budget costs less."""
    multiplier: float
    both_to_go: NDArray[np.float64]
    most: float
    """Paths that are shorter than `best` and within the budget cost less than this together."""

    @property
    def gap(self) -> float:
        return self.upper - self.lower


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
        return _Bounds(short, beyond_first, beyond_first, 0.0, first_to_go, np.inf)
    best, (best_first, best_second) = frugal, problem.measured(frugal)
    while True:
        multiplier = (best_first - beyond_first) / (beyond_second - best_second)
        both_to_go, cells = problem.to_go(1, multiplier)
        assert cells is not None
        lower = both_to_go[problem.source] - multiplier * within
        first, second = problem.measured(cells)
        gain = beyond_first + multiplier * beyond_second - (first + multiplier * second)
        if second <= within and first < best_first:
            best, best_first, best_second = cells, first, second
        elif second > within:
            beyond_first, beyond_second = first, second
        if gain < 0.5:  # of a unit: no path lies below the line between the two
            most = best_first + multiplier * within
            return _Bounds(best, best_first, lower, multiplier, both_to_go, most)
