"""Figures of exports: masks and route graphs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from locplan._support.drawing import FIELD_COLOURS, LIGHT_MAP_COLOURS, PREVIEW_DPI, save_figure
from locplan.export.route_graph import RouteGraph
from locplan.maps.figures import (
    compute_figure_size,
    downsample,
    downsample_map,
    draw_cells,
    draw_map,
    draw_zones,
    make_map_axes,
)
from locplan.maps.grid import OccupancyGrid
from locplan.maps.zones import Zones
from locplan.planning.costmap import Costmap
from locplan.planning.metrics import format_costs_caption


def save_preview(folder: Path, figure: Figure, dpi: int = PREVIEW_DPI) -> None:
    """Write the picture of an export into its folder."""
    save_figure(figure, folder / "preview.png", dpi=dpi)


def values_figure(
    grid: OccupancyGrid,
    values: NDArray[Any],
    label: str,
    title: str,
    is_falling: bool = False,
    zones: Zones | None = None,
) -> Figure:
    """Draw the values of a mask over its map.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    values : (H, W) array of int
        The values 0..100, or -1 for no value.
    label : str
        Label of the values, with their unit.
    title : str
        Title of the figure.
    is_falling : bool, default False
        Whether the colour bar shows 100 minus the value, such as the remaining speed.
    zones : Zones, optional
        The zones to draw.
    """
    grid, coarse_values = (
        downsample_map(grid, 1000),
        downsample(values, maximum=True, max_blocks=1000),
    )
    figure, axes = make_map_axes(grid)
    draw_map(axes, grid)
    if (coarse_values >= 0).any():
        masked_values, norm = (
            np.ma.masked_less(coarse_values, 0),
            Normalize(0.0, max(25.0, coarse_values.max())),
        )
        image = draw_cells(axes, grid, masked_values, cmap=FIELD_COLOURS, norm=norm)
        bar = figure.colorbar(image, ax=axes, label=label, shrink=0.9)
        if is_falling:
            bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 - value:.0f}"))
    if zones and (handles := draw_zones(axes, zones, grid)):
        figure.key(handles, ncols=3)
    axes.set_title(title, fontsize="medium")
    return figure


def routes_figure(costs: Costmap, graph: RouteGraph, title: str) -> Figure:
    """Draw a route graph over its map, with the edges coloured by their cost per metre.

    Parameters
    ----------
    costs : Costmap
        The costmap of the graph.
    graph : RouteGraph
        The graph.
    title : str
        Title of the figure.
    """
    figure, axes = make_map_axes(costs.grid)
    draw_map(axes, costs.grid)
    axes.images[0].set_cmap(LIGHT_MAP_COLOURS)
    per_metre = graph.cost / np.maximum(graph.length, 1e-9)
    order = np.argsort(per_metre, kind="stable")  # the costliest on top
    order = order[graph.length[order] > 0]
    width, _ = compute_figure_size(costs.grid)
    # The width of edges is a share of their median length in the figure; nodes are twice as wide.
    scale = 72 * width / np.ptp(axes.get_xlim())
    line_width = 0.07 * scale * np.median(graph.length) if len(order) else 0.0
    # Costly edges are dark, and none is too pale to see on white.
    lines = LineCollection(
        list(graph.nodes[graph.edges[order]]),
        array=per_metre[order],
        cmap=ListedColormap(colormaps["plasma_r"](np.linspace(0.2, 1.0, 256))),
        norm=Normalize(1.0, max(1.1, per_metre.max(initial=1.0))),
        linewidths=np.clip(line_width, 0.6, 1.8),
        capstyle="round",
    )
    axes.add_collection(lines)
    if handles := draw_zones(axes, costs.zones, costs.grid):
        figure.key(handles, ncols=3)
    size = np.clip(2 * line_width, 0.8, 3.6)
    axes.plot(*graph.nodes.T, "o", color="black", markersize=size, markeredgewidth=0, zorder=3)
    figure.colorbar(lines, ax=axes, label="cost per metre of the edge", shrink=0.9)
    axes.set_title(f"{title}{format_costs_caption(costs)}", fontsize="medium")
    return figure
