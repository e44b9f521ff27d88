"""Maps of values 0..100 as ROS's map servers publish them: an image and its YAML.

Formulas read from nav2_map_server's map_io.cpp (humble and main) and ROS 1's image_loader.cpp.
"""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from locplan.maps import OccupancyGrid

PREVIEW = "preview.png"
MODES = ("raw", "scale", "scale-ros1")
_LOW, _HIGH = 20, 216
"""Of "scale-ros1": the greys, counted from white, between which its 1..99 lie."""


class YawWarning(UserWarning):
    """A map's yaw was left out."""


def without_yaw(grid: OccupancyGrid) -> OccupancyGrid:
    """The map as Nav2's and ROS 1's planners have it, who ignore its yaw; warns if there is one."""
    x, y, yaw = grid.origin
    if yaw:
        warnings.warn(
            YawWarning(
                f"{grid.name or 'the map'} has a yaw of {yaw:g} rad, which the stacks ignore:"
                " written as they have it, unturned"
            ),
            stacklevel=2,
        )
    return dataclasses.replace(grid, origin=(x, y, 0.0))


def write_values(
    stem: Path, values: NDArray[np.int8], grid: OccupancyGrid, mode: str = "raw"
) -> None:
    """Write values that every map server of its stack reads back unchanged.

    Parameters
    ----------
    stem : Path
        Of the YAML and of its image, .pgm in mode "raw", else .png.
    values : (H, W) array of int8
        0..100, or -1 for unknown; row 0 at the lowest y.
    grid : OccupancyGrid
        Where they lie: its resolution and origin.
    mode : str
        "raw": grey n for n, 255 for unknown; read alike by Nav2 and ROS 1. "scale": greys for
        Nav2; "scale-ros1": for ROS 1, whose scale has other steps.
    """
    import yaml
    from PIL import Image

    free, occupied = 0.0, 1.0
    if mode == "raw":
        picture = Image.fromarray(values[::-1].view(np.uint8))
        image = stem.with_suffix(".pgm")
        occupied, free = 0.65, 0.196
    else:
        greys, (free, occupied) = _greys(mode)
        known = values >= 0  # ROS 1 looks at the opacity between its thresholds only
        shown = np.dstack([greys[np.where(known, values, 50)], np.where(known, 255, 0)])
        picture = Image.fromarray(shown[::-1].astype(np.uint8))
        image = stem.with_suffix(".png")
    picture.save(image)
    entries = {
        "image": image.name,
        "mode": mode.partition("-")[0],
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        "negate": 0,
        "occupied_thresh": occupied,
        "free_thresh": free,
    }
    text = yaml.safe_dump(entries, default_flow_style=None, sort_keys=False, allow_unicode=True)
    stem.with_suffix(".yaml").write_text(text, encoding="utf-8")


def write_preview(
    folder: Path, grid: OccupancyGrid, values: NDArray[np.int8], label: str, title: str
) -> None:
    """Draw the values over their map."""
    from locplan.export import _figures
    from locplan.plotting import save_figure

    figure = _figures.values_figure(grid, values, label, f"{grid.name or 'map'}: {title}")
    save_figure(figure, folder / PREVIEW, dpi=90)


def _greys(mode: str) -> tuple[NDArray[np.int64], tuple[float, float]]:
    """The grey of each value 0..100, and free_thresh and occupied_thresh."""
    n = np.arange(101)
    if mode == "scale":
        return np.floor(255 * (1 - n / 100) + 0.5).astype(np.int64), (0.0, 1.0)
    # ROS 1 truncates 1 + 98 r, r the share of the way between the thresholds: n lies in the
    # middle of its step of two greys, and 99 on the threshold itself.
    from_white = np.clip(_LOW + 2 * n - 1, _LOW, _HIGH)
    from_white[[0, 99, 100]] = 0, _HIGH, 255
    return 255 - from_white, (_LOW / 255, _HIGH / 255)
