"""When a search of OMPL's ends, and how its cost fell until then."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from locplan._util.checks import is_number, whole
from locplan._util.progress import ProgressCallback
from locplan.errors import ConfigError

TIME_LIMIT = 5.0
"""Default time limit [s]."""
SEED = 1
"""Default seed of OMPL's random numbers."""
SETTLED_AFTER = 1000
"""Iterations that a search goes on at least before it may count as converged."""
LOOK_EVERY = 8
"""Iterations from one look at the best cost to the next."""
TELL_EVERY = 512
"""Iterations from one report of progress to the next."""


@dataclass
class Limits:
    """When to end a search, and the best costs that were seen until then.

    Raises
    ------
    ConfigError
        If a value is not positive.
    """

    time_limit: float | None = None
    """[s]; 5 unless iterations are given."""
    iterations: int | None = None
    """How often OMPL's planner asks whether to go on; for most once an iteration."""
    convergence: float | None = None
    """Enough is a fall of J by less than this share over the latter half of the iterations."""
    progress: ProgressCallback | None = None
    """Called with what passed of the limit and the limit, in milliseconds or iterations."""
    history: list[tuple[float, float]] = field(default_factory=list)
    """Seconds since the start and the best J [m], wherever it was seen to fall."""

    def __post_init__(self) -> None:
        for name, unit in (("time_limit", "seconds"), ("convergence", "a share of J")):
            value = getattr(self, name)
            if value is not None and not (is_number(value) and value > 0):
                raise ConfigError(f"{name} must be positive, {unit}, not {value!r}")
        if self.iterations is not None:
            whole("iterations", self.iterations)
        if self.time_limit is None and self.iterations is None:
            self.time_limit = TIME_LIMIT

    def description(self) -> str:
        """For people."""
        seconds = [] if self.time_limit is None else [f"{self.time_limit:g} s"]
        counted = [] if self.iterations is None else [f"{self.iterations:,} iterations"]
        return " and ".join(seconds + counted)

    def condition(
        self,
        best_cost: Callable[[], float] | None = None,
        *,
        share: float = 1.0,
        settled_after: int = SETTLED_AFTER,
    ) -> Callable[[], bool]:
        """What OMPL asks at every iteration: whether to end the search that begins now.

        `best_cost` tells the best J so far, `share` which part of the time limit counts; before
        `settled_after` iterations no search has converged.
        """
        time_limit = math.inf if self.time_limit is None else share * self.time_limit
        most = math.inf if self.iterations is None else self.iterations
        began, iteration = time.perf_counter(), 0
        best: list[tuple[int, float]] = [(0, math.inf)]

        def ends() -> bool:
            nonlocal iteration
            iteration += 1
            elapsed = time.perf_counter() - began
            if iteration % LOOK_EVERY == 0:
                if best_cost and (cost := best_cost()) < best[-1][1]:
                    best.append((iteration, cost))
                    self.history.append((elapsed, cost))
                if (
                    self.convergence
                    and iteration >= settled_after
                    and _settled(best, iteration, self.convergence)
                ):
                    return True
                if self.progress and iteration % TELL_EVERY == 0:
                    whole = (1000 * elapsed, 1000 * time_limit)
                    done, total = (iteration, most) if math.isinf(time_limit) else whole
                    self.progress(int(min(done, total)), int(total))
            return elapsed >= time_limit or iteration > most

        return ends


def _settled(best: list[tuple[int, float]], iteration: int, convergence: float) -> bool:
    earlier = next(cost for at, cost in reversed(best) if at <= iteration / 2)
    return best[-1][1] > earlier * (1 - convergence)
