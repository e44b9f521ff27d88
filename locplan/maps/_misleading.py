"""What of a map misleads a planner or its user, in plain sentences."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from locplan.maps._grid import OccupancyGrid
from locplan.maps._occupancy import FREE, OCCUPIED
from locplan.maps._source import DARK, ROWS, MapSource

MIN_SHARE = 0.01
"""Minimum share of the pixels, or of the image's edge, that is worth a sentence."""


def misleading(grid: OccupancyGrid, source: MapSource | None = None) -> tuple[str, ...]:
    """Say what of a map misleads: thresholds, greys, open edges, a mask instead of a map.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    source : MapSource, optional
        How its pixels were read, see `read_map`; without it only the cells are looked at.

    Returns
    -------
    tuple of str
        Sentences without a full stop, the most important first; none if all seems well.

    Examples
    --------
    >>> misleading(OccupancyGrid([[127, 0, 0, 0], [127, 0, 254, 0], [127, 0, 0, 0]], 0.05))
    ()
    """
    of_source = _of_source(grid, source) if source else ()
    return (*of_source, *_of_cells(grid), *_of_origin(grid))


def _of_source(grid: OccupancyGrid, source: MapSource) -> Iterator[str]:
    """What the file's entries and pixels make of the map."""
    yield from _of_mask(grid, source)
    free, occupied = source.free_thresh, source.occupied_thresh
    if source.light_free > MIN_SHARE * source.pixels:
        lower = 0.196 if free > 0.196 else 0.15
        yield (
            f"{source.light_free:,} pixels ({source.light_free / source.pixels:.0%}) of a light"
            f" grey, mostly {source.light_value}, are read as free, while map_saver's 205 means"
            f" unknown; if they are unknown, lower free_thresh to {lower:g} (it is {free:g})"
        )
    walls = np.count_nonzero(grid.cells == OCCUPIED)
    if source.dark_unknown > walls / 2 and source.mode == "trinary":
        yield (
            f"{source.dark_unknown:,} dark grey pixels are read as unknown, beside {walls:,}"
            f" occupied ones; if they are walls, lower occupied_thresh to {DARK:g} (it is"
            f" {occupied:g})"
        )
    if free == occupied:
        yield (
            f"free_thresh and occupied_thresh are both {free:g}, so that no grey is unknown;"
            " map_saver writes 0.25 or 0.196, and 0.65"
        )
    if source.over_100 > MIN_SHARE * source.pixels:
        yield (
            f"{source.over_100:,} pixels ({source.over_100 / source.pixels:.0%}) are above 100 and"
            " read as unknown, since pixels are per cent in mode raw; for an ordinary image set"
            " mode: trinary"
        )


def _of_mask(grid: OccupancyGrid, source: MapSource) -> Iterator[str]:
    """What tells of a mask for a costmap filter."""
    signs = []
    words = re.split(r"[^a-z]+", f"{grid.name} {Path(source.image).name}".lower())
    of_masks = {"costmap", "filter", "keepout", "limit", "mask", "speed", "virtual"}
    found = [word for word in words if word in of_masks]
    if found:
        signs.append(f"its name has the word {found[0]}")
    if source.mode != "trinary":
        signs.append(f"its mode is {source.mode}")
    if source.free_thresh <= 0.05 and source.occupied_thresh >= 0.95:
        signs.append(
            f"only the ends of its scale are free or occupied (thresholds {source.free_thresh:g}"
            f" and {source.occupied_thresh:g})"
        )
    if found or len(signs) >= 2:
        yield (
            f"this seems to be a mask for a costmap filter, not a map: {', '.join(signs)};"
            " plan on the map that it belongs to"
        )


def _of_cells(grid: OccupancyGrid) -> Iterator[str]:
    """What the cells themselves tell."""
    import cv2

    cells = grid.cells
    if not (cells == FREE).any():
        yield "no cell is free, so that the robot can stand nowhere; check the thresholds"
        return
    rim = np.concatenate([cells[0], cells[-1], cells[1:-1, 0], cells[1:-1, -1]]) == FREE
    if rim.mean() > MIN_SHARE:
        yield (
            f"free space runs out of the image along {rim.sum() * grid.resolution:.3g} m"
            f" ({rim.mean():.0%} of its edge); what lies outside counts as unknown"
        )
    if not (cells == OCCUPIED).any():
        yield "no cell is occupied, so that a lidar sees nothing; check the thresholds"
        return
    kernel = np.ones((7, 7), np.uint8)  # SLAM maps have a fringe of three unknown cells at walls
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    count = np.zeros(2, np.int64)  # of the boundary's cells, and of the open ones
    for top in range(0, len(cells), ROWS):
        first = max(top - 3, 0)
        around, own = cells[first : top + ROWS + 3], slice(top - first, top - first + ROWS)
        free, occupied = ((around == level).astype(np.uint8) for level in (FREE, OCCUPIED))
        inner = cv2.erode(free, cross, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        edge = (free > inner)[own]
        open_ = edge & (cv2.dilate(occupied, kernel)[own] == 0)
        count += np.count_nonzero(edge), np.count_nonzero(open_)
    share = count[1] / count[0]
    if share > 0.5:
        yield (
            f"{share:.0%} of the free space's boundary is open to the unknown instead of walled;"
            " no lidar sees that boundary"
        )


def _of_origin(grid: OccupancyGrid) -> Iterator[str]:
    """What is unusual about the origin's yaw."""
    yaw = grid.origin[2]
    if abs(yaw) > 2 * math.pi:
        yield f"the origin's yaw of {yaw:g} is in radians, and looks like degrees"
    elif yaw:
        yield (
            f"the origin's yaw of {math.degrees(yaw):.4g} deg counts in all coordinates here; Nav2"
            " and ROS 1 ignore it"
        )
