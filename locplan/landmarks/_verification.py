"""Drives that show whether landmarks help: before, after, and with objects at random places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from locplan._kernels.arrays import Bools, Floats
from locplan._util.records import Column, Table
from locplan.simulation import RATES, Drives, Rated, rates_of
from locplan.simulation.verdict import DriveSet, Verdict, compare

DRIVES = 100
"""Number of drives along each route by default."""
OUTCOME = (
    Column("drives", title="drives", digits=0, value=lambda outcome: outcome.number),
    *RATES,
    Column("rmse", "m", "error, all drives", interval=True),
    Column("kept_rmse", "m", "of those never lost", interval=True),
)


@dataclass(frozen=True, eq=False, repr=False)
class Outcome(Rated):
    """Drives along some routes with one set of objects, or several."""

    drives: tuple[Drives, ...]
    """Drives of each route and set."""

    @property
    def number(self) -> int:
        """Number of drives."""
        return len(self.lost)

    @property
    def lost(self) -> Bools:
        """True for each drive that was lost, off by more than 1 m, at any time, (number,)."""
        return np.concatenate([each.lost for each in self.drives])

    @property
    def mean_squares(self) -> Floats:
        """Mean square of each drive's position error, (number,) [m^2]."""
        return np.concatenate([each.mean_squares for each in self.drives])

    @property
    def off_at_end(self) -> Bools:
        """True for each drive that is off by more than 1 m where it ends, (number,)."""
        return np.concatenate([each.off_at_end for each in self.drives])

    def __repr__(self) -> str:
        return f"Outcome({self.number} drives, {rates_of(self)})"


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """Drives without landmarks, with them, and with as many objects at random places."""

    before: Outcome
    """Drives without landmarks."""
    after: Outcome
    """Drives with them."""
    random: Outcome | None
    """Drives with objects at random places; None if no other places are allowed."""
    profiles: Mapping[str, tuple[Drives, Drives]]
    """Drives of each route before and after."""
    seed: int
    """Seed of all random numbers."""

    def __repr__(self) -> str:
        return f"Verification({self.verdict})"

    @cached_property
    def comparison(self) -> Verdict:
        """The verdict on the drives with landmarks beside those without, with its figures."""
        return compare(*(DriveSet.from_drives(each.drives) for each in (self.before, self.after)))

    @property
    def word(self) -> str:
        """The verdict: "better", "worse", "no difference" or "undecided"."""
        return self.comparison.word

    @property
    def none_lost(self) -> bool:
        """Whether no drive was lost before and after, but for 2 %."""
        # Share of lost drives up to which none counts as lost to begin with.
        return max(self.before.lost_rate.value, self.after.lost_rate.value) <= 0.02

    @property
    def verdict(self) -> str:
        """The verdict with its figures, in one line."""
        before, after, random = self.before, self.after, self.random
        lost = before.lost_rate.value
        error = f"{before.rmse.value:.2f} -> {after.rmse.value:.2f} m"
        if self.none_lost:
            few = f"{lost:.0%} of the drives were" if lost else "no drive was"
            said = f"{self.word}: {few} lost to begin with; error {error}"
            return said + (f", {random.rmse.value:.2f} m at random places" if random else "")
        said = f"{self.word}: {lost:.0%} of the drives lost before,"
        said += f" {after.lost_rate.value:.0%} after"
        said += f", {random.lost_rate.value:.0%} at random places" if random else ""
        return f"{said}; error {error}"

    def table(self) -> Table:
        """The drives on each map: how many went wrong, and their errors."""
        named = {"none": self.before, "proposed": self.after}
        if self.random:
            named["as many at random"] = self.random
        rows = zip(named, Table.of(OUTCOME, named.values()).rows, strict=True)
        return Table(
            (Column("world", title="landmarks"), *OUTCOME),
            tuple((name, *row) for name, row in rows),
        )
