"""The picture of a check: the map with its trips, its weak spots, and where drives get lost."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from locplan.diagnosis._weak_spots import gathered
from locplan.plotting import Picture, draw_map, draw_path, map_size

if TYPE_CHECKING:
    from locplan.diagnosis._result import Check

LOSES, KEEPS, WEAK, LETTER, MARK = "#d55e00", "#0072b2", "#e69f00", "#7a3b00", "#b00020"
"""Colours of trips that lose a tenth of the drives or more, of the others, of weak spots, of their
letters, and of the numbers of lost drives."""
OFTEN = 0.1
"""Share of lost drives from which on a trip is drawn as one that loses them."""
SIZE = 0.055
"""Size of a label, as a share of the longer side of what is drawn."""


class Label(NamedTuple):
    """A letter, a number of lost drives, or the name of an end of a trip."""

    kind: str
    """"spot", "lost" or "end"."""
    text: str
    """What it says."""
    xy: tuple[float, float]
    """The place that it names [m]."""
    at: tuple[float, float]
    """Where it stands, beside others [m]."""


def labels(check: Check, size: float) -> list[Label]:
    """Labels none of which stands on another.

    Parameters
    ----------
    check : Check
        The check.
    size : float
        Height of a label [m].
    """
    around = [
        (size * far * np.cos(turn), size * far * np.sin(turn))
        for far in (0.0, 1.05, 1.6, 2.2, 3.0, 4.0)
        for turn in np.radians(range(90, 450, 30))
    ]
    made: list[Label] = []
    for kind, text, (x, y) in _named(check, size):
        free = (
            (x + dx, y + dy)
            for dx, dy in around
            if not any(_overlap(text, (x + dx, y + dy), each, size) for each in made)
        )
        made.append(Label(kind, text, (x, y), next(free, (x, y))))
    return made


def _overlap(text: str, at: tuple[float, float], other: Label, size: float) -> bool:
    (x, y), (left, low) = at, other.at
    wide = max(1.0, 0.2 * (len(text) + len(other.text)))
    return abs(x - left) < size * wide and abs(y - low) < size


def _named(check: Check, size: float) -> Iterator[tuple[str, str, tuple[float, float]]]:
    """Kind, text and place of each label."""
    lost = np.concatenate([each.lost_at for each in check.trips])
    for spot in check.spots:
        if spot.letter:
            yield "spot", spot.letter, (spot.x, spot.y)
    for (x, y), members in gathered(lost, 1.2 * size):
        yield "lost", f"{len(members)}", (float(x), float(y))
    ends = {}
    for trip in check.trips:
        start, _, goal = trip.name.partition(" to ")
        ends.update(zip((start, goal), map(tuple, trip.path.xy[[0, -1]].tolist()), strict=True))
    for name, xy in ends.items():
        if name:
            yield "end", name, xy


def check_figure(check: Check, *_: Any) -> Figure:
    """Draw the map with its trips, weak spots, and where drives get lost.

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
        rings = [Outline(np.vstack([ring, ring[:1]])) for ring in spot.rings]
        if rings:
            shape = Outline.make_compound_path(*rings)
            axes.add_patch(PathPatch(shape, facecolor=WEAK, alpha=0.45, edgecolor="none"))
    for trip in check.trips:
        often = trip.rates.lost.value >= OFTEN
        draw_path(axes, trip.path, color=LOSES if often else KEEPS, linewidth=1.6)
    size = SIZE * max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
    for each in labels(check, size):
        back, ink = {"spot": (LETTER, "white"), "lost": (MARK, "white")}.get(
            each.kind, ("white", "#1b1f24")
        )
        axes.plot(*zip(each.xy, each.at, strict=True), color=back, linewidth=1.2, zorder=5)
        axes.text(
            *each.at,
            each.text,
            fontsize="large" if each.kind == "spot" else "small",
            weight="normal" if each.kind == "end" else "bold",
            ha="center",
            va="center",
            color=ink,
            zorder=6,
            bbox={
                "boxstyle": "round,pad=.2" if each.kind == "end" else "circle,pad=.2",
                "fc": back,
                "ec": "#5b6470" if each.kind == "end" else "white",
            },
        )
    axes.set_title(
        f"{check.grid.name or 'map'}: trips (orange: lost in a tenth of the drives or more), weak"
        " spots\n(shaded, A the worst), and how many drives were first off by over 1 m (red)",
        fontsize="small",
    )
    return figure
