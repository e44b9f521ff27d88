"""The picture of a check: the map with its trips, its weak spots, and where drives get lost."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from locplan.maps import OccupancyGrid
from locplan.plotting import Picture, draw_map, draw_path, map_size

if TYPE_CHECKING:
    from locplan.diagnosis._result import Check

LOSES, KEEPS, WEAK, LETTER, MARK = "#d55e00", "#0072b2", "#e69f00", "#7a3b00", "#b00020"
"""Colours of trips that lose a tenth of the drives or more, of the others, of weak spots, of their
letters, and of the places where drives were first off by over 1 m."""
OFTEN = 0.1
"""Share of lost drives from which on a trip is drawn as one that loses them."""
SIZE = 0.055
"""Size of a label, as a share of the longer side of what is drawn."""


class Label(NamedTuple):
    """A letter with its number of lost drives, or the name of an end of a trip."""

    kind: str
    """"spot" or "end"."""
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
    for kind, text, (x, y) in _named(check):
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


def _named(check: Check) -> Iterator[tuple[str, str, tuple[float, float]]]:
    """Kind, text and place of each label."""
    for spot in check.spots:
        if spot.letter:
            text = f"{spot.letter}: {spot.lost}" if spot.lost else spot.letter
            yield "spot", text, (spot.x, spot.y)
    ends: dict[str, tuple[float, ...]] = {}
    for trip in check.trips:
        start, _, goal = trip.name.partition(" to ")
        ends.update(zip((start, goal), map(tuple, trip.path.xy[[0, -1]].tolist()), strict=True))
    yield from (("end", name, (x, y)) for name, (x, y) in ends.items() if name)


def drawn_part(grid: OccupancyGrid) -> OccupancyGrid:
    """The part of a map in which a robot can be, with its walls.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    """
    rows, cols = (np.flatnonzero(grid.free.any(axis=axis)) for axis in (1, 0))
    edge = max(2, round(0.03 * max(np.ptp(rows), np.ptp(cols))))
    return grid.part(
        *(slice(max(0, each[0] - edge), int(each[-1]) + edge) for each in (rows, cols))
    )


def check_figure(check: Check, *_: Any) -> Figure:
    """Draw the map with its trips, weak spots, and where drives get lost.

    Parameters
    ----------
    check : Check
        What `locplan.check` has found.
    *_
        What `save` takes, of which nothing is drawn.
    """
    part = drawn_part(check.site.world)
    figure = Picture(figsize=map_size(part), layout="constrained")
    axes = figure.subplots()
    draw_map(axes, part)
    for spot in check.spots:
        rings = [Outline(np.vstack([ring, ring[:1]])) for ring in spot.rings]
        if rings:
            shape = Outline.make_compound_path(*rings)
            axes.add_patch(PathPatch(shape, facecolor=WEAK, alpha=0.45, edgecolor="none"))
    for trip in check.trips:
        often = trip.rates.lost.value >= OFTEN
        draw_path(axes, trip.path, color=LOSES if often else KEEPS, linewidth=1.6)
        axes.plot(*trip.lost_at.T, "x", color=MARK, markersize=5, zorder=4)
    for each in labels(check, SIZE * max(part.shape) * part.resolution):
        is_spot = each.kind == "spot"
        back, ink, edge = (LETTER, "white", "white") if is_spot else ("white", "#1b1f24", "#5b6470")
        axes.plot(
            *zip(each.xy, each.at, strict=True), color=edge if not is_spot else back, zorder=5
        )
        axes.text(
            *each.at,
            each.text,
            fontsize="small",
            weight="bold" if is_spot else "normal",
            ha="center",
            va="center",
            color=ink,
            zorder=6,
            bbox={"boxstyle": "round,pad=.25", "fc": back, "ec": edge},
        )
    axes.set_title(
        f"{check.grid.name or 'map'}: trips (orange: lost in a tenth of the drives or more), the"
        " worst\nplaces (A: drives lost), weak spots (shaded), and where drives were first off by"
        " over 1 m (x)",
        fontsize="small",
    )
    return figure
