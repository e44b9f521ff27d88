"""Built-in maps: the paper's kinds of places, and larger plans to drive through."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from locplan._support.checks import check_choice, check_integer, check_number
from locplan._support.kernels.arrays import Bools
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE, OCCUPIED, UNKNOWN

BUILT_IN = ("places", "hall", "two_corridors", "office", "warehouse")
"""Names of the built-in maps."""


def is_built_in(path: Path) -> bool:
    """True if a path is the name of a built-in map, and no file or folder has this name.

    Parameters
    ----------
    path : Path
        The path, as the user wrote it.
    """
    return str(path) in BUILT_IN and not os.path.lexists(path)


def suggest_built_in_map(name: str) -> str:
    """Return the remedy for a name that no built-in map has.

    Parameters
    ----------
    name : str
        The name.
    """
    if similar := get_close_matches(name, BUILT_IN, 1):
        return f"did you mean {similar[0]}? The built-in maps are {', '.join(BUILT_IN)}"
    return f"give a map's YAML file, or a built-in map: {', '.join(BUILT_IN)}"


_FINEST, _COARSEST = 0.01, 0.1  # limits of the resolution at which plans keep their walls [m]
_WALL = 0.1  # thickness of the walls [m]
_MARGIN = 0.6  # from the drawing to the grid's edge [m]: the wall, and 0.5 m of unknown
_GAP = 0.6  # least gap between pieces of furniture, so that a robot can pass [m]

_Shape = tuple[str, list[float]]


@cache
def _read_plan(name: str) -> tuple[list[_Shape], dict[str, tuple[float, float]]]:
    """Read the shapes of a plan in drawing order, and its named places."""
    shapes: list[_Shape] = []
    places: dict[str, tuple[float, float]] = {}
    text = Path(__file__).with_name("plans").joinpath(f"{name}.txt").read_text("utf-8")
    for line in text.splitlines():
        word, *arguments = line.split(maxsplit=1)
        for part in arguments[0].split(",") if word != "#" else ():
            if word == "place":
                place, x, y = part.split()
                places[place] = float(x), float(y)
            else:
                shapes.append((word, [*map(float, part.split())]))
    return shapes, places


def list_environments() -> tuple[str, ...]:
    """Return the names of the environments that `make` draws."""
    return BUILT_IN


def place_positions(name: str) -> dict[str, tuple[float, float]]:
    """Return the world positions x, y [m] of the named places of an environment.

    They lie in free space, at least 0.25 m from any wall, and all are reachable from one another at
    that clearance.

    Parameters
    ----------
    name : str
        One of `names`.

    Returns
    -------
    dict of str to (x, y)
        Positions [m] by name, such as "start" and "goal".

    Raises
    ------
    ConfigError
        If the name is unknown.

    Examples
    --------
    >>> place_positions("two_corridors")["goal"]
    (38.0, 3.0)
    """
    check_choice("the environment", name, BUILT_IN)
    return dict(_read_plan(name)[1])


def make(
    name: str, *, resolution: float = 0.05, boundary_noise: float = 0.0, seed: int = 0
) -> OccupancyGrid:
    """Draw an environment: the same arguments always give the same map.

    Its walls are 0.1 m thick, and everything behind them is unknown.

    Parameters
    ----------
    name : str
        "places": a complex room A, a straight corridor B, a round room C and a corridor D that
        repeats every 1.6 m. "hall": a hall E of 42 m x 32 m next to small rooms F. "two_corridors":
        two rooms joined by a short featureless corridor and by a longer irregular one. "office" and
        "warehouse": larger plans.
    resolution : float, default 0.05
        Edge of a cell [m], 0.01 to 0.1; coarse cells are quicker to compute with.
    boundary_noise : float, default 0.0
        Share of the boundary cells to flip, 0 to 1, as `with_boundary_noise` does; 0 leaves the
        walls as they are drawn.
    seed : int, default 0
        Seed of that noise, not negative. The drawing does not depend on it.

    Raises
    ------
    ConfigError
        If the name is unknown or a value is out of its range.

    Examples
    --------
    >>> grid = make("two_corridors", resolution=0.1)
    >>> grid.shape, grid.name
    ((158, 412), 'two_corridors')
    """
    check_choice("the environment", name, BUILT_IN)
    check_number("resolution", resolution, _FINEST, _COARSEST)
    (_, size), *shapes = _read_plan(name)[0]
    canvas = _Canvas(size, resolution)
    for word, numbers in shapes:
        getattr(canvas, word)(*numbers)
    return with_boundary_noise(canvas.grid(name), boundary_noise, seed=seed)


def with_boundary_noise(grid: OccupancyGrid, fraction: float, *, seed: int = 0) -> OccupancyGrid:
    """Flip some of the cells where free space meets walls, as mapping errors do.

    Parameters
    ----------
    grid : OccupancyGrid
        The map to disturb; it is left as it is, and the new one has its place and name.
    fraction : float
        Probability with which each boundary cell flips, 0 to 1. A boundary cell is an occupied
        one with a free 4-neighbour (it becomes free) or the reverse (it becomes occupied).
    seed : int, default 0
        Seed of the choice, not negative.

    Raises
    ------
    ConfigError
        If the fraction or the seed is out of its range.
    """
    check_number("boundary_noise", fraction, 0, 1)
    check_integer("seed", seed, 0)
    occupied, flip = grid.cells == OCCUPIED, boundary_cells(grid)
    random = np.random.default_rng(seed)
    for row in flip:  # row by row, which saves memory on a large map
        row &= random.random(row.size) < fraction
    cells = grid.cells.copy()
    cells[flip & occupied], cells[flip & ~occupied] = FREE, OCCUPIED
    return replace(grid, cells=cells)


def boundary_cells(grid: OccupancyGrid) -> Bools:
    """Mark occupied cells with a free 4-neighbour, and free ones with an occupied one, (H, W).

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    """
    occupied, free = grid.cells == OCCUPIED, grid.free
    return np.asarray((occupied & _mark_neighbours(free)) | (free & _mark_neighbours(occupied)))


def _mark_neighbours(mask: Bools) -> Bools:
    """Mark the cells with a 4-neighbour in the mask."""
    neighbours = np.zeros_like(mask)
    neighbours[1:] |= mask[:-1]
    neighbours[:-1] |= mask[1:]
    neighbours[:, 1:] |= mask[:, :-1]
    neighbours[:, :-1] |= mask[:, 1:]
    return neighbours


class _Canvas:
    """Free space carved out of the unknown, in world metres; its walls appear at the end.

    Its methods are the words of the plans in `plans/`; boxes are x0, y0, x1, y1 [m].
    Edges belong on multiples of 0.1 m, which all the usual resolutions represent exactly.
    """

    def __init__(self, size: Sequence[float], resolution: float) -> None:
        self.resolution = resolution
        width, height = (math.ceil((v + 2 * _MARGIN) / resolution - 1e-6) for v in size)
        # Slightly off the cells' centres, so that rounding never decides where an edge falls.
        self._x = (np.arange(width) + 0.5) * resolution - _MARGIN + 1e-7
        self._y = (np.arange(height) + 0.5) * resolution - _MARGIN + 1e-7
        self._free = np.zeros((height, width), bool)
        self._keep_out: list[tuple[float, ...]] = []

    def _box_slices(self, x0: float, y0: float, x1: float, y1: float) -> tuple[slice, slice]:
        """Return the rows and columns of a box."""
        return (
            slice(*np.searchsorted(self._y, (y0, y1)).tolist()),
            slice(*np.searchsorted(self._x, (x0, x1)).tolist()),
        )

    def carve(self, *box: float) -> None:
        """Make a box free."""
        self._free[self._box_slices(*box)] = True

    def door(self, *box: float) -> None:
        """Make a box free, and keep furniture away from it."""
        self.carve(*box)
        self._keep_out.append(box)

    def block(self, *box: float) -> None:
        """Put an obstacle into free space."""
        self._free[self._box_slices(*box)] = False
        self._keep_out.append(box)

    def disc(self, x: float, y: float, radius: float, *, free: bool = True) -> None:
        """Carve a round room."""
        window = self._box_slices(x - radius, y - radius, x + radius, y + radius)
        dx, dy = self._x[window[1]] - x, self._y[window[0], None] - y
        self._free[window][dx * dx + dy * dy < radius * radius] = free

    def pillar(self, x: float, y: float, radius: float) -> None:
        """Put a round pillar into free space."""
        self.disc(x, y, radius, free=False)
        self._keep_out.append((x - radius, y - radius, x + radius, y + radius))

    def polygon(self, *places: float) -> None:
        """Put a polygonal obstacle into free space; its corners are x, y in turn."""
        xs, ys = places[::2], places[1::2]
        corners = [*zip(xs, ys, strict=True)]
        box = (min(xs), min(ys), max(xs), max(ys))
        window = self._box_slices(*box)
        x, y = self._x[window[1]], self._y[window[0], None]
        inside = np.zeros((y.size, x.size), bool)
        for (xa, ya), (xb, yb) in pairwise([*corners, corners[0]]):
            if ya != yb:  # a level edge crosses no ray along x
                inside ^= ((ya > y) != (yb > y)) & (x < xa + (y - ya) * (xb - xa) / (yb - ya))
        self._free[window][inside] = False
        self._keep_out.append(box)

    def seed(self, seed: float) -> None:
        """Set the seed of the random furniture."""
        self._random = np.random.default_rng(int(seed))

    def room(self, *room: float) -> None:
        """Carve a box and put furniture into it, see `furnish`."""
        self.carve(*room[:4])
        self.furnish(*room)

    def furnish(self, *room: float) -> None:
        """Put furniture into a room: its box, the maximum number of pieces and their size.

        Pieces are of 0.3 m to the size [m]. Positions depend on the seed alone, not on the
        resolution.
        """
        x0, y0, x1, y1, left, largest = room
        rng = self._random
        for _ in range(30 * int(left)):
            w, h = (int(v) / 10 for v in rng.integers(3, round(10 * largest) + 1, 2))
            x, y = _draw_coordinate(rng, x0, x1 - w), _draw_coordinate(rng, y0, y1 - h)
            wide = (x - _GAP, y - _GAP, x + w + _GAP, y + h + _GAP)
            # A piece stands at a wall or clear of it, and clear of all else: nothing is closed off.
            gaps = (x - x0, y - y0, x1 - x - w, y1 - y - h)
            blocked = any(1e-6 < gap < _GAP - 1e-6 for gap in gaps) or min(gaps) < -1e-6
            if not blocked and not any(_boxes_overlap(wide, other) for other in self._keep_out):
                self.block(x, y, x + w, y + h)
                left -= 1
                if left == 0:
                    return

    def grid(self, name: str) -> OccupancyGrid:
        """Put walls around the free space and leave the rest unknown, as in a SLAM map."""
        import cv2

        solid = (~self._free).astype(np.uint8)
        depth = np.asarray(cv2.distanceTransform(solid, cv2.DIST_L2, cv2.DIST_MASK_PRECISE))
        # Walls hold at least the eight neighbours, or else they would leak at their corners.
        wall = depth <= max(_WALL / self.resolution, 1.5) + 0.01
        cells = np.where(self._free, FREE, np.where(wall, OCCUPIED, UNKNOWN)).astype(np.uint8)
        return OccupancyGrid(cells, self.resolution, (-_MARGIN, -_MARGIN, 0.0), name)


def _draw_coordinate(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a position at random: an end, or one between them on a lattice of 0.1 m."""
    end, step = int(rng.integers(4)), int(rng.integers(max(round(10 * (high - low)), 0) + 1))
    return (low, high, low + step / 10, low + step / 10)[end]


def _boxes_overlap(a: Sequence[float], b: Sequence[float]) -> bool:
    """True if two boxes are closer than the gap that a robot needs."""
    return a[0] < b[2] - 1e-6 and b[0] < a[2] - 1e-6 and a[1] < b[3] - 1e-6 and b[1] < a[3] - 1e-6
