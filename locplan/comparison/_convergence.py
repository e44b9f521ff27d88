"""Progress of anytime planners over time, relative to a baseline planner."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from locplan.comparison._runs import MEASURES, Run
from locplan.comparison._statistics import Array, Query, Setting, grouped, query_medians, query_of

MOMENTS = 60
"""Number of moments on the common grid of times."""


@dataclass(frozen=True)
class Convergence:
    """The best J so far of an anytime planner, in units of the baseline's J of the same query.

    The value of a query is the median over its seeds; median and quartiles are over queries.
    They are infinite until that share of the queries has a path.
    """

    setting: Setting
    planner: str
    baseline: str
    times: Array
    """Logarithmic times, common to all planners [s]."""
    median: Array
    """The median ratio at each time."""
    lower: Array
    """The lower quartile, that of the nearest query: nothing lies between a ratio and infinity."""
    upper: Array
    """The upper quartile, that of the nearest query."""
    solved: Array
    """The share of runs with a path at each time, also for queries that the baseline failed."""
    queries: int
    """Number of queries whose ratio to the baseline is known."""


def convergence(runs: Iterable[Run], baseline: str, pooled: bool = False) -> list[Convergence]:
    """The median best J over time of each planner with a history.

    A planner's runs without a history count as without any path until their end.
    """
    known = list(runs)
    references = baseline_costs(known, baseline)
    moments = [max(time, 1e-4) for run in known if run.history for time, _ in best_so_far(run)]
    times = np.geomspace(min(moments), max(moments), MOMENTS) if moments else np.empty(0)
    curves = []
    for (setting, planner), group in grouped(known, pooled).items():
        if not any(run.history for run in group):
            continue
        costs = np.array([_costs_at(run, times) for run in group])
        members: dict[Query, list[int]] = {}
        for index, run in enumerate(group):
            if references.get(query_of(run), np.nan) > 0:
                members.setdefault(query_of(run), []).append(index)
        ratios = [np.median(costs[n], axis=0) / references[query] for query, n in members.items()]
        median = lower = upper = np.full(len(times), np.nan)
        if ratios:
            median = np.median(ratios, axis=0)
            lower, upper = np.quantile(ratios, (0.25, 0.75), axis=0, method="nearest")
        solved = np.isfinite(costs).mean(axis=0)
        bands = median, lower, upper, solved
        curves.append(Convergence(setting, planner, baseline, times, *bands, len(ratios)))
    return curves


def baseline_costs(runs: Sequence[Run], baseline: str) -> dict[Query, float]:
    """The median J over seeds by setting and query [m]."""
    medians = query_medians(run for run in runs if run.task.planner == baseline)
    column = list(MEASURES).index("cost")
    return {
        (setting, query): float(values[column])
        for (setting, _), queries in medians.items()
        for (_, query), values in queries.items()
    }


def best_so_far(run: Run) -> list[tuple[float, float]]:
    """Every moment [s] with the best J until then [m]; the path returned is the last."""
    points = [(time, cost) for time, cost in run.history if np.isfinite((time, cost)).all()]
    end = run.seconds, run.measures.get("cost", np.nan)
    if run.status == "solved" and np.isfinite(end).all():
        points.append(end)
    best = np.inf
    return [(time, best := min(best, cost)) for time, cost in sorted(points)]


def _costs_at(run: Run, times: Array) -> Array:
    """The best J at these moments, infinite before the first path."""
    points = best_so_far(run)
    if not points:
        return np.full(len(times), np.inf)
    moments, costs = np.array(points).T
    found = np.searchsorted(np.maximum(moments, 1e-4), times * (1 + 1e-12), side="right")
    return np.append(np.inf, costs)[found]
