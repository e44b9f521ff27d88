"""Greedy choice of places, and exchanges afterwards."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from locplan.landmarks._candidates import too_close
from locplan.landmarks._objects import Shape
from locplan.landmarks._passages import Passages
from locplan.maps import OccupancyGrid

ROUNDS = 3
"""Greatest number of rounds in which each object may be exchanged for another place."""
BETTER = 1e-6
"""Share of the objective by which an exchange must lower it."""
BESIDE_OTHERS = "cuts a passage for the robot beside the others"
TOO_NEAR = "too close to another landmark"


class Objective(Protocol):
    """What is made small by the choice of places."""

    def start(self, chosen: NDArray[np.float64]) -> None:
        """Begin from objects that stand at these poses on the map, (k, 3)."""

    def value(self) -> float:
        """The objective with them."""

    def values(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """The objective with each of these places besides, (m,)."""


@dataclass
class Search:
    """A search for the places that make an objective small.

    Places are row, column and heading on the map [cells, cells, rad].
    """

    objective: Objective
    places: NDArray[np.float64]
    """Places where an object may stand by itself, (n, 3)."""
    shape: Shape
    passages: Passages
    """Space of the robot on the map without objects."""
    resolution: float
    refused: dict[int, str] = field(default_factory=dict)
    """Places that would have been chosen but for the others, and why they were not."""

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

        for _ in range(count):
            found = self.best(chosen)
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

    def best(self, others: list[int], now: int | None = None) -> int | None:
        """Best place beside others that is allowed; None if none is better than what is."""
        self.objective.start(self.places[others])
        values = self.objective.values(self.places)
        most = self.objective.value() if now is None else values[now]
        passages: Passages | None = None
        for n in np.argsort(values, kind="stable").tolist():
            if not values[n] < most * (1 - BETTER):
                return None
            if n in others:
                continue
            if passages is None:
                passages = self.around(others)
            fault = self.fault(n, others, passages)
            if not fault:
                return int(n)
            self.refused[n] = fault
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
        if too_close(self.shape, pose, self.places[others], self.resolution):
            return TOO_NEAR
        return BESIDE_OTHERS if passages.cuts(pose) else ""

    def in_order(self, chosen: list[int]) -> list[int]:
        """The places in order of gain, each the best beside those before it."""
        order: list[int] = []
        left = sorted(chosen)
        while left:
            self.objective.start(self.places[order])
            best = left[int(np.argmin(self.objective.values(self.places[left])))]
            order.append(best)
            left.remove(best)
        return order

    def curve(self, order: list[int]) -> NDArray[np.float64]:
        """The objective with 0, 1, ... of the places, (k + 1,)."""
        values = []
        for n in range(len(order) + 1):
            self.objective.start(self.places[order[:n]])
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


def in_threads(
    run: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    places: NDArray[np.float64],
    threads: int,
) -> NDArray[np.float64]:
    """Values of places that are computed in parts, each on a thread."""
    if threads < 2 or len(places) < 4 * threads:
        return run(places)
    with ThreadPoolExecutor(threads) as pool:
        # Near places cost alike: each thread takes every so-manieth one.
        parts = [pool.submit(run, np.ascontiguousarray(places[n::threads])) for n in range(threads)]
        result = np.empty(len(places))
        for n, part in enumerate(parts):
            result[n::threads] = part.result()
    return result
