"""The pictures of a report with their explanations and legends."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from locplan.comparison._runs import MEASURES
from locplan.comparison._statistics import Convergence, convergence
from locplan.comparison.report._data import Case, ReportData
from locplan.comparison.report._figures import (
    MARKERS,
    Look,
    integral_unit,
    marker_sizes,
    paths_picture,
    progress_picture,
    trade_off_picture,
)
from locplan.comparison.report._filters import of_case
from locplan.comparison.report._html import Html, counted, element, html, picture
from locplan.comparison.report._marks import legend, line, swatch
from locplan.comparison.report._query_costs import query_costs
from locplan.comparison.report._thumbnails import thumbnails, typical
from locplan.costs import Path


def trade_offs(data: ReportData, looks: Mapping[str, Look]) -> Iterator[Html]:
    """Length against degenerate metres with the exact front, and J of every query."""
    note = (
        "Planners minimise J = length + weight × ∫u ds. The first picture of each map has every run"
        " of one query: shorter to the left, less degenerate below. Markers grow with the weight,"
        " a line joins the medians of a planner's weights. Along a dotted line J is that of"
        f" {data.baseline}, at one weight; what lies to its left or below has less. The grey line"
        " is the Pareto front of the grid, which is exact on the grid only: no path from cell to"
        " cell over 8 neighbours is better in both. any-angle and the planners of OMPL leave these"
        " eight directions, in which the same way is up to 8 % longer. So their runs may lie left"
        " of the front and below it. The other pictures have the J of each query as a multiple of"
        f" that of {data.baseline}, the median over seeds; an arrow at the edge stands for more."
    )
    yield element("p", note, kind="muted note")
    yield _gallery(
        part
        for case in data.cases
        for part in (*_front(data, case, looks), *query_costs(data, case, looks))
    )


def _front(data: ReportData, case: Case, looks: Mapping[str, Look]) -> Iterator[Html]:
    scene = data.scenes.get(case)
    if scene is not None and scene.front is not None and len(scene.front):
        yield _trade_off(data, case, looks)


def _trade_off(data: ReportData, case: Case, looks: Mapping[str, Look]) -> Html:
    scene = data.scenes[case]
    front, query = scene.front, scene.front_query
    assert front is not None
    runs = [run for run in data.of_case(case) if run.task.query == query and run.measures]
    what, unit = MEASURES[f"integrated_{front.objective}"][0], integral_unit(scene)
    ends = [f"{front.length[n]:.1f} m and {front.integral[n]:.3g} {unit}" for n in (0, -1)]
    alt = f"Length against {what} on {_name(case, query)}. The front goes from {' to '.join(ends)}."
    drawn, outside = trade_off_picture(scene, runs, looks, data.baseline, alt)
    caption = _name(case, query)
    if outside:
        caption += f"; {counted(outside, 'run')} too far out to show"
    used = {run.task.planner for run in runs}
    entries = [(line(look, marked=True), name) for name, look in looks.items() if name in used]
    exact = "exact" if front.epsilon == 0 else f"within {front.epsilon:.2%}"
    entries.append((swatch("muted"), f"front of the grid, {exact}, {counted(len(front), 'path')}"))
    if front.objective == "u" and data.baseline in used:
        entries.append((swatch("muted", 2), f"J of {data.baseline}"))
    sizes = marker_sizes(sorted({run.task.weight for run in runs}))
    for weight, size in sizes.items():
        entries.append((swatch("muted", -1, MARKERS[0], size), f"weight {weight:g}"))
    return picture(drawn, legend(entries), caption, **of_case(case))


def over_time(data: ReportData, looks: Mapping[str, Look]) -> Iterator[Html]:
    """Best J over time of the anytime planners."""
    note = (
        f"Best J so far of the anytime planners as a multiple of the J of {data.baseline} for the"
        " same query: the median over queries, of which each is the median over its seeds, and the"
        " interquartile band. A line begins when half of the queries have a path."
    )
    yield element("p", note, kind="muted note")
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
        yield picture(
            progress_picture(own, looks, alt), legend(entries), caption, **of_case(case, weight)
        )


def _course(curve: Convergence) -> str:
    ratio = float(curve.median[-1])
    return f"ends at {ratio:.3f}" if ratio < float("inf") else "has no path in half of the queries"


def paths(data: ReportData, looks: Mapping[str, Look]) -> Iterator[Html]:
    """Paths over the map and its field."""
    note = (
        "The darker a place, the less a match there tells where the robot is. Lines that coincide"
        " lie on one another, ever thinner. Of several seeds the path of median J is drawn. First"
        " comes one query of each map with its scales, at the greatest weight, then every query:"
        " circle and star are start and goal, and the numbers are J [m]."
    )
    yield element("p", note, kind="muted note")
    asked = (
        (case, query)
        for case, scene in data.scenes.items()
        if (query := scene.front_query or next(iter(scene.queries), ""))
    )
    yield _gallery((_paths(data, *each, looks) for each in asked), "wide")
    yield from thumbnails(data, looks)


def _paths(data: ReportData, case: Case, query: str, looks: Mapping[str, Look]) -> Html:
    """The paths of a query at the greatest weight."""
    asked = [run for run in data.of_case(case) if run.task.query == query]
    weight = max((run.task.weight for run in asked), default=0.0)
    runs = [run for run in asked if run.task.weight == weight and run.xy]
    found = {name: typical(runs, name) for name in looks}
    drawn = {name: run for name, run in found.items() if run is not None}
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
    return picture(svg, legend(entries), caption, "map", **of_case(case, weight))


def _name(case: Case, query: str) -> str:
    return f"{', '.join(case)}, query {query}"


def _gallery(pictures: Iterable[Html], kind: str = "") -> Html:
    drawn = list(pictures)
    if not drawn:
        return element("p", "Nothing to draw.")
    return element("div", *drawn, kind=f"pictures {kind}".strip())
