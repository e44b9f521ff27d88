"""The pictures of a report with their explanations and legends.

The paths of every query are small: lines over an image of the map that all queries share.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from locplan.comparison._runs import MEASURES, Run
from locplan.comparison._statistics import Convergence, convergence, query_of
from locplan.comparison.report._data import Case, Ends, ReportData, Scene
from locplan.comparison.report._figures import (
    DASHES,
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
from locplan.comparison.report._marks import SHAPES, legend, line, swatch
from locplan.comparison.report._query_costs import query_costs
from locplan.costs import Path
from locplan.plotting import Picture, draw_field

MAX_THUMBNAILS = 400
"""Greatest number of small pictures in a report."""
SIZE = 640
"""Length of the longer side of a map's image [pixels], the unit of the lines over it, too."""
COLOURS = 64
"""Number of colours of a map's image."""
TOLERANCE = 0.7
"""Greatest distance of a line from the path that it shows [pixels]."""
WIDTHS = 4.5, 1.8
"""Widths of the first and the last line [pixels of the screen], so that none hides another."""
OUTLINE = 1.6
"""Width of the white line around them, more than theirs [pixels of the screen]."""
END = 2.0
"""Size of the marks of start and goal, as a factor on those of legends."""


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


@dataclass(frozen=True)
class Backdrop:
    """The image of a map with its field, and where it lies in the world."""

    name: str
    """The identifier of the image in the page."""
    low: NDArray[np.float64]
    """x and y of the lower left corner [m]."""
    scale: float
    """Pixels per metre."""
    size: tuple[int, int]
    """Width and height [pixels]."""
    image: Html
    """The element that holds the image, which is not shown by itself."""

    @classmethod
    def of(cls, scene: Scene, name: str) -> Backdrop:
        """Draw the scene's field without axes."""
        figure = Picture(figsize=(1, 1), dpi=SIZE)
        axes = figure.add_axes((0, 0, 1, 1))
        draw_field(axes, scene.field)
        axes.set_axis_off()
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        spans = np.array([right - left, top - bottom])
        width, height = np.ceil(SIZE * spans / spans.max()).astype(int).tolist()
        figure.set_size_inches(width / SIZE, height / SIZE)
        written = io.BytesIO()
        figure.savefig(written, format="png", dpi=SIZE, facecolor="white")
        small = io.BytesIO()
        Image.open(written).convert("RGB").quantize(COLOURS).save(small, "png", optimize=True)
        data = f"data:image/png;base64,{base64.b64encode(small.getvalue()).decode()}"
        size = {"width": str(width), "height": str(height)}
        image = element("image", id=name, href=data, preserveAspectRatio="none", **size)
        held = element(
            "svg", element("defs", image), width="0", height="0", aria_hidden="true", kind="held"
        )
        scale = float(SIZE / spans.max())
        return cls(name, np.array([left, bottom]), scale, (width, height), held)

    def pixels(self, xy: Sequence[Sequence[float]]) -> NDArray[np.float32]:
        """Positions in the image, (n, 2); rows go down."""
        points = (np.array(xy, float).reshape(-1, 2) - self.low) * self.scale
        points[:, 1] = self.size[1] - points[:, 1]
        return points.astype(np.float32)


def thumbnails(data: ReportData, looks: Mapping[str, Look]) -> Iterator[Html]:
    """Every query of every scene at every weight."""
    drawn = left_out = 0
    for n, (case, scene) in enumerate(data.scenes.items()):
        groups: dict[tuple[str, float], list[Run]] = {}
        for run in data.of_case(case):
            groups.setdefault((run.task.query, run.task.weight), []).append(run)
        known = {key: runs for key, runs in groups.items() if key[0] in scene.queries}
        order = list(scene.queries)
        keys = sorted(known, key=lambda key: (order.index(key[0]), key[1]))
        chosen = keys[: MAX_THUMBNAILS - drawn]
        drawn, left_out = drawn + len(chosen), left_out + len(keys) - len(chosen)
        if not chosen:
            continue
        backdrop = Backdrop.of(scene, f"map-{n}")
        yield backdrop.image
        pictures = [
            _thumbnail(known[key], scene.queries[key[0]], backdrop, looks, case) for key in chosen
        ]
        gallery = element("div", *pictures, kind="pictures small")
        title = element("summary", element("h3", f"Every query of {', '.join(case)}"))
        yield element("details", title, gallery, open="open", **of_case(case))
    if left_out:
        more = counted(left_out, "picture")
        yield element("p", f"The limit is {MAX_THUMBNAILS} pictures; {more} left out.")
    missing = len(data.cases) - len(data.scenes)
    if missing:
        text = f"{counted(missing, 'map or field', 'maps or fields')} without pictures; runs.csv"
        yield element("p", f"{text} has their runs.")


def typical(runs: Sequence[Run], planner: str) -> Run | None:
    """The planner's run of median J."""
    own = [run for run in runs if run.task.planner == planner and run.xy]
    return sorted(own, key=lambda run: run.measures["cost"])[(len(own) - 1) // 2] if own else None


def _thumbnail(
    runs: Sequence[Run], ends: Ends, backdrop: Backdrop, looks: Mapping[str, Look], case: Case
) -> Html:
    """The paths of one query at one weight, with the J of each."""
    (_, _, weight), query = query_of(runs[0])
    asked = {run.task.planner for run in runs}
    found = {planner: typical(runs, planner) for planner in looks if planner in asked}
    paths = {planner: run for planner, run in found.items() if run is not None}
    widths = np.linspace(*WIDTHS, len(paths)) if len(paths) != 1 else WIDTHS[1:]
    width, height = backdrop.size
    parts = [element("use", href=f"#{backdrop.name}")]
    for (planner, run), thickness in zip(paths.items(), widths, strict=True):
        parts.append(_line(backdrop.pixels(run.xy), looks[planner], float(thickness), planner))
    for end, mark in zip(ends, "o*", strict=True):
        x, y = backdrop.pixels([end[:2]])[0]
        where = f"translate({x:.0f} {y:.0f}) scale({END})"
        parts.append(element("path", d=SHAPES[mark], transform=where, kind="end"))
    texts = {
        planner: f"{planner} {run.measures['cost']:.1f}" if run else f"{planner} no path"
        for planner, run in found.items()
    }
    caption = f"{query}, weight {weight:g}"
    alt = f"Paths of {caption}, J [m]: {'; '.join(texts.values())}."
    box = {"viewBox": f"0 0 {width} {height}", "role": "img", "aria_label": alt}
    entries = [
        (line(looks[planner]) if found[planner] else html("–"), text)
        for planner, text in texts.items()
    ]
    drawn = element("svg", *parts, **box)
    return picture(drawn, legend(entries), caption, "map", **of_case(case, weight))


def _line(points: NDArray[np.float32], look: Look, width: float, planner: str) -> Html:
    """A path as a line with an outline, with no more vertices than it takes to show it."""
    short = cv2.approxPolyDP(points[:, None], TOLERANCE, False)[:, 0]
    path = "M" + " ".join(f"{x:.1f} {y:.1f}" for x, y in short.tolist())
    dashes = [] if DASHES[look.dash] == "-" else DASHES[look.dash][1]
    dashed = " ".join(f"{width * part:.3g}" for part in dashes)
    outline = element("path", d=path, kind="outline", stroke_width=f"{width + OUTLINE:.3g}")
    style = {"stroke": f"var(--p{look.colour})", "stroke_width": f"{width:.3g}"}
    drawn = element("path", d=path, stroke_dasharray=dashed, **style)
    return element("g", outline, drawn, data_planner=planner, kind="path")
