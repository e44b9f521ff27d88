"""The picture of a check: the map with its trips and the letters of its weak spots."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from locplan.plotting import Picture, draw_map, draw_path, map_size

if TYPE_CHECKING:
    from locplan.diagnosis._result import Check

LOSES, KEEPS, WEAK = "#d55e00", "#0072b2", "#e69f00"
"""Colours of trips that lose a tenth of the drives or more, of the others, and of weak spots."""
OFTEN = 0.1
"""Share of lost drives from which on a trip is drawn as one that loses them."""


def check_figure(check: Check, *_: Any) -> Figure:
    """Draw the map with its trips and weak spots.

    Parameters
    ----------
    check : Check
        What `locplan.check` has found.
    *_
        What `save` takes, of which nothing is drawn.
    """
    figure = Picture(figsize=map_size(check.site.world), layout="constrained")
    axes = figure.subplots()
    draw_map(axes, check.site.world)
    for spot in check.spots:
        axes.add_patch(Polygon(spot.outline, facecolor=WEAK, alpha=0.45, edgecolor="none"))
    for trip in check.trips:
        often = trip.rates.lost.value >= OFTEN
        draw_path(axes, trip.path, color=LOSES if often else KEEPS, linewidth=1.6)
        for (x, y), name in zip(trip.path.xy[[0, -1]].tolist(), _ends(trip.name), strict=True):
            axes.text(
                x,
                y,
                name,
                fontsize="small",
                color="#1b1f24",
                ha="center",
                va="center",
                bbox={"boxstyle": "round,pad=.2", "fc": "white", "ec": "#5b6470"},
            )
    for spot in check.spots:
        axes.text(
            spot.x,
            spot.y,
            spot.letter,
            fontsize="large",
            weight="bold",
            ha="center",
            va="center",
            color="white",
            zorder=6,
            bbox={"boxstyle": "circle,pad=.25", "fc": "#7a3b00", "ec": "white"},
        )
    axes.set_title(
        f"{check.grid.name or 'map'}: weak spots, and trips (orange: lost in a tenth of the drives"
        " or more)",
        fontsize="small",
    )
    return figure


def _ends(name: str) -> tuple[str, str]:
    """Names of both ends of a trip."""
    start, _, goal = name.partition(" to ")
    return (start, goal) if goal else (name, "")
