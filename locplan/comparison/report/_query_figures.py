"""The picture of J of every query."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from locplan._util.checks import printable
from locplan.comparison.report._figures import COLOURS, MARKERS, MUTED, Look, filtered, svg_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROW, AROUND = 0.19, 0.75
"""Height of a query's row, and of what is above and below all rows [inch]."""
SPREAD = 0.25
"""Greatest distance of a marker from the middle of its row, as a share of the row's height."""
FARTHEST = 1.5
"""Factor on the usual greatest excess of J over the baseline's within which J is shown to scale."""
LEAST_EXCESS = 0.02
"""Least excess that is taken as usual, so that rounding does not fill a picture."""
LONGEST = 24
"""Greatest number of characters of a query's label."""


def query_costs_picture(
    ratios: Mapping[str, NDArray[np.float64]],
    labels: Sequence[str],
    looks: Mapping[str, Look],
    alt: str,
) -> str:
    """A row for each query, a marker for each planner; an arrow stands for J beyond the edge."""
    values = np.array(list(ratios.values()))
    excess = np.median([np.nanmax(own) - 1 for own in values])
    top = 1 + FARTHEST * max(float(excess), LEAST_EXCESS)
    top = min(top, max(float(np.nanmax(values)), 1 + LEAST_EXCESS))
    bottom = min(1.0, float(np.nanmin(values)))
    margin = 0.05 * (top - bottom)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axvline(1, color=MUTED, linewidth=1.4)
        rows = np.arange(len(labels))
        shifts = np.linspace(-SPREAD, SPREAD, len(ratios)) if len(ratios) > 1 else [0.0]
        for (planner, own), shift in zip(ratios.items(), shifts, strict=True):
            if (own != 1).any():  # the baseline is the line
                _draw_planner(axes, own, rows + shift, top, looks, planner)
        axes.set_yticks(rows, [_short(label) for label in labels], parse_math=False)
        axes.set(xlim=(bottom - margin, top + margin), ylim=(len(labels) - 0.5, -0.5))
        axes.set_xlabel("J / baseline's J")
        axes.grid()

    return svg_of(draw, AROUND + ROW * len(labels), alt, list(looks))


def _draw_planner(
    axes: Axes,
    ratios: NDArray[np.float64],
    rows: NDArray[np.float64],
    top: float,
    looks: Mapping[str, Look],
    planner: str,
) -> None:
    look = looks[planner]
    style: dict[str, Any] = {"color": COLOURS[look.colour], "linestyle": "none", "markersize": 5}
    part = filtered(list(looks).index(planner))
    near = ratios <= top
    marker = MARKERS[look.marker]
    axes.plot(ratios[near], rows[near], marker, gid=part, markerfacecolor="none", **style)
    far = np.flatnonzero(ratios > top)
    axes.plot(np.full(far.size, top), rows[far], ">", gid=part, **style)


def _short(label: str) -> str:
    """The end of a label, which tells queries apart, as far as there is room for it."""
    text = printable(label)
    return text if len(text) <= LONGEST else f"…{text[-LONGEST:]}"
