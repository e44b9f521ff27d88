"""Small drawings in tables and legends: intervals on a common scale, lines and markers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from locplan.comparison.report._figures import COLOURS, DASHES, MARKERS, Look
from locplan.comparison.report._html import Html, breakable, element

WIDTH, HEIGHT = 120, 14
MAX_RATIO = 0.1
"""Greatest distance of a scale's ends from 1, so that one bad planner does not hide the others."""
SHAPES: Mapping[str, str] = {
    "o": "M4 0 A4 4 0 1 1 -4 0 A4 4 0 1 1 4 0 Z",
    "s": "M-4 -4 H4 V4 H-4 Z",
    "D": "M0 -5 L5 0 L0 5 L-5 0 Z",
    "^": "M0 -4.5 L4.5 4 H-4.5 Z",
    "v": "M0 4.5 L4.5 -4 H-4.5 Z",
    "P": "M-1.6 -5 H1.6 V-1.6 H5 V1.6 H1.6 V5 H-1.6 V1.6 H-5 V-1.6 H-1.6 Z",
    "X": "M-5 -2.5 L-2.5 -5 L0 -2.5 L2.5 -5 L5 -2.5 L2.5 0 L5 2.5 L2.5 5 L0 2.5 L-2.5 5 L-5 2.5"
    " L-2.5 0 Z",
    "*": "M0 -7 L1.7 -2.3 L6.6 -2.2 L2.7 0.9 L4.1 5.7 L0 2.9 L-4.1 5.7 L-2.7 0.9 L-6.6 -2.2"
    " L-1.7 -2.3 Z",
}
"""Paths around 0 for the markers of matplotlib."""


@dataclass(frozen=True)
class Scale:
    """A scale that turns a ratio into its place in a drawing."""

    low: float
    high: float

    @classmethod
    def of(cls, intervals: Iterable[tuple[float, float]]) -> Scale:
        """A scale that shows 1 and these intervals, as far as they are near 1."""
        ends = [end for interval in intervals for end in interval if math.isfinite(end)]
        low, high = max(min([*ends, 0.99]), 1 - MAX_RATIO), min(max([*ends, 1.01]), 1 + MAX_RATIO)
        return cls(low, high)

    def at(self, ratio: float) -> float:
        """The distance of a ratio from the left [pixels], with room for arrows at both ends."""
        share = (ratio - self.low) / (self.high - self.low)
        return 8 + (WIDTH - 16) * min(max(share, 0.0), 1.0)


def interval(ratio: float, low: float, high: float, scale: Scale) -> Html:
    """A ratio with its interval and a line at 1; muted if the interval includes 1."""
    middle, equal = HEIGHT / 2, f"{scale.at(1):.1f}"
    colour = "muted" if low <= 1 <= high else "accent"
    ends = f"M{scale.at(low):.1f} {middle} H{scale.at(high):.1f}"
    parts = [_stroke(f"M{equal} 0 V{HEIGHT}", "ink", 1), _stroke(ends, colour, 3)]
    if scale.low <= ratio <= scale.high:
        parts.append(_fill(SHAPES["o"], (scale.at(ratio), middle), colour))
    if high > scale.high:
        parts.append(_fill("M0 0 L-8 -5 V5 Z", (WIDTH, middle), colour))
    if low < scale.low:
        parts.append(_fill("M0 0 L8 -5 V5 Z", (0, middle), colour))
    return _drawing(WIDTH, HEIGHT, parts)


def line(look: Look, marked: bool = False) -> Html:
    """A short line in a planner's colour and dash, with its marker if it is `marked`."""
    return swatch(f"p{look.colour}", look.dash, MARKERS[look.marker] if marked else "")


def swatch(colour: str, dash: int = 0, marker: str = "", size: float = 6) -> Html:
    """A line in a colour of the page, or none if `dash` is -1, with a marker of a `size` [pt]."""
    parts = []
    width = 30 if dash >= 0 else 16
    if dash >= 0:
        dashes = [] if DASHES[dash] == "-" else DASHES[dash][1]
        parts.append(_stroke("M0 8 H30", colour, 2.2, " ".join(f"{2.2 * d:g}" for d in dashes)))
    if marker:
        where = f"translate({width / 2:g} 8) scale({size / 6:.2f})"
        style = f"fill:var(--paper);stroke:var(--{colour});stroke-width:1.6"
        style += ";vector-effect:non-scaling-stroke"
        parts.append(element("path", d=SHAPES[marker], transform=where, style=style))
    return _drawing(width, 16, parts)


def legend(entries: Iterable[tuple[Html, str]]) -> Html:
    """The legend of a picture: each mark with its text."""
    items = (element("li", mark, element("span", breakable(text))) for mark, text in entries)
    return element("ul", *items, kind="legend")


def palette() -> str:
    """The planners' colours as declarations of CSS."""
    return " ".join(f"--p{n}: {colour};" for n, colour in enumerate(COLOURS))


def _stroke(path: str, colour: str, width: float, dashes: str = "") -> Html:
    style = f"fill:none;stroke:var(--{colour});stroke-width:{width:g}"
    return element("path", d=path, style=style, stroke_dasharray=dashes)


def _fill(path: str, at: tuple[float, float], colour: str) -> Html:
    where = f"translate({at[0]:.1f} {at[1]:g})"
    return element("path", d=path, transform=where, style=f"fill:var(--{colour})")


def _drawing(width: int, height: int, parts: Iterable[Html]) -> Html:
    size = {"width": str(width), "height": str(height), "viewBox": f"0 0 {width} {height}"}
    return element("svg", *parts, **size, aria_hidden="true")
