"""A robot's outline, and the check that it stays clear of walls along a path."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._util.checks import shown
from locplan.errors import ConfigError
from locplan.maps import OCCUPIED, OccupancyGrid


@dataclass(frozen=True, eq=False, repr=False)
class Footprint:
    """A convex outline around the robot's centre.

    Parameters
    ----------
    vertices : (n, 2) array of float64
        Corners x (forward), y (left) [m] from the robot's centre, n >= 3. If the outline is not
        convex, its convex hull counts. The centre must lie inside.

    Examples
    --------
    >>> outline = Footprint([(0.5, 0.2), (0.5, -0.2), (-0.3, -0.2), (-0.3, 0.2)])
    >>> round(outline.circumscribed_radius, 3), round(outline.inscribed_radius, 3)
    (0.539, 0.2)
    """

    vertices: NDArray[np.float64]

    def __post_init__(self) -> None:
        hull = _hull(_corners(self.vertices))
        area = np.sum(hull[:, 0] * np.roll(hull[:, 1], -1) - hull[:, 1] * np.roll(hull[:, 0], -1))
        hull = hull if area > 0 else hull[::-1]
        inside = np.sum(_normals(hull) * hull, axis=1) > 0
        if len(hull) < 3 or not inside.all():
            raise ConfigError("footprint must be a polygon around the robot's centre (0, 0)")
        object.__setattr__(self, "vertices", hull)

    @classmethod
    def from_text(cls, text: str) -> Footprint:
        """Footprint of a text as Nav2's parameter files have it.

        Parameters
        ----------
        text : str
            The corners, such as "[[0.3, 0.2], [0.3, -0.2], [-0.3, 0.0]]" [m].

        Raises
        ------
        ConfigError
            If it is no such text, or no polygon around the robot's centre.
        """
        plain = "".join(part.strip() for part in re.split(r"([\[\],])", text))
        pairs = [pair.split(",") for pair in plain[2:-2].split("],[")]
        try:
            if not (plain.startswith("[[") and plain.endswith("]]")):
                raise ValueError
            return cls(np.array([[float(value) for value in pair] for pair in pairs]))
        except ValueError:
            raise ConfigError(
                "footprint must be corners such as [[0.3,0.2],[0.3,-0.2],[-0.3,0]], not"
                f" {shown(text)}"
            ) from None

    def __repr__(self) -> str:
        radii = f"radii {self.inscribed_radius:g} and {self.circumscribed_radius:.3g} m"
        return f"Footprint({len(self.vertices)} corners, {radii})"

    @property
    def circumscribed_radius(self) -> float:
        """Radius of the smallest circle about the centre that holds the outline [m]."""
        return float(np.hypot(*self.vertices.T).max())

    @property
    def inscribed_radius(self) -> float:
        """Radius of the largest circle about the centre that the outline holds [m]."""
        normals = _normals(self.vertices)
        return float((np.sum(self.vertices * normals, axis=1) / np.hypot(*normals.T)).min())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Footprint) and np.array_equal(self.vertices, other.vertices)

    def __hash__(self) -> int:
        return hash(self.vertices.tobytes())

    def first_collision(self, grid: OccupancyGrid, poses: Any) -> tuple[float, float] | None:
        """Position along a path where the outline first meets an occupied cell, or None.

        A path without headings is driven forward: the robot heads along each line and turns on
        the spot, the shorter way, where two lines meet. The check is exact for lines, and slightly
        too strict for turns.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        poses : Path, or (n, 2) or (n, 3) array
            Positions of the robot's centre along the path in the world, with headings or without
            [m, m, rad].

        Returns
        -------
        (x, y) or None
            The position where the colliding line or turn begins [m].
        """
        outline = self.vertices / grid.resolution
        occupied = grid.cells == OCCUPIED
        for xy, to, heading, turn in _moves(
            grid, np.asarray(getattr(poses, "poses", poses), np.float64)
        ):
            # In steps of 2 deg, with the outline grown to cover the angles between.
            count = max(1, math.ceil(abs(turn) / math.radians(2)))
            grown = outline / math.cos(turn / count / 2)
            for part in range(count):
                body = _turned(grown, heading + turn * (part + 0.5) / count)
                here, there = (xy + (to - xy) * share / count for share in (part, part + 1))
                if _meets(occupied, _hull(np.vstack([here + body, there + body]))):
                    x, y = grid.grid_to_world(xy[1], xy[0])
                    return float(x), float(y)
        return None


def _moves(
    grid: OccupancyGrid, poses: NDArray[np.float64]
) -> Iterator[tuple[NDArray[Any], NDArray[Any], float, float]]:
    """Start and end (col, row), first heading and turn [rad] of each move along a path."""
    lines = itertools.pairwise(np.column_stack(grid.world_to_grid(*poses[:, :2].T))[:, ::-1])
    if poses.shape[1] == 3:
        turns = itertools.pairwise(poses[:, 2] - grid.origin[2])
        for (xy, to), (heading, after) in zip(lines, turns, strict=True):
            yield xy, to, heading, math.remainder(after - heading, 2 * math.pi)
        return
    previous = None
    for xy, to in lines:
        if np.array_equal(xy, to):
            continue
        heading = math.atan2(to[1] - xy[1], to[0] - xy[0])
        if previous is not None:
            yield xy, xy, previous, math.remainder(heading - previous, 2 * math.pi)
        yield xy, to, heading, 0.0
        previous = heading


def _corners(vertices: ArrayLike) -> NDArray[np.float64]:
    try:
        corners = np.array(vertices, dtype=np.float64)
    except (TypeError, ValueError):
        corners = np.empty(0)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise ConfigError("footprint must be three or more corners (x, y) in metres")
    if not np.isfinite(corners).all():
        raise ConfigError("footprint must have finite corners, in metres")
    return corners


def _turned(outline: NDArray[Any], angle: float) -> NDArray[np.float64]:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.asarray(outline @ np.array([[cos, sin], [-sin, cos]]))


def _hull(corners: NDArray[Any]) -> NDArray[np.float64]:
    import cv2

    order = cv2.convexHull(corners.astype(np.float32), returnPoints=False)
    return np.asarray(corners[np.asarray(order).ravel()])


def _normals(polygon: NDArray[Any]) -> NDArray[np.float64]:
    """Outward normals of a polygon's edges, as long as the edges; counter-clockwise corners."""
    x, y = (np.roll(polygon, -1, axis=0) - polygon).T
    return np.column_stack([y, -x])


def _meets(occupied: NDArray[np.bool_], polygon: NDArray[Any]) -> bool:
    """True if a convex polygon (n, 2) of (col, row) meets an occupied cell, by separating axes."""
    low, high = np.floor(polygon.min(axis=0)).astype(int), np.floor(polygon.max(axis=0)).astype(int)
    top, left = max(0, low[1]), max(0, low[0])
    rows, cols = np.nonzero(occupied[top : max(0, high[1] + 1), left : max(0, high[0] + 1)])
    if not rows.size:
        return False
    centres = np.column_stack([cols + left + 0.5, rows + top + 0.5])
    apart = np.zeros(len(centres), bool)
    for normal in _normals(polygon):
        half = np.abs(normal).sum() / 2  # half the width of a cell's projection on the normal
        polygon_shadow, shadow = polygon @ normal, centres @ normal
        apart |= shadow - half >= polygon_shadow.max() - 1e-9
        apart |= shadow + half <= polygon_shadow.min() + 1e-9
    return not bool(apart.all())
