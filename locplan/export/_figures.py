"""Figures of what is exported: the values of a mask, and a route graph."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from locplan.costs import Costmap
from locplan.maps import UNKNOWN, OccupancyGrid
from locplan.plotting._maps import FIELD_COLOURS, draw_cells, draw_map, map_size
from locplan.plotting._picture import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

EDGE = "#0072b2"
LONGEST = 1000
"""Of a picture's sides [cells]: finer maps are merged, walls and the greatest values first."""


def values_figure(grid: OccupancyGrid, values: NDArray[Any], label: str, title: str) -> Figure:
    """Values of a mask over its map.

    Parameters
    ----------
    grid : OccupancyGrid
    values : (H, W) array of int
        -1 where there is none.
    label : str
        Of the values, with their unit.
    title : str
    """
    grid, shown = _shrunk(grid, values)
    figure = Picture(figsize=map_size(grid), layout="constrained")
    axes = figure.add_subplot()
    draw_map(axes, grid)
    image = _draw_known(axes, grid, shown)
    figure.colorbar(image, ax=axes, label=label, shrink=0.9)
    axes.set_title(title, fontsize="medium")
    return figure


def routes_figure(
    costs: Costmap, nodes: NDArray[np.float64], edges: NDArray[np.int64], title: str
) -> Figure:
    """A route graph over the map and its u.

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
    grid, shown = _shrunk(costs.grid, percent)
    figure = Picture(figsize=map_size(grid), layout="constrained")
    axes = figure.add_subplot()
    draw_map(axes, grid)
    if (shown >= 0).any():
        image = _draw_known(axes, grid, shown)
        figure.colorbar(image, ax=axes, label="degeneracy u [%]", shrink=0.9)
    axes.add_collection(LineCollection(list(nodes[edges]), colors=EDGE, linewidths=0.7))
    axes.plot(*nodes.T, ".", color="black", markersize=2.5)
    axes.set_title(title, fontsize="medium")
    return figure


def _shrunk(grid: OccupancyGrid, values: NDArray[Any]) -> tuple[OccupancyGrid, NDArray[Any]]:
    """A map that is no finer than a picture shows, with its values."""
    step = -(-max(grid.shape) // LONGEST)
    if step == 1:
        return grid, values
    edge = [(0, -size % step) for size in grid.shape]
    blocks = [
        np.pad(array, edge, constant_values=outside).reshape(
            (grid.shape[0] + edge[0][1]) // step, step, -1, step
        )
        for array, outside in ((grid.cells, UNKNOWN), (values, -1))
    ]
    cells = blocks[0].min(axis=(1, 3))
    return (
        dataclasses.replace(grid, cells=cells, resolution=grid.resolution * step),
        blocks[1].max(axis=(1, 3)),
    )


def _draw_known(axes: Axes, grid: OccupancyGrid, values: NDArray[Any]) -> AxesImage:
    shown = np.ma.masked_less(values, 0)
    return draw_cells(axes, grid, shown, cmap=FIELD_COLOURS, norm=Normalize(0.0, 100.0))
