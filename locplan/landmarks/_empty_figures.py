"""Panels of a figure: one map or two, and plots below them, or beside tall ones."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from locplan.maps import OccupancyGrid
from locplan.plotting import Picture, drawn_size

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STACKED = 0.9
"""Ratio of a map's height to its width up to which two maps stand above each other."""
TALL = 1.5
"""Ratio of the maps' height to their width from which on the plots stand beside them."""
WIDTH, LEAST_WIDTH = 11.0, 9.5
"""Width of a figure that its maps fill if they can, and least width of all [inch]."""
GREATEST_HEIGHT = 8.0
"""Greatest height of a map [inch]."""
BAR, LABELS = 1.6, 0.7
"""Width of a colour bar, and the space of a map's labels on each axis [inch]."""
PLOT_HEIGHT, PLOT_WIDTH = 2.9, 4.6
"""Size of the plots, where they stand below the maps or beside them [inch]."""
LINE = 0.24
"""Height of a line of the title [inch]."""
LETTERS = 11
"""Letters of the title to an inch."""


class Panels(NamedTuple):
    """A figure, its maps and its plots."""

    figure: Figure
    map_part: Any
    """The part of the figure that the maps are in, for a colour bar."""
    maps: list[Axes]
    plots: list[Axes]


def panels(grid: OccupancyGrid, said: Sequence[str], maps: int, plots: int) -> Panels:
    """An empty figure with room for one map or two, and for plots.

    Parameters
    ----------
    grid : OccupancyGrid
        The map that is drawn.
    said : sequence of str
        Lines of the title, broken where they are too wide.
    maps, plots : int
        Number of each.
    """
    wide, high = drawn_size(grid)
    columns = 1 if high <= STACKED * wide else maps
    rows = maps // columns
    tall = high > TALL * columns * wide
    if not tall:
        scale = ((WIDTH - BAR) / columns - LABELS) / wide
        scale = min(scale, max(GREATEST_HEIGHT / high, 1.0))
        wide, high = scale * wide, scale * high
    width, height = columns * (wide + LABELS) + BAR, rows * (high + LABELS)
    width = width + PLOT_WIDTH if tall else max(width, LEAST_WIDTH)
    lines = [part for line in said for part in textwrap.wrap(line, int(LETTERS * width))]
    top = LINE * (len(lines) + 1)
    figure: Any
    if tall:
        height = max(height, plots * PLOT_HEIGHT)
        figure = Picture(figsize=(width, height + top), layout="constrained")
        parts = figure.subfigures(1, 2, width_ratios=(width - PLOT_WIDTH, PLOT_WIDTH))
        lower = parts[1].subplots(plots, 1, squeeze=False)[:, 0]
    else:
        figure = Picture(figsize=(width, height + PLOT_HEIGHT + top), layout="constrained")
        parts = figure.subfigures(2, height_ratios=(height, PLOT_HEIGHT))
        lower = parts[1].subplots(1, plots, squeeze=False)[0]
    figure.suptitle("\n".join(lines), fontsize="medium")
    upper = parts[0].subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    return Panels(figure, parts[0], list(upper.ravel()), list(lower))
