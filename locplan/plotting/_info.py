"""The figure of a map with its rooms and places."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator

from locplan._util.tables import in_square_metres
from locplan.planners import MapInfo
from locplan.plotting._cells import draw_cells, shrunk
from locplan.plotting._maps import draw_map, map_axes
from locplan.plotting.style import BLUE, GREEN, ORANGE, PURPLE, SKY, YELLOW

ROOM_COLOURS = (SKY, ORANGE, GREEN, PURPLE, YELLOW, BLUE)
"""Colours of the largest rooms."""
OTHER_COLOUR = "#b08d57"
"""Colour of all further rooms."""
TINT = 115
"""Opacity of the rooms' colours, 0..255."""
LINES = 24
"""Most grid lines along the map's longer side."""


def info_figure(info: MapInfo) -> Figure:
    """Draw the map with numbered grid lines [m], its rooms tinted, and its places named.

    Parameters
    ----------
    info : MapInfo
        The description of the map, from `locplan.planners.describe_map`.
    """
    figure, axes = map_axes(info.grid)
    draw_map(axes, info.grid)
    colours = [(0.0, 0.0, 0.0), *map(to_rgb, ROOM_COLOURS), to_rgb(OTHER_COLOUR)]
    tints = np.array([(*(round(255 * part) for part in rgb), TINT) for rgb in colours], np.uint8)
    tints[0, 3] = 0
    kind = np.minimum(info.room_of_cell, len(tints) - 1).astype(np.uint8)
    draw_cells(axes, info.grid, tints[shrunk(kind)])
    spacing = _spacing(max(*np.diff(axes.get_xlim()), *np.diff(axes.get_ylim())))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(spacing))
    axes.grid(color="0.25", linewidth=0.5, alpha=0.5)
    axes.tick_params(labeltop=True, labelright=True, top=True, right=True, labelsize="small")
    for place in info.places:
        axes.plot(place.x, place.y, "o", markersize=13, color="white", markeredgecolor="black")
        centred: dict[str, Any] = {"ha": "center", "va": "center_baseline", "fontsize": 9}
        axes.text(place.x, place.y, place.name, fontweight="bold", zorder=5, **centred)
    (width, height), turned = info.size, math.degrees(info.grid.origin[2])
    yaw = f", yaw {turned:.4g} deg" if turned else ""
    size = f"{width:.4g} x {height:.4g} m, {info.grid.resolution:g} m a cell{yaw}"
    rooms = f"{len(info.rooms)} room{'' if len(info.rooms) == 1 else 's'}"
    robot = f"{rooms} for a robot of radius {info.robot_radius:g} m"
    axes.set_title(f"{info.grid.name or 'map'}: {size}\n{robot}", fontsize="medium")
    _add_legend(figure, info)
    return figure


def _add_legend(figure: Figure, info: MapInfo) -> None:
    """Name the rooms' colours and the places' positions below the map."""
    handles: list[Patch | Line2D] = []
    shown = info.rooms[: len(ROOM_COLOURS)]
    for room, colour in zip(shown, ROOM_COLOURS, strict=False):
        label = f"room {room.number}, {in_square_metres(room.area)}"
        handles.append(Patch(facecolor=colour, alpha=TINT / 255, label=label))
    if more := info.rooms[len(ROOM_COLOURS) :]:
        area = sum(room.area for room in more)
        label = f"{len(more)} more, {in_square_metres(area)}"
        handles.append(Patch(facecolor=OTHER_COLOUR, alpha=TINT / 255, label=label))
    plain: dict[str, Any] = {"linestyle": "", "markeredgewidth": 0}
    for place in info.places:
        label = f"{place.xy} m"
        marker = f"$\\mathbf{{{place.name}}}$"
        handles.append(Line2D([], [], color="black", marker=marker, **plain, label=label))
    if handles:
        width = figure.get_figwidth()
        figure.legend(
            handles=handles,
            loc="outside lower center",
            ncols=max(1, min(len(handles), int(width / 1.6))),
            frameon=False,
            fontsize="small",
        )


def _spacing(extent: float) -> float:
    """Distance of the grid lines [m]: 1, 2 or 5 times a power of ten."""
    least = extent / LINES
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= least)
