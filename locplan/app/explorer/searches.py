"""Searches for paths over several stops, which are kept between plans, up to a number of bytes."""

from __future__ import annotations

import dataclasses
import itertools
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from locplan._support.kernels.arrays import Ints, Octets
from locplan._support.poses import window_around
from locplan.app.explorer.scene import Scene
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE
from locplan.planning.any_angle import AnyAngle, any_angle_path
from locplan.planning.costmap import Costmap
from locplan.planning.grid import Bordered, bordered_index
from locplan.planning.path import Path
from locplan.planning.protocol import Position

Result = TypeVar("Result")
Check = Callable[[], None]
"""Function that raises where a plan is not wanted any more."""


class Kept:
    """Results by key; the least recently used ones go when all take too many bytes."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.bytes = 0
        self._lock = threading.Lock()
        self._results: OrderedDict[Hashable, tuple[Any, int]] = OrderedDict()

    @property
    def keys(self) -> list[Any]:
        """Keys of all results, the least recently used one first."""
        with self._lock:
            return list(self._results)

    def get(self, key: Hashable) -> Any:
        """The result of a key, which is now the most recently used one; None without it."""
        with self._lock:
            if key not in self._results:
                return None
            self._results.move_to_end(key)
            return self._results[key][0]

    def put(self, key: Hashable, result: Result, size: int) -> Result:
        """Keep a result of so many bytes, and return it; the last one is kept whatever its size."""
        with self._lock:
            self._drop([key])
            self._results[key] = result, size
            self.bytes += size
            self._shrink(self.limit, 1)
        return result

    def made(
        self,
        key: Hashable,
        make: Callable[[], Result],
        size: Callable[[Result], int],
        expected: int = 0,
    ) -> Result:
        """The result of a key, made if it is not kept.

        Room for the bytes that are expected is made before, so that they do not come on top. The
        two results that were used last stay: others may be made of them.
        """
        found: Result | None = self.get(key)
        if found is not None:
            return found
        with self._lock:
            self._shrink(self.limit - expected, 2)
        result = make()
        return self.put(key, result, size(result))

    def forget(self, unless: Callable[[Any], bool] = lambda key: False) -> None:
        """Drop the results whose keys do not fulfil a condition; without one, all."""
        with self._lock:
            self._drop([key for key in self._results if not unless(key)])

    def _shrink(self, limit: float, min_count: int) -> None:
        """Drop the least recently used results beyond a limit, but keep the last ones."""
        while self.bytes > limit and len(self._results) > min_count:
            self._drop([next(iter(self._results))])

    def _drop(self, keys: Sequence[Hashable]) -> None:
        for key in keys:
            self.bytes -= self._results.pop(key, (None, 0))[1]


@dataclass(frozen=True, eq=False)
class Searched:
    """A costmap, and the same as the searches take it."""

    costs: Costmap
    """The costmap."""
    bordered: Bordered
    """Its density with a border of blocked cells."""

    @classmethod
    def halved(cls, costs: Costmap) -> Searched:
        """A costmap at half of its cost, which shares its memory with what the searches take.

        The same path is the cheapest, and twice its cost is exactly that on the whole costmap.
        """
        bordered = Bordered.of(costs)
        inner = bordered.half.reshape(-1, bordered.columns)[1:-1, 1:-1]
        inner.setflags(write=False)
        return cls(dataclasses.replace(costs, density=inner), bordered)

    def index_of(self, xy: Position) -> int:
        """Index in the bordered grid of the cell at a world position [m]."""
        return bordered_index(self.costs, xy, "position")

    def free_near(self, xy: Position) -> Position | None:
        """The position, or the centre of a free cell near it; None where there is none [m]."""
        grid, density = self.costs.grid, self.costs.density
        row, col = grid.cell(xy[:2])
        if grid.contains(row, col) and np.isfinite(density[row, col]):
            return xy
        # A free place has a cell at most two away that is free for its greater part.
        window = window_around(row, col, 2, grid.shape)
        near = np.argwhere(np.isfinite(density[window])) + [each.start for each in window]
        if not len(near):
            return None
        squared = ((near - (row, col)) ** 2).sum(axis=1)
        row, col = near[squared.argmin()]
        return grid.position(int(row), int(col))


@dataclass(frozen=True, eq=False)
class Flood:
    """The cheapest ways from one end to every cell, in a byte a cell.

    The costmap that was searched is given anew for each path: held here, its eight bytes a cell
    would outlast it where it is no longer kept.
    """

    source: int
    """Index of the end's cell in the bordered grid."""
    steps: Octets
    """Steps back to the end on cheapest ways, flat with the border: a bit for each neighbour."""

    @classmethod
    def of(cls, bordered: Bordered, source: int, check: Check | None = None) -> Flood:
        """Search all that can be reached from a cell; what `check` raises ends that early."""
        from locplan._support.kernels.search import search
        from locplan._support.kernels.ways import steps_back, tolerance_of

        half, columns, scale = bordered.half, bordered.columns, bordered.scale
        cost = search(half, columns, source, -1, False, scale, check=check).cost
        tolerance = tolerance_of(cost, scale.cheapest)
        return cls(source, steps_back(half, columns, cost, tolerance))

    @classmethod
    def prepare(cls) -> None:
        """Compile the kernels, so that the first drag does not wait for that."""
        costs = Costmap.blank(OccupancyGrid(np.full((1, 3), FREE), 1.0))
        searched = Searched(costs, Bordered.of(costs))
        first, last = (searched.index_of((x, 0.5)) for x in (0.5, 2.5))
        cls.of(searched.bordered, first).cells(searched.bordered, first, last)

    @staticmethod
    def expected(bordered: Bordered) -> int:
        """Bytes that a search takes while it is made, with its costs."""
        return bordered.half.nbytes + bordered.half.size

    def cells(self, bordered: Bordered, first: int, last: int) -> Ints | None:
        """Cells (n, 2) of (row, col) of the cheapest path between two cells; None without one.

        One of them is the flood's end. It is the path that a planner finds from the first to the
        last, whichever of them that is.
        """
        from locplan._support.kernels.ways import cheapest_cells

        forwards = first == self.source
        other = last if forwards else first
        if other != self.source and not self.steps[other]:
            return None
        costs = bordered.half, bordered.columns
        return bordered.cells_of(cheapest_cells(*costs, self.steps, self.source, other, forwards))


@dataclass(frozen=True, eq=False)
class Searches:
    """What is searched on a scene."""

    kept: Kept
    """Costmaps, searches and paths that are kept."""
    scene: Scene
    """The scene."""
    check: Check
    """It is called between the legs and in searches, and raises to end the plan."""

    def halved(self, weight: float) -> Searched:
        """The costmap at a weight, or the blank one before there is a field."""
        costs = self.scene.costs

        def make() -> Searched:
            return Searched.halved(costs if self.scene.field is None else costs.with_weight(weight))

        key = ("halved", self.scene.serial, weight)
        return self.kept.made(key, make, lambda m: m.bordered.half.nbytes, 2 * costs.density.nbytes)

    def coarse(self, weight: float) -> Searched:
        """The costmap of drafts at a weight."""

        def make() -> Searched:
            costs = self.scene.coarse.with_weight(weight)
            return Searched(costs, Bordered.of(costs))

        key = ("coarse", self.scene.serial, weight)
        return self.kept.made(key, make, lambda made: 3 * made.bordered.half.nbytes)

    def flood(
        self, weight: float, end: Position, check: Check | None = None, *, draft: bool = False
    ) -> Flood:
        """The search from an end of a leg."""
        searched = self.coarse(weight) if draft else self.halved(weight)
        source = searched.index_of(end)
        return self.kept.made(
            ("coarse flood" if draft else "flood", self.scene.serial, weight, source),
            lambda: Flood.of(searched.bordered, source, check),
            lambda made: made.steps.nbytes,
            Flood.expected(searched.bordered),
        )

    def path(
        self, stops: Sequence[Position], weight: float, held: int | None, *, draft: bool = False
    ) -> Path | None:
        """The path over all stops, leg by leg, of which one may be held; None if a leg has none."""
        find = self._draft if draft else self._leg
        legs: list[Path] = []
        for n, (start, goal) in enumerate(itertools.pairwise(stops)):
            self.check()
            moving = "start" if held == n else "goal" if held == n + 1 else ""
            leg = find(weight, start, goal, moving)
            if leg is None:
                return None
            legs.append(leg)
        return legs[0] if len(legs) == 1 else Path.joined(legs)

    def _leg(self, weight: float, start: Position, goal: Position, moving: str) -> Path | None:
        """The any-angle path of a leg, of which one end may be moving; None if there is none.

        A search from an end that rests is kept, and serves paths to it and from it. It is finished
        even where the plan is not: the next one needs it.
        """
        key = ("leg", self.scene.serial, weight, start, goal)
        path: Path | None = self.kept.get(key)
        if path is not None:
            return path
        searched = self.halved(weight)
        costs, bordered = searched.costs, searched.bordered
        if moving:
            self.flood(weight, goal if moving == "start" else start)
        ends = searched.index_of(start), searched.index_of(goal)
        keys = [("flood", self.scene.serial, weight, end) for end in ends]
        flood: Flood | None = self.kept.get(keys[0]) or self.kept.get(keys[1])
        if flood is None:
            self.check()
            path = AnyAngle().solve_prepared(costs, bordered, start, goal, self.check).path
        elif (cells := flood.cells(bordered, *ends)) is not None:
            path = any_angle_path(costs, bordered, cells, start, goal)
        return None if path is None else self.kept.put(key, path, path.xy.nbytes)

    def _draft(self, weight: float, start: Position, goal: Position, moving: str) -> Path | None:
        """The path of a leg on larger cells; None if there is none."""
        coarse = self.coarse(weight)
        first, last = coarse.free_near(start), coarse.free_near(goal)
        if first is None or last is None:
            return None
        # The search is kept from the end that rests.
        flood = self.flood(weight, last if moving == "start" else first, draft=True)
        cells = flood.cells(coarse.bordered, coarse.index_of(first), coarse.index_of(last))
        if cells is None:
            return None
        found = any_angle_path(coarse.costs, coarse.bordered, cells, first, last)
        return Path(np.vstack([start, found.xy[1:-1], goal]))
