"""Figures of exports: the values of a mask, and a route graph."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from locplan.costs import Costmap
from locplan.maps import UNKNOWN, OccupancyGrid
from locplan.plotting._cells import draw_cells
from locplan.plotting._maps import FIELD_COLOURS, draw_map, map_size
from locplan.plotting._picture import Picture

EDGE = "#0072b2"
LONGEST = 1000
"""Longest side of a picture [cells]; cells of larger maps are merged, and walls and the greatest
values stay."""


def values_figure(
    grid: OccupancyGrid, values: NDArray[Any], label: str, title: str, falling: bool = False
) -> Figure:
    """A figure of the values of a mask over its map.

    Parameters
    ----------
    grid : OccupancyGrid
    values : (H, W) array of int
        The values 0..100, or -1 where there is none.
    label : str
        Label of the values, with their unit.
    title : str
    falling : bool
        Whether the scale names what is left of 100, such as the speed of which the values say how
        much is given up.
    """
    grid, shown = _shrunk(grid, values)
    figure = Picture(figsize=map_size(grid), layout="constrained")
    axes = figure.add_subplot()
    draw_map(axes, grid)
    if (shown >= 0).any():
        known, norm = np.ma.masked_less(shown, 0), Normalize(0.0, 100.0)
        image = draw_cells(axes, grid, known, cmap=FIELD_COLOURS, norm=norm)
        bar = figure.colorbar(image, ax=axes, label=label, shrink=0.9)
        if falling:
            bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 - value:.0f}"))
    axes.set_title(title, fontsize="medium")
    return figure


def routes_figure(
    costs: Costmap, nodes: NDArray[np.float64], edges: NDArray[np.int64], title: str
) -> Figure:
    """A figure of a route graph over the map and its degeneracy.

    Parameters
    ----------
    costs : Costmap
    nodes : (n, 2) array
        World positions [m].
    edges : (m, 2) array of int
        Pairs of nodes.
    title : str
    """
    percent = np.where(np.isnan(costs.u), -1, 100 * costs.u)
    figure = values_figure(costs.grid, percent, "degeneracy u [%]", title)
    (axes, *_) = figure.axes
    axes.add_collection(LineCollection(list(nodes[edges]), colors=EDGE, linewidths=0.7))
    axes.plot(*nodes.T, ".", color="black", markersize=2.5)
    return figure


def _shrunk(grid: OccupancyGrid, values: NDArray[Any]) -> tuple[OccupancyGrid, NDArray[Any]]:
    """A map that is no finer than a picture shows, with its values."""
    step = -(-max(grid.shape) // LONGEST)
    if step == 1:
        return grid, values
    down, right = (-size % step for size in grid.shape)
    blocks, merged = (
        np.pad(array, ((0, down), (0, right)), constant_values=outside).reshape(
            (grid.shape[0] + down) // step, step, -1, step
        )
        for array, outside in ((grid.cells, UNKNOWN), (values, -1))
    )
    cells, resolution = blocks.min(axis=(1, 3)), grid.resolution * step
    return dataclasses.replace(grid, cells=cells, resolution=resolution), merged.max(axis=(1, 3))
