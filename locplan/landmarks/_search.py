"""The greedy search for places of landmarks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from locplan._kernels.arrays import Floats
from locplan._util.progress import ProgressCallback
from locplan.landmarks._places import Passages, too_close
from locplan.landmarks._sight import Sight
from locplan.maps import OccupancyGrid


@dataclass
class Search:
    """A greedy search for the places that lower the objective of `Sight` most."""

    sight: Sight
    """What the robot sees with objects at some of the places, and the objective."""
    passages: Passages
    """Space of the robot on the map without objects."""
    lazy: int = 128
    """Number of places that a lazy search looks at together."""

    @property
    def places(self) -> Floats:
        """Row, column and heading of all places on the map, (n, 3) [cells, cells, rad]."""
        return self.sight.places

    def run(self, count: int, progress: ProgressCallback | None = None) -> tuple[list[int], Floats]:
        """Return indices of at most `count` places, and the objective with 0, 1, ... of them."""
        chosen: list[int] = []
        bounds = np.full(len(self.places), np.inf)
        curve = []
        while True:
            self.sight.start(np.array(chosen, np.int64))
            curve.append(self.sight.value())
            best = self.best(chosen, bounds) if len(chosen) < count else None
            if progress:
                progress(count if best is None else len(chosen) + 1, count)
            if best is None:
                return chosen, np.array(curve)
            chosen.append(best)

    def best(self, others: list[int], bounds: Floats | None = None) -> int | None:
        """Return the best allowed place added to others; None if none lowers the objective.

        With `bounds` (n,), which no gain exceeds, the search is lazy: places are looked at from the
        greatest bound on, until none of the rest can gain more. Gains with fewer objects are such
        bounds as far as the objective has diminishing returns; they are lowered in place.
        """
        self.sight.start(np.array(others, np.int64))
        value = self.sight.value()
        # Share of the objective by which a place must lower it.
        least = 1e-6 * value
        waiting = np.setdiff1d(np.arange(len(self.places)), others)
        lot = max(len(waiting), 1)
        if bounds is not None:
            waiting, lot = waiting[np.argsort(-bounds[waiting], kind="stable")], self.lazy
        gains = np.full(len(self.places), -np.inf)
        passages = self.around(others)
        for begin in range(0, len(waiting), lot):
            part = waiting[begin : begin + lot]
            gains[part] = value - self.sight.values(part)
            rest = -np.inf
            if bounds is not None:
                bounds[part] = gains[part]
                rest = bounds[waiting[begin + lot :]].max(initial=-np.inf)
            for n in np.argsort(-gains, kind="stable").tolist():
                if not gains[n] > least or gains[n] < rest:
                    break
                if self.is_allowed(n, others, passages):
                    return int(n)
                gains[n] = -np.inf
            if not rest > least:
                return None
        return None

    def around(self, chosen: list[int]) -> Passages:
        """Return the robot's space with objects at these places."""
        passages = self.passages.copy()
        for n in chosen:
            passages.place(self.places[n])
        return passages

    def is_allowed(self, place: int, others: list[int], passages: Passages) -> bool:
        """True if an object may stand at a place together with others."""
        pose, sight = self.places[place], self.sight
        near = too_close(sight.shape, pose, self.places[others], sight.grid.resolution)
        return not near and not passages.cuts(pose)

    def at_random(self, count: int, random: np.random.Generator) -> list[int]:
        """Return places drawn at random that are allowed together, at most `count`."""
        chosen: list[int] = []
        passages = self.passages.copy()
        for n in random.permutation(len(self.places)).tolist():
            if len(chosen) == count:
                break
            if self.is_allowed(n, chosen, passages):
                chosen.append(n)
                passages.place(self.places[n])
        return chosen


def poses_in_world(grid: OccupancyGrid, places: Floats) -> Floats:
    """Return places (row, col, heading) on a map as poses in the world, (n, 3) [m, m, rad]."""
    x, y = grid.grid_to_world(places[:, 0], places[:, 1])
    return np.column_stack([x, y, places[:, 2] + grid.origin[2]])
