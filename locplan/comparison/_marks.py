"""Small drawings of a report and its numbers: marks, scales, maps behind paths, and filters."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray
from PIL import Image

from locplan.comparison._figures import DASHES, MARKERS, Look
from locplan.comparison._result import Standing
from locplan.field import CovarianceField
from locplan.plotting import Picture, draw_field

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


class Mark(NamedTuple):
    """A line in a colour of the page, or none if `dash` is -1, with a marker of a size [pt]."""

    colour: str
    dash: int = 0
    marker: str = ""
    size: float = 6.0

    @classmethod
    def of(cls, look: Look, marked: bool = False) -> Mark:
        """A planner's line, with its marker if it is `marked`."""
        return cls(f"p{look.colour}", look.dash, MARKERS[look.marker] if marked else "")


@dataclass(frozen=True)
class Scale:
    """A scale that turns a ratio into its place in a drawing of 120 pixels."""

    low: float
    high: float

    @classmethod
    def of(cls, rows: Iterable[Standing]) -> Scale:
        """A scale that shows 1 and the intervals of J's ratios, as far as they are near 1."""
        ends = [end for row in rows for end in row.cost.estimate[1:] if math.isfinite(end)]
        # At most 10 % to either side, so that one bad planner does not hide the others.
        return cls(max(min([*ends, 0.99]), 0.9), min(max([*ends, 1.01]), 1.1))

    def at(self, ratio: float) -> str:
        """The distance of a ratio from the left [pixels], with room for arrows at both ends."""
        share = (ratio - self.low) / (self.high - self.low)
        return f"{8 + 104 * min(max(share, 0.0), 1.0):.1f}"


@dataclass(frozen=True)
class Backdrop:
    """The image of a map with its field, and where it lies in the world."""

    low: NDArray[np.float64]
    """x and y of the lower left corner [m]."""
    scale: float
    """Pixels per metre."""
    size: tuple[int, int]
    """Width and height [pixels]."""
    data: str
    """The image as a URL."""

    @classmethod
    def of(cls, drawn: CovarianceField) -> Backdrop:
        """Draw a field without axes."""
        side = 640  # pixels of the longer side, the unit of the lines over it, too
        figure = Picture(figsize=(1, 1), dpi=side)
        axes = figure.add_axes((0, 0, 1, 1))
        draw_field(axes, drawn)
        axes.set_axis_off()
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        spans = np.array([right - left, top - bottom])
        width, height = np.ceil(side * spans / spans.max()).astype(int).tolist()
        figure.set_size_inches(width / side, height / side)
        written, small = io.BytesIO(), io.BytesIO()
        figure.savefig(written, format="png", dpi=side, facecolor="white")
        Image.open(written).convert("RGB").quantize(64).save(small, "png", optimize=True)
        data = f"data:image/png;base64,{base64.b64encode(small.getvalue()).decode()}"
        return cls(np.array([left, bottom]), float(side / spans.max()), (width, height), data)

    def pixels(self, xy: Sequence[Sequence[float]]) -> NDArray[np.float32]:
        """Positions in the image, (n, 2); rows go down."""
        points = (np.array(xy, float).reshape(-1, 2) - self.low) * self.scale
        points[:, 1] = self.size[1] - points[:, 1]
        return points.astype(np.float32)

    def line(self, xy: Sequence[Sequence[float]]) -> str:
        """A path as an SVG path, with no more vertices than it takes to show it."""
        short = cv2.approxPolyDP(self.pixels(xy)[:, None], 0.7, False)[:, 0]
        return "M" + " ".join(f"{x:.1f} {y:.1f}" for x, y in short.tolist())


def breakable(label: str) -> Markup:
    """A planner's label that may be broken between its options."""
    return Markup(str(escape(label)).replace(":", ":<wbr>").replace(",", ",<wbr>"))


def counted(number: int, one: str, many: str = "") -> str:
    """A number with its noun, in the plural unless it is 1."""
    return f"{number:,} {one if number == 1 else many or one + 's'}"


def dashes(look: Look | Mark, width: float) -> str:
    """The dashes of a line of some width, for SVG; empty for a whole line."""
    pattern = () if DASHES[look.dash] == "-" else DASHES[look.dash][1]
    return " ".join(f"{width * part:.3g}" for part in pattern)


def key(value: float) -> str:
    """The key by which a table is sorted; what is not known comes last."""
    return f"{value:.9g}" if math.isfinite(value) else "x"


def number(value: float) -> str:
    """Text with four significant digits above 10, three above 1 and two below."""
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else "–"
    size = math.floor(math.log10(abs(value)))
    if size < -4:
        return f"{value:.1e}".replace("e-0", "e-")
    return f"{value:,.{1 - size if size < 0 else max(0, min(2, 3 - size))}f}"
