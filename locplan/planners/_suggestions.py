"""Places far apart in a room, for a start and a goal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap
from locplan.maps import FREE, UNKNOWN, OccupancyGrid
from locplan.planners._cost_to_go import plan_field

SEARCHED = 1_000_000
"""Most cells of the grid on which distances are measured; larger rooms are coarsened to it."""
CLEAR = 0.5
"""Distance from the robot to what it must not touch that a place has where the room allows [m]."""
LEEWAY = 0.05
"""Share of the greatest distance that a place may give up to stand clear."""
SPACING = 0.2
"""Least distance of a further place from those before, as a share of the first pair's."""


@dataclass(frozen=True)
class NamedPlace:
    """A place that suits as a start or a goal."""

    name: str
    """Name: A, B, C and so on."""
    x: float
    """World x [m], rounded as far as the place stays in its room."""
    y: float
    """World y [m], rounded likewise."""
    room: int
    """Number of the room, from 1 on."""

    @property
    def xy(self) -> str:
        """The position as the command line takes it [m]."""
        return f"{self.x!r},{self.y!r}"


@dataclass(frozen=True)
class PlacePair:
    """Two places of one room."""

    start: NamedPlace
    """One place."""
    goal: NamedPlace
    """The other."""
    distance: float
    """Length of the shortest path on the grid [m]."""


def farthest_pairs(
    grid: OccupancyGrid,
    room_of_cell: NDArray[np.int32],
    room: int,
    names: Sequence[str],
    least: float,
) -> list[PlacePair]:
    """Pairs of the places in a room that are farthest apart by path length, the farthest first.

    Every further place is the farthest from those before, and is paired with the one of them that
    is farthest from it. Distances are within a few cells, in a room of more than `SEARCHED` cells
    within a few of the coarser ones.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    room_of_cell : (H, W) array of int32
        Number of the room that each cell belongs to.
    room : int
        Number of the room.
    names : sequence of str
        Names of the places, as many as are wanted; fewer are found where the room is small.
    least : float
        Least distance of any two places [m].
    """
    searched = _Room(grid, room_of_cell, room)
    chosen = [searched.farthest(searched.distance(searched.deepest))]
    distances = [searched.distance(chosen[0])]
    while len(chosen) < len(names):
        nearest = np.minimum.reduce(distances)
        place = searched.farthest(nearest)
        spacing = SPACING * distances[0][chosen[1]] if len(chosen) > 1 else 0.0
        if nearest[place] <= max(least, spacing):
            break
        chosen.append(place)
        distances.append(searched.distance(place))
    ends = sorted(chosen[:2], key=searched.position)  # A is the left one of the first pair
    order = [*ends, *chosen[2:]]
    from_places = [distances[chosen.index(place)] for place in order]
    places = [
        NamedPlace(name, *searched.position(place), room)
        for name, place in zip(names, order, strict=False)
    ]
    pairs = []
    for n, place in enumerate(order[1:], 1):
        before = max(range(n), key=lambda k: float(from_places[k][place]))
        pairs.append(PlacePair(places[before], places[n], float(from_places[before][place])))
    return pairs


class _Room:
    """A room on a grid that is coarse enough to measure distances on quickly.

    Its cells are counted row by row; a coarse cell is free if any of its cells is in the room.
    """

    def __init__(self, grid: OccupancyGrid, room_of_cell: NDArray[np.int32], room: int) -> None:
        import cv2

        self._grid, self._room_of_cell, self._room = grid, room_of_cell, room
        inside = room_of_cell == room
        (top, bottom), (left, right) = (
            np.flatnonzero(inside.any(axis=axis))[[0, -1]].tolist() for axis in (1, 0)
        )
        rows, cols = bottom + 1 - top, right + 1 - left
        factor = math.ceil(math.sqrt(rows * cols / SEARCHED))
        self._top, self._left, self._factor = top, left, factor
        size = -(-rows // factor) * factor, -(-cols // factor) * factor
        own = np.zeros((size[0] + 2, size[1] + 2), np.uint8)  # with a border, which is outside
        own[1 : rows + 1, 1 : cols + 1] = inside[top : bottom + 1, left : right + 1]
        depth = np.asarray(cv2.distanceTransform(own, cv2.DIST_L2, cv2.DIST_MASK_5))[1:-1, 1:-1]
        coarse = size[0] // factor, size[1] // factor
        self._blocks = depth.reshape(coarse[0], factor, coarse[1], factor).swapaxes(1, 2)
        self._depth = self._blocks.max(axis=(2, 3)).ravel() * grid.resolution
        free = self._depth > 0
        cells = np.where(free, FREE, UNKNOWN).astype(np.uint8).reshape(coarse)
        edge = grid.resolution * factor
        self._costs = Costmap.blank(OccupancyGrid(cells, edge), robot_radius=0.0)
        self._clear = self._depth >= min(float(np.median(self._depth[free])), CLEAR)
        self.deepest = int(self._depth.argmax())

    def distance(self, place: int) -> NDArray[np.float64]:
        """Length of the shortest path from a cell to each other, flat [m]."""
        row, col = divmod(place, self._costs.grid.shape[1])
        xy = self._costs.grid.cell_to_world(row, col)
        return plan_field(self._costs, xy).cost.ravel()

    def farthest(self, distance: NDArray[np.float64]) -> int:
        """The clearest of the cells that are almost as far as the farthest clear one."""
        reached = np.where(self._clear, distance, -1.0)
        far = np.flatnonzero(reached >= (1 - LEEWAY) * reached.max())
        return int(far[np.lexsort((-reached[far], -self._depth[far]))[0]])

    def position(self, place: int) -> tuple[float, float]:
        """World x, y [m] of the deepest cell of a coarse one, rounded if it stays in the room."""
        row, col = divmod(place, self._costs.grid.shape[1])
        deep_row, deep_col = divmod(int(self._blocks[row, col].argmax()), self._factor)
        row = self._top + row * self._factor + deep_row
        col = self._left + col * self._factor + deep_col
        x, y = self._grid.cell_to_world(row, col)
        for decimals in range(1, 6):
            rounded = round(x, decimals) + 0.0, round(y, decimals) + 0.0
            cell = self._grid.world_to_cell(rounded)
            if self._grid.contains(*cell) and self._room_of_cell[cell] == self._room:
                return rounded
        return x, y
