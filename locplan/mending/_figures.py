"""The figure of a mended map."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from locplan.plotting import MAP_COLOURS, Picture, draw_cells, draw_map, map_size, shrunk

if TYPE_CHECKING:
    from locplan.mending._mend import Mended


def mended_figure(mended: Mended) -> Figure:
    """Draw the map as it is and mended, side by side.

    Parameters
    ----------
    mended : Mended
        What `locplan.mend` has made.
    """
    width, height = map_size(mended.grid)
    figure = Picture(figsize=(2 * width, height), layout="constrained")
    pair = figure.subplots(1, 2, sharex=True, sharey=True)
    named = {"as it is": mended.grid, "for the filter": mended.filter_map}
    for axes, (title, grid) in zip(pair, named.items(), strict=True):
        draw_map(axes, grid)
        # All that is occupied is black here, which maps in other pictures show as a rim.
        levels = shrunk(grid.cells) // 127
        draw_cells(axes, grid, levels, cmap=MAP_COLOURS, vmin=0, vmax=3)
        axes.set_title(f"{grid.name or 'map'} {title}", fontsize="medium")
    return figure
