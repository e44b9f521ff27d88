"""Drawing on given Axes: maps, fields and paths; and writing figures."""

from __future__ import annotations

import os
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize, to_rgba_array
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from locplan._kernels.arrays import Floats, Octets
from locplan._util.files import PICTURES, check_target
from locplan._util.output import replacing
from locplan.field import CovarianceField
from locplan.maps import UNKNOWN, MapFaults, OccupancyGrid
from locplan.plotting import _cells as cells, style as styles
from locplan.plotting._picture import HARMLESS, label_plainly
from locplan.plotting.style import FILE_DPI

if TYPE_CHECKING:
    from locplan.costs import Path


def draw_map(axes: Axes, grid: OccupancyGrid) -> None:
    """Draw the map in world coordinates: walls black, unknown space grey, free space white.

    The inside of what is solid is grey, too, and only its rim black.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on; its limits become those of the map [m].
    grid : OccupancyGrid
        The map.
    """
    cells.draw_cells(axes, grid, shades(grid), cmap=styles.MAP_COLOURS, vmin=0, vmax=3)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", **cells.limits_of(grid))


def shades(grid: OccupancyGrid) -> Octets:
    """What `MAP_COLOURS` has a colour for, of each cell or block: 0 is a wall, or a solid's rim."""
    import cv2

    levels = np.asarray(cells.shrunk(grid.cells) // UNKNOWN)
    deep = max(3, round(0.006 * max(levels.shape)))
    around = np.ones((2 * deep + 1, 2 * deep + 1), np.uint8)
    levels[cv2.erode((levels == 0).astype(np.uint8), around) == 1] = 3
    return levels


def draw_field(
    axes: Axes,
    field: CovarianceField,
    name: str | None = None,
    part: OccupancyGrid | None = None,
    *,
    read: Floats | None = None,
) -> AxesImage:
    """Draw a scalar of the field over its map on a logarithmic scale, or a layer on a linear one.

    The scale begins at the anchor of a perfect match and ends at the greatest value drawn; that of
    scalars without Q begins at their least value.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on; its limits become those of the map [m].
    field : CovarianceField
        The field; several headings count by their mean information.
    name : str, optional
        Scalar or layer, see `field_figure`; by default what degeneracy is made of.
    part : OccupancyGrid, optional
        Part of the map that is drawn, cut out of it along its cells; all of it by default.
    read : array, optional
        The scalar at the cells that are drawn, or at their blocks, where it has been read already.

    Returns
    -------
    matplotlib.image.AxesImage
        The values, for a colour bar, in the unit of `CovarianceField.quantity`.
    """
    name, drawn = name or field.config.estimator.criterion, part or field.grid
    if read is None:
        values = field.scalar(name, headings="mean")
        read = cells.field_cells(field, values, logarithmic=name not in field.layers, part=part)
    draw_map(axes, drawn)
    values = field.quantity(name).factor * read
    norm = field_norm(field, name, values)
    return cells.draw_cells(axes, drawn, values, cmap=styles.FIELD_COLOURS, norm=norm)


def field_norm(field: CovarianceField, name: str, values: Floats) -> Normalize:
    """The scale of colours of a scalar or layer of a field, as `draw_field` draws it.

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
    known = np.isfinite(values).any()
    if name in field.layers:
        most = float(np.nanquantile(values, 0.98)) if known else high
        return Normalize(low, min(high, max(low + 0.02 * (high - low), most)))
    if known and not field.config.estimator.adds_q:
        low, high = np.nanmin(values), np.nanmax(values)
    low = max(low, np.finfo(float).tiny)
    high = max(high, low * 1.001)
    if known:
        high = min(high, max(low * (high / low) ** HARMLESS, np.nanmax(values)))
    return LogNorm(low, high)


def draw_path(axes: Axes, path: Path, **style: Any) -> None:
    """Draw a path as a line with a white outline.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on, in world coordinates [m].
    path : Path
        The path.
    **style
        Properties of the line for ``Axes.plot``, such as color and linewidth.
    """
    axes.plot(*path.xy.T, **{"linewidth": 2.2, "path_effects": styles.outline(), **style})


def along_norm(values: Floats, *, of_errors: bool = False) -> LogNorm:
    """The logarithmic scale of colours of what is drawn along paths.

    Parameters
    ----------
    values : array (n,)
        All that is drawn; NaN where unknown.
    of_errors : bool, default False
        Whether the values are mean errors [m]: the scale then spans all from `MIN_ERROR` on, and
        else those between the quantiles of 2 and 98 %.
    """
    known = values[np.isfinite(values)]
    if of_errors:
        low = max(styles.MIN_ERROR, float(known.min()))
        return LogNorm(low, max(float(known.max()), 2 * low), clip=True)
    low, high = np.quantile(known, (0.02, 0.98)).tolist()
    return LogNorm(low, max(high, 1.5 * low), clip=True)


def draw_along(axes: Axes, xy: Floats, values: Floats, **style: Any) -> LineCollection:
    """Draw a line in pieces from position to position, each in the colour of its value.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on, in world coordinates [m].
    xy : array (n, 2)
        The positions [m].
    values : array (n - 1,)
        The value of each piece.
    **style
        Properties of the lines, such as norm and linewidths.
    """
    look = {"cmap": styles.ERROR_COLOURS, "linewidths": 4.0, "zorder": 3, **style}
    lines = LineCollection(list(np.stack([xy[:-1], xy[1:]], axis=1)), array=values, **look)
    axes.add_collection(lines)
    return lines


def draw_along_bar(
    figure: Any, lines: Any, axes: Any, label: str = "mean position error [m]", shrink: float = 0.9
) -> None:
    """The colour bar of what is drawn along paths, with plain numbers.

    Parameters
    ----------
    figure : matplotlib.figure.Figure or SubFigure
        The figure.
    lines : LineCollection
        What `draw_along` returned.
    axes : matplotlib.axes.Axes, or a list of them
        The Axes that the bar stands beside.
    label : str, default "mean position error [m]"
        What the colours stand for, with its unit.
    shrink : float, default 0.9
        Height of the bar, as a share of the Axes'.
    """
    bar = figure.colorbar(lines, ax=axes, label=label, shrink=shrink)
    label_plainly(bar.ax.yaxis)


def draw_ends(axes: Axes, start: Sequence[float], goal: Sequence[float]) -> None:
    """Draw start (circle) and goal (star), each with an arrow if it has a heading.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on, in world coordinates [m].
    start, goal : (x, y) or (x, y, heading)
        The poses in the world [m, m, rad].
    """
    axes.plot(*start[:2], "o", markersize=7, zorder=4, **styles.END_STYLE)
    axes.plot(*goal[:2], "*", markersize=13, zorder=4, **styles.END_STYLE)
    for x, y, *heading in (start, goal):
        if heading:
            ahead = 22 * np.cos(heading[0]), 22 * np.sin(heading[0])  # in points, at any scale
            arrow = {"arrowstyle": "<|-", "color": "black", "linewidth": 1.5, "shrinkA": 0}
            axes.annotate("", (x, y), ahead, textcoords="offset points", arrowprops=arrow)


def end_handles() -> list[Line2D]:
    """Start and goal as `draw_ends` draws them, for a legend.

    Returns
    -------
    list of matplotlib.lines.Line2D
        The two handles, labelled "start" and "goal".
    """
    style = {"linestyle": "none", **styles.END_STYLE}
    start = Line2D([], [], marker="o", label="start", **style)
    return [start, Line2D([], [], marker="*", markersize=10, label="goal", **style)]


def save_figure(figure: Figure, path: str | os.PathLike[str], *, dpi: int = FILE_DPI) -> None:
    """Write a figure, whole or not at all.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    path : path
        The file, whose suffix chooses the format: .png, .pdf or .svg. One that is there is
        replaced.
    dpi : int, default 130
        Pixels an inch of a .png; more make a larger and sharper picture.

    Raises
    ------
    LocplanError
        If the suffix is another, or the file cannot be written.
    """
    check_target(FilePath(path), *PICTURES)
    suffix = FilePath(path).suffix.lower().lstrip(".")
    with replacing(path) as temporary:
        # matplotlib's writer of PDFs hides an error of the disk behind one of its own
        drawn = BytesIO() if suffix == "pdf" else temporary
        figure.savefig(drawn, dpi=dpi, format=suffix, bbox_inches="tight", pad_inches=0.1)
        if isinstance(drawn, BytesIO):
            temporary.write_bytes(drawn.getvalue())


def draw_inset(axes: Axes, grid: OccupancyGrid, part: OccupancyGrid, paths: Sequence[Path]) -> None:
    """Show in a corner without paths where a small part lies on its map, if it is small.

    The part is drawn without a margin, since the map goes on there.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes on which the part was drawn.
    grid, part : OccupancyGrid
        The map, and the part of it that was drawn.
    paths : sequence of Path
        The paths that the inset must not cover, one at least.
    """
    if part.shape != grid.shape:
        axes.set(**cells.limits_of(part, share=0.0))
    if not cells.is_small(grid, part):
        return
    points = [path.resampled(0.5, even=True).xy for path in paths]
    size = _size(axes, grid)
    inset = axes.inset_axes((*_free_corner(axes, np.concatenate(points), size), *size))
    draw_map(inset, cells.coarse(grid, 300))
    inset.images[0].set_cmap(styles.LIGHT_MAP_COLOURS)
    inset.set(xlabel="", ylabel="", xticks=(), yticks=(), zorder=6, **cells.limits_of(grid))
    height, width = part.shape
    x, y = part.grid_to_world(np.array([0, 0, height, height]), np.array([0, width, width, 0]))
    corners = np.stack([x, y], axis=1)
    look: dict[str, Any] = {"color": styles.VERMILION, "zorder": 5}
    inset.add_patch(Polygon(corners, fill=False, linewidth=2.2, **look))
    if max(part.shape) < 0.06 * max(grid.shape):  # its outline is hard to see
        inset.plot(*corners.mean(axis=0), "o", markersize=5, **look)


def _size(axes: Axes, grid: OccupancyGrid) -> tuple[float, float]:
    """Width and height of an inset that shows a map, as shares of those of the Axes."""
    shares = np.ptp([*cells.limits_of(grid).values()], axis=1)
    shares /= np.ptp([axes.get_xlim(), axes.get_ylim()], axis=1)
    across, along = (shares * (0.3 / shares.max())).tolist()
    return across, along


def _free_corner(axes: Axes, xy: Floats, size: tuple[float, float]) -> tuple[float, float]:
    """Lower left end, in shares of the Axes, of the inset in the corner with fewest points."""
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
    at = (xy - low) / (high - low)
    gap = 0.015
    far = 1 - np.array(size) - gap
    corners = np.array([(gap, far[1]), (far[0], far[1]), (far[0], gap), (gap, gap)])
    near = gap + 0.03

    inside = [((at > corner - near) & (at < corner + size + near)).all(1) for corner in corners]
    x, y = corners[np.argmin(np.sum(inside, axis=1))].tolist()
    return x, y


def faults_figure(faults: MapFaults) -> Figure:
    """Draw the map with the cells of its faults in colour, and the faults' kinds.

    Parameters
    ----------
    faults : MapFaults
        What `locplan.maps.faults` has found.
    """
    figure, axes = cells.map_axes(faults.grid)
    draw_map(axes, faults.grid)
    tints = to_rgba_array(["black", styles.VERMILION], [0.0, 0.8])
    colours = np.round(255 * tints).astype(np.uint8)
    cells.draw_cells(axes, faults.grid, colours[cells.shrunk(faults.cells.astype(np.uint8))])
    kinds = ", ".join(dict.fromkeys(each.kind for each in faults)) or "no fault"
    axes.set_title(f"{faults.grid.name or 'map'}: {kinds}", fontsize="medium")
    return figure
