"""The figure of a comparison, and the means of a report's pictures: marks, and inline SVG."""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Callable, Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.markers import MarkerStyle

from locplan._kernels.arrays import Floats
from locplan._util.checks import printable
from locplan.comparison._statistics import Convergence, Run
from locplan.plotting import Picture

if TYPE_CHECKING:
    from locplan.comparison._result import Comparison

COLOURS = ("#1b1f24", "#0072b2", "#008a64", "#b8548f", "#c05000", "#2f93d1", "#a07800", "#6a51a3")
"""Colours of planners after Okabe and Ito."""
THEME = {"ink": "#010203", "muted": "#040506", "rule": "#070809"} | {
    f"p{n}": colour for n, colour in enumerate(COLOURS)
}
"""Colours that the page's own of these names replace: placeholders, and those of planners, which
are the page's in its light scheme."""
DASHES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1.6, 1.4, 1.6)), (0, (2, 1)))
SETTINGS: dict[Any, Any] = {
    **dict.fromkeys(("font.size", "axes.labelsize", "xtick.labelsize", "ytick.labelsize"), 8.5),
    **dict.fromkeys(("text.color", "axes.labelcolor"), THEME["ink"]),
    **dict.fromkeys(("xtick.labelcolor", "ytick.labelcolor"), THEME["ink"]),
    **dict.fromkeys(("axes.edgecolor", "xtick.color", "ytick.color"), THEME["muted"]),
    **dict.fromkeys(("axes.spines.top", "axes.spines.right"), False),
    **{"grid.color": THEME["rule"], "grid.linewidth": 0.6},
    **{"svg.fonttype": "none", "svg.hashsalt": "locplan"},
}


class Mark(NamedTuple):
    """A line and a marker, in pictures and legends."""

    colour: str
    """Name of the colour in `THEME`."""
    dash: int = 0
    """Index of the line's dashes in `DASHES`; -1 for no line."""
    marker: str = ""
    """Marker of matplotlib; empty for none."""
    size: float = 6.0
    """Size of the marker [pt]."""

    @property
    def line(self) -> dict[str, Any]:
        """The style of the line, for matplotlib."""
        return {"color": THEME[self.colour], "linestyle": DASHES[self.dash]}


def marks_of(runs: Iterable[Run]) -> dict[str, Mark]:
    """The mark of each planner in the order of the runs; no two of the first 280 are alike."""
    planners = dict.fromkeys(run.task.planner for run in runs)
    return {
        planner: Mark(f"p{n % len(COLOURS)}", n % len(DASHES), "osD^vPX"[n % 7])
        for n, planner in enumerate(planners)
    }


def shape(marker: str) -> str:
    """A marker of matplotlib, eight pixels wide, as an SVG path around 0."""
    drawn: Any = MarkerStyle(marker)
    parts = drawn.get_path().transformed(drawn.get_transform().scale(8, -8)).iter_segments()
    # Commands of SVG paths by the codes of matplotlib's.
    letters = (({1: "M", 2: "L", 4: "C"}.get(code), np.round(at, 2).tolist()) for at, code in parts)
    return "".join(f"{letter}{' '.join(map(str, at))}" for letter, at in letters if letter) + "Z"


class Limits(NamedTuple):
    """How much a report shows."""

    scenes: int = 24
    """Number of cases that are drawn."""
    fronts: int = 8
    """Number of those with the front of a query."""
    front_time: float = 20.0
    """Time limit of the exact front of a query [s]."""
    queries: int = 60
    """Number of queries in a picture of J of every query."""
    thumbnails: int = 400
    """Number of small pictures."""
    runs: int = 2000
    """Number of runs in the table."""
    failures: int = 200
    """Number of kinds of failures in the table."""


CaseKey = tuple[str, str]
Attributes = dict[str, str]
Legend = list[tuple[Mark | None, str]]
"""Marks with their texts; a dash stands for no mark."""


class Drawing(NamedTuple):
    """A picture with its caption, its legend, and the attributes by which it is filtered."""

    svg: str
    legend: Legend
    caption: str
    attributes: Attributes


def counted(number: int, one: str, many: str = "") -> str:
    """A number with its noun, in the plural unless it is 1."""
    return f"{number:,} {one if number == 1 else many or one + 's'}"


def attributes(setting: Sequence[Any]) -> Attributes:
    """The attributes that filter what belongs to a map and settings, and perhaps to a weight."""
    names = "data-map", "data-config", "data-weight"
    texts = (each if isinstance(each, str) else f"{each:g}" for each in setting)
    return dict(zip(names, texts, strict=False))


def title_of(setting: Sequence[Any]) -> str:
    """The names of map and settings, and perhaps the weight, in words."""
    name, config, *weight = setting
    return ", ".join([name, config, *(f"weight {each:g}" for each in weight)])


def medians_of(points: Floats) -> dict[float, Floats]:
    """The median of (weight, x, y), (n, 3), at each weight."""
    weights = np.unique(points[:, 0]).tolist()
    return {each: np.median(points[points[:, 0] == each, 1:], axis=0) for each in weights}


def shown_until(curve: Convergence) -> float:
    """A multiple below which most of a curve lies."""
    middle, high = (line[np.isfinite(line)] for line in (curve.median, curve.upper))
    if not middle.size:
        return 1.1
    return float(max(np.quantile(middle, 0.9), high[-1] if high.size else 1, 1.02))


def filtered(planner: str) -> str:
    """The `gid` of what is drawn of a planner, by which the page filters it."""
    return f"planner-{planner}"


def svg_of(draw: Callable[[Axes], None], height: float, alt: str) -> str:
    """A picture with alternative text, colours of the page and unique identifiers, as SVG.

    Parts with the `gid` of `filtered` get the attribute data-planner.
    """
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with mpl.rc_context(SETTINGS):
        # As wide as a phone's screen [inch], so that texts are legible there.
        figure = Picture(figsize=(3.5, height), layout="constrained")
        draw(figure.subplots())
        written = io.StringIO()
        figure.savefig(written, format="svg", dpi=250, transparent=True, metadata=nothing)
    svg = re.sub(r"<!--.*?-->\s*|<metadata>.*?</metadata>\s*", "", written.getvalue(), flags=re.S)
    svg = svg[svg.index("<svg") :]
    own = "s" + hashlib.sha256((alt + svg).encode(errors="replace")).hexdigest()[:10]
    part = rf"<g id=([\"']){filtered('')}(.*?)\1"  # matplotlib takes either kind of quotes
    svg = re.sub(part, r"<g data-planner=\1\2\1", svg)
    svg = re.sub(r'(<[^>]* id="|url\(#|href="#)', rf"\g<1>{own}-", svg)
    for name, colour in THEME.items():
        svg = svg.replace(colour, f"var(--{name})")
    return svg.replace("<svg ", f'<svg role="img" aria-label="{escape(alt, quote=True)}" ', 1)


def comparison_figure(comparison: Comparison) -> Figure:
    """J of each planner as a multiple of the baseline's with its interval, a row for each setting.

    Parameters
    ----------
    comparison : Comparison
        The comparison.
    """
    known = [row for row in comparison.standings() if row.summary.planner != comparison.baseline]
    rows, marks = known[:100], marks_of(comparison.runs)
    figure = Picture(figsize=(8, 1.2 + 0.3 * len(rows)), layout="constrained")
    axes = figure.subplots()
    axes.axvline(1, color="0.4", linewidth=1.2)
    for place, row in enumerate(rows):
        value, low, high = row.cost.estimate
        mark = marks[row.summary.planner]
        axes.plot([low, high], [place, place], color=THEME[mark.colour], linewidth=2)
        axes.plot([value], [place], mark.marker, color=THEME[mark.colour])
    names = [
        printable("{}: {}, {}, weight {:g}".format(row.summary.planner, *row.setting))
        for row in rows
    ]
    axes.set_yticks(range(len(rows)), names, parse_math=False)
    axes.set(
        ylim=(max(len(rows), 1) - 0.5, -0.5), xlabel=f"J / J of {printable(comparison.baseline)}"
    )
    axes.grid(axis="x", color="0.85")
    return figure
