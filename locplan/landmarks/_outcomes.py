"""Drives in one world or several: the share of those that were lost, and their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import Interval, of_rms, wilson
from locplan._util.tables import finite, table
from locplan.simulation import Drives
from locplan.simulation._formats import in_percent, with_unit

CLEAR = 0.1
"""Least share by which an error is clearly less than another."""
COLUMNS = (
    "drives",
    *("lost_rate", "lost_rate_low", "lost_rate_high"),
    *("rmse_m", "rmse_low_m", "rmse_high_m"),
    "kept_rmse_m",
)
"""Names of the columns of verification.csv, beside that of the world."""


@dataclass(frozen=True, eq=False, repr=False)
class Outcome:
    """Drives along some routes with one set of objects, or several."""

    drives: tuple[Drives, ...]
    """Drives of each route and set."""

    @property
    def number(self) -> int:
        """Number of drives."""
        return sum(len(each.errors) for each in self.drives)

    @property
    def lost_rate(self) -> Interval:
        """Share of the drives that were lost, off by more than 1 m, at any time, 0..1."""
        lost = np.concatenate([each.lost for each in self.drives])
        return wilson(float(lost.mean()), len(lost))

    @property
    def rmse(self) -> Interval:
        """Root mean square of the position error along the way [m]."""
        return of_rms(self._mean_squares)

    @property
    def kept_rmse(self) -> Interval:
        """RMSE of the drives that were not lost at any time [m]; NaN if all of them were."""
        lost = np.concatenate([each.lost for each in self.drives])
        return of_rms(self._mean_squares[~lost])

    @property
    def _mean_squares(self) -> NDArray[np.float64]:
        return np.concatenate([each.mean_squares for each in self.drives])

    def __repr__(self) -> str:
        return f"Outcome({self.number} drives, {self.lost_rate.value:.0%} lost)"

    def better_than(self, other: Outcome) -> bool:
        """Whether fewer drives are lost, or as few with clearly less error.

        Fewer are lost, and the error is less, where the intervals do not touch. A clear difference
        of the error is also a tenth or more.

        Parameters
        ----------
        other : Outcome
            Drives along the same routes with other objects.
        """
        if self.lost_rate.high < other.lost_rate.low:
            return True
        return (
            self.lost_rate.value <= other.lost_rate.value
            and self.rmse.high < other.rmse.low
            and self.rmse.value <= (1 - CLEAR) * other.rmse.value
        )

    def summary(self) -> dict[str, object]:
        """Errors and share of lost drives in numbers, fit for JSON."""
        return finite(
            {
                "drives": self.number,
                "lost_rate": list(self.lost_rate),
                "rmse_m": list(self.rmse),
                "kept_rmse_m": list(self.kept_rmse),
            }
        )


Named = Sequence[tuple[str, Outcome]]
"""Outcomes, each with the name of its world."""


def outcomes_table(world: str, named: Named) -> str:
    """Table for people; `world` is the heading of the names."""
    rows = [
        [
            name,
            str(each.number),
            in_percent(each.lost_rate),
            with_unit(each.rmse, "m"),
            with_unit(each.kept_rmse, "m"),
        ]
        for name, each in named
    ]
    return table([world, "drives", "lost (> 1 m) [95 %]", "error, all drives", "not lost"], rows)


def outcomes_rows(named: Named) -> list[list[object]]:
    """Rows of verification.csv: the name, and the `COLUMNS`."""
    return [
        [name, each.number, *each.lost_rate, *each.rmse, each.kept_rmse.value]
        for name, each in named
    ]
