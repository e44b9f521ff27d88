"""Ticks of logarithmic axes: plain numbers, as many as tell a scale and as there is room for."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, Locator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

FIRST_DIGITS = ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0))
"""What the numbers of a scale may begin with, few first."""
FEWEST, MOST = 3, 8
"""Number of ticks that tell a scale, and that are read."""


class RoundNumbers(Locator):
    """Ticks of a logarithmic axis at 1, 2, 5, 10 and so on, or evenly where it is short."""

    def __init__(self, most: int = MOST) -> None:
        self.most = most

    def __call__(self) -> Any:
        """Find the ticks of the axis; matplotlib calls it."""
        assert self.axis is not None
        return self.tick_values(*self.axis.get_view_interval())

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """Find the ticks between two values."""
        return round_numbers(min(vmin, vmax), max(vmin, vmax), self.most)


def round_numbers(low: float, high: float, most: int = MOST) -> NDArray[np.float64]:
    """Round numbers from `low` to `high` for a logarithmic scale, at most `most` of them."""
    if not (0 < low < high and math.isfinite(high)):
        return np.array([low])
    powers = 10.0 ** np.arange(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    within = low * (1 - 1e-9), high * (1 + 1e-9)
    found = np.array([])
    for digits in FIRST_DIGITS:
        every = np.sort(np.outer(powers, digits).ravel())
        every = every[(within[0] <= every) & (every <= within[1])]
        if len(every) > most:
            # Decades are left out where even they are too many.
            return found if len(found) >= FEWEST else every[:: -(-len(every) // most)]
        found = every
        if len(found) >= FEWEST + 1:
            return found
    if len(found) >= FEWEST:
        return found
    for count in range(FEWEST + 1, most + 1):
        found = np.asarray(MaxNLocator(count, steps=[1, 2, 5, 10]).tick_values(low, high))
        found = found[(within[0] <= found) & (found <= within[1])]
        if len(found) >= FEWEST:
            break
    return found


def label_plainly(axis: Axis, most: int = MOST) -> None:
    """Label a logarithmic axis with plain numbers.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
        The axis.
    most : int, default 8
        Greatest number of ticks.
    """
    axis.set_major_locator(RoundNumbers(most))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.6g}"))
    axis.set_minor_formatter(NullFormatter())


def make_logarithmic(axis: Any, most: int = MOST) -> None:
    """Make an axis of matplotlib logarithmic, with plain numbers.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
        The axis.
    most : int, default 8
        Greatest number of ticks.
    """
    getattr(axis.axes, f"set_{axis.axis_name}scale")("log")
    label_plainly(axis, most)
