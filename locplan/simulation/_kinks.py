"""Kinks of a filter's map: the part of the map behind a place in a corridor is turned about it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Octets
from locplan._util.poses import Poses
from locplan.costs import Path
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

WIDEST = 4.0
"""Greatest width of a corridor [m]."""
STRAIGHT = 1.0
"""Distance before and behind a kink over which the path leads through the corridor [m]."""
SPACING = 0.25
"""Distance between two places that are compared [m]."""
SETTLED, LATEST = 3.0, 2 / 3
"""Least distance of a kink from the start [m], so that the filter has settled, and its greatest
share of the path, so that a filter that recovers can show it."""


@dataclass(frozen=True)
class Kink:
    """A place on a path, and the line across the path that cuts the map in two."""

    x: float
    """Position in the world [m]."""
    y: float
    """Position in the world [m]."""
    direction: float
    """Direction of the path, in which the turned part lies [rad]."""

    def is_behind(self, xy: Floats) -> Bools:
        """Return whether positions (..., 2) in the world lie in the turned part.

        Parameters
        ----------
        xy : (..., 2) array
            Positions before the turn [m].
        """
        ahead = math.cos(self.direction), math.sin(self.direction)
        return np.asarray((xy - (self.x, self.y)) @ ahead > 0)

    def turn(self, xy: Floats, angle: float) -> Floats:
        """Return positions (n, 2) turned about the place.

        Parameters
        ----------
        xy : (n, 2) array
            Positions in the world [m].
        angle : float
            Angle [rad].
        """
        cos, sin = math.cos(angle), math.sin(angle)
        dx, dy = (xy - (self.x, self.y)).T
        return np.column_stack([self.x + cos * dx - sin * dy, self.y + sin * dx + cos * dy])

    def turn_poses(self, poses: Poses, angle: float) -> Poses:
        """Return poses of the building as they are in the kinked map.

        Parameters
        ----------
        poses : (n, 3) array
            Poses in the world [m, m, rad].
        angle : float
            Angle of the kink [rad].
        """
        behind = self.is_behind(poses[:, :2])
        kinked = poses.copy()
        kinked[behind, :2] = self.turn(poses[behind, :2], angle)
        kinked[behind, 2] += angle
        return kinked

    def turn_map(self, grid: OccupancyGrid, angle: float) -> OccupancyGrid:
        """Return a map whose part behind the place is turned.

        Where both parts overlap, cells are occupied if they are in either, and free if they are
        free in either.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        angle : float
            Angle of the kink [rad].
        """
        known = np.argwhere(grid.cells != UNKNOWN)
        xy = np.column_stack(grid.grid_to_world(*(known + 0.5).T))
        behind = self.is_behind(xy)
        turned = grid.world_to_grid(*self.turn(xy[behind], angle).T)
        kept = (known[~behind].T + 0.5).reshape(2, -1)
        ends = [np.concatenate(both) for both in zip(turned, kept, strict=True)]
        # One more cell on all sides, for cells that the turn cuts.
        first = [math.floor(at.min()) - 1 for at in ends]
        shape = [math.floor(at.max()) + 2 - low for at, low in zip(ends, first, strict=True)]
        rows, cols = (at.ravel() + 0.5 for at in np.indices(shape))
        at_x, at_y = grid.grid_to_world(rows + first[0], cols + first[1])
        here = np.column_stack([at_x, at_y])
        before, after = here, self.turn(here, -angle)
        near = np.where(self.is_behind(before), UNKNOWN, _values_at(grid, before))
        far = np.where(self.is_behind(after), _values_at(grid, after), UNKNOWN)
        is_free = (near == FREE) | (far == FREE)
        cells = np.where(is_free, FREE, UNKNOWN)
        cells = np.where((near == OCCUPIED) | (far == OCCUPIED), OCCUPIED, cells)
        corner = grid.grid_to_world(first[0], first[1])
        origin = (float(corner[0]), float(corner[1]), grid.origin[2])
        return OccupancyGrid(
            cells.astype(np.uint8).reshape(shape), grid.resolution, origin, grid.name
        )


def find_kink(path: Path, grid: OccupancyGrid) -> Kink | None:
    """Return the place of a kink on a path, or None if there is no suitable one.

    It lies in a corridor of at most 4 m, and the path crosses the line of the cut there alone. Of
    several places, the cut through the fewest free cells is taken.

    Parameters
    ----------
    path : Path
        The path.
    grid : OccupancyGrid
        The map.
    """
    fine = path.resampled(SPACING, even=True)
    xy, distance = fine.xy, fine.distance
    around = round(STRAIGHT / SPACING)
    places = np.flatnonzero((distance >= SETTLED) & (distance <= LATEST * path.length))
    places = places[(places >= around) & (places < len(xy) - around)]
    if not places.size:
        return None
    dx, dy = (xy[places + around] - xy[places - around]).T
    direction = np.arctan2(dy, dx)
    kinks = [
        Kink(float(x), float(y), float(angle))
        for (x, y), angle in zip(xy[places], direction, strict=True)
    ]
    is_once = np.array(
        [
            (kink.is_behind(xy) == (np.arange(len(xy)) > place)).all()
            for place, kink in zip(places, kinks, strict=True)
        ]
    )
    widths, cuts = np.array([_measure_cut(kink, grid) for kink in kinks]).T
    # The width counts on both sides of the place, too: a door is no corridor.
    has_wide = np.convolve(widths > WIDEST, np.ones(2 * around + 1))[around : around + len(widths)]
    suitable = is_once & (has_wide == 0)
    if not suitable.any():
        return None
    return kinks[int(np.where(suitable, cuts, np.inf).argmin())]


def _measure_cut(kink: Kink, grid: OccupancyGrid) -> tuple[float, float]:
    """Return the width of the free space about a place, and the free length of the whole cut."""
    half = math.ceil(math.hypot(*grid.shape))
    steps = grid.resolution * np.arange(-half, half + 1)
    aside = -math.sin(kink.direction), math.cos(kink.direction)
    free = _values_at(grid, np.array([kink.x, kink.y]) + steps[:, None] * aside) == FREE
    sides = free[half:], free[half::-1]
    width = sum(len(side) if side.all() else int(side.argmin()) for side in sides)
    return width * grid.resolution, float(free.sum()) * grid.resolution


def _values_at(grid: OccupancyGrid, xy: Floats) -> Octets:
    """Return the cells at positions (n, 2) in the world; unknown outside the map."""
    rows, cols = (np.floor(at).astype(np.int64) for at in grid.world_to_grid(*xy.T))
    inside = (rows >= 0) & (rows < grid.shape[0]) & (cols >= 0) & (cols < grid.shape[1])
    values = np.full(len(xy), UNKNOWN, np.uint8)
    values[inside] = grid.cells[rows[inside], cols[inside]]
    return values
