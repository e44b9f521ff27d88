"""Objects that serve as landmarks: their shape, and the cells that they fill."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from locplan._support.checks import (
    Settings,
    check_number,
    check_positive,
    short_repr,
)
from locplan._support.kernels.arrays import Floats, Ints
from locplan._support.poses import find_window
from locplan.errors import ConfigError
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.occupancy import OCCUPIED


class ObjectShape(NamedTuple):
    """The shape of an object: a disc or a rectangle."""

    half_length: float
    """Half the extent along the heading, or the radius [m]."""
    half_width: float
    """Half the extent across the heading, or the radius [m]."""
    is_round: bool
    """True for a disc."""

    @property
    def outer_radius(self) -> float:
        """Maximum distance of a point of the shape from its centre [m]."""
        return self.half_length if self.is_round else math.hypot(self.half_length, self.half_width)

    def compute_distance(self, x: Any, y: Any, heading: float = 0.0) -> Floats:
        """Return the distance from points to a shape at the origin; 0 inside [m].

        Parameters
        ----------
        x, y : array
            The points, broadcast together [m].
        heading : float, default 0.0
            Heading of the shape, counter-clockwise from the x axis [rad].
        """
        if self.is_round:
            return np.asarray(np.maximum(np.hypot(x, y) - self.half_length, 0.0))
        cos, sin = math.cos(heading), math.sin(heading)
        along = np.abs(cos * x + sin * y) - self.half_length
        across = np.abs(cos * y - sin * x) - self.half_width
        return np.asarray(np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0)))

    def compute_window_distances(
        self, grid: OccupancyGrid, pose: Floats, margin: float
    ) -> tuple[tuple[slice, slice], Floats]:
        """Return the window of a map around a shape, and the distances of its cell centres [m].

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        pose : (3,) array
            Row, column and heading of the shape on the map [cells, cells, rad].
        margin : float
            Distance from the shape within which all cells lie in the window [m].
        """
        row, col, heading = pose.tolist()
        reach = math.ceil((self.outer_radius + margin) / grid.resolution) + 1
        rows, cols = window = find_window(row, col, reach, grid.shape)
        y = (np.arange(rows.start, rows.stop)[:, None] + 0.5 - row) * grid.resolution
        x = (np.arange(cols.start, cols.stop) + 0.5 - col) * grid.resolution
        return window, self.compute_distance(x, y, heading)


class LandmarkObject(Settings):
    """An object that can be a landmark: a dataclass of one size, or of a length and a width."""

    word: ClassVar[str]
    """Its kind in files and on the command line."""

    def __post_init__(self) -> None:
        for name, size in vars(self).items():
            object.__setattr__(self, name, _check_size(name, size))

    @property
    def _sizes(self) -> tuple[float, ...]:
        return tuple(vars(self).values())

    @property
    def title(self) -> str:
        """Kind and size, for tables."""
        return f"{self.word} of {' x '.join(f'{size:g}' for size in self._sizes)} m"

    @property
    def shape(self) -> ObjectShape:
        """The outline as the kernels take it."""
        sizes = self._sizes
        return ObjectShape(sizes[0] / 2, sizes[-1] / 2, is_round=len(sizes) == 1)


@dataclass(frozen=True, repr=False)
class Pole(LandmarkObject):
    """A round post.

    Raises
    ------
    ConfigError
        If the diameter is not above 0 and at most 100 m.

    Examples
    --------
    >>> Pole(diameter=0.1).title
    'pole of 0.1 m'
    """

    word: ClassVar[str] = "pole"
    diameter: float = 0.2
    """Diameter, above 0 and at most 100 [m]."""


@dataclass(frozen=True, repr=False)
class Box(LandmarkObject):
    """A rectangular object such as a box, a cabinet or a board.

    Raises
    ------
    ConfigError
        If a side is not above 0 and at most 100 m.

    Examples
    --------
    >>> Box(1.2, 0.1).title
    'box of 1.2 x 0.1 m'
    """

    word: ClassVar[str] = "box"
    length: float = 0.6
    """Extent along its heading (at a wall, the wall's direction), at most 100 [m]."""
    width: float = 0.3
    """Extent across its heading, at most 100 [m]."""


def check_object(kind: object) -> None:
    """Raise a ConfigError unless this is an object that can be a landmark."""
    if not isinstance(kind, LandmarkObject):
        raise ConfigError(f"the object must be a Pole or a Box, not {short_repr(kind)}")


def parse_object(text: str) -> LandmarkObject:
    """Parse an object such as pole:0.2 or box:0.6,0.3.

    Parameters
    ----------
    text : str
        Kind and sizes [m], see above.

    Returns
    -------
    Pole or Box
        The object.

    Raises
    ------
    ConfigError
        If the text is not an object.

    Examples
    --------
    >>> parse_object("box:0.6,0.3").title
    'box of 0.6 x 0.3 m'
    """
    word, _, sizes = text.partition(":")
    with contextlib.suppress(ValueError):
        values = [float(size) for size in sizes.split(",")] if sizes else []
        for kind, numbers in ((Pole, (0, 1)), (Box, (0, 2))):
            if word == kind.word and len(values) in numbers:
                return kind(*values)
    raise ConfigError(
        "the object must be pole:DIAMETER or box:LENGTH,WIDTH in metres, such as pole:0.2 or"
        f" box:0.6,0.3, not {short_repr(text)}"
    )


def mark_objects(grid: OccupancyGrid, kind: LandmarkObject, poses: Iterable[Any]) -> OccupancyGrid:
    """Return a copy of a map with equal objects in it.

    An object fills the cells whose centre lies inside. An object narrower than two cells also fills
    the cells that its outline crosses, so that a thin board neither vanishes nor has gaps.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    kind : Pole or Box
        The object.
    poses : iterable of (x, y) or (x, y, heading)
        Centres in the world, and headings counter-clockwise from the x axis [m, m, rad]. Parts
        outside the map are ignored.

    Returns
    -------
    OccupancyGrid
        The new map; the given one stays as it is.

    Raises
    ------
    ConfigError
        If the object or a pose is not valid.

    Examples
    --------
    >>> from locplan.maps import FREE
    >>> grid = OccupancyGrid(np.full((6, 8), FREE, np.uint8), resolution=0.1)
    >>> mark_objects(grid, Box(0.4, 0.2), [(0.4, 0.3)]).cells[::-1] // FREE
    array([[1, 1, 1, 1, 1, 1, 1, 1],
           [1, 1, 1, 1, 1, 1, 1, 1],
           [1, 1, 0, 0, 0, 0, 1, 1],
           [1, 1, 0, 0, 0, 0, 1, 1],
           [1, 1, 1, 1, 1, 1, 1, 1],
           [1, 1, 1, 1, 1, 1, 1, 1]], dtype=uint8)
    """
    check_grid(grid)
    check_object(kind)
    cells = grid.cells.copy()
    for pose in parse_object_poses(poses):
        cells[find_covered_cells(grid, kind, pose)] = OCCUPIED
    return dataclasses.replace(grid, cells=cells)


def find_covered_cells(
    grid: OccupancyGrid, kind: LandmarkObject, pose: Floats
) -> tuple[Ints, Ints]:
    """Return rows and columns of the cells that an object fills, see `mark_objects`.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    kind : Pole or Box
        The object.
    pose : (3,) array
        Its centre in the world, and its heading [m, m, rad].
    """
    return find_filled_cells(grid, kind.shape, map_poses_from_world(grid, pose[None])[0])


def parse_object_poses(poses: Iterable[Any]) -> Floats:
    """Return poses (x, y) or (x, y, heading) as an array (n, 3) [m, m, rad]."""
    rows = []
    for pose in poses:
        try:
            values = [float(value) for value in pose]
        except (TypeError, ValueError):
            values = []
        if len(values) not in (2, 3) or not np.isfinite(values).all():
            raise ConfigError(
                f"a landmark must be (x, y) or (x, y, heading), not {short_repr(pose)}"
            )
        rows.append([*values, 0.0][:3])
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def map_poses_from_world(grid: OccupancyGrid, poses: Floats) -> Floats:
    """Return poses in the world as (row, col, heading) on the map [cells, cells, rad]."""
    rows, cols = grid.world_to_grid(poses[:, 0], poses[:, 1])
    return np.column_stack([rows, cols, poses[:, 2] - grid.origin[2]])


def find_filled_cells(grid: OccupancyGrid, shape: ObjectShape, pose: Floats) -> tuple[Ints, Ints]:
    """Return rows and columns of the cells that a shape fills, see `mark_objects`.

    `pose` is (row, col, heading) on the map, its heading from the columns' to the rows' axis.
    """
    (rows, cols), distances = shape.compute_window_distances(grid, pose, 0.0)
    filled, resolution = distances <= 1e-9, grid.resolution
    # Width of an object up to which the cells that its outline meets are filled, too [cells].
    if 2 * min(shape.half_length, shape.half_width) < 2.0 * resolution:
        at = _sample_outline(shape, float(pose[2]), resolution / 8) / resolution + pose[1::-1]
        at_row, at_col = np.floor(at[:, 1]).astype(int), np.floor(at[:, 0]).astype(int)
        inside = (at_row >= rows.start) & (at_row < rows.stop)
        inside &= (at_col >= cols.start) & (at_col < cols.stop)
        filled[at_row[inside] - rows.start, at_col[inside] - cols.start] = True
    filled_rows, filled_cols = np.nonzero(filled)
    return filled_rows + rows.start, filled_cols + cols.start


def compute_outline_points(shape: ObjectShape, pose: Floats, n_disc_points: int = 24) -> Floats:
    """Return the corners of a shape at a pose, or points around a disc, (n, 2) [m]."""
    if shape.is_round:
        angle = np.linspace(0, 2 * math.pi, n_disc_points, endpoint=False)
        return pose[:2] + shape.half_length * np.column_stack([np.cos(angle), np.sin(angle)])
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    corners = signs * (shape.half_length, shape.half_width)
    return np.asarray(pose[:2] + corners @ np.array([(cos, sin), (-sin, cos)]))


def _sample_outline(shape: ObjectShape, heading: float, step: float) -> Floats:
    """Return points along the outline of a shape at the origin, at most `step` apart [m]."""
    origin = np.array([0.0, 0.0, heading])
    if shape.is_round:
        return compute_outline_points(
            shape, origin, math.ceil(2 * math.pi * shape.half_length / step)
        )
    corners = compute_outline_points(shape, origin)
    sides = []
    for corner, next_corner in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = math.ceil(float(np.hypot(*(next_corner - corner))) / step)
        sides.append(
            corner + np.linspace(0, 1, count, endpoint=False)[:, None] * (next_corner - corner)
        )
    return np.concatenate(sides)


def _check_size(name: str, value: object) -> float:
    # Greatest length of an object [m].
    return check_number(name, check_positive(name, value, "m"), 0.0, 100.0)
