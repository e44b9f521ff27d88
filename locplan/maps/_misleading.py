"""What the cells of a map and its file show of faults, each in a plain sentence."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from locplan._kernels.arrays import Bools, Octets
from locplan.maps._grid import OccupancyGrid
from locplan.maps._occupancy import FREE, OCCUPIED
from locplan.maps._solid import DEPTH, Solidity, inside_of_walls
from locplan.maps._source import DARK, ROWS, MapSource

MIN_SHARE = 0.01
"""Minimum share of the pixels, or of the image's edge, that is worth a sentence."""
SPECK, SPECKS, COARSE = 3, 1.0, 0.5
"""Maximum size of a speck [cells], the number of specks a square metre that is too many, and the
size of cells from which on they are coarse [m]."""

PAINTED, NO_UNKNOWN = 0.3, 0.001
"""Minimum share of the cells that are black inside, and maximum share of unknown ones, of a map
whose unknown space seems painted black. Real ones have .54 to .85; of the others none has .14."""


@dataclass(frozen=True)
class MapFault:
    """Something of a map that misleads."""

    kind: str
    """What it is: "mask", "costmap", "thresholds", "cells", "coarse cells", "open boundary", "solid
    walls", "thick walls", "painted unknown", "specks" or "origin"; by recorded drives "resolution",
    "deep walls", "false walls" or "missing walls"."""
    what: str
    """What is wrong, as a sentence without a full stop."""
    mend: str = ""
    """What to do about it; empty where the sentence says all."""
    costs: str = ""
    """What it costs a robot, where that was measured; else empty."""
    sure: bool = False
    """Whether the map, or the drive, shows it; else only the user, or a longer drive, can tell."""
    boxes: tuple[tuple[float, float, float, float], ...] = ()
    """Where it is, largest first: the least and greatest x, then y, of each place in the world [m];
    empty where it is everywhere."""

    @property
    def where(self) -> str:
        """The largest places in words, the middle of each and its size [m]; else empty."""
        said = [
            f"{(left + right) / 2:.1f},{(low + top) / 2:.1f}"
            f" ({right - left:.1f} x {top - low:.1f} m)"
            for left, right, low, top in self.boxes[:3]
        ]
        more = [f"{len(self.boxes) - 3} more places"] if len(self.boxes) > 3 else []
        return ", ".join([*said, *more])

    @property
    def sentence(self) -> str:
        """All of it in one sentence, without a full stop."""
        what = f"{self.what}, at {self.where}" if self.boxes else self.what
        return "; ".join(each for each in (what, self.costs, self.mend) if each)


def _said(kind: str, sentence: str, *, sure: bool = False) -> MapFault:
    """A fault whose sentence ends in what to do, or in what it means."""
    what, _, mend = sentence.rpartition("; ")
    return MapFault(kind, what or mend, mend if what else "", sure=sure)


def of_source(grid: OccupancyGrid, source: MapSource) -> Iterator[MapFault]:
    """What the file's entries and pixels make of the map."""
    free, occupied = source.free_thresh, source.occupied_thresh
    if source.light_free > MIN_SHARE * source.pixels:
        lower = 0.196 if free > 0.196 else 0.15
        yield _said(
            "thresholds",
            f"{source.light_free:,} pixels ({source.light_free / source.pixels:.0%}) of a light"
            f" grey, mostly {source.light_value}, are read as free, while map_saver's 205 means"
            f" unknown; if they are unknown, lower free_thresh to {lower:g} (it is {free:g})",
        )
    if source.of_costs:
        yield _said(
            "costmap",
            f"this is a costmap, not a map: {source.of_costs:,} pixels"
            f" ({source.of_costs / source.pixels:.0%}) are 253 or 254, the costs of obstacles, and"
            " are read as free; take the map that it was made of",
            sure=True,
        )
    if source.has_dark_walls:
        yield _said(
            "thresholds",
            f"{source.dark_unknown:,} dark grey pixels are read as unknown, beside"
            f" {source.occupied:,} occupied ones; if they are walls, lower occupied_thresh to"
            f" {DARK:g} (it is {occupied:g})",
        )
    if free == occupied:
        yield _said(
            "thresholds",
            f"free_thresh and occupied_thresh are both {free:g}, so that no grey is unknown;"
            " map_saver writes 0.25 or 0.196, and 0.65",
        )
    if source.over_100 > MIN_SHARE * source.pixels:
        yield _said(
            "thresholds",
            f"{source.over_100:,} pixels ({source.over_100 / source.pixels:.0%}) are above 100 and"
            " read as unknown, since pixels are per cent in mode raw; for an ordinary image set"
            " mode: trinary",
        )


def of_mask(grid: OccupancyGrid, source: MapSource) -> Iterator[MapFault]:
    """What tells of a mask for a costmap filter, which is no map to drive in.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    source : MapSource
        How its pixels were read, see `read_map`.

    Yields
    ------
    MapFault
        One fault at most, where a name or two other signs say so.
    """
    signs = []
    words = " ".join(re.findall(r"[a-z]+", f"{grid.name} {Path(source.image).name}".lower()))
    found = re.search(r"\b(filter|keepout|limit|mask|speed|virtual walls?)\b", words)
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
        yield _said(
            "mask",
            f"this seems to be a mask for a costmap filter, not a map: {', '.join(signs)};"
            " plan on the map that it belongs to",
            sure=True,
        )


def of_cells(grid: OccupancyGrid) -> Iterator[MapFault]:
    """What the cells themselves tell."""
    import cv2

    cells = grid.cells
    if not (cells == FREE).any():
        yield _said(
            "cells", "no cell is free, so that the robot can stand nowhere; check the thresholds"
        )
        return
    if grid.resolution > COARSE:
        yield _said(
            "coarse cells",
            f"cells of {grid.resolution:g} m are coarse beside a lidar, which measures to some"
            " centimetres; check resolution in the map's YAML (0.05 is usual), or map the site"
            " anew",
        )
    rim = np.concatenate([cells[0], cells[-1], cells[1:-1, 0], cells[1:-1, -1]]) == FREE
    if rim.mean() > MIN_SHARE:
        yield _said(
            "open boundary",
            f"free space runs out of the image along {rim.sum() * grid.resolution:.3g} m"
            f" ({rim.mean():.0%} of its edge); what lies outside counts as unknown",
        )
    if not (cells == OCCUPIED).any():
        yield _said(
            "cells", "no cell is occupied, so that a lidar sees nothing; check the thresholds"
        )
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
        yield _said(
            "open boundary",
            f"{share:.0%} of the free space's boundary is open to the unknown instead of walled;"
            " no lidar sees that boundary",
        )


def of_origin(grid: OccupancyGrid) -> Iterator[MapFault]:
    """What is unusual about the origin's yaw."""
    yaw = grid.origin[2]
    if abs(yaw) > 2 * math.pi:
        yield _said("origin", f"the origin's yaw of {yaw:g} is in radians, and looks like degrees")
    elif yaw:
        yield _said(
            "origin",
            f"the origin's yaw of {math.degrees(yaw):.4g} deg counts in all coordinates here; Nav2"
            " and ROS 1 ignore it",
        )


def specks_of(grid: OccupancyGrid) -> Bools:
    """The cells of specks: up to 3 that touch each other, and else only free ones, (H, W)."""
    import cv2

    found = np.zeros(grid.shape, np.bool_)
    for top in range(0, len(found), ROWS):
        first = max(top - SPECK - 1, 0)
        around = grid.cells[first : top + ROWS + SPECK + 1]
        occupied = (around == OCCUPIED).view(np.uint8)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(occupied, connectivity=8)
        floats = np.bincount(labels[_beside_unknown(around)], minlength=count) == 0
        small = floats & (stats[:, cv2.CC_STAT_AREA] <= SPECK)
        small[0] = False
        own = slice(top - first, top - first + ROWS)
        found[top : top + ROWS] = small[labels[own]]
    return found


def _beside_unknown(cells: Octets) -> Bools:
    """The cells that have a neighbour of unknown, or are that."""
    import cv2

    unknown = ((cells != OCCUPIED) & (cells != FREE)).view(np.uint8)
    return np.asarray(cv2.dilate(unknown, np.ones((3, 3), np.uint8)).view(np.bool_))


def boxes_of(
    grid: OccupancyGrid, cells: Bools, apart: float = 0.5
) -> tuple[tuple[float, float, float, float], ...]:
    """Boxes around the places of some cells, as `MapFault` has them.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    cells : (H, W) array of bool
        The cells.
    apart : float, default 0.5
        Distance from which on cells are two places [m].
    """
    import cv2

    size = 2 * int(apart / grid.resolution / 2) + 1
    near = cv2.dilate(cells.view(np.uint8), np.ones((size, size), np.uint8))
    count, labels = cv2.connectedComponents(near, connectivity=8)
    rows, cols = np.nonzero(cells)
    own = labels[rows, cols]
    places = []
    for n in np.argsort(-np.bincount(own, minlength=count), kind="stable")[: len(np.unique(own))]:
        row, col = rows[own == n], cols[own == n]
        corners = np.ix_((row.min(), row.max() + 1.0), (col.min(), col.max() + 1.0))
        x, y = grid.grid_to_world(*map(np.ravel, np.broadcast_arrays(*corners)))
        places.append((float(x.min()), float(x.max()), float(y.min()), float(y.max())))
    return tuple(places)


def of_painted(grid: OccupancyGrid) -> Iterator[MapFault]:
    """What tells of unknown space that was painted black."""
    unknown = np.count_nonzero(~grid.free & (grid.cells != OCCUPIED)) / grid.cells.size
    inside = float(inside_of_walls(grid).mean())
    if unknown <= NO_UNKNOWN and inside >= PAINTED:
        yield MapFault(
            "painted unknown",
            f"no cell is unknown, and {inside:.0%} of all are black inside of walls, as if unknown"
            " space were painted black",
            "save it as unknown, as map_saver does, or take the map that locplan repair writes",
        )


def of_walls(grid: OccupancyGrid, found: Solidity) -> Iterator[MapFault]:
    """What the walls do to a particle filter."""
    if found.misleads:
        yield MapFault(
            "solid walls" if found.is_solid else "thick walls",
            f"walls are black inside: a wrong pose explains {found.wins:.0%} of noisy scans better"
            f" than the true one, and {found.wins_hollowed:.0%} with hollow walls",
            "give AMCL, of ROS 1 or 2, the map that locplan repair writes, and plan on this one"
            if found.is_solid
            else f"hardly any is over {DEPTH:g} m deep, so that they may be smeared or inflated,"
            " and hollowing may harm; draw the walls from a recorded drive",
            "on such maps Nav2's default filter loses most drives" if found.is_solid else "",
            found.is_solid,
        )
    area = np.count_nonzero(grid.free) * grid.resolution**2
    count = _count_of_specks(grid, SPECKS * area)
    if count > SPECKS * area > 0:
        yield MapFault(
            "specks",
            f"{count:,} specks of up to {SPECK} cells float in free space, {count / area:.1f} a"
            " square metre",
            "erase them if nothing stands there",
            "a filter's error grows by up to 1.8 times",
        )


def _count_of_specks(grid: OccupancyGrid, limit: float) -> int:
    """Number of specks; that of their cells where it is no more than a limit."""
    import cv2

    specks = specks_of(grid)
    cells = int(np.count_nonzero(specks))
    if cells <= limit:  # each has a cell at least
        return cells
    return int(cv2.connectedComponents(specks.view(np.uint8), connectivity=8)[0]) - 1
