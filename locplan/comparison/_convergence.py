"""How fast anytime planners come near a baseline planner."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from locplan.comparison._runs import MEASURES, Run
from locplan.comparison._statistics import Array, Setting, grouped, query_medians, setting_of

MOMENTS = 60
"""On the common grid of times."""


@dataclass(frozen=True)
class Convergence:
    """The best J so far of an anytime planner, in units of the baseline's J of the same query.

    The value of a query is the median over its seeds; median and quartiles are over queries.
    They are infinite as long as that share of the queries has no path yet.
    """

    setting: Setting
    planner: str
    baseline: str
    times: Array
    """Logarithmic, and common to all planners [s]."""
    median: Array
    lower: Array
    upper: Array
    """The quartiles, each the nearest query's: between a ratio and infinity there is no value."""
    solved: Array
    """The share of runs that have a path by then, also of queries that the baseline failed."""
    queries: int
    """Whose ratio to the baseline is known."""


def convergence(runs: Iterable[Run], baseline: str, pooled: bool = False) -> list[Convergence]:
    """The median best J over time of the planners with a history.

    Parameters
    ----------
    runs
        What came of the comparison.
    baseline
        The label of the planner whose J is 1.
    pooled
        Take all maps together, each query alike.

    Returns
    -------
    list of Convergence
        Empty if no planner has a history. A planner's runs without one count as without any path
        until their end.
    """
    known = list(runs)
    references = baseline_costs(known, baseline)
    times = _times(known)
    return [
        _curve(setting, planner, baseline, group, references, times)
        for (setting, planner), group in grouped(known, pooled).items()
        if any(run.history for run in group)
    ]


Query = tuple[Setting, str]


def query_of(run: Run) -> Query:
    return setting_of(run), run.task.query


def baseline_costs(runs: Sequence[Run], baseline: str) -> dict[Query, float]:
    """The median J over seeds by setting and query [m]."""
    medians = query_medians(run for run in runs if run.task.planner == baseline)
    column = list(MEASURES).index("cost")
    return {
        (setting, query): float(values[column])
        for (setting, _), queries in medians.items()
        for (_, query), values in queries.items()
    }


def _times(runs: Sequence[Run]) -> Array:
    moments = [max(time, 1e-4) for run in runs for time, _ in best_so_far(run) if run.history]
    if not moments:
        return np.empty(0)
    return np.geomspace(min(moments), max(moments), MOMENTS)


def best_so_far(run: Run) -> list[tuple[float, float]]:
    """Every moment [s] with the best J until then [m], ending with the path that was returned."""
    points = [(time, cost) for time, cost in run.history if np.isfinite((time, cost)).all()]
    end = run.seconds, run.measures.get("cost", np.nan)
    if run.status == "solved" and np.isfinite(end).all():
        points.append(end)
    best = np.inf
    return [(time, best := min(best, cost)) for time, cost in sorted(points)]


def _curve(
    setting: Setting,
    planner: str,
    baseline: str,
    runs: Sequence[Run],
    references: dict[Query, float],
    times: Array,
) -> Convergence:
    curves = np.array([_costs_at(run, times) for run in runs])
    solved = np.isfinite(curves).mean(axis=0)
    members: dict[Query, list[int]] = {}
    for index, run in enumerate(runs):
        if references.get(query_of(run), np.nan) > 0:
            members.setdefault(query_of(run), []).append(index)
    ratios = [
        np.median(curves[each], axis=0) / references[query] for query, each in members.items()
    ]
    if not ratios:
        median = lower = upper = np.full(len(times), np.nan)
    else:
        median = np.median(ratios, axis=0)
        lower, upper = np.quantile(ratios, (0.25, 0.75), axis=0, method="nearest")
    return Convergence(setting, planner, baseline, times, median, lower, upper, solved, len(ratios))


def _costs_at(run: Run, times: Array) -> Array:
    """The best J at these moments, infinite before the first."""
    points = best_so_far(run)
    if not points:
        return np.full(len(times), np.inf)
    moments, costs = np.array(points).T
    found = np.searchsorted(np.maximum(moments, 1e-4), times * (1 + 1e-12), side="right")
    return np.append(np.inf, costs)[found]
