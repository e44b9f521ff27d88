"""Figures of maps, of their rooms, and of fields."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection, PatchCollection
from matplotlib.colors import Normalize, to_rgba_array
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Wedge
from matplotlib.ticker import MaxNLocator, MultipleLocator

from locplan._util.checks import one_of
from locplan._util.tables import in_square_metres
from locplan.errors import ConfigError
from locplan.field import (
    SCALARS,
    CovarianceField,
    Estimator,
    FieldConfig,
    Sad,
    config_of,
    load_or_compute,
    position_axes,
    sampled_covariances,
    scalar,
)
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.plotting import style as styles
from locplan.plotting._cells import draw_cells, field_cells, limits_of, map_axes, map_size, shrunk
from locplan.plotting._maps import draw_field, draw_map
from locplan.plotting._picture import HARMLESS, Picture, field_bar, weak_spots

if TYPE_CHECKING:
    from locplan.planners import MapInfo


TURN = "#d62728"
"""Colour of the heading's deviation."""


def figure_of(
    grid: OccupancyGrid,
    figure: str = "field",
    estimators: Sequence[FieldConfig | Estimator] = (Sad(),),
    *,
    compute: Callable[[OccupancyGrid, FieldConfig], CovarianceField] = load_or_compute,
    **options: Any,
) -> Figure:
    """Draw a map with its field, as ``locplan plot`` does.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    figure : str, default "field"
        "field", "e" or "ellipses": see `field_figure`, `e_figure` and `ellipses_figure`.
    estimators : sequence of FieldConfig or Estimator, default (Sad(),)
        Settings of the fields, which "e" and "ellipses" show side by side; "field" shows the first.
    compute : callable, default `load_or_compute`
        Gives the field of the map and the settings.
    **options
        The figure's own: scalar of "field", limits of "e", spacing and magnify of "ellipses".

    Raises
    ------
    ConfigError
        If the figure or an option of it is unknown or out of its range.
    """
    known = {"field": ("scalar",), "e": ("limits",), "ellipses": ("spacing", "magnify")}
    one_of("figure", figure, known)
    for name in options:
        one_of(f"an option of the figure {figure}", name, known[figure])
    configs = [config_of(each) for each in estimators]
    if options.get("scalar"):
        layers = [layer.name for layer in configs[0].estimator.layers]
        one_of("scalar", options["scalar"], [*SCALARS, *layers])
    low, high = options.get("limits") or (0.0, 1.0)
    if low >= high:
        raise ConfigError(f"limits must rise, not {low:g},{high:g}")
    if figure == "field":
        return field_figure(compute(grid, configs[0]), options.get("scalar"))
    draw: Callable[..., Figure] = e_figure if figure == "e" else ellipses_figure
    fields = {f"{grid.name}: {each.summary}": compute(grid, each) for each in configs}
    return draw(fields, **options)


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
    title = f"{field.grid.name or 'map'}: {field.saturated_share:.0%} saturated"
    weak = weak_spots(field, image.get_array(), name)
    axes.set_title(f"{title}; {weak}\n{field.config.summary}", fontsize="medium")
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


def ellipses_figure(
    fields: Mapping[str, CovarianceField], *, spacing: float = 2.0, magnify: float = 1.0
) -> Figure:
    """Draw error ellipses of several fields side by side, at sampled poses (Figs. 29 and 31).

    Parameters
    ----------
    fields : mapping of str to CovarianceField
        Fields of one map, by the title to show, at least one.
    spacing : float, default 2.0
        Minimum distance of the poses from one another [m], above 0; more of them on a large map.
    magnify : float, default 1.0
        Factor on the ellipses, above 0; 1 draws one standard deviation to the map's scale, and 10
        shows the shape of ellipses of a few centimetres.
    """
    figure, grid_of_axes = _side_by_side(fields)
    for axes, (title, field) in zip(grid_of_axes, fields.items(), strict=True):
        draw_ellipses(axes, field, spacing=spacing, magnify=magnify)
        axes.set_title(title, fontsize="medium")
    factor = "" if magnify == 1 else f", {magnify:g} times as large"
    handles = [
        Line2D([], [], color=styles.BLUE, label=f"position, one std. deviation{factor}"),
        Line2D([], [], color="black", label="first eigenvector"),
        Line2D([], [], color=TURN, linewidth=6, alpha=0.6, label="heading ± one std. deviation"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return figure


def draw_ellipses(
    axes: Axes, field: CovarianceField, *, spacing: float = 2.0, magnify: float = 1.0
) -> None:
    """Draw the map with error ellipses, first eigenvectors and heading wedges at sampled poses.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on, in world coordinates [m].
    field : CovarianceField
        The field; several headings count by their mean information.
    spacing, magnify
        See `ellipses_figure`.
    """
    draw_map(axes, field.grid)
    xy, covariance = sampled_covariances(field, spacing)
    if not len(xy):
        return
    major, minor, direction = position_axes(covariance)
    wedge = 0.4 * spacing
    reach = np.maximum(magnify * major, wedge)[:, None]
    corners = np.transpose([axes.get_xlim(), axes.get_ylim()])
    every = np.concatenate([corners, xy - reach, xy + reach])
    axes.set(**dict(zip(("xlim", "ylim"), np.transpose([every.min(0), every.max(0)]), strict=True)))
    along = (magnify * major)[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    where: dict[str, Any] = {"units": "xy", "offsets": xy, "offset_transform": axes.transData}
    style: dict[str, Any] = {"facecolors": "none", "edgecolors": styles.BLUE, "linewidths": 1.4}
    width, height, angle = 2 * magnify * major, 2 * magnify * minor, np.degrees(direction)
    ellipses = EllipseCollection(width, height, angle, zorder=4, **where, **style)
    if covariance.shape[-1] == 3:
        half = np.degrees(scalar(covariance, "heading_std"))
        wedges = [Wedge(at, wedge, -turn, turn) for at, turn in zip(xy, half, strict=True)]
        axes.add_collection(PatchCollection(wedges, color=TURN, alpha=0.6, linewidth=0.8))
    axes.add_collection(ellipses)
    lines = np.stack([xy - along, xy + along], axis=1)
    axes.add_collection(LineCollection(list(lines), colors="black", linewidths=0.8, zorder=3))


def e_figure(
    fields: Mapping[str, CovarianceField], limits: tuple[float, float] | None = None
) -> Figure:
    """Draw maps of e on one linear scale, 0 in unknown and occupied cells (Figs. 30 and 32).

    Parameters
    ----------
    fields : mapping of str to CovarianceField
        Fields of one map, by the title to show, at least one.
    limits : (float, float), optional
        Ends of the colour scale [m^2 rad]; by default 0 and the 98 % quantile of the free cells' e,
        or the e of u = 1/3 where that is more. Give them to compare figures.
    """
    maps = [
        field_cells(field, field.scalar("e", headings="mean"), logarithmic=True, part=None)
        for field in fields.values()
    ]
    if limits is None:
        known = np.concatenate([values[np.isfinite(values)] for values in maps])
        low, high = next(iter(fields.values())).anchors("e")
        least = low * (high / low) ** HARMLESS  # what is less has no strong colour
        limits = 0.0, max(least, float(np.quantile(known, 0.98)) if known.size else 0.0)
    figure, grid_of_axes = _side_by_side(fields)
    image = None
    for axes, (title, field), e in zip(grid_of_axes, fields.items(), maps, strict=True):
        draw_map(axes, field.grid)  # sets the axes; the values cover the map
        shown = np.nan_to_num(e, nan=0.0)
        image = draw_cells(
            axes, field.grid, shown, cmap=styles.ERROR_COLOURS, norm=Normalize(*limits)
        )
        cells = shrunk(field.grid.cells)  # half white over e = 0 shows walls
        walls = np.where(cells == OCCUPIED, 150, 0).astype(np.uint8)
        white = np.full((*walls.shape, 3), 255, np.uint8)
        draw_cells(axes, field.grid, np.dstack([white, walls]))
        axes.set_title(f"{title}\n{weak_spots(field, e[np.isfinite(e)], 'e')}", fontsize="medium")
    assert image is not None
    label = next(iter(fields.values())).quantity("e").axis
    figure.colorbar(image, ax=grid_of_axes, label=label, extend="max", shrink=0.8)
    return figure


def _side_by_side(fields: Mapping[str, CovarianceField]) -> tuple[Figure, list[Axes]]:
    """Figure and Axes for maps of one size, one above the other where that shows them larger."""
    width, height = map_size(next(iter(fields.values())).grid)
    shape = (len(fields), 1) if 1.4 * width > height else (1, len(fields))
    figure = Picture(figsize=(width * shape[1], height * shape[0]), layout="constrained")
    return figure, figure.subplots(*shape, squeeze=False).ravel().tolist()


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
    plain: dict[str, Any] = {"linestyle": "", "markeredgewidth": 0, "color": "black"}
    for place in info.places:
        marker = f"$\\mathbf{{{place.name}}}$"
        handles.append(Line2D([], [], marker=marker, **plain, label=f"{place.xy} m"))
    if handles:
        columns = max(1, min(len(handles), int(figure.get_figwidth() / 1.6)))
        style: dict[str, Any] = {"ncols": columns, "frameon": False, "fontsize": "small"}
        figure.legend(handles=handles, loc="outside lower center", **style)
