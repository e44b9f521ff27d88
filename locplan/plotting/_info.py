"""The figure of a map with its rooms and places."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator

from locplan._util.tables import in_square_metres
from locplan.planners import MapInfo
from locplan.plotting._cells import draw_cells, shrunk
from locplan.plotting._maps import draw_map, map_axes
from locplan.plotting.style import BLUE, GREEN, ORANGE, PURPLE, SKY, YELLOW


def info_figure(info: MapInfo) -> Figure:
    """Draw the map with numbered grid lines [m], its rooms tinted, and its places named.

    Parameters
    ----------
    info : MapInfo
        The description of the map, from `locplan.planners.describe_map`.
    """
    figure, axes = map_axes(info.grid)
    draw_map(axes, info.grid)
    colours = (SKY, ORANGE, GREEN, PURPLE, YELLOW, BLUE, "#b08d57")  # the last one of all others
    shades = [to_rgba_array("black", 0.0), to_rgba_array(colours, 0.45)]
    tints = np.round(255 * np.concatenate(shades)).astype(np.uint8)
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
    _add_legend(figure, info, colours)
    return figure


def _add_legend(figure: Figure, info: MapInfo, colours: Sequence[str]) -> None:
    """Name the rooms' colours and the places' positions below the map."""
    count = len(colours) - 1
    labels = [f"room {each.number}, {in_square_metres(each.area)}" for each in info.rooms[:count]]
    if more := info.rooms[count:]:
        labels.append(f"{len(more)} more, {in_square_metres(sum(room.area for room in more))}")
    handles: list[Patch | Line2D] = [
        Patch(facecolor=colour, alpha=0.45, label=label)
        for label, colour in zip(labels, colours, strict=False)
    ]
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
    least = extent / 24  # at most 24 lines
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= least)
