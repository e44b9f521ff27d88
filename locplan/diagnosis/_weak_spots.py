"""Weak spots of a map, and other places where drives fail."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan.costs import Costmap, Path
from locplan.diagnosis._areas import degenerate_areas
from locplan.diagnosis._outlines import DegenerateArea
from locplan.field import CovarianceField
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.planners import connected_parts


@dataclass(frozen=True, eq=False, repr=False)
class WeakSpot:
    """A place where scans fit the map at many poses, or where drives fail anyway."""

    letter: str
    """Its letter on the picture, A for the worst; empty beyond the sixth."""
    x: float
    """World x of a place in it, which a route passes if one does [m]."""
    y: float
    """World y of it [m]."""
    length: float
    """Its extent along the direction in which a pose is uncertain [m]."""
    width: float
    """Its extent across [m]."""
    direction: float
    """Direction in which a pose is uncertain, from x, 0..pi [rad]; NaN without a common one."""
    position_std: float
    """Standard deviation of a pose match along it, the median over the spot [m]; NaN where no scan
    is weak."""
    heading_std: float
    """Standard deviation of the heading, the median over the spot [rad]; NaN where no scan is."""
    missing: str
    """What is missing there, in words."""
    routes: tuple[str, ...]
    """Names of the routes that pass it."""
    outline: Floats
    """Corners [m], (n, 2); none where no scan is weak."""
    holes: tuple[Floats, ...] = ()
    """Corners of the holes [m], (n, 2) each."""
    lost: int = 0
    """Number of the baseline's drives that get lost in it, or up to 10 m after."""
    stopped: int = 0
    """Number of the baseline's closed-loop drives that stop there instead of at the goal."""

    def __repr__(self) -> str:
        return f"WeakSpot({self.letter}: {self.size} at {self.place}, {self.missing})"

    @property
    def place(self) -> str:
        """Position as text [m]."""
        return f"({self.x:.1f}, {self.y:.1f})"

    @property
    def size(self) -> str:
        """Its extent, as people read it."""
        return f"{self.length:.0f} x {self.width:.0f} m" if self.rings else "-"

    @property
    def deviation(self) -> str:
        """How uncertain a pose of a scan is there."""
        if not self.rings:
            return "-"
        if self.missing == ROUND:
            return f"{math.degrees(self.heading_std):.0f} deg"
        return f"{100 * self.position_std:.0f} cm"

    @property
    def rings(self) -> tuple[Floats, ...]:
        """Corners of its outline and of its holes [m]; nothing where no scan is weak."""
        return (self.outline, *self.holes) if len(self.outline) else ()

    @property
    def hurts(self) -> tuple[float, ...]:
        """What it is ranked by: failed drives, and deviation x length x number of routes."""
        weight = self.position_std * self.length if self.rings else 0.0
        return self.lost + self.stopped, self.stopped, weight * len(self.routes), weight


ROUND, CLEAR = "no corner fixes the heading", "the filter errs although scans fit"
"""What is missing if only the heading is uncertain, and at a place where scans are not weak."""


def weak_spots(
    costs: Costmap, field: CovarianceField, reach: float, paths: Mapping[str, Path]
) -> tuple[WeakSpot, ...]:
    """The weak spots of a map, first those of the largest deviation x length x routes that pass.

    They lie in the parts of the map that the robot can reach from the routes.

    Parameters
    ----------
    costs : Costmap
        The costmap of the field.
    field : CovarianceField
        The field.
    reach : float
        Range within which the filter reads the lidar [m].
    paths : mapping of str to Path
        The routes by name.
    """
    lines = {name: points_of(path) for name, path in paths.items()}
    reachable = _mark_reachable(costs, lines)
    costs = replace(costs, u=np.where(reachable, costs.u, np.nan))
    free = np.count_nonzero(reachable) * costs.grid.resolution**2
    spots = [_spot(area, costs.grid, reach, lines) for area in _areas(costs, field, free)]
    return tuple(sorted(spots, key=lambda each: each.hurts, reverse=True))


def _mark_reachable(costs: Costmap, lines: Mapping[str, Floats]) -> Bools:
    """Mark the free cells that the robot covers in the parts of the map where routes lie."""
    import cv2

    _, labels = connected_parts(costs)
    rows, cols = (
        np.clip(np.floor(each).astype(int), 0, size - 1)
        for each, size in zip(
            costs.grid.world_to_grid(*np.concatenate([*lines.values()]).T),
            labels.shape,
            strict=True,
        )
    )
    drivable = np.isin(labels, np.setdiff1d(labels[rows, cols], [0]))
    distance = cv2.distanceTransform((~drivable).astype(np.uint8), cv2.DIST_L2, 5)
    near = distance * costs.grid.resolution <= costs.robot_radius + costs.grid.resolution
    return np.asarray(near & costs.grid.free)


def _areas(costs: Costmap, field: CovarianceField, free: float) -> tuple[DegenerateArea, ...]:
    """Degenerate areas, none of which takes most of the map unless nothing divides it."""
    found: tuple[DegenerateArea, ...] = ()
    for threshold in (None, 0.6, 0.7, 0.8, 0.9):  # minimum u of a spot's cells
        before, found = found, degenerate_areas(costs, field, threshold=threshold)
        if not found:
            return before
        if found[0].area < 0.25 * free:  # else an area takes too much of the map
            break
    return found


def _spot(
    area: DegenerateArea, grid: OccupancyGrid, reach: float, lines: Mapping[str, Floats]
) -> WeakSpot:
    direction = area.direction % math.pi
    along = np.array([math.cos(direction), math.sin(direction)])
    length, width = (float(np.ptp(area.outline @ way)) for way in (along, along[::-1] * [-1, 1]))
    passing = {name: own for name, line in lines.items() if len(own := line[is_within(area, line)])}
    longest = max(passing.values(), key=len, default=np.array([area.middle]))
    x, y = longest[len(longest) // 2].tolist()
    turns = area.heading_std > math.radians(10) and area.position_std < 0.2
    degrees = round(math.degrees(direction)) % 180
    axis = {0: "x", 9: "y", 18: "x"}.get(round(degrees / 10), f"{degrees} deg")
    missing = f"no features along {axis}"
    if seen_around(grid, (x, y), reach) < 0.35:  # of the directions
        missing = f"few walls within {reach:g} m"
    elif turns:
        missing = ROUND
    elif not area.agrees:
        missing = "no long wall, only clutter"
    return WeakSpot(
        letter="",
        x=x,
        y=y,
        length=length,
        width=width,
        direction=direction if area.agrees else math.nan,
        position_std=area.position_std,
        heading_std=area.heading_std,
        missing=missing,
        routes=tuple(passing),
        outline=area.outline,
        holes=area.holes,
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

    if not len(outline):
        return np.zeros(len(points), np.bool_)
    corners = outline.astype(np.float32)
    tested = [cv2.pointPolygonTest(corners, (x, y), False) for x, y in points.tolist()]
    return np.array(tested) >= 0


def is_within(area: DegenerateArea | WeakSpot, points: Floats) -> Bools:
    """Which of some points lie in an area, and in none of its holes."""
    found = inside(area.outline, points)
    for hole in area.holes:
        found &= ~inside(hole, points)
    return found


def gathered(xy: Floats, radius: float) -> list[tuple[Floats, Ints]]:
    """Positions in groups, the largest first: one within a radius of all, and which they are.

    Parameters
    ----------
    xy : (n, 2) array
        The positions [m].
    radius : float
        The radius [m].
    """
    near = np.linalg.norm(xy[:, None] - xy, axis=2) <= radius
    left, groups = np.ones(len(xy), np.bool_), []
    while left.any():
        middle = int(np.argmax((near & left).sum(axis=1) * left))
        groups.append((xy[middle], np.flatnonzero(near[middle] & left)))
        left &= ~near[middle]
    return groups
