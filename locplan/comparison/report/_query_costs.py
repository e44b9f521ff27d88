"""J of every query: each planner's beside the baseline's, as one picture for each weight."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from locplan.comparison._runs import Run
from locplan.comparison._statistics import Query, query_of
from locplan.comparison.report._data import Case, ReportData
from locplan.comparison.report._figures import Look, query_costs_picture
from locplan.comparison.report._filters import of_case
from locplan.comparison.report._html import Html, counted, picture
from locplan.comparison.report._marks import legend, line, swatch

MAX_QUERIES = 60
"""Greatest number of queries in a picture."""


def costs_of(runs: Iterable[Run]) -> dict[tuple[Query, str], float]:
    """The median over seeds of J of each query [m], by setting, query and planner."""
    found: dict[tuple[Query, str], list[float]] = {}
    for run in runs:
        if "cost" in run.measures:
            found.setdefault((query_of(run), run.task.planner), []).append(run.measures["cost"])
    return {key: float(np.median(values)) for key, values in found.items()}


def query_costs(data: ReportData, case: Case, looks: Mapping[str, Look]) -> Iterator[Html]:
    """A picture for each weight of a case."""
    runs = data.of_case(case)
    for weight in sorted({run.task.weight for run in runs}):
        own = [run for run in runs if run.task.weight == weight]
        drawn = _picture(data, own, looks, f"{', '.join(case)}, weight {weight:g}")
        if drawn is not None:
            svg, entries, caption = drawn
            yield picture(svg, entries, caption, **of_case(case, weight))


def _picture(
    data: ReportData, runs: Sequence[Run], looks: Mapping[str, Look], name: str
) -> tuple[str, Html, str] | None:
    """Picture, legend and caption; None where the baseline has no path."""
    costs = costs_of(runs)
    queries = list(dict.fromkeys(query_of(run) for run in runs))
    every = [(each, costs.get((each, data.baseline), 0.0)) for each in queries]
    compared = [(query, own) for query, own in every if own > 0]
    if not compared:
        return None
    shown = compared[:MAX_QUERIES]
    ratios = {
        planner: np.array([costs.get((query, planner), np.nan) / own for query, own in shown])
        for planner in looks
    }
    ratios = {planner: own for planner, own in ratios.items() if np.isfinite(own).any()}
    middles = {planner: np.nanmedian(own) for planner, own in ratios.items()}
    words = "; ".join(f"{planner} {middle:.3f}" for planner, middle in middles.items())
    alt = f"J of every query as a multiple of that of {data.baseline}, {name}. Medians: {words}."
    labels = [f"{query}, {own:.1f} m" for (_, query), own in shown]
    drawn = query_costs_picture(ratios, labels, looks, alt)
    entries = [(swatch("muted"), f"{data.baseline}, the baseline, with its J")]
    others = [planner for planner in ratios if planner != data.baseline]
    entries += [(line(looks[planner], marked=True), planner) for planner in others]
    caption = f"J of every query, {name}"
    if len(shown) < len(compared):
        caption += f"; the first {len(shown)} of {counted(len(compared), 'query', 'queries')}"
    if len(compared) < len(queries):
        lost = counted(len(queries) - len(compared), "query", "queries")
        caption += f"; {lost} without a path of {data.baseline} left out"
    return drawn, legend(entries), caption
