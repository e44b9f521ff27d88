"""How settings were judged: at each level of disturbance, and on the whole of a recorded drive."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from locplan._util.intervals import Interval, of_geometric_mean, of_mean, wilson
from locplan.robots import Amcl
from locplan.simulation._drives import FLOOR, Drives, rmse_ratio
from locplan.simulation.tuning._bench import DisturbanceLevel, Driven, TuningBench
from locplan.simulation.tuning._recovery import KIDNAPPINGS, Recovery
from locplan.simulation.verdict import BETTER, WORSE, DriveSet, compare


@dataclass(frozen=True)
class AtLevel:
    """Errors of one setting at one level of disturbance; intervals are over the paths."""

    level: DisturbanceLevel
    """The level, as factors on the disturbances that were asked for."""
    m: float
    """Score: mean over the drives of 0.5 ln(mean square position error [m^2] + 1e-6), and 1 more
    where they were lost."""
    rmse: Interval
    """RMSE of the position along a path: geometric mean over the paths [m]."""
    kept_rmse: float
    """Root mean square position error of the drives never off by more than 1 m [m]."""
    median_error: float
    """Median of the position error on the way [m]."""
    lost: Interval
    """Share of the drives that were off by more than 1 m at some time."""
    off_at_goal: Interval
    """Share of the drives that were off by more than 0.5 m at the end."""
    rmse_ratio: Interval
    """Ratio of the RMSE to that of the user's settings: geometric mean over the paths."""
    lost_difference: Interval
    """Share of lost drives minus that of the user's settings: mean over the paths."""
    verdict: str
    """The verdict on its drives at this level, beside those of the user's settings."""


@dataclass(frozen=True)
class WholeDrive:
    """One setting on the whole of a recorded drive from its beginning; intervals over replays."""

    derived: ClassVar[tuple[str, ...]] = ("holds",)

    name: str
    """Name of the drive, where there are several; else empty."""
    rmse: Interval
    """RMSE of the position: geometric mean over the replays [m]."""
    lost_way: Interval
    """Share of the scans at which it was off by more than 1 m."""
    first_loss: float
    """Distance driven when first off by more than 1 m, the median over the replays [m]; infinite
    if half of them never were."""
    rmse_ratio: Interval
    """Ratio of the RMSE to that of the user's settings: geometric mean over the replays."""
    lost_way_difference: float
    """`lost_way` minus that of the user's settings."""
    lost_difference: float
    """Share of the replays that were lost at some time, minus that of the user's settings."""

    @classmethod
    def of(cls, drives: Drives, own: Drives, name: str = "") -> WholeDrive:
        """What replays of a setting show, beside those of the user's settings.

        Parameters
        ----------
        drives, own : Drives
            Equally many replays of both.
        name : str, default ""
            Name of the drive, where there are several.
        """
        lost_way, ratio = drives.lost_way, rmse_ratio(drives, own)
        more = lost_way.value - own.lost_way.value, float(drives.lost.mean() - own.lost.mean())
        return cls(name, drives.typical_rmse, lost_way, drives.first_loss, ratio, *more)

    @property
    def holds(self) -> bool:
        """True unless it errs more than the user's settings, or is lost on more of the way or in
        more replays."""
        # A scan more of many hundred is no harm.
        is_lost_less = self.lost_way_difference < 0.005 and self.lost_difference <= 0
        return self.rmse_ratio.value < 1 and is_lost_less

    @property
    def sentence(self) -> str:
        """The error, the share of the way lost and the first loss in words."""
        first = f", first after {self.first_loss:.0f} m" if math.isfinite(self.first_loss) else ""
        where = f"{self.name}: " if self.name else ""
        return (
            f"{where}{self.rmse.value:.2g} m, lost on {self.lost_way.value:.0%} of the way{first}"
        )


@dataclass(frozen=True)
class Judged:
    """One setting, judged at every level of disturbance."""

    derived: ClassVar[tuple[str, ...]] = ("worst", "better", "better_at_every_level")

    name: str
    """Name in tables: whose settings they are, or what differs from the user's own."""
    amcl: Amcl
    """The setting."""
    levels: tuple[AtLevel, ...]
    """Its errors at each level of disturbance."""
    rmse_ratio: Interval
    """Ratio of the RMSE to that of the user's settings: geometric mean over levels and paths."""
    verdict: str
    """The verdict on its drives at all levels, beside those of the user's settings."""
    cpu_ms_per_update: float
    """CPU time of the simulation an update of the filter, the scan included [ms]."""
    cpu_ms_per_metre: float
    """CPU time of the simulation a metre that is driven [ms]."""
    whole: WholeDrive | None = None
    """What it does on the whole of a recorded drive, the worst one of several; None where paths
    were simulated."""
    beyond: AtLevel | None = None
    """Its errors at the worst level that is beyond those of the search, and decides nothing; None
    where there is none, or the settings are neither the user's own nor what was found."""
    recoveries: tuple[Recovery, ...] = ()
    """How often the user's settings and those found came back by the goal after they were off by
    more than 1 m, at all levels, and 10 m after kidnappings; what no drive shows is left out."""

    @property
    def worst(self) -> float:
        """The greatest m of all levels, which tuning minimises."""
        return max(each.m for each in self.levels)

    def worst_at(self, odometry: float | None = None) -> AtLevel:
        """The worst of the levels, or of those with a factor on odometry's errors.

        Parameters
        ----------
        odometry : float, optional
            The factor.
        """
        some = [each for each in self.levels if odometry in (None, each.level.odometry)]
        return max(some, key=lambda each: each.m)

    @property
    def better(self) -> bool:
        """True if it is better than the user's settings over all levels, and worse at none.

        The whole of a recorded drive must not contradict its stretches.
        """
        harms = any(each.verdict == WORSE for each in self.levels)
        holds = self.whole is None or self.whole.holds
        return self.verdict == BETTER and holds and not harms

    @property
    def better_at_every_level(self) -> bool:
        """True if it is better than the user's settings at every level of disturbance."""
        return self.better and all(each.verdict == BETTER for each in self.levels)


def judged_beside(
    bench: TuningBench,
    name: str,
    amcl: Amcl,
    own: Amcl,
    wholes: Mapping[Amcl, Sequence[Drives]],
    searched: Collection[str],
    n_alternatives: int = 1,
) -> Judged:
    """Errors of a setting at the levels that the bench drove it at, beside the user's own.

    `wholes` are the replays of the whole of recorded drives; the levels named `searched` decide.
    The first of `n_alternatives` settings that is better is taken, so that they share the error
    probability.
    """

    def verdict_at(some: list[int]) -> str:
        before, after = (_drive_set(each, some) for each in (others, driven))
        return compare(before, after, n_alternatives=n_alternatives).word

    driven, others = bench.driven[amcl], bench.driven[own]
    ratios = np.sqrt(driven.squares.mean(axis=2) / others.squares.mean(axis=2))
    differences = driven.lost.mean(axis=2) - others.lost.mean(axis=2)
    _, paths, drives = driven.squares.shape
    means = bench.means(amcl, paths, drives)
    levels = []
    at = np.flatnonzero(~np.isnan(means)).tolist()
    for n in at:
        squares, lost = driven.squares[n], driven.lost[n].astype(bool)
        errors = np.concatenate([each for key, each in driven.errors.items() if key[0] == n])
        levels.append(
            AtLevel(
                bench.levels[n],
                float(means[n]),
                of_geometric_mean(np.sqrt(squares.mean(axis=1))),
                math.nan if lost.all() else float(np.sqrt(squares[~lost].mean())),
                float(np.median(errors)),
                wilson(float(lost.mean()), lost.size),
                wilson(float(driven.off[n].mean()), lost.size),
                of_geometric_mean(ratios[n]),
                of_mean(differences[n]),
                verdict_at([n]),
            )
        )
    decide = [bench.levels[n].name in searched for n in at]
    some = list(itertools.compress(at, decide))
    ratio = of_geometric_mean(np.exp(np.log(ratios[some]).mean(axis=0)))
    deciding = tuple(itertools.compress(levels, decide))
    rest = (each for each in levels if each not in deciding)
    beyond = max(rest, key=lambda each: each.m, default=None)
    ms = 1e3 * float(driven.seconds[some].sum()) / (len(some) * drives)
    metres = float(bench.lengths.sum())
    on_wholes = map(WholeDrive.of, wholes[amcl], wholes[own], bench.parts)
    whole = min(on_wholes, key=lambda each: (each.holds, -each.rmse.value), default=None)
    costs = ms / bench.updates(amcl), ms / metres
    return Judged(name, amcl, deciding, ratio, verdict_at(some), *costs, whole, beyond)


def _drive_set(driven: Driven, levels: list[int]) -> DriveSet:
    """The drives of a setting at some levels as one set."""
    squares, lost, off = (
        each[levels].ravel() for each in (driven.squares, driven.lost, driven.off)
    )
    return DriveSet(0.5 * np.log(squares + FLOOR), lost == 1, off == 1)


def recoveries(bench: TuningBench, amcl: Amcl) -> tuple[Recovery, ...]:
    """What a setting does after it was lost on a bench, and after kidnappings."""
    driven = bench.driven[amcl]
    lost = driven.lost == 1
    found = [Recovery("after it was lost", int((driven.off[lost] == 0).sum()), int(lost.sum()))]
    for metres in KIDNAPPINGS:
        errors = bench.kidnapped(amcl, metres)
        found.append(Recovery.of(f"after a kidnapping of {metres:g} m", errors))
    return tuple(each for each in found if each.drives)
