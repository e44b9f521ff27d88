"""Where the robot can stand: positions moved there, and the floor of a large map in large cells."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from locplan._util.poses import window_around
from locplan.costs import Costmap
from locplan.errors import PoseError
from locplan.maps import FREE, UNKNOWN, OccupancyGrid
from locplan.planners import Position, connected_parts

if TYPE_CHECKING:
    from locplan.explorer._asks import Ask

FACTOR = 4
"""Number of cells of the map along a side of a coarse one."""
MAX_MOVE = 3.0
"""Greatest distance by which a position is moved [m]."""


@dataclass(frozen=True, eq=False)
class Parts:
    """The free cells of a costmap, and which of them are connected."""

    grid: OccupancyGrid
    """The map."""
    labels: NDArray[np.int32] | NDArray[np.uint16]
    """Number of the connected part that a cell belongs to, (H, W); 0 where it is blocked."""

    @classmethod
    def of(cls, costs: Costmap) -> Parts:
        """The parts where no corner may be cut."""
        count, labels = connected_parts(costs)
        fits = count <= np.iinfo(np.uint16).max
        return cls(costs.grid, labels.astype(np.uint16) if fits else labels)

    def label(self, xy: Position) -> int:
        """Number of the part at a world position [m], 0 in blocked cells and outside the map."""
        cell = self.grid.world_to_cell(*xy[:2])
        return int(self.labels[cell]) if self.grid.contains(*cell) else 0

    def nearest(self, xy: Position, label: int = 0) -> Position | None:
        """Centre of the nearest free cell within `MAX_MOVE`, of one part or of any [m]."""
        grid = self.grid
        row, col = (float(v) for v in grid.world_to_grid(*xy[:2]))
        reach = MAX_MOVE / grid.resolution
        window = window_around(row, col, reach, grid.shape)
        labels = self.labels[window]
        rows, cols = np.nonzero(labels == label if label else labels > 0)
        if not rows.size:
            return None
        rows, cols = rows + window[0].start, cols + window[1].start
        squared = (rows + 0.5 - row) ** 2 + (cols + 0.5 - col) ** 2
        at = int(np.argmin(squared))
        if squared[at] > reach**2:
            return None
        return grid.cell_to_world(int(rows[at]), int(cols[at]))


def snapped(parts: Parts, stops: Sequence[Position], held: int | None = None) -> list[Position]:
    """The stops of a path, each of them moved into a free cell where it is in none.

    Cells of the part that the other stops are in are preferred: the first of them that is free
    decides, and the one that is held last of all.

    Raises
    ------
    PoseError
        If there is no free cell near a stop.
    """
    order = [n for n in range(len(stops)) if n != held] + ([] if held is None else [held])
    part = next((label for n in order if (label := parts.label(stops[n]))), 0)
    found = list(stops)
    for n in order:
        xy = stops[n]
        if parts.label(xy):
            continue
        near = (parts.nearest(xy, part) if part else None) or parts.nearest(xy)
        if near is None:
            role = {len(stops) - 1: "the goal", 0: "the start"}.get(n, f"waypoint {n}")
            raise PoseError(
                f"{role} {xy[0]:.2f},{xy[1]:.2f} has no free cell within"
                f" {MAX_MOVE:g} m; put it where the robot can stand"
            )
        found[n] = near
        part = part or parts.label(near)
    return found


def stops_of(ask: Ask, parts: Parts) -> tuple[list[Position], int | None]:
    """Stops of a question, moved to where the robot can stand, and which of them is held."""
    stops = [ask.position("start"), *ask.positions("via"), ask.position("goal")]
    names = ["start", *(f"via:{k}" for k in range(len(stops) - 2)), "goal"]
    hold = ask.one_of("hold", ["", *names], "")
    held = names.index(hold) if hold else None
    return snapped(parts, stops, held), held


@dataclass(frozen=True, eq=False)
class Floor:
    """The floor that a robot can stand on, in larger cells."""

    grid: OccupancyGrid
    """The map: free where at least half of a cell's floor is."""
    u: NDArray[np.float64]
    """Mean degeneracy of the floor in each cell, (h, w); 0 without a field."""

    @classmethod
    def of(cls, fine: Costmap, factor: int = FACTOR) -> Floor:
        """The floor of a costmap, in blocks of its cells."""
        shape = -(-fine.grid.shape[0] // factor), -(-fine.grid.shape[1] // factor)
        total, count = np.zeros(shape), np.zeros(shape, np.uint8)
        for row, col in itertools.product(range(factor), repeat=2):  # no copy of the whole map
            some = slice(row, None, factor), slice(col, None, factor)
            free, u = np.isfinite(fine.density[some]), fine.u[some]
            at = slice(0, free.shape[0]), slice(0, free.shape[1])
            total[at] += np.where(free & ~np.isnan(u), u, 0.0)
            count[at] += free
        free = count >= factor * factor / 2
        cells = np.where(free, FREE, UNKNOWN).astype(np.uint8)
        grid = OccupancyGrid(cells, fine.grid.resolution * factor, fine.grid.origin)
        return cls(grid, total / np.maximum(count, 1))
