"""Drawing on given Axes: maps, fields and paths; and writing figures."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import matplotlib.patheffects as effects
import numpy as np
from matplotlib import colormaps
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from locplan._util.files import PICTURES, check_target, replacing
from locplan.field import CovarianceField
from locplan.maps import UNKNOWN, OccupancyGrid
from locplan.plotting._cells import draw_cells, field_cells, shrunk
from locplan.plotting._picture import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colorbar import Colorbar
    from matplotlib.image import AxesImage

    from locplan.costs import Path

FIELD_COLOURS = ListedColormap(colormaps["magma_r"](np.linspace(0.0, 0.8, 256)))
"""Colours of fields, never as dark as a wall."""
MAP_COLOURS = ListedColormap(["black", "0.82", "white"])
"""Colours of occupied, unknown and free cells."""
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
END_STYLE: dict[str, Any] = {"color": "white", "markeredgecolor": "black"}


def draw_map(axes: Axes, grid: OccupancyGrid) -> None:
    """Draw the map in world coordinates: walls black, unknown space grey, free space white."""
    draw_cells(axes, grid, shrunk(grid.cells) // UNKNOWN, cmap=MAP_COLOURS, vmin=0, vmax=2)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    _limit_to(axes, grid)


def draw_field(axes: Axes, field: CovarianceField, name: str | None = None) -> AxesImage:
    """Draw a scalar of the field over its map on a logarithmic scale, or a layer on a linear one.

    It is the one that degeneracy is made of unless another is named.

    The scale ends at the anchors, except for scalars without Q: at their least and greatest values.
    """
    name = name or field.config.estimator.criterion
    values = field.scalar(name, headings="mean")
    read = field_cells(field, values, logarithmic=name not in field.layers)
    return draw_field_cells(axes, field, name, read)


def draw_field_cells(
    axes: Axes, field: CovarianceField, name: str, values: NDArray[np.float64]
) -> AxesImage:
    """Draw as `draw_field` does a scalar that has been read at the map's cells, or its blocks."""
    draw_map(axes, field.grid)
    values = field.quantity(name).factor * values
    norm = field_norm(field, name, values)
    return draw_cells(axes, field.grid, values, cmap=FIELD_COLOURS, norm=norm)


def field_norm(field: CovarianceField, name: str, values: NDArray[np.float64]) -> Normalize:
    """The scale of a scalar or layer of a field, in the unit that is shown, as are the values."""
    factor = field.quantity(name).factor
    low, high = (factor * anchor for anchor in field.anchors(name))
    if name in field.layers:
        return Normalize(low, high)
    if not field.config.estimator.adds_q and field.evaluated.any():
        low, high = np.nanmin(values), np.nanmax(values)
    low = max(low, np.finfo(float).tiny)
    return LogNorm(low, max(high, low * 1.001))


def field_bar(figure: Figure, image: AxesImage, axes: Any, label: str, **options: Any) -> Colorbar:
    """The colour bar of a field; deviations have plain numbers at 1, 2 and 5 of each decade."""
    bar = figure.colorbar(image, ax=axes, label=label, **options)
    low, high = image.get_clim()
    if isinstance(image.norm, LogNorm) and low and high:
        if low >= 0.1 and high <= 10_000:
            bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
            bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            bar.ax.yaxis.set_minor_formatter(NullFormatter())
        elif high >= 10 * low:
            bar.ax.yaxis.set_major_formatter(FuncFormatter(_power_of_ten))
            bar.ax.yaxis.set_minor_formatter(NullFormatter())
    return bar


def _power_of_ten(value: float, _: object) -> str:
    """10 to a power in plain characters; matplotlib's own formulas take 0.3 s to begin with."""
    return f"10{str(round(math.log10(value))).translate(SUPERSCRIPTS)}"


def draw_path(axes: Axes, path: Path, **style: Any) -> None:
    """Draw a path as a line, in a style of matplotlib."""
    axes.plot(*path.xy.T, **{"linewidth": 2.2, "path_effects": outline(), **style})


def draw_ends(axes: Axes, start: Sequence[float], goal: Sequence[float]) -> None:
    """Draw start (circle) and goal (star), each with an arrow if it has a heading."""
    axes.plot(*start[:2], "o", markersize=7, zorder=4, **END_STYLE)
    axes.plot(*goal[:2], "*", markersize=13, zorder=4, **END_STYLE)
    for x, y, *heading in (start, goal):
        if heading:
            ahead = 22 * np.cos(heading[0]), 22 * np.sin(heading[0])  # in points, at any scale
            arrow = {"arrowstyle": "<|-", "color": "black", "linewidth": 1.5, "shrinkA": 0}
            axes.annotate("", (x, y), ahead, textcoords="offset points", arrowprops=arrow)


def save_figure(figure: Figure, path: str | os.PathLike[str], *, dpi: int = 130) -> None:
    """Write a figure, whole or not at all; the suffix chooses the format (.png, .pdf, .svg)."""
    check_target(FilePath(path), *PICTURES)
    suffix = FilePath(path).suffix.lower().lstrip(".")
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=dpi, format=suffix, bbox_inches="tight", pad_inches=0.1)


def _known(grid: OccupancyGrid) -> tuple[int, int, int, int]:
    """First row, end of the rows, first column and end of the columns with known cells."""
    known = grid.cells != UNKNOWN
    if not known.any():
        return 0, grid.shape[0], 0, grid.shape[1]
    rows, cols = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    return int(rows[0]), int(rows[-1]) + 1, int(cols[0]), int(cols[-1]) + 1


def _limit_to(axes: Axes, grid: OccupancyGrid) -> None:
    """Limit the Axes to the known cells, with a margin."""
    low, high, left, right = _known(grid)
    x, y = grid.grid_to_world(np.array([low, low, high, high]), np.array([left, right] * 2))
    margin = 0.02 * max(np.ptp(x), np.ptp(y)) + grid.resolution
    axes.set(xlim=(x.min() - margin, x.max() + margin), ylim=(y.min() - margin, y.max() + margin))


def map_axes(grid: OccupancyGrid) -> tuple[Picture, Axes]:
    """A figure for one map, and its Axes."""
    figure = Picture(figsize=map_size(grid), layout="constrained")
    return figure, figure.add_subplot()


def map_size(grid: OccupancyGrid) -> tuple[float, float]:
    """Figure size [inch] for the known part of a map with a colour bar at its side."""
    width, height = drawn_size(grid)
    return max(width, 5.0) + 1.6, max(height, 2.0) + 0.8


def drawn_size(grid: OccupancyGrid) -> tuple[float, float]:
    """Width and height [inch] of the known part of a map, at most 9 and 8."""
    low, high, left, right = _known(grid)
    height, width = high - low, right - left
    cos, sin = abs(np.cos(grid.origin[2])), abs(np.sin(grid.origin[2]))
    height, width = sin * width + cos * height, cos * width + sin * height
    drawn_width = min(9.0, 8.0 * width / height)
    return drawn_width, drawn_width * height / width


def outline() -> list[Any]:
    """The white outline of a path, as effects of matplotlib."""
    return [effects.Stroke(linewidth=4, foreground="white"), effects.Normal()]
