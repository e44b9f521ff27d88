"""Weak spots of a map: where, how large, uncertain along what, and what is missing there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from string import ascii_uppercase
from typing import Any

import numpy as np

from locplan._kernels.arrays import Bools, Floats
from locplan.costs import Costmap, Path
from locplan.export import DegenerateArea, degenerate_areas
from locplan.field import CovarianceField
from locplan.maps import OCCUPIED, OccupancyGrid

LISTED = 5
"""Maximum number of weak spots."""
WIDE, LONG = 6.0, 12.0
"""Width and length of an area from which on it is cut into parts of at most this length [m]."""
PIXEL, SMALLEST = 0.25, 4.0
"""Side of the pixels that areas are cut by [m], and minimum area of a part [m^2]."""


@dataclass(frozen=True, eq=False, repr=False)
class WeakSpot:
    """A place where scans fit the map at many poses."""

    letter: str
    """Its letter on the picture, A for the worst."""
    x: float
    """World x of a place well inside it [m]."""
    y: float
    """World y of it [m]."""
    length: float
    """Its extent along the direction in which a pose is uncertain [m]."""
    width: float
    """Its extent across [m]."""
    direction: float
    """Direction in which a pose is uncertain, from x, 0..pi [rad]; NaN without a common one."""
    position_std: float
    """Standard deviation of a pose match along it, the median over the spot [m]."""
    heading_std: float
    """Standard deviation of the heading, the median over the spot [rad]."""
    missing: str
    """What is missing there, in words."""
    trips: tuple[str, ...]
    """Names of the trips that pass it."""
    outline: Floats
    """Corners [m], (n, 2)."""

    def __repr__(self) -> str:
        return f"WeakSpot({self.letter}: {self.size} at {self.place}, {self.missing})"

    @property
    def place(self) -> str:
        """Where it is, as people read it [m]."""
        return f"{self.x:.1f},{self.y:.1f}"

    @property
    def size(self) -> str:
        """Its extent, as people read it."""
        return f"{self.length:.0f} x {self.width:.0f} m"

    @property
    def deviation(self) -> str:
        """How uncertain a pose of a scan is there."""
        if self.missing == ROUND:
            return f"{math.degrees(self.heading_std):.0f} deg"
        return f"{100 * self.position_std:.0f} cm"


ROUND = "no corner tells the heading"


def weak_spots(
    costs: Costmap, field: CovarianceField, reach: float, paths: Mapping[str, Path]
) -> tuple[WeakSpot, ...]:
    """The weak spots of a map, first those that most trips pass.

    Those come first that most trips pass, and then those of the largest product of deviation and
    length.

    Parameters
    ----------
    costs : Costmap
        The costmap of the field.
    field : CovarianceField
        The field.
    reach : float
        Range within which the filter reads the lidar [m].
    paths : mapping of str to Path
        The trips by name.
    """
    lines = {name: points_of(path) for name, path in paths.items()}
    every = [part for area in _areas(costs, field) for part in _cut(area, lines)]
    spots = [_spot(area, costs.grid, reach, lines) for area in every]
    spots.sort(key=lambda each: (-len(each.trips), -each.position_std * each.length))
    named = zip(ascii_uppercase, spots[:LISTED], strict=False)
    return tuple(replace(each, letter=letter) for letter, each in named)


def _areas(costs: Costmap, field: CovarianceField) -> tuple[DegenerateArea, ...]:
    """Degenerate areas, none of which takes most of the map unless nothing divides it."""
    free = np.count_nonzero(costs.grid.free) * costs.grid.resolution**2
    found: tuple[DegenerateArea, ...] = ()
    for threshold in (None, 0.6, 0.7, 0.8, 0.9):  # minimum u of a spot's cells
        before, found = found, degenerate_areas(costs, field, threshold=threshold)
        if not found:
            return before
        if found[0].area < 0.25 * free:  # else an area takes too much of the map
            break
    return found


def _extents(area: DegenerateArea) -> tuple[float, float]:
    """Extents of an area along and across its direction [m]."""
    along = np.array([math.cos(area.direction), math.sin(area.direction)])
    length, width = (np.ptp(area.outline @ way) for way in (along, along[::-1] * [-1, 1]))
    return float(length), float(width)


def _cut(area: DegenerateArea, lines: Mapping[str, Floats]) -> list[DegenerateArea]:
    """An area; of one that is wide and long the parts of it, near trips where there are any."""
    import cv2

    extents = _extents(area)
    if min(extents) < WIDE or max(extents) < LONG:
        return [area]
    lowest = area.outline.min(axis=0) - PIXEL
    size = np.ceil(np.ptp(area.outline, axis=0) / PIXEL).astype(int) + 3
    mask, near = np.zeros((2, *size[::-1]), np.uint8)

    def pixels(xy: Floats) -> Any:
        return np.rint((xy - lowest) / PIXEL).astype(np.int32)

    cv2.fillPoly(mask, [pixels(each) for each in (area.outline, *area.holes)], 1)
    cv2.polylines(near, [pixels(each) for each in lines.values()], False, 1, int(WIDE / PIXEL))
    if (mask & near).any():
        mask &= near
    rows, cols = (
        np.array_split(np.arange(count), math.ceil(count * PIXEL / LONG)) for count in mask.shape
    )
    tiles = [np.ix_(row, col) for row in rows for col in cols]
    parts = []
    for tile in tiles:
        own = np.zeros_like(mask)
        own[tile] = mask[tile]
        parts += [
            replace(
                area, outline=outline * PIXEL + lowest, middle=middle * PIXEL + lowest, holes=()
            )
            for outline, middle in _pieces(own)
        ]
    return parts or [area]


def _pieces(mask: Any) -> Iterator[tuple[Floats, Floats]]:
    """Corners of each piece of a mask that is large enough, and a pixel well inside it."""
    import cv2

    count, labels = cv2.connectedComponents(mask)
    for number in range(1, count):
        piece = (labels == number).astype(np.uint8)
        if piece.sum() * PIXEL**2 < SMALLEST:
            continue
        corners, _ = cv2.findContours(piece, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        depth = cv2.distanceTransform(np.pad(piece, 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
        row, col = np.unravel_index(depth.argmax(), depth.shape)
        yield max(corners, key=len)[:, 0].astype(float), np.array([col, row], float)


def _spot(
    area: DegenerateArea, grid: OccupancyGrid, reach: float, lines: Mapping[str, Floats]
) -> WeakSpot:
    direction = area.direction % math.pi
    length, width = _extents(area)
    turns = area.heading_std > math.radians(10) and area.position_std < 0.2
    missing = f"no feature along {math.degrees(direction):.0f} deg"
    if seen_around(grid, area.middle, reach) < 0.35:  # of the directions
        missing = f"few walls within {reach:g} m"
    elif turns:
        missing = ROUND
    elif not area.agrees:
        missing = "only clutter, no long wall"
    passing = [name for name, line in lines.items() if inside(area.outline, line).any()]
    return WeakSpot(
        letter="",
        x=float(area.middle[0]),
        y=float(area.middle[1]),
        length=length,
        width=width,
        direction=direction if area.agrees else math.nan,
        position_std=area.position_std,
        heading_std=area.heading_std,
        missing=missing,
        trips=tuple(passing),
        outline=area.outline,
    )


def seen_around(grid: OccupancyGrid, xy: tuple[float, float], reach: float) -> float:
    """Share of 72 directions from a place in which a wall stands within a range [m]."""
    angles = np.linspace(0, 2 * np.pi, 72, endpoint=False)[:, None]
    steps = np.arange(0.0, reach, grid.resolution / 2)
    at = grid.world_to_grid(xy[0] + steps * np.cos(angles), xy[1] + steps * np.sin(angles))
    rows, cols = (np.floor(each).astype(int) for each in at)
    height, width = grid.shape
    known = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
    walls = grid.cells[np.where(known, rows, 0), np.where(known, cols, 0)] == OCCUPIED
    return float((walls & known).any(axis=1).mean())


def points_of(path: Path) -> Floats:
    """Points of a path every quarter of a metre, (n, 2) [m]."""
    return np.asarray(path.resampled(0.25, even=True).xy)


def inside(outline: Floats, points: Floats) -> Bools:
    """Which of some points (n, 2) lie in an outline, (n,)."""
    import cv2

    corners = outline.astype(np.float32)
    tested = [cv2.pointPolygonTest(corners, (x, y), False) for x, y in points.tolist()]
    return np.array(tested) >= 0


def blamed(spots: Sequence[WeakSpot], path: Path, lost_at: Floats) -> str:
    """Where drives were lost: letters of the spots they were in or had left, or a position.

    Letters come in the order of how many drives each explains.

    Parameters
    ----------
    spots : sequence of WeakSpot
        The weak spots.
    path : Path
        The trip.
    lost_at : (drives,) array
        Distance along it where each drive was first off by over 1 m [m]; NaN where none was.
    """
    if not len(known := lost_at[np.isfinite(lost_at)]):
        return ""
    points = points_of(path)
    distance = np.linspace(0, path.length, len(points))
    counts = {}
    for spot in spots:
        own = distance[inside(spot.outline, points)]
        since = known[:, None] - own
        # A robot drives up to 10 m from a spot until it is off by over 1 m because of it.
        hit = ((since >= -0.5) & (since <= 10.0)).any(axis=1) if len(own) else np.zeros(1)
        counts[spot.letter] = int(hit.sum())
    often = sorted(counts, key=lambda letter: -counts[letter])
    named = [letter for letter in often if counts[letter] >= 0.25 * len(known)]
    x, y = points[np.abs(distance - np.median(known)).argmin()].tolist()
    return ", ".join(named) or f"{x:.1f},{y:.1f}"
