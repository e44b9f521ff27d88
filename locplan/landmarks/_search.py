"""Greedy choice of places, and exchanges afterwards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from locplan.landmarks._candidates import too_close
from locplan.landmarks._objectives import Objective
from locplan.landmarks._passages import Passages
from locplan.maps import OccupancyGrid

ROUNDS = 3
"""Greatest number of rounds in which each object may be exchanged for another place."""
BETTER = 1e-6
"""Share of the objective by which an exchange must lower it."""
LAZY = 128
"""Number of places that a lazy search looks at together."""
BESIDE_OTHERS = "cuts a passage for the robot beside the others"
TOO_NEAR = "too close to another landmark"


@dataclass
class Search:
    """A search for the places that make an objective small, by their indices."""

    objective: Objective
    passages: Passages
    """Space of the robot on the map without objects."""
    among: NDArray[np.int64]
    """The places that are searched among."""
    refused: dict[int, str] = field(default_factory=dict)
    """Places that would have been chosen but for the others, and why they were not."""

    @property
    def places(self) -> NDArray[np.float64]:
        """Row, column and heading of all places on the map, (n, 3) [cells, cells, rad]."""
        return self.objective.sight.places

    def run(
        self, first: list[int], count: int, progress: Callable[[int, int], None] | None = None
    ) -> list[int]:
        """Indices of the places: `first` and `count` more, then exchanged, in order of gain."""
        chosen, steps, done = list(first), count + ROUNDS * (count + len(first)), 0

        def step() -> None:
            nonlocal done
            done += 1
            if progress:
                progress(min(done, steps), steps)

        bounds = np.full(len(self.places), np.inf)
        for _ in range(count):
            found = self.best(chosen, bounds=bounds)
            step()
            if found is None:
                break
            chosen.append(found)
        settled = 0  # objects in a row that stay where they are
        for turn in range(ROUNDS * len(chosen)):
            n = turn % len(chosen)
            found = self.best(chosen[:n] + chosen[n + 1 :], chosen[n])
            settled = settled + 1 if found is None else 1
            chosen[n] = chosen[n] if found is None else found
            step()
            if settled == len(chosen):
                break
        if progress:
            progress(steps, steps)
        return self.in_order(chosen)

    def best(
        self,
        others: list[int],
        now: int | None = None,
        bounds: NDArray[np.float64] | None = None,
    ) -> int | None:
        """Best place beside others that is allowed; None if none is better than what is.

        With `bounds` (n,), which no gain exceeds, the search is lazy: places are looked at from the
        greatest bound on, until none of the rest can gain more. Gains beside fewer objects are
        such bounds as far as the objective has diminishing returns; they are lowered in place.
        """
        self.objective.start(np.array(others, np.int64))
        value = self.objective.value()
        least = 0.0 if now is None else value - float(self.objective.values(np.array([now]))[0])
        least += BETTER * (value - least)
        waiting = np.setdiff1d(self.among, others)
        lot = max(len(waiting), 1)
        if bounds is not None:
            waiting, lot = waiting[np.argsort(-bounds[waiting], kind="stable")], LAZY
        gains = np.full(len(self.places), -np.inf)
        passages: Passages | None = None
        for begin in range(0, len(waiting), lot):
            part = waiting[begin : begin + lot]
            gains[part] = value - self.objective.values(part)
            rest = -np.inf
            if bounds is not None:
                bounds[part] = gains[part]
                rest = bounds[waiting[begin + lot :]].max(initial=-np.inf)
            if passages is None:
                passages = self.around(others)
            for n in np.argsort(-gains, kind="stable").tolist():
                if not gains[n] > least or gains[n] < rest:
                    break
                fault = self.fault(n, others, passages)
                if not fault:
                    return int(n)
                self.refused[n] = fault
                gains[n] = -np.inf
            if not rest > least:
                return None
        return None

    def around(self, chosen: list[int]) -> Passages:
        """The robot's space beside objects at these places."""
        passages = self.passages.copy()
        for n in chosen:
            passages.place(self.places[n])
        return passages

    def fault(self, place: int, others: list[int], passages: Passages) -> str:
        """Why no object may stand at a place beside others, or nothing."""
        pose = self.places[place]
        sight = self.objective.sight
        if too_close(sight.shape, pose, self.places[others], sight.resolution):
            return TOO_NEAR
        return BESIDE_OTHERS if passages.cuts(pose) else ""

    def in_order(self, chosen: list[int]) -> list[int]:
        """The places in order of gain, each the best beside those before it."""
        order: list[int] = []
        left = sorted(chosen)
        while left:
            self.objective.start(np.array(order, np.int64))
            best = left[int(np.argmin(self.objective.values(np.array(left))))]
            order.append(best)
            left.remove(best)
        return order

    def curve(self, order: list[int]) -> NDArray[np.float64]:
        """The objective with 0, 1, ... of the places, (k + 1,)."""
        values = []
        for n in range(len(order) + 1):
            self.objective.start(np.array(order[:n], np.int64))
            values.append(self.objective.value())
        return np.array(values)

    def in_world(self, grid: OccupancyGrid, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        """Poses of some places in the world, (k, 3) [m, m, rad]."""
        return in_world(grid, self.places[indices])

    def at_random(self, count: int, random: np.random.Generator) -> list[int]:
        """Places drawn at random that are allowed beside each other, at most `count`."""
        chosen: list[int] = []
        passages = self.passages.copy()
        for n in random.permutation(len(self.places)).tolist():
            if len(chosen) == count:
                break
            if not self.fault(n, chosen, passages):
                chosen.append(n)
                passages.place(self.places[n])
        return chosen


def in_world(grid: OccupancyGrid, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (row, col, heading) on a map as poses in the world, (n, 3) [m, m, rad]."""
    x, y = grid.grid_to_world(places[:, 0], places[:, 1])
    return np.column_stack([x, y, places[:, 2] + grid.origin[2]])
