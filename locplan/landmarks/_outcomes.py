"""Drives in one world or several: the share of those that were lost, and their errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import Interval, of_rms, wilson
from locplan._util.records import Column, Table
from locplan.simulation import Drives

DRIVES = 100
"""Number of drives along each route by default."""
CLEAR = 0.1
"""Least share by which an error is clearly less than another."""
COLUMNS = (
    Column("drives", title="drives", digits=0, value=lambda outcome: outcome.number),
    Column("lost_rate", title="lost (> 1 m) [95 %]", digits=0, people="%", interval=True),
    Column("rmse", "m", "error, all drives", interval=True),
    Column("kept_rmse", "m", "not lost", interval=True),
)


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
        return Table.of(COLUMNS, [self]).records()[0]


def outcomes_table(title: str, named: Mapping[str, Outcome]) -> Table:
    """Table of the outcomes in several worlds; people see the title above their names."""
    rows = zip(named, Table.of(COLUMNS, named.values()).rows, strict=True)
    return Table(
        (Column("world", title=title), *COLUMNS), tuple((name, *row) for name, row in rows)
    )
