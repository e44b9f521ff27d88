"""Figure of twins: how sure a match is, which places are joined to which, and where to start."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray

from locplan.plotting import Picture, draw_cells, draw_map, map_size, style
from locplan.twins._places import THRESHOLD, Start
from locplan.twins._trials import GlobalMatches
from locplan.twins._twins import SHOWN, Twins

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ListedColormap(colormaps["YlOrBr"](np.linspace(0.0, 0.8, 256)))
"""Colours of the share elsewhere, from nearly white to brown, never as dark as a wall."""
OTHER = "0.35"
"""Colour of lines that belong to none of these symmetries."""
MAX_LINES = 24
"""Maximum number of lines."""
NUMBERED: dict[str, Any] = {
    **{"marker": "o", "markersize": 11, "linestyle": "none"},
    **{"markerfacecolor": "white", "markeredgecolor": "black"},
}
"""Style of the markers that hold a number."""


def twins_figure(
    twins: Twins, starts: Sequence[Start] | None = None, matches: GlobalMatches | None = None
) -> Figure:
    """Draw the map with the share of the posterior elsewhere, some twins, and the best starts.

    Of one place only, its twins are numbered instead.

    Parameters
    ----------
    twins : Twins
        What was found.
    starts : sequence of Start, optional
        Starts, which are numbered; `Twins.best_starts` by default.
    matches : GlobalMatches, optional
        What `Twins.verify` gave; it is not shown.
    """
    if len(twins) == 1:
        return place_figure(twins, 0)
    starts = twins.best_starts() if starts is None else starts
    width, height = map_size(twins.grid)
    named = twins.symmetries[:5]
    figure = Picture(figsize=(width, height + 0.5 + 0.16 * len(named)), layout="constrained")
    axes = figure.add_subplot()
    draw_map(axes, twins.grid)
    image = draw_cells(axes, twins.grid, twins.layer("elsewhere"), cmap=COLOURS, vmin=0.0, vmax=1.0)
    bar = figure.colorbar(image, ax=axes, shrink=0.8, label="chance that a match lands elsewhere")
    bar.ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    handles = _draw_twins(axes, twins)
    if starts:
        handles.append(_draw_starts(axes, starts))
    title = (
        f"{twins.grid.name or 'map'}: {twins.share:.0%} of {len(twins)} places have a twin within"
        f" {THRESHOLD:g} nats\n{twins.matching.lidar.title}"
    )
    said = [f"symmetry {n}: {each}" for n, each in enumerate(named, 1)]
    more = len(twins.symmetries) - len(named)
    if more > 0:
        said[-1] += f"; {more} more"
    axes.set_title("\n".join([title, *said]), fontsize="small", loc="left")
    if handles:
        figure.legend(
            handles=handles, ncols=3, fontsize="small", frameon=False, loc="outside lower center"
        )
    return figure


def place_figure(twins: Twins, place: int) -> Figure:
    """Draw one place, joined with its best twins, which are numbered as in its table."""
    x, y = twins.places[place].tolist()
    figure = Picture(figsize=map_size(twins.grid), layout="constrained")
    axes = figure.add_subplot()
    draw_map(axes, twins.grid)
    found = twins.of(place)
    for n, twin in enumerate(found[:SHOWN], 1):
        alike = twin.excess <= THRESHOLD
        line = axes.plot(
            [x, twin.x], [y, twin.y], color=style.COLOURS[0] if alike else OTHER, zorder=3
        )
        line[0].set_linestyle("-" if alike else ":")
        axes.plot(twin.x, twin.y, zorder=5, **NUMBERED)
        axes.annotate(
            str(n), (twin.x, twin.y), ha="center", va="center", fontsize=7, zorder=6 + 1 / n
        )
    axes.plot(x, y, "*", color=style.VERMILION, markeredgecolor="black", markersize=15, zorder=8)
    about = "no twin"
    if found:
        more = f", the best {SHOWN} of {len(found)}" if len(found) > SHOWN else ""
        about = f"numbers: its twins{more}; dotted: an excess above {THRESHOLD:g} nats"
    axes.set_title(
        f"{twins.grid.name or 'map'}, {twins.matching.lidar.title}\nstar: {x:.2f},{y:.2f} m,"
        f" {twins.elsewhere[place]:.0%} of the posterior more than 2 m away\n{about}",
        fontsize="small",
        loc="left",
    )
    return figure


def _draw_twins(axes: Axes, twins: Twins) -> list[Any]:
    """Join some places with their twins, of each symmetry in its colour; the legend's handles."""
    handles: list[Any] = []
    chosen = _joined(twins)
    for number, pairs in sorted(chosen.items(), key=lambda item: (item[0] < 0, item[0])):
        colour = style.COLOURS[number] if number >= 0 else OTHER
        lines = [twins.places[place].tolist() + twin for place, twin in pairs]
        segments = np.array(lines).reshape(-1, 2, 2)
        axes.add_collection(
            LineCollection(list(segments), colors=colour, linewidths=1.2, alpha=0.85, zorder=3)
        )
        axes.plot(*segments.reshape(-1, 2).T, "o", color=colour, markersize=3, zorder=3)
        label = (
            f"twins by symmetry {number + 1}"
            if number >= 0
            else "other twins"
            if twins.symmetries
            else "twins"
        )
        handles.append(Line2D([], [], color=colour, marker="o", markersize=3, label=label))
    return handles


def _joined(twins: Twins) -> dict[int, list[tuple[int, list[float]]]]:
    """Pairs of a place and its best twin, thinned out, by the symmetry that joins them or -1."""
    twin = _best_twins(twins)
    # Share of the posterior elsewhere from which on a place is joined to its twin.
    having = np.flatnonzero((twin[:, 3] <= THRESHOLD) & (twins.elsewhere >= 0.2))
    # The fewer lines there may be, the farther apart their ends are.
    apart = math.sqrt(having.size * twins.spacing**2 / (MAX_LINES / 2)) if having.size else 0.0
    taken: list[NDArray[np.float64]] = []
    pairs: dict[int, list[tuple[int, list[float]]]] = {}
    for place in having[np.argsort(twin[having, 3], kind="stable")]:
        ends = twins.places[place], twin[place, :2]
        near = [float(np.hypot(*(end - other))) < apart for end in ends for other in taken]
        if any(near) or len(taken) >= 2 * MAX_LINES:
            continue
        taken += ends
        pairs.setdefault(_symmetry_of(twins, place, twin[place]), []).append(
            (int(place), twin[place, :2].tolist())
        )
    return pairs


def _best_twins(twins: Twins) -> NDArray[np.float64]:
    """x, y, heading and excess of the best twin of each place, (n, 4); NaN where there is none."""
    every = twins.twins[:, :, 0]
    heading = np.nan_to_num(every[:, :, 3], nan=np.inf).argmin(axis=1)
    best: NDArray[np.float64] = every[np.arange(len(every)), heading]
    return best


def _symmetry_of(twins: Twins, place: int, twin: NDArray[np.float64]) -> int:
    """Number of the first symmetry with a colour that takes a place to a twin, or -1."""
    for n, each in enumerate(twins.symmetries[: len(style.COLOURS)]):
        from_middle = twins.places[place] - np.array(each.middle)
        cos, sin = math.cos(each.turn), math.sin(each.turn)
        turned = np.array([[cos, -sin], [sin, cos]]) @ from_middle
        if np.hypot(*(np.array(each.moved) + turned - twin[:2])) <= 1.0:
            return n
    return -1


def _draw_starts(axes: Axes, starts: Sequence[Start]) -> Any:
    """Draw the starts with their numbers; the legend's handle."""
    for n, start in enumerate(starts, 1):
        axes.plot(start.x, start.y, zorder=5, **NUMBERED)
        axes.annotate(str(n), (start.x, start.y), ha="center", va="center", fontsize=7, zorder=6)
    most = max(start.elsewhere for start in starts)
    label = f"best starts, at most {most:.0%} elsewhere"
    return Line2D([], [], label=label, **(NUMBERED | {"markersize": 8}))
