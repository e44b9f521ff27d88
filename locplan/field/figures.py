"""Figures of covariance fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from locplan._support import drawing as styles
from locplan._support.drawing import (
    NotebookFigure,
    draw_field_bar,
)
from locplan._support.kernels.arrays import Floats
from locplan.field.covariance import DEGENERATE
from locplan.field.field import CovarianceField
from locplan.maps.figures import (
    compute_axes_limits,
    compute_block_size,
    compute_figure_size,
    downsample,
    draw_cells,
    draw_map,
    make_map_axes,
)
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE

HARMLESS = 1 / 3
"""The u up to which no place of a map is a weak spot."""


def format_weak_share(field: CovarianceField, values: Any, name: str | None = None) -> str:
    """Return the share of a map's values whose u is 0.5 or more, as text.

    If no u is that high, the text has the greatest value; if none is above a third, that no place
    is weak.
    """
    quantity, name = field.quantity(name), name or field.config.estimator.criterion
    values = np.ma.filled(values, np.nan)
    finite_values = values[np.isfinite(values)]
    if not finite_values.size:
        return "nothing is known"
    low, high = (quantity.factor * anchor for anchor in field.anchors(name))

    def value_from_u(u: float) -> float:
        return low + u * (high - low) if name in field.layers else low * (high / low) ** u

    unit = f" {quantity.unit}" if quantity.unit != "1" else ""
    threshold = value_from_u(DEGENERATE)
    share, greatest = float(np.mean(finite_values >= threshold)), float(finite_values.max())
    if share == 0:
        prefix = "no weak spot: " if greatest < value_from_u(HARMLESS) else ""
        return f"{prefix}at most {greatest:.2g}{unit}"
    share_text = "under 1%" if share < 0.01 else f"{share:.0%}"
    return f"{share_text} weak ({threshold:.2g}{unit} or more)"


def interpolate_drawn_cells(
    field: CovarianceField, values: Floats, *, logarithmic: bool, part: OccupancyGrid | None
) -> Floats:
    """Return values (h, w) on the field's lattice as `draw_cells` takes them; NaN outside free
    space.

    They cover all cells of the map, or of a part of it. Blocks of large maps are read in their
    middles, instead of cell by cell.
    """
    visible_map = part or field.grid
    cells = compute_block_size(visible_map.shape)
    if cells == 1 and visible_map.shape == field.grid.shape:
        return field.interpolate_on_map(values, logarithmic=logarithmic)
    first = np.round(field.grid.world_to_grid(*visible_map.origin[:2]))
    free = downsample(visible_map.cells) == FREE
    rows, cols = (
        (np.arange(size) + 0.5) * cells - 0.5 + float(start)
        for size, start in zip(free.shape, first, strict=True)
    )
    at_middles = rows[:, None], cols[None, :]
    read = field.interpolate_on_map(values, logarithmic=logarithmic, cells=at_middles)
    return np.where(free, read, np.nan)


TURN = "#d62728"
"""Colour of the heading's deviation."""


def field_figure(field: CovarianceField, name: str | None = None) -> Figure:
    """Draw the map with one scalar of its field as a heat map.

    Parameters
    ----------
    field : CovarianceField
        The field.
    name : str, optional
        "e", "position_std", "position_rms" or "heading_std", see `locplan.field.scalar`, or
        one of the field's layers; by default the estimator's criterion. For several headings, the
        mean information is drawn. Deviations are shown in cm and degrees.
    """
    figure, axes = make_map_axes(field.grid)
    image = draw_field(axes, field, name)
    draw_field_bar(figure, image, axes, field.quantity(name).axis, shrink=0.9)
    title = f"{field.grid.name or 'map'}: u is about 0 on {field.saturated_share:.0%}"
    weak = format_weak_share(field, image.get_array(), name)
    axes.set_title(f"{title}; {weak}\n{field.config.title}", fontsize="medium")
    return figure


def fields_figure(
    rows: Sequence[Mapping[str, CovarianceField]],
    name: str = "e",
    parts: Sequence[OccupancyGrid] | None = None,
) -> Figure:
    """Draw a scalar of several fields side by side on one scale, one row per map.

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
    heights = [height / width for width, height in map(compute_figure_size, parts)]
    wide = min(3.6, 8.0 / columns)  # of a map, and of all of them together [inch]
    size = wide * columns + 1, sum(wide * height + 0.6 for height in heights)
    figure = NotebookFigure(figsize=size, layout="constrained")
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
                limits = compute_axes_limits(part, share=0.0)
                axes.set(xlim=limits.xlim, ylim=limits.ylim)
    ends = np.array([image.get_clim() for image in images])  # of one scale for all
    for image in images:
        image.set_clim(ends[:, 0].min(), ends[:, 1].max())
    draw_field_bar(figure, images[0], grid.ravel().tolist(), label_of_bar, shrink=0.6)
    figure.supxlabel("x and y [m]", fontsize="medium")
    return figure


def draw_field(
    axes: Axes,
    field: CovarianceField,
    name: str | None = None,
    part: OccupancyGrid | None = None,
    *,
    read: Floats | None = None,
) -> AxesImage:
    """Draw a scalar of the field over its map on a logarithmic scale, or a layer on a linear one.

    The scale begins at the anchor of a perfect match, for scalars without Q at their least value,
    and ends at the greatest value drawn.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on; its limits are set to the extent of the map [m].
    field : CovarianceField
        The field; several headings count by their mean information.
    name : str, optional
        Scalar or layer, see `field_figure`; by default what degeneracy is made of.
    part : OccupancyGrid, optional
        Part of the map that is drawn, cut out of it along its cells; all of it by default.
    read : array, optional
        The scalar at the drawn cells or blocks, if it has been read already.

    Returns
    -------
    matplotlib.image.AxesImage
        The values, for a colour bar, in the unit of `CovarianceField.quantity`.
    """
    name, visible_map = name or field.config.estimator.criterion, part or field.grid
    if read is None:
        values = field.scalar(name, headings="mean")
        read = interpolate_drawn_cells(
            field, values, logarithmic=name not in field.layers, part=part
        )
    draw_map(axes, visible_map)
    values = field.quantity(name).factor * read
    norm = make_colour_norm(field, name, values)
    return draw_cells(axes, visible_map, values, cmap=styles.FIELD_COLOURS, norm=norm)


def make_colour_norm(field: CovarianceField, name: str, values: Floats) -> Normalize:
    """Return the colour scale of a scalar or layer of a field, as `draw_field` draws it.

    It ends at the greatest value, but is never so short that harmless values would look weak.

    Parameters
    ----------
    field : CovarianceField
        The field.
    name : str
        Scalar or layer, see `field_figure`.
    values : array
        The values to be drawn, in the unit of `CovarianceField.quantity`; NaN where unknown.

    Returns
    -------
    matplotlib.colors.Normalize
        A linear scale of layers, a logarithmic one of scalars, in the unit of the values.
    """
    factor = field.quantity(name).factor
    low, high = (factor * anchor for anchor in field.anchors(name))
    has_values = np.isfinite(values).any()
    if name in field.layers:
        high_quantile = float(np.nanquantile(values, 0.98)) if has_values else high
        return Normalize(low, min(high, max(low + 0.02 * (high - low), high_quantile)))
    if has_values and not field.config.estimator.adds_q:
        low, high = np.nanmin(values), np.nanmax(values)
    low = max(low, np.finfo(float).tiny)
    high = max(high, low * 1.001)
    if has_values:
        high = min(high, max(low * (high / low) ** HARMLESS, np.nanmax(values)))
    return LogNorm(low, high)
