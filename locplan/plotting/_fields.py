"""Figures of maps, of their rooms, and of fields."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, MultipleLocator

from locplan._util.tables import in_square_metres
from locplan.field import (
    CovarianceField,
)
from locplan.maps import OccupancyGrid
from locplan.plotting import style as styles
from locplan.plotting._cells import draw_cells, limits_of, map_axes, map_size, shrunk
from locplan.plotting._maps import draw_field, draw_map
from locplan.plotting._picture import Picture, field_bar, weak_spots

if TYPE_CHECKING:
    from locplan.planners import MapInfo


TURN = "#d62728"
"""Colour of the heading's deviation."""


def map_figure(grid: OccupancyGrid) -> Figure:
    """Draw the map alone: walls black, unknown space grey, free space white.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    """
    figure, axes = map_axes(grid)
    draw_map(axes, grid)
    axes.set_title(grid.name or "map", fontsize="medium")
    return figure


def field_figure(field: CovarianceField, name: str | None = None) -> Figure:
    """Draw the map with one scalar of its field as a heat map.

    Parameters
    ----------
    field : CovarianceField
        The field.
    name : str, optional
        "e", "position_std", "position_rms" or "heading_std", see `locplan.field.scalar`, or
        one of the field's layers; by default what degeneracy is made of. For several headings,
        that of the mean information is drawn. Deviations are shown in cm and degrees.
    """
    figure, axes = map_axes(field.grid)
    image = draw_field(axes, field, name)
    field_bar(figure, image, axes, field.quantity(name).axis, shrink=0.9)
    title = f"{field.grid.name or 'map'}: u is about 0 on {field.saturated_share:.0%}"
    weak = weak_spots(field, image.get_array(), name)
    axes.set_title(f"{title}; {weak}\n{field.config.title}", fontsize="medium")
    return figure


def fields_figure(
    rows: Sequence[Mapping[str, CovarianceField]],
    name: str = "e",
    parts: Sequence[OccupancyGrid] | None = None,
) -> Figure:
    """Draw a scalar of several fields side by side on one scale, a row for each map.

    Parameters
    ----------
    rows : sequence of mappings of str to CovarianceField
        The fields of each map by the title to show, at least one; e has one unit in all of them.
    name : str, default "e"
        Scalar or layer that all fields have, see `field_figure`.
    parts : sequence of OccupancyGrid, optional
        The part of each map that is drawn, cut out of it along its cells; all of it by default.
    """
    columns = max(map(len, rows))
    parts = parts or [next(iter(fields.values())).grid for fields in rows]
    heights = [height / width for width, height in map(map_size, parts)]
    wide = min(3.6, 8.0 / columns)  # of a map, and of all of them together [inch]
    size = wide * columns + 1, sum(wide * height + 0.6 for height in heights)
    figure = Picture(figsize=size, layout="constrained")
    grid = figure.subplots(len(rows), columns, squeeze=False, height_ratios=heights)
    images, label_of_bar = [], ""
    for axes_of_row, fields, part in zip(grid, rows, parts, strict=True):
        for axes, (label, field) in zip(axes_of_row, fields.items(), strict=False):
            images.append(draw_field(axes, field, name, part))
            label_of_bar = field.quantity(name).axis
            axes.set_title(label, fontsize="medium")
            first = axes is axes_of_row[0]
            axes.set(xlabel="", ylabel=(field.grid.name or "map") if first else "")
            if part.shape != field.grid.shape:
                axes.set(**limits_of(part, share=0.0))
    ends = np.array([image.get_clim() for image in images])  # of one scale for all
    for image in images:
        image.set_clim(ends[:, 0].min(), ends[:, 1].max())
    field_bar(figure, images[0], grid.ravel().tolist(), label_of_bar, shrink=0.6)
    figure.supxlabel("x and y [m]", fontsize="medium")
    return figure


def info_figure(info: MapInfo) -> Figure:
    """Draw the map with numbered grid lines [m], its rooms tinted, and its places named.

    Parameters
    ----------
    info : MapInfo
        The description of the map, from `locplan.planners.describe_map`.
    """
    figure, axes = map_axes(info.grid)
    draw_map(axes, info.grid)
    colours = (
        styles.SKY,
        styles.ORANGE,
        styles.GREEN,
        styles.PURPLE,
        styles.YELLOW,
        styles.BLUE,
        "#b08d57",
    )  # the last one of all others
    shades = [to_rgba_array("black", 0.0), to_rgba_array(colours, 0.45)]
    tints = np.round(255 * np.concatenate(shades)).astype(np.uint8)
    kind = np.minimum(info.room_of_cell, len(tints) - 1).astype(np.uint8)
    draw_cells(axes, info.grid, tints[shrunk(kind)])
    extent = max(*np.diff(axes.get_xlim()), *np.diff(axes.get_ylim()))
    # At most 24 lines, at 1, 2 or 5 times a power of ten; the same on both axes.
    ticks = MaxNLocator(24, steps=[1, 2, 5, 10]).tick_values(0, extent)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(ticks[1] - ticks[0]))
    axes.grid(color="0.25", linewidth=0.5, alpha=0.5)
    axes.tick_params(labeltop=True, labelright=True, top=True, right=True, labelsize="small")
    centred: dict[str, Any] = {"ha": "center", "va": "center_baseline", "fontsize": 9}
    for place in info.places:
        axes.plot(place.x, place.y, "o", markersize=13, **styles.END_STYLE)
        axes.text(place.x, place.y, place.name, fontweight="bold", zorder=5, **centred)
    (width, height), turned = info.size, math.degrees(info.grid.origin[2])
    yaw = f", yaw {turned:.4g} deg" if turned else ""
    size = f"{width:.4g} x {height:.4g} m, {info.grid.resolution:g} m a cell{yaw}"
    rooms = f"{len(info.rooms)} room{'' if len(info.rooms) == 1 else 's'}"
    robot = f"{rooms} for a robot of radius {info.robot_size}"
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
    plain: dict[str, Any] = {"linestyle": "", "markeredgewidth": 0, "color": "black"}
    for place in info.places:
        marker = f"$\\mathbf{{{place.name}}}$"
        handles.append(Line2D([], [], marker=marker, **plain, label=f"{place.xy} m"))
    if handles:
        columns = max(1, min(len(handles), int(figure.get_figwidth() / 1.6)))
        style: dict[str, Any] = {"ncols": columns, "frameon": False, "fontsize": "small"}
        figure.legend(handles=handles, loc="outside lower center", **style)
