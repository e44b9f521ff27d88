"""The pictures of a report with their explanations and legends."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from locplan.comparison._convergence import Convergence, convergence
from locplan.comparison._runs import MEASURES, Run
from locplan.comparison.report._data import Case, ReportData
from locplan.comparison.report._figures import (
    MARKERS,
    Look,
    marker_sizes,
    paths_picture,
    progress_picture,
    trade_off_picture,
)
from locplan.comparison.report._html import Html, counted, element, html, picture
from locplan.comparison.report._marks import legend, line, swatch
from locplan.costs import Path


def trade_offs(data: ReportData, looks: Mapping[str, Look]) -> Iterator[Html]:
    """Length against the integral of e, with the exact front."""
    note = (
        "Every run of one query: shorter to the left, safer below. Markers grow with the weight,"
        " a line joins the medians of a planner's weights. The grey line is the Pareto front of"
        " paths from cell to cell, exact unless the legend says otherwise; paths that leave its"
        " eight directions can lie below it."
    )
    yield element("p", note, kind="muted")
    yield _gallery(
        _trade_off(data, case, looks)
        for case, scene in data.scenes.items()
        if scene.front is not None and len(scene.front)
    )


def _trade_off(data: ReportData, case: Case, looks: Mapping[str, Look]) -> Html:
    scene = data.scenes[case]
    front, query = scene.front, scene.front_query
    assert front is not None
    runs = [run for run in data.of_case(case) if run.task.query == query and run.measures]
    what, unit = MEASURES[f"integrated_{front.objective}"][0], f"{scene.field.e_unit} m"
    ends = [f"{front.length[n]:.1f} m and {front.integral[n]:.3g} {unit}" for n in (0, -1)]
    alt = f"Length against {what} on {_name(case, query)}. The front goes from {' to '.join(ends)}."
    drawn, outside = trade_off_picture(scene, runs, looks, alt)
    caption = _name(case, query)
    if outside:
        caption += f"; {counted(outside, 'run')} too far out to show"
    used = {run.task.planner for run in runs}
    entries = [(line(look, marked=True), name) for name, look in looks.items() if name in used]
    exact = "exact front" if front.epsilon == 0 else f"front within {front.epsilon:.2%}"
    entries.append((swatch("muted"), f"{exact}, {counted(len(front), 'path')}"))
    sizes = marker_sizes(sorted({run.task.weight for run in runs}))
    for weight, size in sizes.items():
        entries.append((swatch("muted", -1, MARKERS[0], size), f"weight {weight:g}"))
    return picture(drawn, legend(entries), caption)


def over_time(data: ReportData, looks: Mapping[str, Look]) -> Iterator[Html]:
    """Best J over time of the anytime planners."""
    note = (
        f"Best J so far of the anytime planners as a multiple of the J of {data.baseline} for the"
        " same query: the median over queries, of which each is the median over its seeds, and the"
        " interquartile band. A line begins when half of the queries have a path."
    )
    yield element("p", note, kind="muted")
    yield _gallery(part for case in data.cases for part in _over_time(data, case, looks))


def _over_time(data: ReportData, case: Case, looks: Mapping[str, Look]) -> Iterator[Html]:
    # Without a query that the baseline has solved there is no ratio to draw.
    curves = [each for each in convergence(data.of_case(case), data.baseline) if each.queries]
    for weight in sorted({curve.setting.weight for curve in curves}):
        own = {curve.planner: curve for curve in curves if curve.setting.weight == weight}
        caption = f"{', '.join(case)}, weight {weight:g}"
        courses = "; ".join(f"{name} {_course(curve)}" for name, curve in own.items())
        alt = f"Best J over time as a multiple of that of {data.baseline}, {caption}: {courses}."
        entries = [(swatch("muted"), f"{data.baseline}, the baseline")]
        entries += [(line(looks[name]), name) for name in own]
        yield picture(progress_picture(own, looks, alt), legend(entries), caption)


def _course(curve: Convergence) -> str:
    ratio = float(curve.median[-1])
    return f"ends at {ratio:.3f}" if ratio < float("inf") else "has no path in half of the queries"


def paths(data: ReportData, looks: Mapping[str, Look]) -> Iterator[Html]:
    """Paths over the map and its field."""
    note = (
        "The darker a place, the less a match there tells where the robot is. Lines that coincide"
        " lie on one another, ever thinner. Of several seeds the path of median J is drawn."
    )
    yield element("p", note, kind="muted")
    asked = ((case, query) for case, scene in data.scenes.items() for query in scene.queries)
    yield _gallery((_paths(data, *each, looks) for each in asked), "large")


def _paths(data: ReportData, case: Case, query: str, looks: Mapping[str, Look]) -> Html:
    """The paths of a query at the greatest weight."""
    asked = [run for run in data.of_case(case) if run.task.query == query]
    weight = max((run.task.weight for run in asked), default=0.0)
    runs = [run for run in asked if run.task.weight == weight and run.xy]
    typical = {name: _typical(runs, name) for name in looks}
    drawn = {name: run for name, run in typical.items() if run is not None}
    caption = f"{_name(case, query)}, weight {weight:g}"
    lengths = {name: f"{name}, {run.measures['length']:.1f} m" for name, run in drawn.items()}
    scene = data.scenes[case]
    svg = paths_picture(
        scene,
        scene.queries[query],
        {name: Path(np.array(run.xy)) for name, run in drawn.items()},
        looks,
        f"Paths over the field of {caption}: {'; '.join(lengths.values()) or 'none'}.",
    )
    entries = [(line(looks[name]), lengths[name]) for name in drawn]
    missing = {run.task.planner for run in asked} - set(drawn)
    entries += [(html("–"), f"{name}: no path") for name in looks if name in missing]
    entries += [(swatch("ink", -1, "o"), "start"), (swatch("ink", -1, "*"), "goal")]
    return picture(svg, legend(entries), caption, "map")


def _typical(runs: Sequence[Run], planner: str) -> Run | None:
    """The planner's run of median J."""
    own = [run for run in runs if run.task.planner == planner]
    return sorted(own, key=lambda run: run.measures["cost"])[(len(own) - 1) // 2] if own else None


def _name(case: Case, query: str) -> str:
    return f"{', '.join(case)}, query {query}"


def _gallery(pictures: Iterable[Html], kind: str = "") -> Html:
    drawn = list(pictures)
    if not drawn:
        return element("p", "Nothing to draw.")
    return element("div", *drawn, kind=f"pictures {kind}".strip())
