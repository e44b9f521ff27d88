"""Greedy choice of places, exchanges afterwards, and regular rows, which are broken."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from locplan._kernels.arrays import Floats, Ints
from locplan.landmarks._objectives import Objective
from locplan.landmarks._places import Passages, too_close
from locplan.maps import OccupancyGrid

MISTAKEN = 3.0
"""Maximum shift that a filter may mistake [m]: farther, its cloud of particles is not."""


class Regularity(NamedTuple):
    """A row of landmarks with equal steps between them."""

    period: float
    """The step [m]."""
    landmarks: tuple[int, ...]
    """Numbers of the landmarks, from 1."""

    def __str__(self) -> str:
        numbers = ", ".join(map(str, self.landmarks))
        return f"landmarks {numbers} stand in a row every {self.period:.2f} m"


def regularity(positions: Floats) -> Regularity | None:
    """The longest row of at least four landmarks with equal short steps, or None.

    Parameters
    ----------
    positions : (n, 2) array
        Positions of the landmarks [m].

    Examples
    --------
    >>> regularity(np.array([[0.0, 0.0], [1.3, 0.1], [2.6, 0.0], [3.9, 0.0]])).period
    1.3
    >>> regularity(np.array([[0.0, 0.0], [1.3, 0.1], [3.1, 0.0], [3.9, 0.0]])) is None
    True
    """
    best: Regularity | None = None
    for one, other in itertools.permutations(range(len(positions)), 2):
        step = positions[other] - positions[one]
        if np.hypot(*step) > MISTAKEN:
            continue
        row, found = [one], other
        while found not in row:
            row.append(found)
            step = (positions[row[-1]] - positions[one]) / (len(row) - 1)
            apart = np.hypot(*(positions - (positions[row[-1]] + step)).T)
            # Greatest distance of a shifted landmark from another that it may be taken for [m].
            found = int(np.argmin(apart)) if apart.min() <= 0.2 else one
        # Least number of landmarks in a regular row.
        if len(row) >= 4 and (best is None or len(row) > len(best.landmarks)):
            best = Regularity(round(float(np.hypot(*step)), 6), tuple(n + 1 for n in row))
    return best


ROUNDS = 3
"""Maximum number of rounds in which each object may be exchanged for another place."""


class Shift(NamedTuple):
    """A landmark that was taken out of a regular row."""

    period: float
    """The row's step [m]."""
    distance: float
    """How far the landmark was moved [m]."""
    price: float
    """Share by which that raised the objective."""

    def __str__(self) -> str:
        return (
            f"one landmark was moved by {self.distance:.2f} m out of a row every"
            f" {self.period:.2f} m, which raised what is expected by {self.price:.1%}"
        )


@dataclass
class Search:
    """A search for the places that make an objective small, by their indices."""

    objective: Objective
    passages: Passages
    """Space of the robot on the map without objects."""
    among: Ints
    """The places that are searched among."""
    lazy: int = 128
    """Number of places that a lazy search looks at together."""
    refused: dict[int, str] = field(default_factory=dict)
    """Places that would have been chosen but for the others, and why they were not."""

    @property
    def places(self) -> Floats:
        """Row, column and heading of all places on the map, (n, 3) [cells, cells, rad]."""
        return self.objective.sight.places

    def run(
        self, first: list[int], count: int, progress: Callable[[int, int], None] | None = None
    ) -> list[int]:
        """Indices of the places: `first` and `count` more, then exchanged, in order of gain."""
        chosen, steps = list(first), count + ROUNDS * (count + len(first))
        done = itertools.count(1)

        def step() -> None:
            if progress:
                progress(min(next(done), steps), steps)

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
        self, others: list[int], now: int | None = None, bounds: Floats | None = None
    ) -> int | None:
        """Best place beside others that is allowed; None if none is better than what is.

        With `bounds` (n,), which no gain exceeds, the search is lazy: places are looked at from the
        greatest bound on, until none of the rest can gain more. Gains beside fewer objects are
        such bounds as far as the objective has diminishing returns; they are lowered in place.
        """
        value = self._beside(others).value()
        least = 0.0 if now is None else value - float(self.objective.values(np.array([now]))[0])
        # Share of the objective by which an exchange must lower it.
        least += 1e-6 * (value - least)
        waiting = np.setdiff1d(self.among, others)
        lot = max(len(waiting), 1)
        if bounds is not None:
            waiting, lot = waiting[np.argsort(-bounds[waiting], kind="stable")], self.lazy
        gains = np.full(len(self.places), -np.inf)
        passages = self.around(others)
        for begin in range(0, len(waiting), lot):
            part = waiting[begin : begin + lot]
            gains[part] = value - self.objective.values(part)
            rest = -np.inf
            if bounds is not None:
                bounds[part] = gains[part]
                rest = bounds[waiting[begin + lot :]].max(initial=-np.inf)
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
        if too_close(sight.shape, pose, self.places[others], sight.grid.resolution):
            return "too close to another landmark"
        return "cuts a passage for the robot beside the others" if passages.cuts(pose) else ""

    def in_order(self, chosen: list[int]) -> list[int]:
        """The places in order of gain, each the best beside those before it."""
        order: list[int] = []
        left = sorted(chosen)
        while left:
            best = left[int(np.argmin(self._beside(order).values(np.array(left))))]
            order.append(best)
            left.remove(best)
        return order

    def curve(self, order: list[int]) -> Floats:
        """The objective with 0, 1, ... of the places, (k + 1,)."""
        return np.array([self._beside(order[:n]).value() for n in range(len(order) + 1)])

    def _beside(self, chosen: list[int]) -> Objective:
        """The objective beside objects at these places."""
        self.objective.start(np.array(chosen, np.int64))
        return self.objective

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

    def without_rows(self, order: list[int]) -> tuple[list[int], tuple[Shift, ...]]:
        """The places in order of gain, with one of each regular row moved, and what was moved.

        A row that a filter can mistake for itself a step farther is broken by the move that costs
        least, if that is at most a twentieth; else it stays.
        """
        shifts: list[Shift] = []
        while len(shifts) < len(order) and (row := regularity(self._positions[order])):
            found = self._broken(order, row)
            if found is None:
                break
            order, shift = found
            shifts.append(shift)
        return (self.in_order(order) if shifts else order), tuple(shifts)

    def _broken(self, order: list[int], row: Regularity) -> tuple[list[int], Shift] | None:
        """The places with one of a row moved for the least price; None if all cost more."""
        now = self._beside(order).value()
        everywhere = self._positions
        # Share of the objective that breaking a row may cost.
        least, best = now * (1 + 0.05), None
        for member in row.landmarks:
            n = member - 1
            others = order[:n] + order[n + 1 :]
            apart = np.hypot(*(everywhere[self.among] - everywhere[order[n]]).T)
            near = np.setdiff1d(self.among[apart <= MISTAKEN / 2], order)
            values = self._beside(others).values(near)
            passages = self.around(others)
            # Number of places near each landmark of a row that are looked at, the best first.
            for at in np.argsort(values, kind="stable")[:20].tolist():
                if values[at] >= least:
                    break
                moved = [*order[:n], int(near[at]), *order[n + 1 :]]
                rows = regularity(self._positions[moved])
                if rows is not None and len(rows.landmarks) >= len(row.landmarks):
                    continue
                if not self.fault(int(near[at]), others, passages):
                    distance = float(np.hypot(*(everywhere[near[at]] - everywhere[order[n]])))
                    price = float(values[at] / now - 1)
                    least, best = float(values[at]), (moved, Shift(row.period, distance, price))
                    break
        return best

    @property
    def _positions(self) -> Floats:
        """Positions of all places on the map, (n, 2) [m]."""
        return np.asarray(self.places[:, :2] * self.objective.sight.grid.resolution)


def in_world(grid: OccupancyGrid, places: Floats) -> Floats:
    """Places (row, col, heading) on a map as poses in the world, (n, 3) [m, m, rad]."""
    x, y = grid.grid_to_world(places[:, 0], places[:, 1])
    return np.column_stack([x, y, places[:, 2] + grid.origin[2]])
