"""Searches for paths over several stops, stored between plans up to a number of bytes."""

from __future__ import annotations

import dataclasses
import itertools
import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from locplan._support.kernels.arrays import Ints, Octets
from locplan.app.explorer.scene import MapScene, find_nearest_centre
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE
from locplan.planning.any_angle import AnyAngle, make_any_angle_path
from locplan.planning.costmap import Costmap
from locplan.planning.grid import PaddedCostmap, find_bordered_index
from locplan.planning.path import Path
from locplan.planning.protocol import Position

Result = TypeVar("Result")
Check = Callable[[], None]
"""Function that raises `Cancelled` if a plan is obsolete."""
Weight = float | None
"""Weight of a path; None for the shortest one."""


class ResultStore:
    """Cache of results by key that drops the least recently used ones above a size limit."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.bytes = 0
        self._lock = threading.Lock()
        self._results: OrderedDict[Hashable, tuple[Any, int]] = OrderedDict()

    @property
    def results(self) -> list[Any]:
        """All results, the most recently used one first."""
        with self._lock:
            return [result for result, _ in reversed(self._results.values())]

    def get(self, key: Hashable) -> Any:
        """Return the result of a key, and mark it as the most recently used; None if missing."""
        with self._lock:
            if key not in self._results:
                return None
            self._results.move_to_end(key)
            return self._results[key][0]

    def put(self, key: Hashable, result: Result, size: int) -> Result:
        """Store a result of a size in bytes, and return it. The newest result is always kept."""
        with self._lock:
            self._drop([key])
            self._results[key] = result, size
            self.bytes += size
            self._shrink(self.limit, 1)
        return result

    def get_or_create(
        self,
        key: Hashable,
        create: Callable[[], Result],
        size: Callable[[Result], int],
        expected: int = 0,
    ) -> Result:
        """Return the result of a key; create it if it is missing.

        Frees room for the expected bytes first. Keeps the two most recently used results, from
        which the new one may be made.
        """
        stored: Result | None = self.get(key)
        if stored is not None:
            return stored
        with self._lock:
            self._shrink(self.limit - expected, 2)
        result = create()
        return self.put(key, result, size(result))

    def forget(self, is_kept: Callable[[Any], bool] = lambda key: False) -> None:
        """Drop the results whose keys do not satisfy a condition; by default all."""
        with self._lock:
            self._drop([key for key in self._results if not is_kept(key)])

    def _shrink(self, limit: float, min_count: int) -> None:
        """Drop the least recently used results above a limit, but keep a minimum number."""
        while self.bytes > limit and len(self._results) > min_count:
            self._drop([next(iter(self._results))])

    def _drop(self, keys: Sequence[Hashable]) -> None:
        for key in keys:
            self.bytes -= self._results.pop(key, (None, 0))[1]


@dataclass(frozen=True, eq=False)
class SearchGrid:
    """A costmap, and its bordered copy for searches."""

    costs: Costmap
    """The costmap."""
    bordered: PaddedCostmap
    """Its density with a border of blocked cells."""

    @classmethod
    def from_half_costs(cls, costs: Costmap) -> SearchGrid:
        """Return a costmap at half its cost, which shares memory with the searches.

        The cheapest path is the same, and its cost is exactly half.
        """
        bordered = PaddedCostmap.from_costmap(costs)
        inner = bordered.half.reshape(-1, bordered.columns)[1:-1, 1:-1]
        inner.setflags(write=False)
        return cls(dataclasses.replace(costs, density=inner), bordered)

    def find_cell_index(self, xy: Position) -> int:
        """Return the index of the cell at a world position [m] in the bordered grid."""
        return find_bordered_index(self.costs, xy, "position")

    def find_nearest_free(self, xy: Position) -> Position | None:
        """Return a free position, or the centre of a free cell near it [m]; None without one."""
        grid, density = self.costs.grid, self.costs.density
        row, col = grid.cell(xy[:2])
        if grid.contains(row, col) and np.isfinite(density[row, col]):
            return xy
        # Near a free place, a cell at most two away is free for its greater part.
        return find_nearest_centre(grid, xy, 2.5 * math.sqrt(2), density, np.isfinite)


@dataclass(frozen=True, eq=False)
class PathTree:
    """The cheapest paths from one cell to all cells, in one byte per cell.

    It does not refer to the costmap, which takes eight bytes per cell and can be dropped.
    """

    root: int
    """Index of the cell in the bordered grid."""
    steps: Octets
    """Steps back to the root on cheapest paths, flat with the border: a bit for each neighbour."""

    @classmethod
    def search(cls, bordered: PaddedCostmap, root: int, check: Check | None = None) -> PathTree:
        """Search all cells that can be reached from a root; `check` may raise to stop."""
        from locplan._support.kernels.search import search_grid
        from locplan._support.kernels.ways import compute_tolerance, find_backward_steps

        half, columns, scale = bordered.half, bordered.columns, bordered.scale
        cost = search_grid(half, columns, root, -1, False, scale, check=check).cost
        tolerance = compute_tolerance(cost, scale.cheapest)
        return cls(root, find_backward_steps(half, columns, cost, tolerance))

    @classmethod
    def prepare(cls) -> None:
        """Compile the kernels, so that the first drag is fast."""
        costs = Costmap.blank(OccupancyGrid(np.full((1, 3), FREE), 1.0))
        grid = SearchGrid(costs, PaddedCostmap.from_costmap(costs))
        first, last = (grid.find_cell_index((x, 0.5)) for x in (0.5, 2.5))
        cls.search(grid.bordered, first).trace_path_cells(grid.bordered, first, last)

    @staticmethod
    def estimate_search_bytes(bordered: PaddedCostmap) -> int:
        """Return the bytes of a running search, including its costs."""
        return bordered.half.nbytes + bordered.half.size

    def trace_path_cells(self, bordered: PaddedCostmap, first: int, last: int) -> Ints | None:
        """Return the cells (n, 2) of the cheapest path between two cells; None without one.

        One of the two is the root. A planner finds the same path from the first to the last.
        """
        from locplan._support.kernels.ways import trace_cheapest_path

        is_forwards = first == self.root
        other = last if is_forwards else first
        if other != self.root and not self.steps[other]:
            return None
        costs = bordered.half, bordered.columns
        return bordered.unflatten(
            trace_cheapest_path(*costs, self.steps, self.root, other, is_forwards)
        )


@dataclass(frozen=True, eq=False)
class PathSearches:
    """Path searches on a scene, through a cache."""

    store: ResultStore
    """Costmaps, searches and paths."""
    scene: MapScene
    """The scene."""
    check: Check = lambda: None
    """Function called between legs and in searches. It raises to end the plan."""

    def grid(self, weight: Weight) -> SearchGrid:
        """Return the costmap at a weight; blank before there is a field."""
        costs = self.scene.costs

        def create() -> SearchGrid:
            return SearchGrid.from_half_costs(
                costs if self.scene.field is None else _apply_weight(costs, weight)
            )

        key, expected = ("grid", self.scene.key, weight), 2 * costs.density.nbytes
        return self.store.get_or_create(
            key, create, lambda grid: grid.bordered.half.nbytes, expected
        )

    def coarse_grid(self, weight: Weight) -> SearchGrid:
        """Return the costmap of drafts at a weight."""

        def create() -> SearchGrid:
            costs = _apply_weight(self.scene.coarse_costs, weight)
            return SearchGrid(costs, PaddedCostmap.from_costmap(costs))

        key = ("coarse grid", self.scene.key, weight)
        return self.store.get_or_create(key, create, lambda grid: 3 * grid.bordered.half.nbytes)

    def get_tree(
        self,
        weight: Weight,
        end: Position,
        check: Check | None = None,
        *,
        is_draft: bool = False,
    ) -> PathTree:
        """Return the search from an end of a leg."""
        grid = self.coarse_grid(weight) if is_draft else self.grid(weight)
        root = grid.find_cell_index(end)
        return self.store.get_or_create(
            ("coarse tree" if is_draft else "tree", self.scene.key, weight, root),
            lambda: PathTree.search(grid.bordered, root, check),
            lambda tree: tree.steps.nbytes,
            PathTree.estimate_search_bytes(grid.bordered),
        )

    def path(
        self,
        stops: Sequence[Position],
        weight: Weight,
        dragged_index: int | None = None,
        *,
        is_draft: bool = False,
    ) -> Path | None:
        """Return the path over all stops, one of which may be dragged; None if a leg has none."""
        find = self._find_draft_leg if is_draft else self._find_leg
        legs: list[Path] = []
        for n, (start, goal) in enumerate(itertools.pairwise(stops)):
            self.check()
            moving = "start" if dragged_index == n else "goal" if dragged_index == n + 1 else ""
            leg = find(weight, start, goal, moving)
            if leg is None:
                return None
            legs.append(leg)
        return legs[0] if len(legs) == 1 else Path.join(legs)

    def _find_leg(
        self, weight: Weight, start: Position, goal: Position, moving_end: str
    ) -> Path | None:
        """Return the any-angle path of a leg; None if there is none.

        If one end moves, the search from the other end is stored for paths in both directions. It
        completes even if the plan is cancelled: the next plan needs it.
        """
        key = ("leg", self.scene.key, weight, start, goal)
        path: Path | None = self.store.get(key)
        if path is not None:
            return path
        grid = self.grid(weight)
        if moving_end:
            self.get_tree(weight, goal if moving_end == "start" else start)
        ends = grid.find_cell_index(start), grid.find_cell_index(goal)
        trees = (self.store.get(("tree", self.scene.key, weight, end)) for end in ends)
        tree: PathTree | None = next(filter(None, trees), None)
        if tree is None:
            self.check()
            path = (
                AnyAngle().solve_prepared(grid.costs, grid.bordered, start, goal, self.check).path
            )
        elif (cells := tree.trace_path_cells(grid.bordered, *ends)) is not None:
            path = make_any_angle_path(grid.costs, grid.bordered, cells, start, goal)
        return None if path is None else self.store.put(key, path, path.xy.nbytes)

    def _find_draft_leg(
        self, weight: Weight, start: Position, goal: Position, moving_end: str
    ) -> Path | None:
        """Return the path of a leg on larger cells; None if there is none."""
        grid = self.coarse_grid(weight)
        first, last = grid.find_nearest_free(start), grid.find_nearest_free(goal)
        if first is None or last is None:
            return None
        # The search starts from the end that does not move.
        tree = self.get_tree(weight, last if moving_end == "start" else first, is_draft=True)
        cells = tree.trace_path_cells(
            grid.bordered, grid.find_cell_index(first), grid.find_cell_index(last)
        )
        if cells is None:
            return None
        path = make_any_angle_path(grid.costs, grid.bordered, cells, first, last)
        return Path(np.vstack([start, path.xy[1:-1], goal]))


def _apply_weight(costs: Costmap, weight: Weight) -> Costmap:
    return costs.for_shortest if weight is None else costs.with_weight(weight)
