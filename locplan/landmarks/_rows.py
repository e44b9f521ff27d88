"""Regular rows of landmarks are broken where that costs little."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan.landmarks._regular import MISTAKEN, Regularity, regularity
from locplan.landmarks._search import Search

PRICE = 0.05
"""Share of the objective that breaking a row may cost."""
TRIED = 20
"""Number of places near each landmark of a row that are looked at, the best first."""


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


def without_rows(search: Search, order: list[int]) -> tuple[list[int], tuple[Shift, ...]]:
    """The places in order of gain, with one of each regular row moved, and what was moved.

    A row that a filter can mistake for itself a step farther is broken by the move that costs
    least, if that is at most `PRICE`; else it stays.
    """
    shifts: list[Shift] = []
    while len(shifts) < len(order) and (row := regularity(_at(search, order))):
        found = _broken(search, order, row)
        if found is None:
            break
        order, shift = found
        shifts.append(shift)
    return (search.in_order(order) if shifts else order), tuple(shifts)


def _broken(search: Search, order: list[int], row: Regularity) -> tuple[list[int], Shift] | None:
    """The places with one landmark of a row moved, for the least price; None if all cost more."""
    search.objective.start(np.array(order, np.int64))
    now = search.objective.value()
    everywhere = _at(search, list(range(len(search.places))))
    least, best = now * (1 + PRICE), None
    for member in row.landmarks:
        n = member - 1
        others = order[:n] + order[n + 1 :]
        apart = np.hypot(*(everywhere[search.among] - everywhere[order[n]]).T)
        near = np.setdiff1d(search.among[apart <= MISTAKEN / 2], order)
        search.objective.start(np.array(others, np.int64))
        values = search.objective.values(near)
        passages = search.around(others)
        for at in np.argsort(values, kind="stable")[:TRIED].tolist():
            if values[at] >= least:
                break
            moved = [*order[:n], int(near[at]), *order[n + 1 :]]
            rows = regularity(_at(search, moved))
            if rows is not None and len(rows.landmarks) >= len(row.landmarks):
                continue
            if not search.fault(int(near[at]), others, passages):
                distance = float(np.hypot(*(everywhere[near[at]] - everywhere[order[n]])))
                price = float(values[at] / now - 1)
                least, best = float(values[at]), (moved, Shift(row.period, distance, price))
                break
    return best


def _at(search: Search, indices: list[int]) -> NDArray[np.float64]:
    """Positions of places on the map, (k, 2) [m]."""
    found: NDArray[np.float64] = search.places[indices, :2] * search.objective.sight.resolution
    return found
