"""The pictures of a report as inline SVG in the page's colours, and the figure of a comparison.

The legends of a report's pictures are parts of its page.
"""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from locplan._util.checks import printable
from locplan.comparison._statistics import MEASURES, Convergence, Run
from locplan.costs import Path
from locplan.field import CovarianceField
from locplan.planners import ParetoFront, Query
from locplan.plotting import Picture, draw_ends, draw_field, draw_path, label_plainly

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from locplan.comparison._result import Comparison

WIDTH = 3.5
"""Width of every picture [inch]: that of a phone's screen, so that texts are legible there."""
INK, MUTED, RULE = "#010203", "#040506", "#070809"
"""Placeholders that the page's colours of these names replace."""
COLOURS = ("#1b1f24", "#0072b2", "#008a64", "#b8548f", "#c05000", "#2f93d1", "#a07800", "#6a51a3")
"""Colours of planners after Okabe and Ito: the page's --p0, --p1, ... in its light scheme."""
DASHES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1.6, 1.4, 1.6)), (0, (2, 1)))
MARKERS = "osD^vPX"
SETTINGS: dict[Any, Any] = {
    **dict.fromkeys(("font.size", "axes.labelsize", "xtick.labelsize", "ytick.labelsize"), 8.5),
    **dict.fromkeys(("text.color", "axes.labelcolor", "xtick.labelcolor", "ytick.labelcolor"), INK),
    **dict.fromkeys(("axes.edgecolor", "xtick.color", "ytick.color"), MUTED),
    **dict.fromkeys(("axes.spines.top", "axes.spines.right"), False),
    **{"grid.color": RULE, "grid.linewidth": 0.6},
    **{"svg.fonttype": "none", "svg.hashsalt": "locplan"},
}


@dataclass(frozen=True)
class Look:
    """Indices of a planner's colour, dash and marker."""

    colour: int
    dash: int
    marker: int

    @property
    def line(self) -> dict[str, Any]:
        """The style of the planner's lines, for matplotlib."""
        return {"color": COLOURS[self.colour], "linestyle": DASHES[self.dash]}


def looks_of(planners: Sequence[str]) -> dict[str, Look]:
    """The look of each planner; no two of the first 280 are alike."""
    counts = len(COLOURS), len(DASHES), len(MARKERS)
    return {planner: Look(*(n % count for count in counts)) for n, planner in enumerate(planners)}


def marker_sizes(weights: Sequence[float]) -> dict[float, float]:
    """The size of the markers of each weight [pt]; it grows with the weight."""
    return dict(zip(weights, np.linspace(4, 9, len(weights)).tolist(), strict=True))


def trade_off_picture(
    front: ParetoFront,
    e_unit: str,
    runs: Sequence[Run],
    looks: Mapping[str, Look],
    baseline: str,
    alt: str,
) -> tuple[str, int]:
    """Length against the integral of the runs of one query, and its exact front.

    A line joins the medians of each planner's weights. Dotted are the lines of the baseline's J,
    one for each weight, if the integral is that of u. Returned are the SVG and the number of runs
    that lie too far from the front to be shown.
    """
    measure = f"integrated_{front.objective}"
    rows: dict[str, list[tuple[float, ...]]] = {planner: [] for planner in looks}
    for run in runs:
        values = run.task.weight, run.measures["length"], run.measures[measure]
        rows[run.task.planner].append(values)
    points = {planner: np.array(own).reshape(-1, 3) for planner, own in rows.items()}
    worst = [own[:, 1:].max(axis=0) for own in points.values() if len(own)]
    usual = np.median(worst, axis=0) if worst else np.zeros(2)
    # Runs are shown up to a little beyond the front and most planners.
    edge = 1.3 * np.maximum((front.length.max(), front.integral.max()), usual)
    sizes = marker_sizes(sorted({run.task.weight for run in runs}))

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        alone = "." if len(front) == 1 else ""
        axes.step(front.length, front.integral, "-", marker=alone, where="post", color=MUTED)
        if front.objective == "u" and len(points.get(baseline, ())):
            _draw_equal_costs(axes, points[baseline], sizes)
        for n, (planner, own) in enumerate(points.items()):
            near = own[(own[:, 1:] <= edge).all(1)]
            _draw_trade_offs(axes, near, looks[planner], sizes, filtered(n))
        unit = f"{e_unit} m" if front.objective == "e" else "m"
        axes.set(xlabel="length [m]", ylabel=f"{MEASURES[measure].title} [{unit}]")
        axes.margins(0.06)
        axes.grid()

    outside = sum(int((own[:, 1:] > edge).any(axis=1).sum()) for own in points.values())
    return svg_of(draw, 2.5, alt, list(looks)), outside


def _draw_equal_costs(axes: Axes, points: NDArray[np.float64], weights: Iterable[float]) -> None:
    """The line of all lengths and integrals of u whose J is that of the points' median."""
    for weight in weights:
        group = points[points[:, 0] == weight, 1:]
        if not len(group):
            continue
        length, integral = np.median(group, axis=0)
        style: dict[str, Any] = {"color": MUTED, "linewidth": 0.9, "linestyle": (0, (1, 2))}
        if weight:
            axes.axline((length, integral), slope=-1 / weight, **style)
        else:
            axes.axvline(length, **style)


def _draw_trade_offs(
    axes: Axes,
    points: NDArray[np.float64],
    look: Look,
    sizes: Mapping[float, float],
    part: str,
) -> None:
    """A marker for each of (weight, length, integral), and a line through the weights' medians."""
    groups = {weight: points[points[:, 0] == weight, 1:] for weight in sizes}
    medians = [np.median(group, axis=0) for group in groups.values() if len(group)]
    if medians:
        axes.plot(*np.transpose(medians), **look.line, linewidth=1.0, gid=part)
    hollow: dict[str, Any] = {"markerfacecolor": "none", "markeredgewidth": 1.2}
    for weight, group in groups.items():
        style = {"color": COLOURS[look.colour], "markersize": sizes[weight], **hollow}
        axes.plot(*group.T, MARKERS[look.marker], gid=part, **style)


def progress_picture(curves: Mapping[str, Convergence], looks: Mapping[str, Look], alt: str) -> str:
    """Best J over time as a multiple of the baseline's: medians and interquartile bands."""
    top = max(map(_shown_until, curves.values()))
    bottom = min(1.0, *(float(curve.lower.min()) for curve in curves.values()))
    margin = 0.06 * (top - bottom)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axhline(1, color=MUTED, linewidth=1.4)
        for planner, curve in curves.items():
            quartiles = np.array([curve.lower, curve.median, curve.upper])
            low, middle, high = np.minimum(quartiles, 10 * top)
            line = looks[planner].line
            band = {"alpha": 0.2, "linewidth": 0, "color": line["color"]}
            part = filtered(list(looks).index(planner))
            axes.fill_between(curve.times, low, high, step="post", gid=part, **band)
            axes.step(curve.times, middle, where="post", linewidth=1.8, gid=part, **line)
        axes.set(xscale="log", ylim=(bottom - margin, top + margin))
        axes.set(xlabel="time since the search began [s]", ylabel="best J / baseline's J")
        label_plainly(axes.xaxis, 6)
        axes.grid()

    return svg_of(draw, 2.3, alt, list(looks))


def _shown_until(curve: Convergence) -> float:
    """A multiple below which most of a curve lies."""
    middle, high = (line[np.isfinite(line)] for line in (curve.median, curve.upper))
    if not middle.size:
        return 1.1
    return float(max(np.quantile(middle, 0.9), high[-1] if high.size else 1, 1.02))


def paths_picture(
    field: CovarianceField,
    query: Query,
    paths: Mapping[str, Path],
    looks: Mapping[str, Look],
    alt: str,
) -> str:
    """The paths of one query over the field, ever thinner, so that none hides another."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        image = draw_field(axes, field)
        axes.set(xlabel="", ylabel="")
        axes.spines[["top", "right"]].set_visible(True)
        widths = [2.2] if len(paths) == 1 else np.linspace(4.2, 1.5, len(paths)).tolist()
        for (planner, path), width in zip(paths.items(), widths, strict=True):
            outline = [Stroke(linewidth=width + 1.2, foreground="white"), Normal()]
            style = {"linewidth": width, "path_effects": outline, **looks[planner].line}
            draw_path(axes, path, gid=filtered(list(looks).index(planner)), **style)
        draw_ends(axes, query.start, query.goal)
        label = f"{field.quantity().axis}, x and y [m]"
        bar = figure.colorbar(image, ax=axes, label=label, location="bottom", aspect=40, pad=0.04)
        label_plainly(bar.ax.xaxis, 6)
        bar.outline.set_linewidth(0.5)
        width, height = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
        figure.set_size_inches(WIDTH, min((WIDTH - 0.35) * height / width + 0.85, 5.0))

    return svg_of(draw, 5.0, alt, list(looks))


def filtered(planner: int) -> str:
    """The `gid` of what is drawn of a planner, by its place; with it the page can be filtered."""
    return f"planner-{planner}"


def svg_of(
    draw: Callable[[Figure], None], height: float, alt: str, planners: Sequence[str] = ()
) -> str:
    """A picture with alternative text, colours of the page and unique identifiers, as SVG.

    Parts with the `gid` of `filtered` get the attribute data-planner.
    """
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with mpl.rc_context(SETTINGS):
        figure = Picture(figsize=(WIDTH, height), layout="constrained")
        draw(figure)
        written = io.StringIO()
        figure.savefig(written, format="svg", dpi=250, transparent=True, metadata=nothing)
    svg = re.sub(r"<!--.*?-->\s*|<metadata>.*?</metadata>\s*", "", written.getvalue(), flags=re.S)
    svg = svg[svg.index("<svg") :]
    own = "s" + hashlib.sha256((alt + svg).encode(errors="replace")).hexdigest()[:10]
    svg = re.sub(r'(<[^>]* id="|url\(#|href="#)', rf"\g<1>{own}-", svg)
    theme = {INK: "ink", MUTED: "muted", RULE: "rule"} | {c: f"p{n}" for n, c in enumerate(COLOURS)}
    for colour, name in theme.items():
        svg = svg.replace(colour, f"var(--{name})")
    svg = re.sub(
        rf'(<g) id="{own}-{filtered(0)[:-1]}(\d+)"',
        lambda found: f'{found[1]} data-planner="{escape(planners[int(found[2])], quote=True)}"',
        svg,
    )
    return svg.replace("<svg ", f'<svg role="img" aria-label="{escape(alt, quote=True)}" ', 1)


def query_costs_picture(
    ratios: Mapping[str, NDArray[np.float64]],
    labels: Sequence[str],
    looks: Mapping[str, Look],
    alt: str,
) -> str:
    """A row for each query, a marker for each planner; an arrow stands for J beyond the edge."""
    values = np.array(list(ratios.values()))
    excess = np.median([np.nanmax(own) - 1 for own in values])
    # Up to half more than the usual excess is to scale; 2 % at least, lest rounding fill it.
    top = min(1 + 1.5 * max(float(excess), 0.02), max(float(np.nanmax(values)), 1.02))
    bottom = min(1.0, float(np.nanmin(values)))
    margin = 0.05 * (top - bottom)
    plain: dict[str, Any] = {"linestyle": "none", "markersize": 5}

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axvline(1, color=MUTED, linewidth=1.4)
        rows = np.arange(len(labels))
        shifts = np.linspace(-0.25, 0.25, len(ratios)) if len(ratios) > 1 else [0.0]
        for (planner, own), shift in zip(ratios.items(), shifts, strict=True):
            if (own == 1).all():  # the baseline is the line
                continue
            part, colour = filtered(list(looks).index(planner)), COLOURS[looks[planner].colour]
            marker = MARKERS[looks[planner].marker]
            hollow = {"markerfacecolor": "none", **plain, "color": colour, "gid": part}
            axes.plot(own[own <= top], (rows + shift)[own <= top], marker, **hollow)
            far = rows[own > top] + shift
            axes.plot(np.full(far.size, top), far, ">", gid=part, color=colour, **plain)
        # The end of a label tells queries apart, as far as there is room for it.
        texts = [printable(label) for label in labels]
        short = [text if len(text) <= 24 else f"…{text[-24:]}" for text in texts]
        axes.set_yticks(rows, short, parse_math=False)
        axes.set(xlim=(bottom - margin, top + margin), ylim=(len(labels) - 0.5, -0.5))
        axes.set_xlabel("J / baseline's J")
        axes.grid()

    return svg_of(draw, 0.75 + 0.19 * len(labels), alt, list(looks))


def comparison_figure(comparison: Comparison) -> Figure:
    """J of each planner as a multiple of the baseline's with its interval, a row for each setting.

    Parameters
    ----------
    comparison : Comparison
        The comparison.
    """
    known = [row for row in comparison.standings() if row.summary.planner != comparison.baseline]
    rows = known[:100]
    looks = looks_of(list(dict.fromkeys(run.task.planner for run in comparison.runs)))
    figure = Picture(figsize=(8, 1.2 + 0.3 * len(rows)), layout="constrained")
    axes = figure.subplots()
    axes.axvline(1, color="0.4", linewidth=1.2)
    for place, row in enumerate(rows):
        value, low, high = row.cost.estimate
        look = looks[row.summary.planner]
        axes.plot([low, high], [place, place], color=COLOURS[look.colour], linewidth=2)
        axes.plot([value], [place], MARKERS[look.marker], color=COLOURS[look.colour])
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
