"""The limits of a search, and the best costs seen during it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from locplan._support.checks import check_integer, check_positive
from locplan._support.progress import ProgressCallback
from locplan.planning.ompl.kinds import KINDS, PlannerKind

PROGRESS_INTERVAL = 512
"""Iterations from one report of progress to the next."""


def format_capable_planners(fits: Callable[[PlannerKind], bool]) -> str:
    """Return the names of the planners of the kinds that fit, for messages."""
    return ", ".join(name for name, kind in KINDS.items() if fits(kind))


OPTIMAL = 1e-6
"""A path this close to the straight line's length, relatively, ends a search.

The ellipse of informed sampling then has no area; some planners would seek samples in it forever.
"""


@dataclass
class SearchLimits:
    """The limits of a search, all positive, and the best costs found during it."""

    time_limit: float | None = None
    """Time after which the search ends [s], above 0; 5 unless iterations are given."""
    iterations: int | None = None
    """Number of times that OMPL's planner asks whether to go on, at least 1; most ask once an
    iteration. By default they are not limited."""
    convergence: float | None = None
    """The search ends when J fell by less than this share, above 0, over the latter half of
    iterations; by default it goes on to its limit."""
    progress: ProgressCallback | None = None
    """Function called with the part of the limit used up and the limit, in ms or iterations; none
    by default."""
    history: list[tuple[float, float]] = field(default_factory=list)
    """Time since the start [s] and the best J [m], whenever it was seen to fall."""

    def __post_init__(self) -> None:
        for name, unit in (("time_limit", "seconds"), ("convergence", "")):
            if getattr(self, name) is not None:
                check_positive(name, getattr(self, name), unit)
        if self.iterations is not None:
            check_integer("iterations", self.iterations)
        if self.time_limit is None and self.iterations is None:
            self.time_limit = 5.0

    def description(self) -> str:
        """Return the limits as a text for people."""
        seconds = [] if self.time_limit is None else [f"{self.time_limit:g} s"]
        counted = [] if self.iterations is None else [f"{self.iterations:,} iterations"]
        return " and ".join(seconds + counted)

    def make_stop_condition(
        self,
        best_cost: Callable[[], float] | None = None,
        *,
        share: float = 1.0,
        settled_after: int = 1000,
    ) -> Callable[[], bool]:
        """Make the function by which OMPL decides at every iteration whether to end this search.

        Parameters
        ----------
        best_cost : callable, optional
            Function without arguments that returns the best J so far [m]; without it there is no
            history, and no search converges.
        share : float, default 1.0
            Share of the time limit that counts, 0..1.
        settled_after : int, default 1000
            Minimum number of iterations before a search has converged.

        Returns
        -------
        callable
            Function without arguments that returns True if the search is to end.
        """
        time_limit = math.inf if self.time_limit is None else share * self.time_limit
        max_iterations = math.inf if self.iterations is None else self.iterations
        began, iteration = time.perf_counter(), 0
        best: list[tuple[int, float]] = [(0, math.inf)]

        def has_converged() -> (
            bool
        ):  # J fell by less than a share over the latter half of iterations
            if self.convergence is None:
                return False
            earlier = next(cost for at, cost in reversed(best) if at <= iteration / 2)
            return best[-1][1] > earlier * (1 - self.convergence)

        def must_end() -> bool:
            nonlocal iteration
            iteration += 1
            elapsed = time.perf_counter() - began
            if iteration % 8 == 0:  # a look at the best cost takes longer than an iteration
                if best_cost and (cost := best_cost()) < best[-1][1]:
                    best.append((iteration, cost))
                    self.history.append((elapsed, cost))
                if iteration >= settled_after and has_converged():
                    return True
                if self.progress and iteration % PROGRESS_INTERVAL == 0:
                    in_ms = 1000 * elapsed, 1000 * time_limit
                    n_done, total = (iteration, max_iterations) if math.isinf(time_limit) else in_ms
                    self.progress(int(min(n_done, total)), int(total))
            return elapsed >= time_limit or iteration > max_iterations

        return must_end
