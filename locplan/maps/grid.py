"""The occupancy grid: its cells, their place in the world, and their clearance."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._support import checks
from locplan._support.kernels.arrays import Bools, Floats, Ints
from locplan._support.public import DrawableResult
from locplan.errors import MapError
from locplan.maps.occupancy import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    levels_from_occupancy,
    parse_grid_message,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_SHORT = 12  # greatest distance that `cells_near_walls` finds without the clearance [cells]


@dataclass(frozen=True, eq=False, repr=False)
class OccupancyGrid(DrawableResult):
    """A three-level occupancy grid with its place in the world.

    Row 0 lies at the lowest y and column 0 at the lowest x (before yaw), as in
    nav_msgs/OccupancyGrid. Cell ``(row, col)`` covers ``[row, row + 1) x [col, col + 1)`` cells
    from the origin. Everything outside the grid is unknown.

    Parameters
    ----------
    cells : (H, W) array of uint8
        ``FREE`` (254), ``UNKNOWN`` (127) or ``OCCUPIED`` (0). Copied, and read-only afterwards.
    resolution : float
        Edge of a cell, 0.001 to 10 [m].
    origin : (x, y, yaw)
        World pose of the outer corner of cell (0, 0) [m, m, rad], each within 1e8. A yaw turns
        the map counter-clockwise about that corner.
    name : str
        Name of the map in tables and titles; what cannot be printed in it becomes U+FFFD.

    Raises
    ------
    MapError
        If the array is not two-dimensional, is empty or holds another level, or if the
        resolution or the origin is no number or out of its range.

    Examples
    --------
    >>> grid = OccupancyGrid(np.full((20, 40), FREE), resolution=0.05, origin=(1.0, 2.0, 0.0))
    >>> grid.cell((1.12, 2.01))
    (0, 2)
    >>> grid.cells[grid.cell(np.array([[1.12, 2.01], [2.9, 2.6]]))].tolist()
    [254, 254]
    >>> grid.position(np.array([0, 3]), np.array([2, 4])).round(3).tolist()
    [[1.125, 2.025], [1.225, 2.175]]
    """

    cells: NDArray[np.uint8]
    resolution: float
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    name: str = ""

    if TYPE_CHECKING:  # lists are taken, but arrays kept

        def __init__(
            self, cells: ArrayLike, resolution: float, origin: Sequence[float] = ..., name: str = ""
        ) -> None: ...

    def __post_init__(self) -> None:
        cells = np.asarray(self.cells)
        if cells.ndim != 2 or cells.size == 0:
            raise MapError(
                f"cells must be a non-empty (rows, cols) array, not {cells.shape}; the data of a"
                " nav_msgs/OccupancyGrid is read by OccupancyGrid.from_message"
            )
        # np.isin takes ten bytes for each cell.
        if not np.all((cells == OCCUPIED) | (cells == UNKNOWN) | (cells == FREE)):
            raise MapError(
                "cells may only hold 0 (occupied), 127 (unknown) and 254 (free); other values are"
                " read by OccupancyGrid.from_occupancy"
            )
        resolution = checks.parse_finite_numbers(self.resolution)
        finest, coarsest = checks.RESOLUTIONS
        if len(resolution) != 1 or not finest <= resolution[0] <= coarsest:
            resolution_text = (
                f"{resolution[0]:g}; is it metres?"
                if resolution
                else checks.short_repr(self.resolution)
            )
            raise MapError(
                f"resolution must be {finest:g} to {coarsest:g} m per cell, not {resolution_text}"
            )
        origin = checks.parse_finite_numbers(self.origin)
        if len(origin) != 3 or max(map(abs, origin)) > checks.FARTHEST:
            raise MapError(
                f"origin must be three finite numbers (x, y, yaw) within ±{checks.FARTHEST:g}, not"
                f" {checks.short_repr(self.origin)}"
            )
        checks.check_instance("name", self.name, str)
        name = checks.make_printable(self.name)
        cells = np.array(cells, dtype=np.uint8, order="C")
        cells.setflags(write=False)
        checks.set_frozen_fields(
            self, cells=cells, resolution=resolution[0], origin=origin, name=name
        )

    @classmethod
    def from_occupancy(
        cls,
        occupancy: ArrayLike,
        resolution: float,
        origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
        name: str = "",
        *,
        probabilities: bool = False,
    ) -> OccupancyGrid:
        """Make a grid from occupancy values (H, W), row 0 at the lowest y.

        Parameters
        ----------
        occupancy : (H, W) array
            Per cent as in a nav_msgs/OccupancyGrid: 0 to 19 is free, 65 to 100 occupied, -1 and
            what lies between is unknown, by map_server's default thresholds. Or bool: True is
            occupied, False is free.
        resolution, origin, name
            See `OccupancyGrid`.
        probabilities : bool, default False
            True if the values are probabilities of 0.0 to 1.0, or NaN where unknown.

        Raises
        ------
        MapError
            If a value is out of its range, or the values may be either per cent or probabilities:
            only 0 and 1, or numbers with a decimal point.
        """
        return cls(
            levels_from_occupancy(occupancy, probabilities=probabilities), resolution, origin, name
        )

    @classmethod
    def from_message(cls, message: Any, name: str = "") -> OccupancyGrid:
        """Make a grid from a nav_msgs/OccupancyGrid: its flat data, size, resolution and origin.

        Parameters
        ----------
        message : nav_msgs/OccupancyGrid
            The message, as rclpy or rosbags gives it; any object with its fields will do.
        name : str, default ""
            Name of the map in tables and titles; a message has no name.

        Raises
        ------
        MapError
            If it is no such message, or a value is outside -1 to 100.
        """
        values, resolution, origin = parse_grid_message(message)
        return cls.from_occupancy(values, resolution, origin, name)

    def __repr__(self) -> str:
        (rows, cols), (x, y, yaw) = self.shape, self.origin
        name = f"{self.name}, " if self.name else ""
        yaw_text = f", yaw {math.degrees(yaw):g} deg" if yaw else ""
        return (
            f"OccupancyGrid({name}{rows} x {cols} cells of {self.resolution:g} m,"
            f" origin {x:g},{y:g} m{yaw_text})"
        )

    def __eq__(self, other: object) -> bool:
        """True if two grids are the same map; their names do not count."""
        return isinstance(other, OccupancyGrid) and self.digest == other.digest

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickled grid, with its cells read-only as before."""
        vars(self).update(state)
        self.cells.setflags(write=False)

    def __hash__(self) -> int:
        return hash(self.digest)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        rows, cols = self.cells.shape
        return rows, cols

    @cached_property
    def free(self) -> Bools:
        """Mask of the free cells, (H, W)."""
        return np.asarray(self.cells == FREE)

    @cached_property
    def clearance(self) -> Floats:
        """Distance from each cell's centre to the nearest occupied cell's edge, (H, W) [m].

        Zero in occupied cells, infinite if the map has no occupied cell. Unknown space is no wall.
        """
        import cv2

        occupied = self.cells == OCCUPIED
        if not occupied.any():
            return np.full(self.shape, np.inf)
        # On a lattice of half cells both the centres and the nearest edge or corner of a
        # square are lattice positions, so that the transform gives the distance exactly.
        rows, cols = self.shape
        empty = np.ones((2 * rows + 1, 2 * cols + 1), np.uint8)
        empty[1::2, 1::2] = ~occupied
        empty = cv2.erode(empty, np.ones((3, 3), np.uint8), dst=empty)
        half_cells = cv2.distanceTransform(empty, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        del empty  # saves memory on a large map, as does working in place
        clearance = np.asarray(half_cells)[1::2, 1::2].astype(np.float64)
        del half_cells
        np.rint(np.square(clearance, out=clearance), out=clearance)
        return np.multiply(np.sqrt(clearance, out=clearance), self.resolution / 2, out=clearance)

    def cells_near_walls(self, distance: float) -> Bools:
        """Return the mask of the cells whose `clearance` is below a distance, (H, W).

        Short distances take a fraction of the clearance's time.

        Parameters
        ----------
        distance : float
            The distance [m]; none is closer than 0 or less.
        """
        import cv2

        if distance <= 0:
            return np.zeros(self.shape, bool)
        if "clearance" in vars(self) or distance > _SHORT * self.resolution:
            return np.asarray(self.clearance < distance)
        reach = math.ceil(distance / self.resolution + 0.5)
        offset = np.maximum(2 * np.abs(np.arange(-reach, reach + 1)) - 1, 0)  # to edges, in halves
        squared = (offset[:, None] ** 2 + offset**2).astype(np.float64)
        near = np.sqrt(squared) * (self.resolution / 2) < distance
        occupied = np.asarray(self.cells == OCCUPIED, np.uint8)
        return np.asarray(cv2.dilate(occupied, near.astype(np.uint8)) > 0)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of cells, resolution and origin: equal for equal maps, whatever their names."""
        content = hashlib.sha256(repr((self.shape, self.resolution, self.origin)).encode())
        content.update(self.cells.tobytes())
        return content.hexdigest()

    def world_to_grid(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
        """Convert world coordinates to continuous (row, col); a cell's centre ends in .5.

        Parameters
        ----------
        x, y : float or array
            World coordinates [m], of one shape (...); they may lie outside the map.

        Returns
        -------
        row, col : (...) arrays
            Position from the outer corner of cell (0, 0) [cells].
        """
        x0, y0, yaw = self.origin
        dx, dy = np.asarray(x, float) - x0, np.asarray(y, float) - y0
        cos, sin = math.cos(yaw), math.sin(yaw)
        return (cos * dy - sin * dx) / self.resolution, (cos * dx + sin * dy) / self.resolution

    def grid_to_world(self, row: ArrayLike, col: ArrayLike) -> tuple[Floats, Floats]:
        """Convert continuous (row, col) to world coordinates, the inverse of `world_to_grid`.

        Parameters
        ----------
        row, col : float or array
            Position from the outer corner of cell (0, 0) [cells], of one shape (...).

        Returns
        -------
        x, y : (...) arrays
            World coordinates [m].
        """
        x0, y0, yaw = self.origin
        u, v = np.asarray(col, float) * self.resolution, np.asarray(row, float) * self.resolution
        cos, sin = math.cos(yaw), math.sin(yaw)
        return x0 + cos * u - sin * v, y0 + sin * u + cos * v

    def cell(self, xy: ArrayLike) -> tuple[Any, Any]:
        """Return row and column of the cells at world positions, which may lie outside the grid.

        Parameters
        ----------
        xy : (n, 2) or (n, 3) array, or one (x, y) or (x, y, heading)
            Positions in the world [m]; headings do not count.

        Returns
        -------
        row, col : int, or (n,) arrays of int
            The cells, as an array of the map's shape is indexed.

        Raises
        ------
        PoseError
            If the positions have another shape, or are not finite numbers within 1e8 m.
        """
        positions, is_single = checks.parse_poses(xy)
        row, col = (np.floor(v).astype(np.int64) for v in self.world_to_grid(*positions[:, :2].T))
        return (int(row[0]), int(col[0])) if is_single else (row, col)

    @overload
    def position(self, row: int, col: int) -> tuple[float, float]: ...
    @overload
    def position(self, row: Ints, col: Ints) -> Floats: ...
    def position(self, row: Any, col: Any) -> Any:
        """Return the world positions of the centres of cells, the inverse of `cell`.

        Parameters
        ----------
        row, col : int, or (n,) arrays of int
            The cells, which may lie outside the grid.

        Returns
        -------
        (x, y), or (n, 2) array
            World coordinates [m].
        """
        x, y = self.grid_to_world(np.asarray(row) + 0.5, np.asarray(col) + 0.5)
        return np.column_stack([x, y]) if np.ndim(x) else (float(x), float(y))

    def crop(self, rows: slice, cols: slice) -> OccupancyGrid:
        """Return a part of the map, at the same place in the world.

        Parameters
        ----------
        rows, cols : slice
            Rows and columns, with starts and stops in the map and a step of 1.
        """
        x, y = map(float, self.grid_to_world(rows.start, cols.start))
        return replace(self, cells=self.cells[rows, cols], origin=(x, y, self.origin[2]))

    def contains(self, row: Any, col: Any) -> Any:
        """True if (row, col) is a cell of the grid; for arrays, an array of bool.

        Parameters
        ----------
        row, col : int, or arrays of int
            The cells, as of `cell`.
        """
        rows, cols = self.shape
        return (row >= 0) & (row < rows) & (col >= 0) & (col < cols)

    def figure(self) -> Figure:
        """Draw the map alone: walls black, unknown space grey, free space white."""
        from locplan.maps.figures import map_figure

        return map_figure(self)


def check_grid(grid: object) -> None:
    """Raise a ConfigError unless this is an occupancy grid.

    Parameters
    ----------
    grid : object
        The argument to check.
    """
    checks.check_instance("grid", grid, OccupancyGrid, "read a file with locplan.load_map")


def format_extent(grid: OccupancyGrid) -> str:
    """Return the lowest and the highest corner of a map in the world, such as 0,0 to 40,14 m.

    Parameters
    ----------
    grid : OccupancyGrid
        The map; a turned one covers less than the box between the corners.
    """
    rows, cols = grid.shape
    xs, ys = grid.grid_to_world([0, 0, rows, rows], [0, cols, 0, cols])
    low, high = ((f(xs), f(ys)) for f in (min, max))
    return f"{low[0]:.6g},{low[1]:.6g} to {high[0]:.6g},{high[1]:.6g} m"


def world_to_map_frame(grid: OccupancyGrid, poses: Floats) -> Floats:
    """Return poses along a map's columns and rows from its origin, (n, 3) [m, m, rad].

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    poses : (n, 3) array
        Poses x, y, heading in the world [m, m, rad].
    """
    rows, cols = grid.world_to_grid(*poses[:, :2].T)
    heading = poses[:, 2] - grid.origin[2]
    return np.column_stack([cols * grid.resolution, rows * grid.resolution, heading])
