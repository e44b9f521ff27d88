"""What drives say: the share of those that went wrong, their errors, and a verdict."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

import numpy as np

from locplan._kernels.arrays import Bools, Floats
from locplan._util.progress import ProgressCallback, parts
from locplan._util.records import Column, Table
from locplan.costs import Path
from locplan.simulation import RATES, Drives, Rated, Simulator, drive_paths, rates_of

DRIVES = 100
"""Number of drives along each route by default."""
OUTCOME = (
    Column("drives", title="drives", digits=0, value=lambda outcome: outcome.number),
    *RATES,
    Column("rmse", "m", "error, all drives", interval=True),
    Column("kept_rmse", "m", "of those never off", interval=True),
)
Profile: TypeAlias = Floats
"""Distance along a route and the largest deviation of a match's position there, (n, 2) [m]."""


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
    def off(self) -> Bools:
        """True for each drive that is off by more than 0.5 m where it ends, (number,)."""
        return np.concatenate([each.off for each in self.drives])

    def __repr__(self) -> str:
        return f"Outcome({self.number} drives, {rates_of(self)})"

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
        # Share by which an error must be less to be clearly less than another.
        return (
            self.lost_rate.value <= other.lost_rate.value
            and self.rmse.high < other.rmse.low
            and self.rmse.value <= 0.9 * other.rmse.value
        )

    def summary(self) -> dict[str, object]:
        """Errors and share of lost drives in numbers, fit for JSON."""
        return Table.of(OUTCOME, [self]).records()[0]


Compared: TypeAlias = tuple[Outcome, Outcome, Outcome | None, dict[str, tuple[Drives, Drives]]]
"""The first fields of `BeforeAndAfter`."""
Change = TypeVar("Change")
World: TypeAlias = tuple[Simulator, Mapping[str, Path]]
"""A world with a robot in it, and the robot's routes there."""


def driven_in(
    worlds: Iterable[World], drives: Sequence[int], progress: ProgressCallback | None
) -> Iterator[Outcome]:
    """Drive each of as many routes several times in each world."""
    callbacks = parts(progress, drives)
    for (simulator, routes), number, each in zip(worlds, drives, callbacks, strict=True):
        count = number // len(routes)
        yield Outcome(tuple(drive_paths(simulator, routes, count, progress=each).values()))


def compared(
    enter: Callable[[Change], World],
    changes: Sequence[Change],
    at_random: Sequence[Change],
    drives: int,
    routes: Collection[str],
    progress: ProgressCallback | None,
) -> tuple[Compared, list[Outcome]]:
    """Drive before a change, after it, with parts of it alone, and after some at random.

    `changes` are none, the whole one, and its parts. The parts together have as many drives, and
    the changes at random.
    """
    alone, sets = len(changes) - 2, len(at_random)
    numbers = [drives] * 2 + [max(drives // max(alone, 1), 2)] * alone
    numbers += [drives // max(sets, 1)] * sets
    worlds = (enter(change) for change in (*changes, *at_random))
    counts = [len(routes) * number for number in numbers]
    before, after, *rest = driven_in(worlds, counts, progress)
    random = Outcome(tuple(d for each in rest[alone:] for d in each.drives)) if sets else None
    pairs = zip(before.drives, after.drives, strict=True)
    return (before, after, random, dict(zip(routes, pairs, strict=True))), rest[:alone]


def outcomes_table(title: str, named: Mapping[str, Outcome]) -> Table:
    """Table of the outcomes in several worlds; people see the title above their names."""
    rows = zip(named, Table.of(OUTCOME, named.values()).rows, strict=True)
    return Table(
        (Column("world", title=title), *OUTCOME), tuple((name, *row) for name, row in rows)
    )


@dataclass(frozen=True, eq=False, repr=False)
class BeforeAndAfter:
    """Drives before a change, after it, and after as large a change at random."""

    before: Outcome
    """Drives before the change."""
    after: Outcome
    """Drives after it."""
    random: Outcome | None
    """Drives after as large a change at random; None where no other one is possible."""
    profiles: Mapping[str, tuple[Drives, Drives]]
    """Drives of each route before and after."""
    seed: int
    """Seed of all random numbers."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.verdict})"

    @property
    def helps(self) -> bool:
        """Whether fewer are lost after, or as few with clearly less error.

        The intervals do not touch, and the error falls by a tenth or more.
        """
        return self.after.better_than(self.before)

    @property
    def hurts(self) -> bool:
        """Whether more are lost after, or as many with clearly more error."""
        return self.before.better_than(self.after)

    @property
    def verdict(self) -> str:
        """What the drives say, in one line."""
        raise NotImplementedError

    def summary(self) -> dict[str, object]:
        """The verdict, and the numbers behind it, fit for JSON."""
        return {
            "verdict": self.verdict,
            "helps": self.helps,
            "hurts": self.hurts,
            "before": self.before.summary(),
            "after": self.after.summary(),
            "random": self.random.summary() if self.random else None,
            "seed": self.seed,
        }


@dataclass(frozen=True, eq=False, repr=False)
class Verification(BeforeAndAfter):
    """Drives without landmarks, with them, and with as many objects at random places."""

    fields: Mapping[str, tuple[Profile, Profile]]
    """Largest deviation of a match of one scan along each route before and after, by `Fused`: rows
    of the distance driven and the deviation, (n, 2) [m]."""

    @property
    def none_lost(self) -> bool:
        """Whether no drive was lost before and after, but for 2 %."""
        # Share of lost drives up to which none counts as lost to begin with.
        return max(self.before.lost_rate.value, self.after.lost_rate.value) <= 0.02

    @property
    def nothing_to_gain(self) -> bool:
        """Whether no drive was lost to begin with, and the error is not clearly another after."""
        return self.none_lost and not self.helps and not self.hurts

    @property
    def verdict(self) -> str:
        """What the drives say, in one line."""
        before, after, random = self.before, self.after, self.random
        lost = before.lost_rate.value
        error = f"{before.rmse.value:.2f} -> {after.rmse.value:.2f} m"
        said = "they hurt" if self.hurts else "they help" if self.helps else "not shown to help"
        if self.none_lost:
            said = "nothing to gain" if self.nothing_to_gain else said
            few = f"{lost:.0%} of the drives were" if lost else "no drive was"
            said += f": {few} off by more than 1 m to begin with; error {error}"
            return said + (f", {random.rmse.value:.2f} m at random places" if random else "")
        said += f": {lost:.0%} of the drives off by more than 1 m at some time before,"
        said += f" {after.lost_rate.value:.0%} after"
        said += f", {random.lost_rate.value:.0%} at random places" if random else ""
        return f"{said}; error {error}"

    @property
    def match_deviations(self) -> Floats:
        """Median and 95 % quantile [m] along the routes of `fields`, before and after, (2, 2)."""
        every = (np.concatenate([pair[n][:, 1] for pair in self.fields.values()]) for n in (0, 1))
        return np.array([np.nanquantile(values, [0.5, 0.95]) for values in every])

    def table(self) -> Table:
        """The drives on each map: how many went wrong, and their errors."""
        named = {"none": self.before, "proposed": self.after}
        if self.random:
            named["as many at random"] = self.random
        return outcomes_table("landmarks", named)

    def summary(self) -> dict[str, object]:
        """The verdict, and the numbers behind it, fit for JSON."""
        before, after = (
            {"median": median, "quantile_95": high}
            for median, high in self.match_deviations.tolist()
        )
        return super().summary() | {
            "nothing_to_gain": self.nothing_to_gain,
            "match_deviation": {"before": before, "after": after},
        }


@dataclass(frozen=True, eq=False, repr=False)
class FeatureDrives(BeforeAndAfter):
    """Drives with all features, without some, and without as many random ones in the world."""

    alone: Mapping[int, Outcome]
    """Drives without one of these features, by its number; empty where there is one only."""
    count: int
    """Number of features that are taken away."""

    @property
    def verdict(self) -> str:
        """What the drives say, in one line."""
        before, without = self.before, self.after
        lost = f"{before.lost_rate.value:.0%} of the drives off by more than 1 m with all,"
        lost += f" {without.lost_rate.value:.0%} without the {self.count}"
        error = f"error {before.rmse.value:.2f} -> {without.rmse.value:.2f} m"
        if self.random is not None:
            lost += f", {self.random.lost_rate.value:.0%} without as many random ones"
            error += f" ({self.random.rmse.value:.2f} m without random ones)"
        low = min(each.lost_rate.low for each in (before, without))
        high = max(each.lost_rate.high for each in (before, without))
        said = "their absence is not shown to hurt"
        # Width of the lost drives' intervals up to which a missing difference says something.
        if high - low > 0.3:
            said = (
                f"too few drives to know ({low:.0%} to {high:.0%} off by more than 1 m, with 95 %)"
            )
        if self.hurts or self.helps:
            said = "their absence " + ("hurts" if self.hurts else "helps, against what is expected")
        return f"{said}: {lost}; {error}"

    def table(self) -> Table:
        """The drives in each world: how many went wrong, and their errors."""
        named = {"all features": self.before}
        named |= {f"without {number}": each for number, each in self.alone.items()}
        named[f"without the {self.count}"] = self.after
        if self.random:
            named["without random ones"] = self.random
        return outcomes_table("in the world", named)

    def summary(self) -> dict[str, object]:
        """The verdict, and the numbers behind it, fit for JSON."""
        alone = {str(number): each.summary() for number, each in self.alone.items()}
        return super().summary() | {"count": self.count, "alone": alone}
