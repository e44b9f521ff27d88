"""The paths of every query, small: lines over an image of the map that all queries share."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from locplan.comparison._runs import Run
from locplan.comparison._statistics import query_of
from locplan.comparison.report._data import Case, Ends, ReportData, Scene
from locplan.comparison.report._figures import DASHES, Look
from locplan.comparison.report._filters import of_case
from locplan.comparison.report._html import Html, counted, element, html, picture
from locplan.comparison.report._marks import SHAPES, legend, line
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
