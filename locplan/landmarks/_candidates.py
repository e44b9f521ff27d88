"""Places where an object may stand: along walls, and free in halls."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Path
from locplan.landmarks._objects import Shape, filled_cells
from locplan.landmarks._passages import Passages
from locplan.maps import UNKNOWN, OccupancyGrid

WALL_GAP = 0.05
"""Least distance of an object from a wall [m]."""
NEAR_WALL = 0.3
"""Greatest distance of an object from its wall beyond the least one [m]."""
LATTICE = 1.0
"""Spacing of free-standing candidates [m]."""
FREE_CLEARANCE = 1.2
"""Clearance of a place from which on an object may stand free [m]."""
CHORD = 0.5
"""Length along a wall over which its direction is measured [m]."""
APART = 0.05
"""Least distance between two objects [m]."""

Where: TypeAlias = Literal["walls", "free", "both"]
"""Kinds of places that are tried."""
WHERE = ("walls", "free", "both")
AT_WALL = "less than 5 cm from a wall or another object"
BEYOND = "reaches beyond the map or into what is unknown"
KEPT_OUT = "in an area that is kept out"
ON_ROUTE = "in the way of a route"
IN_PASSAGE = "cuts a passage for the robot"


class Rejected(NamedTuple):
    """A candidate that was refused."""

    x: float
    """World x [m]."""
    y: float
    """World y [m]."""
    heading: float
    """Heading in the world [rad]."""
    reason: str
    """Why it was refused."""


@dataclass(frozen=True)
class Candidates:
    """Places at which an object may stand, and those that were refused."""

    poses: NDArray[np.float64]
    """Row, column and heading on the map, (n, 3) [cells, cells, rad]."""
    refused: NDArray[np.float64]
    """The same of the places that were refused, (m, 3)."""
    reasons: tuple[str, ...]
    """Why each was refused."""


def places_of(
    grid: OccupancyGrid,
    shape: Shape,
    where: Where,
    spacing: float,
    routes: Iterable[Path],
    keep: float,
) -> NDArray[np.float64]:
    """Poses of an object along walls and free-standing, not yet checked, (n, 3).

    Along walls it is turned as the wall is; a long object that stands free is tried both ways.
    """
    parts = []
    if where != "free":
        parts.append(along_walls(grid, shape, spacing))
    if where != "walls":
        parts.append(free_standing(grid, shape))
        parts.append(beside_routes(grid, shape, routes, keep, spacing))
    return np.concatenate(parts)


def along_walls(grid: OccupancyGrid, shape: Shape, spacing: float) -> NDArray[np.float64]:
    """Poses every `spacing` [m] along the walls, at least `WALL_GAP` clear of them."""
    import cv2

    resolution = grid.resolution
    distance = shape.half_width + WALL_GAP + resolution
    clear = np.where(grid.free, grid.clearance, 0.0)
    mask = (clear >= distance).astype(np.uint8)
    contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    found = [np.empty((0, 3))]
    for contour in contours:
        at = contour[:, 0, ::-1].astype(np.float64) + 0.5  # (row, col) of the cells' centres
        ring = np.concatenate([at, at[:1]])
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(ring, axis=0).T))]) * resolution
        count = max(1, int(way[-1] / spacing))
        where = (np.arange(count) + 0.5) * way[-1] / count
        half = min(CHORD / 2, way[-1] / 4)
        ends = [
            np.column_stack(
                [np.interp((where + shift) % max(way[-1], 1e-9), way, v) for v in ring.T]
            )
            for shift in (-half, half)
        ]
        d_row, d_col = (ends[1] - ends[0]).T
        nearest = np.searchsorted(way, where).clip(0, len(at)) % len(at)
        rows, cols = at[nearest].T
        near = clear[rows.astype(int), cols.astype(int)] < distance + NEAR_WALL
        # Two headings half a turn apart are one.
        heading = np.mod(np.arctan2(d_row, d_col) + 1e-9, np.pi) - 1e-9
        found.append(np.column_stack([rows, cols, heading])[near])
    return np.concatenate(found)


def free_standing(grid: OccupancyGrid, shape: Shape) -> NDArray[np.float64]:
    """Poses on a lattice of `LATTICE`, where the clearance is above `FREE_CLEARANCE`."""
    step = LATTICE / grid.resolution
    rows, cols = (np.arange(step / 2, size, step) for size in grid.shape)
    row, col = (v.ravel() for v in np.meshgrid(rows, cols, indexing="ij"))
    at = row.astype(int), col.astype(int)
    clear = grid.free[at] & (grid.clearance[at] > FREE_CLEARANCE)
    row, col = row[clear], col[clear]
    ways = (0.0,) if shape.half_length == shape.half_width else (0.0, math.pi / 2)
    return np.concatenate([np.column_stack([row, col, np.full(len(row), way)]) for way in ways])


def beside_routes(
    grid: OccupancyGrid, shape: Shape, routes: Iterable[Path], keep: float, spacing: float
) -> NDArray[np.float64]:
    """Poses every `spacing` [m] on both sides of routes through the open, as near as allowed.

    Near objects tell most to a filter whose heading is uncertain. They are turned as the route is,
    long ones also across it, and have the clearance of `free_standing`.
    """
    long = shape.half_length != shape.half_width
    found = [np.empty((0, 3))]
    for path in routes:
        fine = path.resampled(spacing, even=True)
        ahead = np.arctan2(*np.gradient(fine.xy, axis=0).T[::-1]) - grid.origin[2]
        row, col = grid.world_to_grid(*fine.xy.T)
        for turn in (0.0, math.pi / 2) if long else (0.0,):
            extent = shape.half_length if turn else shape.half_width
            for side in (-1, 1):
                away = side * (keep + extent) / grid.resolution + side
                at_row, at_col = row + np.cos(ahead) * away, col - np.sin(ahead) * away
                heading = np.mod(ahead + turn + 1e-9, np.pi) - 1e-9
                found.append(np.column_stack([at_row, at_col, heading]))
    poses = np.concatenate(found)
    rows, cols = np.floor(poses[:, :2]).astype(int).T
    inside = (rows >= 0) & (rows < grid.shape[0]) & (cols >= 0) & (cols < grid.shape[1])
    poses, at = poses[inside], (rows[inside], cols[inside])
    clear: NDArray[np.float64] = poses[grid.free[at] & (grid.clearance[at] > FREE_CLEARANCE)]
    return clear


def checked(
    places: NDArray[np.float64],
    grid: OccupancyGrid,
    shape: Shape,
    passages: Passages,
    *,
    routes: NDArray[np.float64],
    keep: float,
    keep_out: NDArray[np.bool_] | None = None,
) -> Candidates:
    """Split places into candidates and those that are refused, with the reasons.

    Parameters
    ----------
    places : (n, 3) array
        Row, column and heading [cells, cells, rad].
    grid : OccupancyGrid
        The map without objects.
    shape : Shape
        Outline of the object.
    passages : Passages
        Space of the robot.
    routes : (m, 2) array
        Row and column of positions along the routes [cells]; objects are `keep` [m] away.
    keep : float
        Least distance of an object from the routes [m].
    keep_out : (H, W) array of bool, optional
        Cells that no object may fill.
    """
    from scipy.spatial import cKDTree

    least = WALL_GAP + grid.resolution / 2 - 1e-9
    unknown, taken = grid.cells == UNKNOWN, grid.clearance < least
    tree = cKDTree(routes) if len(routes) else None
    kept, refused, reasons = [], [], []
    for row, col, heading in places:
        cells = filled_cells(shape, row, col, heading, grid.resolution, grid.shape)
        reason = ""
        if _beyond(shape, (row, col, heading), grid) or unknown[cells].any():
            reason = BEYOND
        elif taken[cells].any():
            reason = AT_WALL
        elif keep_out is not None and keep_out[cells].any():
            reason = KEPT_OUT
        elif tree is not None and (
            near := tree.query_ball_point((row, col), (shape.reach + keep) / grid.resolution)
        ):
            y, x = (routes[near] - (row, col)).T * grid.resolution
            reason = ON_ROUTE if (shape.distance(x, y, heading) < keep).any() else ""
        pose = np.array([row, col, heading])
        if not reason and passages.cuts(pose):
            reason = IN_PASSAGE
        if reason:
            refused.append(pose)
            reasons.append(reason)
        else:
            kept.append(pose)
    return Candidates(
        np.array(kept).reshape(-1, 3), np.array(refused).reshape(-1, 3), tuple(reasons)
    )


def _beyond(shape: Shape, pose: tuple[float, float, float], grid: OccupancyGrid) -> bool:
    """Whether an object at a pose [cells, cells, rad] reaches beyond the map."""
    row, col, heading = pose
    high = wide = shape.half_length
    if not shape.is_round:
        cos, sin = abs(math.cos(heading)), abs(math.sin(heading))
        wide = cos * shape.half_length + sin * shape.half_width
        high = sin * shape.half_length + cos * shape.half_width
    high, wide = high / grid.resolution - 1e-6, wide / grid.resolution - 1e-6
    rows, cols = grid.shape
    return not (high <= row <= rows - high and wide <= col <= cols - wide)


def too_close(
    shape: Shape, pose: NDArray[np.float64], others: NDArray[np.float64], resolution: float
) -> bool:
    """Whether an object would stand closer than `APART` to another one [cells, cells, rad]."""
    if not len(others):
        return False
    apart = np.hypot(*(others[:, :2] - pose[:2]).T) * resolution
    if shape.is_round:
        return bool((apart < 2 * shape.reach + APART).any())
    return any(
        _boxes_near(shape, pose, other, resolution)
        for other in others[apart < 2 * shape.reach + APART]
    )


def _boxes_near(
    shape: Shape, one: NDArray[np.float64], other: NDArray[np.float64], resolution: float
) -> bool:
    """Whether two rectangles come closer than `APART`; points along one against the other."""
    along, across = np.meshgrid(
        np.linspace(-shape.half_length, shape.half_length, 9),
        np.linspace(-shape.half_width, shape.half_width, 9),
    )
    for base, against in ((one, other), (other, one)):
        cos, sin = math.cos(base[2]), math.sin(base[2])
        x = cos * along - sin * across + (base[1] - against[1]) * resolution
        y = sin * along + cos * across + (base[0] - against[0]) * resolution
        if (shape.distance(x, y, against[2]) < APART).any():
            return True
    return False
