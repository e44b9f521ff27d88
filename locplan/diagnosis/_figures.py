"""The picture of a check: the map with the routes that fail, weak spots, and failures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from locplan.diagnosis._weak_spots import points_of
from locplan.maps import OccupancyGrid
from locplan.plotting import Picture, draw_map, draw_path, map_size

if TYPE_CHECKING:
    from locplan.diagnosis._rates import RouteResult
    from locplan.diagnosis._result import Check

FAILS, WORKS, WEAK, LETTER, MARK = "#d55e00", "#8a929c", "#e69f00", "#7a3b00", "#b00020"
"""Colours of routes with a failure, of the others, of weak spots, of their letters, and of the
places where drives were first off by more than 1 m, or stopped instead of at the goal."""
N_NAMED = 3
"""Maximum number of routes with a failure that have a label with its rate."""
SIZE = 0.055
"""Size of a label, as a share of the longer side of what is drawn."""


STOP_MARK: dict[str, Any] = {
    "linestyle": "none",
    "marker": "s",
    "color": MARK,
    "markeredgecolor": "white",
    "markersize": 8,
    "zorder": 4,
}
"""Mark of a place where a drive stops instead of at the goal."""
STYLES = {
    "spot": (LETTER, "white", "white"),
    "route": (FAILS, "white", "white"),
    "end": ("white", "#1b1f24", "#5b6470"),
}
"""Colours of the face, the text and the edge of a label by its kind."""


class Label(NamedTuple):
    """A letter, the rate of failure of a route, or the name of an end of a route."""

    kind: str
    """"spot", "route" or "end"."""
    text: str
    """What it says."""
    xy: tuple[float, float]
    """The place that it names [m]."""
    at: tuple[float, float]
    """Where it stands, beside others [m]."""


def place_labels(check: Check, size: float) -> list[Label]:
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
    labels: list[Label] = []
    marks: list[Label] = []
    for kind, text, place in _named(check):
        # The mark of a failure stays visible.
        is_mark = kind == "failure"
        marks += [Label("mark", "", place, place)] * is_mark
        free = (
            (place[0] + dx, place[1] + dy)
            for dx, dy in around[12 * is_mark :]
            if not any(
                _overlap(text, (place[0] + dx, place[1] + dy), other, size)
                for other in (*labels, *marks)
            )
        )
        labels.append(Label("spot" if is_mark else kind, text, place, next(free, place)))
    return labels


def _overlap(text: str, at: tuple[float, float], other: Label, size: float) -> bool:
    (x, y), (left, low) = at, other.at
    wide = max(1.0, 0.2 * (len(text) + len(other.text)))
    return abs(x - left) < size * wide and abs(y - low) < size


def _named(check: Check) -> Iterator[tuple[str, str, tuple[float, float]]]:
    """Kind, text and place of each label."""
    for spot in check.spots:
        if spot.letter:
            kind = "failure" if spot.lost + spot.stopped else "spot"
            yield kind, spot.letter, (spot.x, spot.y)
    if check.passage and check.passage.is_narrow:
        place = check.passage.x, check.passage.y
        yield "failure", f"passage of {check.passage.width:.2f} m", place
    ends: dict[str, tuple[float, ...]] = {}
    for route in check.routes:
        start, _, goal = route.name.partition(" to ")
        ends.update(zip((start, goal), map(tuple, route.path.xy[[0, -1]].tolist()), strict=True))
    yield from (("end", name, (x, y)) for name, (x, y) in ends.items() if name)
    failing = [route for route in check.routes if route.rates.has_failure]
    for route in failing[:N_NAMED]:
        x, y = points_of(route.path)[len(points_of(route.path)) // 2].tolist()
        yield "route", failure_text(route), (x, y)


def failure_text(route: RouteResult) -> str:
    """Return the rate of the worse failure of a route."""
    rates = route.rates
    if rates.is_mostly_lost:
        return f"{100 * rates.lost.value:.0f} % lost"
    return f"{100 * rates.reached.value:.0f} % reach the goal"


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
    """Draw the map with its routes, weak spots, and where drives fail.

    Parameters
    ----------
    check : Check
        The result of `locplan.check`.
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
    for route in check.routes[::-1]:  # the worst on top
        fails = route.rates.has_failure
        width, colour = (3.2, FAILS) if fails else (1.4, WORKS)
        draw_path(axes, route.path, color=colour, linewidth=width, zorder=3 if fails else 2)
        axes.plot(*route.lost_at.T, "x", color=MARK, markersize=7, markeredgewidth=2, zorder=4)
        axes.plot(*route.stopped_at.T, **STOP_MARK)
    for each in place_labels(check, SIZE * max(part.shape) * part.resolution):
        back, ink, edge = STYLES[each.kind]
        axes.plot(
            *zip(each.xy, each.at, strict=True), color=back if edge == "white" else edge, zorder=5
        )
        axes.text(
            *each.at,
            each.text,
            fontsize="small",
            weight="normal" if each.kind == "end" else "bold",
            ha="center",
            va="center",
            color=ink,
            zorder=6,
            bbox={"boxstyle": "round,pad=.25", "fc": back, "ec": edge},
        )
    text = caption(check)
    title = f"{check.grid.name or 'Map'}. {text[:1].upper()}{text[1:]}"
    axes.set_title(title, fontsize="small")
    return figure


def caption(check: Check) -> str:
    """Explain what is drawn.

    Parameters
    ----------
    check : Check
        The check.
    """
    lost, stopped = (
        any(len(getattr(route, name)) for route in check.routes)
        for name in ("lost_at", "stopped_at")
    )
    fails = any(route.rates.has_failure for route in check.routes)
    explained = [
        (True, "orange: routes on which drives fail" if fails else "no route fails"),
        (lost, "x: a drive gets lost"),
        (stopped, "square: a drive stops instead of at the goal"),
        (bool(check.spots), "letters: weak spots (shaded)"),
    ]
    parts = [text for is_drawn, text in explained if is_drawn]
    half = (len(parts) + 1) // 2
    return ",\n".join(filter(None, [", ".join(parts[:half]), ", ".join(parts[half:])]))
