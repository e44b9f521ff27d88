"""Figures of exports: masks, areas, route graphs, and layers with their legends."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.ticker import FuncFormatter
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from locplan import plotting
from locplan._kernels.arrays import Floats
from locplan.costs import Costmap, costs_caption
from locplan.export._outlines import DegenerateArea
from locplan.export._roadmap import RouteGraph
from locplan.field import CovarianceField
from locplan.maps import OccupancyGrid


def save_preview(folder: FilePath, figure: Figure, dpi: int = plotting.style.PREVIEW_DPI) -> None:
    """Write the picture of an export into its folder."""
    plotting.save_figure(figure, folder / "preview.png", dpi=dpi)


def values_figure(
    grid: OccupancyGrid, values: NDArray[Any], label: str, title: str, falling: bool = False
) -> Figure:
    """A figure of the values of a mask over its map.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    values : (H, W) array of int
        The values 0..100, or -1 where there is none.
    label : str
        Label of the values, with their unit.
    title : str
        Title of the figure.
    falling : bool, default False
        Whether the scale names what is left of 100, such as the speed of which the values say how
        much is given up.
    """
    grid, shown = plotting.coarse(grid, 1000), plotting.shrunk(values, maximum=True, most=1000)
    figure, axes = plotting.map_axes(grid)
    plotting.draw_map(axes, grid)
    if (shown >= 0).any():
        known, norm = np.ma.masked_less(shown, 0), Normalize(0.0, max(25.0, shown.max()))
        image = plotting.draw_cells(axes, grid, known, cmap=plotting.style.FIELD_COLOURS, norm=norm)
        bar = figure.colorbar(image, ax=axes, label=label, shrink=0.9)
        if falling:
            bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 - value:.0f}"))
    axes.set_title(title, fontsize="medium")
    return figure


def routes_figure(costs: Costmap, graph: RouteGraph, title: str) -> Figure:
    """A figure of a route graph over its map, the edges coloured by their cost per metre.

    Parameters
    ----------
    costs : Costmap
        The costmap that the graph was made of.
    graph : RouteGraph
        The graph.
    title : str
        Title of the figure.
    """
    figure, axes = plotting.map_axes(costs.grid)
    plotting.draw_map(axes, costs.grid)
    axes.images[0].set_cmap(plotting.style.LIGHT_MAP_COLOURS)
    per_metre = graph.cost / graph.length
    order = np.argsort(per_metre, kind="stable")  # the costliest on top
    width, _ = plotting.map_size(costs.grid)
    # An edge is as wide as a share of the median length, both as drawn; nodes are twice as wide.
    scale = 72 * width / np.ptp(axes.get_xlim())
    drawn = 0.07 * scale * np.median(graph.length) if len(order) else 0.0
    # The costly ones dark, and none so pale that it is lost on white.
    lines = LineCollection(
        list(graph.nodes[graph.edges[order]]),
        array=per_metre[order],
        cmap=ListedColormap(colormaps["plasma_r"](np.linspace(0.2, 1.0, 256))),
        norm=Normalize(1.0, max(1.1, per_metre.max(initial=1.0))),
        linewidths=np.clip(drawn, 0.6, 1.8),
        capstyle="round",
    )
    axes.add_collection(lines)
    size = np.clip(2 * drawn, 0.8, 3.6)
    axes.plot(*graph.nodes.T, "o", color="black", markersize=size, markeredgewidth=0, zorder=3)
    figure.colorbar(lines, ax=axes, label="cost per metre of an edge", shrink=0.9)
    axes.set_title(f"{title}{costs_caption(costs)}", fontsize="medium")
    return figure


def norm_of(field: CovarianceField, name: str, values: Floats) -> Normalize:
    """The scale of plots, in the unit of the values (H, W)."""
    factor, ends = field.quantity(name).factor, np.array(field.anchors(name))
    if np.isfinite(values).any():
        ends = np.array([np.nanmin(values), np.nanmax(values)])
    norm: Any = plotting.field_norm(field, name, factor * ends)
    return LogNorm(norm.vmin / factor, norm.vmax / factor)


def write_coloured(file: FilePath, values: Floats, norm: Normalize) -> None:
    """Write values (H, W) as coloured cells, the highest row first, transparent where NaN."""
    from PIL import Image

    colours = np.zeros((*values.shape, 4), np.uint8)
    for first in range(0, len(values), 256):  # some rows at a time, which saves memory
        some = values[::-1][first : first + 256]
        known = np.isfinite(some)
        shades = plotting.style.FIELD_COLOURS(np.asarray(norm(some[known])), bytes=True)
        colours[first : first + 256][known] = shades
    Image.fromarray(colours, "RGBA").save(file, "png", compress_level=3)


def legend_figure(
    field: CovarianceField, norms: Mapping[str, Normalize], units: Mapping[str, str]
) -> Figure:
    """A figure of the colours of some scalars: people's units above each bar, the files' below.

    Parameters
    ----------
    field : CovarianceField
    norms : mapping of str to Normalize
        The scale of each scalar in the files' unit.
    units : mapping of str to str
        The files' units.
    """
    figure = plotting.Picture(figsize=(6.4, 0.7 + 1.5 * len(norms)), layout="constrained")
    rows = figure.subplots(len(norms), 1, squeeze=False)[:, 0]
    for axes, (name, norm) in zip(rows, norms.items(), strict=True):
        shown = field.quantity(name)
        colours = ScalarMappable(norm, plotting.style.FIELD_COLOURS)
        bar = figure.colorbar(colours, cax=axes, orientation="horizontal").ax
        bar.set_box_aspect(0.06)
        bar.set_xlabel(f"{name} [{units[name]}] in files")
        both = partial(np.multiply, shown.factor), partial(np.multiply, 1 / shown.factor)
        above = bar.secondary_xaxis("top", functions=both)
        above.set_xlabel(shown.axis)
        plotting.label_plainly(bar.xaxis)
        plotting.label_plainly(above.xaxis)
    title = f"{field.grid.name or 'map'}; transparent: nothing is known\n{field.config.summary}"
    figure.suptitle(title, fontsize="medium")
    return figure


def areas_figure(grid: OccupancyGrid, areas: Sequence[DegenerateArea], title: str) -> Figure:
    """A figure of areas with their names, and the line along which each is uncertain.

    Parameters
    ----------
    grid : OccupancyGrid
    areas : sequence of DegenerateArea
        They are named where no name of a larger one stands.
    title : str
    """
    figure, axes = plotting.map_axes(grid)
    plotting.draw_map(axes, grid)
    shapes = []
    for area in areas:
        rings = [np.concatenate([ring, ring[:1]]) for ring in (area.outline, *area.holes)]
        shapes.append(Path.make_compound_path(*(Path(ring, closed=True) for ring in rings)))
    sienna, looks = "#a0522d", {"alpha": 0.75, "linewidths": 1.0}
    faces = PathCollection(shapes, facecolors=plotting.style.ORANGE, edgecolors=sienna, **looks)
    axes.add_collection(faces, autolim=False)
    longest = 0.02 * max(*np.ptp([axes.get_xlim(), axes.get_ylim()], axis=1))
    lines = []
    for area in areas:
        if area.agrees:
            size = min(longest, 0.4 * math.sqrt(area.area))
            arm = size * np.array([np.cos(area.direction), np.sin(area.direction)])
            lines.append([area.middle - arm, area.middle + arm])
    axes.add_collection(LineCollection(lines, colors="black", linewidths=2.0), autolim=False)
    taken: list[Bbox] = []
    metre = 72 * (plotting.map_size(grid)[0] - 2.0) / np.ptp(axes.get_xlim())  # in points, nearly
    for area in areas:
        label = f"{area.name}: {100 * area.position_std:.0f} cm"
        x, y = metre * np.array(area.middle)
        box = Bbox.from_extents(x - 2.6 * len(label), y, x + 2.6 * len(label), y + 12)
        if len(taken) < 25 and not any(box.overlaps(other) for other in taken):
            taken.append(box)
            text = axes.annotate(
                label, area.middle, (0, 4), textcoords="offset points", ha="center", fontsize=8
            )
            text.set_path_effects(plotting.style.outline(2.5))
    below = "name: median position std. deviation; line: its direction"
    axes.set_title(f"{title}\n{below}" if areas else title, fontsize="medium")
    return figure
