"""What is kept between plans: costmaps, searches and paths, up to a number of bytes."""

from __future__ import annotations

import dataclasses
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap
from locplan.maps import FREE, OccupancyGrid
from locplan.planners import Bordered, Position, bordered_index

T = TypeVar("T")


class Kept:
    """Results by key; the least recently used ones go when all take too many bytes."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self._lock = threading.Lock()
        self._results: OrderedDict[Hashable, tuple[Any, int]] = OrderedDict()
        self._bytes = 0

    @property
    def bytes(self) -> int:
        """Bytes of all results."""
        return self._bytes

    def get(self, key: Hashable) -> Any:
        """The result of a key, which is now the most recently used one; None without it."""
        with self._lock:
            if key not in self._results:
                return None
            self._results.move_to_end(key)
            return self._results[key][0]

    def put(self, key: Hashable, result: T, size: int) -> T:
        """Keep a result of so many bytes, and return it; the last one is kept whatever its size."""
        with self._lock:
            if key in self._results:
                self._bytes -= self._results.pop(key)[1]
            self._results[key] = result, size
            self._bytes += size
            self._shrink(self.limit, 1)
        return result

    def _shrink(self, limit: float, least: int) -> None:
        """Drop the least recently used results beyond a limit, but keep the last ones."""
        while self._bytes > limit and len(self._results) > least:
            _, (_, gone) = self._results.popitem(last=False)
            self._bytes -= gone

    def made(
        self, key: Hashable, make: Callable[[], T], size: Callable[[T], int], expected: int = 0
    ) -> T:
        """The result of a key, made if it is not kept.

        Room for the bytes that are expected is made before, so that they do not come on top. The
        two results that were used last stay: others may be made of them.
        """
        found: T | None = self.get(key)
        if found is not None:
            return found
        with self._lock:
            self._shrink(self.limit - expected, 2)
        result = make()
        return self.put(key, result, size(result))

    def forget(self, unless: Callable[[Any], bool]) -> None:
        """Drop the results whose keys do not fulfil a condition."""
        with self._lock:
            for key in [key for key in self._results if not unless(key)]:
                self._bytes -= self._results.pop(key)[1]


@dataclass(frozen=True, eq=False)
class Halved:
    """A costmap at half of its cost, which shares its memory with what the searches take.

    The same path is the cheapest, and twice its cost is exactly that on the whole costmap.
    """

    costs: Costmap
    """The costmap, with half of its density."""
    bordered: Bordered
    """The same as the searches take it."""

    @classmethod
    def of(cls, costs: Costmap) -> Halved:
        """Halve a costmap."""
        bordered = Bordered.of(costs)
        inner = bordered.half.reshape(-1, bordered.columns)[1:-1, 1:-1]
        inner.setflags(write=False)
        return cls(dataclasses.replace(costs, density=inner), bordered)


@dataclass(frozen=True, eq=False)
class Flood:
    """The cheapest ways from one end to every cell, in a byte a cell.

    The costmap that was searched is given anew for each path: held here, its eight bytes a cell
    would outlast it where it is no longer kept.
    """

    source: int
    """Index of the end's cell in the bordered grid."""
    steps: NDArray[np.uint8]
    """Steps back to the end on cheapest ways, flat with the border: a bit for each neighbour."""

    @classmethod
    def of(cls, bordered: Bordered, source: int, check: Callable[[], None] | None = None) -> Flood:
        """Search all that can be reached from a cell; what `check` raises ends that early."""
        from locplan._kernels.search import search
        from locplan._kernels.ways import steps_back, tolerance_of

        half, columns, scale = bordered.half, bordered.columns, bordered.scale
        cost = search(half, columns, source, -1, False, scale, check=check).cost
        tolerance = tolerance_of(cost, scale.cheapest)
        return cls(source, steps_back(half, columns, cost, tolerance))

    @classmethod
    def prepare(cls) -> None:
        """Compile the kernels, so that the first drag does not wait for that."""
        costs = Costmap.blank(OccupancyGrid(np.full((1, 3), FREE), 1.0))
        bordered = Bordered.of(costs)
        flood = cls.of(bordered, index_of(costs, (0.5, 0.5)))
        flood.cells_to(bordered, index_of(costs, (2.5, 0.5)))

    @staticmethod
    def expected(bordered: Bordered) -> int:
        """Bytes that a search takes while it is made, with its costs."""
        return bordered.half.nbytes + bordered.half.size

    def cells_to(self, bordered: Bordered, target: int) -> NDArray[np.int64] | None:
        """Cells (n, 2) of (row, col) of the cheapest path to a cell; None if there is none.

        It is the path that a planner finds from the flood's end.
        """
        return self._cells(bordered, target, True)

    def cells_from(self, bordered: Bordered, start: int) -> NDArray[np.int64] | None:
        """The same from a cell to the flood's end: the path that a planner finds from the cell."""
        return self._cells(bordered, start, False)

    def _cells(self, bordered: Bordered, other: int, from_source: bool) -> NDArray[np.int64] | None:
        from locplan._kernels.ways import cheapest_cells

        if other != self.source and not self.steps[other]:
            return None
        costs = bordered.half, bordered.columns
        flat = cheapest_cells(*costs, self.steps, self.source, other, from_source)
        return bordered.cells_of(flat)


def index_of(costs: Costmap, xy: Position) -> int:
    """Index in the bordered grid of the cell at a world position [m]."""
    return bordered_index(costs, xy, "position")
