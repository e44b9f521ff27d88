"""Colours, line styles and resolutions of all figures."""

from __future__ import annotations

from typing import Any

import matplotlib.patheffects as effects
import numpy as np
from matplotlib import colormaps
from matplotlib.colors import ListedColormap

from locplan._util.records import FILE_DPI as FILE_DPI

BLUE, VERMILION, GREEN, PURPLE = "#0072b2", "#d55e00", "#009e73", "#cc79a7"
ORANGE, SKY, YELLOW = "#e69f00", "#56b4e9", "#f0e442"
COLOURS: tuple[str, ...] = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""Colours of several things in turn, which colour-blind people can tell apart (Okabe and Ito)."""
PATH_STYLES: tuple[dict[str, Any], ...] = (
    {"color": "black", "linestyle": (0, (4, 1.5))},
    {"color": BLUE, "linestyle": "-"},
    {"color": GREEN, "linestyle": (0, (1, 1))},
    {"color": PURPLE, "linestyle": (0, (6, 1, 1, 1))},
)
"""Line styles of several paths in turn, the shortest first; they differ in dashes and colour."""
END_STYLE: dict[str, Any] = {"color": "white", "markeredgecolor": "black"}
"""Style of the markers of a path's ends."""
MAP_COLOURS = ListedColormap(["black", "0.82", "white", "0.6"])
"""Colours of occupied, unknown and free cells, and of the inside of what is solid."""
LIGHT_MAP_COLOURS = ListedColormap(["0.45", "0.9", "white", "0.7"])
"""The colours of `MAP_COLOURS`, lighter, for maps below much that is drawn."""
PALE_MAP_COLOURS = ListedColormap(["0.72", "0.92", "white", "0.72"])
"""The colours of `MAP_COLOURS`, paler than thin lines on them."""
FIELD_COLOURS = ListedColormap(colormaps["magma_r"](np.linspace(0.0, 0.8, 256)))
"""Colours of fields, never as dark as a wall."""
ERROR_COLOURS = "viridis"
"""Colours of errors, of e and of lengths."""
MIN_ERROR = 0.02
"""Smallest error with a colour of its own; smaller ones are drawn in the same colour [m]."""
PREVIEW_DPI = 110
"""Pixels an inch of the pictures beside exported files."""


def outline(width: float = 4) -> list[Any]:
    """White outline of a line over a map.

    Parameters
    ----------
    width : float, default 4
        Width of line and outline together [points].

    Returns
    -------
    list of matplotlib.patheffects.AbstractPathEffect
        The effects of a line or a text.
    """
    return [effects.Stroke(linewidth=width, foreground="white"), effects.Normal()]
