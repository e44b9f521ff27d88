"""Figure of degenerate areas over their map."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox

from locplan.export._areas import DegenerateArea
from locplan.export._autoware import AGREES
from locplan.maps import OccupancyGrid
from locplan.plotting import draw_map, map_axes, map_size

FILL, EDGE = "#e69f00", "#a0522d"
ARM = 0.02
"""Half the length of the lines that show directions, as a share of the map's longer side."""
NAMED = 25
"""Greatest number of areas that are named in a picture, the largest first."""


def areas_figure(grid: OccupancyGrid, areas: Sequence[DegenerateArea], title: str) -> Figure:
    """A figure of areas with their names, and the line along which each is uncertain.

    Parameters
    ----------
    grid : OccupancyGrid
    areas : sequence of DegenerateArea
        They are named where no name of a larger one stands.
    title : str
    """
    figure, axes = map_axes(grid)
    draw_map(axes, grid)
    shapes = [_path(area) for area in areas]
    faces = PathCollection(shapes, facecolors=FILL, edgecolors=EDGE, alpha=0.75, linewidths=1.0)
    axes.add_collection(faces, autolim=False)
    longest = ARM * max(*np.ptp([axes.get_xlim(), axes.get_ylim()], axis=1))
    lines = []
    for area in areas:
        if area.agreement >= AGREES:
            size = min(longest, 0.4 * math.sqrt(area.area))
            arm = size * np.array([np.cos(area.direction), np.sin(area.direction)])
            lines.append([area.middle - arm, area.middle + arm])
    axes.add_collection(LineCollection(lines, colors="black", linewidths=2.0), autolim=False)
    taken: list[Bbox] = []
    metre = 72 * (map_size(grid)[0] - 2.0) / np.ptp(axes.get_xlim())  # in points, nearly
    for area in areas:
        label = f"{area.name}: {100 * area.position_std:.0f} cm"
        x, y = metre * np.array(area.middle)
        box = Bbox.from_extents(x - 2.6 * len(label), y, x + 2.6 * len(label), y + 12)
        if len(taken) < NAMED and not any(box.overlaps(other) for other in taken):
            taken.append(box)
            text = axes.annotate(
                label, area.middle, (0, 4), textcoords="offset points", ha="center", fontsize=8
            )
            text.set_path_effects([withStroke(linewidth=2.5, foreground="white")])
    below = "name: median position std. deviation; line: its direction"
    axes.set_title(f"{title}\n{below}" if areas else title, fontsize="medium")
    return figure


def _path(area: DegenerateArea) -> Path:
    """An area with its holes as a path of matplotlib."""
    rings = [area.outline, *area.holes]
    corners = [np.concatenate([ring, ring[:1]]) for ring in rings]
    codes = [[Path.MOVETO, *[Path.LINETO] * (len(ring) - 1), Path.CLOSEPOLY] for ring in rings]
    return Path(np.concatenate(corners), np.concatenate(codes))
