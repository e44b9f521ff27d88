"""Regular spacing of landmarks, which a filter can mistake for a shift along the row."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MISTAKEN = 3.0
"""Greatest shift that a filter may mistake [m]: farther, its cloud of particles is not."""
ALIKE = 0.2
"""Greatest distance of a shifted landmark from another one that it may be taken for [m]."""
ROW = 4
"""Least number of landmarks in a regular row."""


class Regularity(NamedTuple):
    """A row of landmarks with equal steps between them."""

    period: float
    """The step [m]."""
    landmarks: tuple[int, ...]
    """Numbers of the landmarks, from 1."""

    def __str__(self) -> str:
        numbers = ", ".join(map(str, self.landmarks))
        return f"landmarks {numbers} stand in a row every {self.period:.2f} m"


def regularity(positions: NDArray[np.float64]) -> Regularity | None:
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
    for one in range(len(positions)):
        for other in range(len(positions)):
            step = positions[other] - positions[one]
            if one == other or np.hypot(*step) > MISTAKEN:
                continue
            row = [one]
            while (found := _at(positions, positions[row[-1]] + step)) is not None:
                if found in row:
                    break
                row.append(found)
                step = (positions[row[-1]] - positions[one]) / (len(row) - 1)
            if len(row) >= ROW and (best is None or len(row) > len(best.landmarks)):
                period = math.hypot(*(positions[row[-1]] - positions[one])) / (len(row) - 1)
                best = Regularity(round(period, 6), tuple(n + 1 for n in row))
    return best


def _at(positions: NDArray[np.float64], xy: NDArray[np.float64]) -> int | None:
    """Index of the landmark at a position, or None."""
    apart = np.hypot(*(positions - xy).T)
    nearest = int(np.argmin(apart))
    return nearest if apart[nearest] <= ALIKE else None
