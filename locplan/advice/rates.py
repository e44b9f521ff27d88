"""Rates of simulated drives, along routes and with fixes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from locplan._support.intervals import Interval, compute_wilson_interval
from locplan._support.kernels.arrays import Floats
from locplan.advice.fixes import CHEAP, KINDS, SETTINGS, WALLS
from locplan.advice.trials import Outcome
from locplan.planning.path import Path
from locplan.simulation.arrivals import ARRIVED, FOLLOWER, WORLD, Arrivals
from locplan.simulation.verdict import BETTER

RARE = 0.01
"""Rate of lost drives that needs no fix, unless it is surely larger."""
MISSED = 0.03
"""The same of closed-loop drives that miss the goal because of localization."""
LARGE = 0.25
"""Error of a typical drive from which on a fix may lower it though no drive is lost [m]."""
MODERATE = 0.1
"""The same of other AMCL settings, which take a parameter file only."""
NOTHING = Interval(math.nan, math.nan, math.nan)


def is_rare(lost: Interval) -> bool:
    """True if drives may be lost so rarely that no fix is needed."""
    return lost.low <= RARE


@dataclass(frozen=True)
class DriveRates:
    """Rates of the simulated drives along one route, or along all routes."""

    n_drives: int
    """Number of open-loop drives."""
    lost: Interval
    """Share of the open-loop drives that were lost, 0..1."""
    error: Interval
    """Error of a typical open-loop drive: geometric mean of the RMSE of the position [m]."""
    off_at_end: Interval = NOTHING
    """Share of the open-loop drives that are off at the end, 0..1."""
    n_closed: int = 0
    """Number of closed-loop drives."""
    reached: Interval = NOTHING
    """Share of the closed-loop drives that reach the goal, the mean over the routes, 0..1; NaN
    without any."""
    missed: Interval = NOTHING
    """Share of those that do not, and would with perfect localization, 0..1; NaN without any."""
    endings: Mapping[str, int] = field(default_factory=dict)
    """Number of the closed-loop drives that do not reach the goal by how they end: "elsewhere",
    "aborted", "timed out", or with perfect localization, too, "follower" or "world"."""

    @property
    def has_failure(self) -> bool:
        """True if a drive was lost or did not reach the goal."""
        return self.lost.value > 0 or bool(self.endings)

    @property
    def needs_fix(self) -> bool:
        """True if a drive was lost, or missed the goal because of localization."""
        return self.lost.value > 0 or self.missed.value > 0

    @property
    def keeps_place(self) -> bool:
        """True if drives are rarely lost, and rarely miss the goal because of localization."""
        return is_rare(self.lost) and not self.missed.low > MISSED

    @property
    def fails_localized(self) -> bool:
        """True if most of the drives that miss the goal do so with perfect localization, too."""
        localized = self.endings.get(FOLLOWER, 0) + self.endings.get(WORLD, 0)
        return localized >= 2 and 2 * localized >= sum(self.endings.values())

    @property
    def is_mostly_lost(self) -> bool:
        """True if drives are lost at least as often as they miss the goal: the main failure."""
        return not 1 - self.reached.value > self.lost.value

    @property
    def order(self) -> tuple[float, float]:
        """Shares of lost drives, and of drives that miss the goal, 0..1."""
        return self.lost.value, 0.0 if math.isnan(self.reached.value) else 1 - self.reached.value


@dataclass(frozen=True, repr=False)
class RouteResult:
    """The baseline's drives along one route."""

    name: str
    """Name of the route, of its start and goal."""
    path: Path
    """The shortest path."""
    rates: DriveRates
    """Rates of the drives."""
    lost_near: str
    """Letters of the places that lose a quarter of its lost drives or more."""
    lost_at: Floats = field(compare=False)
    """Positions where open-loop drives got lost, (n, 2) [m]."""
    stopped_near: str = ""
    """Letters of the places where closed-loop drives stop instead of at the goal."""
    stopped_at: Floats = field(default_factory=lambda: np.empty((0, 2)), compare=False)
    """Positions where closed-loop drives end that do not reach the goal, (n, 2) [m]."""

    def __repr__(self) -> str:
        lost, missed = self.rates.order
        return f"RouteResult({self.name}: {lost:.0%} lost, {1 - missed:.0%} reach the goal)"


@dataclass(frozen=True)
class FixResult:
    """The drives with one fix, compared with those of the baseline."""

    kind: str
    """"walls", "map", "range", "settings", "paths" or "landmarks"."""
    title: str
    """The fix in a few words."""
    detail: str
    """What exactly is changed."""
    effort: str
    """What it takes, in words."""
    verdict: str
    """"better", "worse", "no difference" or "undecided"; of a fix that does not lead after a few
    drives, on these."""
    rates: DriveRates
    """Rates of the drives with it."""
    gain: Interval
    """Share of the same drives that are no longer lost, less those that newly are."""
    ratio: Interval
    """Ratio of the errors with it to those without: geometric mean."""
    longer: float
    """What it makes a route longer, the mean over the routes [m]."""
    keeps_more: bool = False
    """True if it keeps drives from getting lost, and does not lower the error alone."""


def is_better(fix: FixResult) -> bool:
    """True if a fix is better than the baseline."""
    return fix.verdict == BETTER


def is_helpful(fix: FixResult, baseline: DriveRates) -> bool:
    """True if a fix is worth being recommended.

    A cheap fix may lower the error alone. If no drive fails because of localization, no fix is,
    unless the error is large, or walls are not read, which planners drive through, too.

    Parameters
    ----------
    fix : FixResult
        The fix.
    baseline : DriveRates
        Drives of the baseline.
    """
    min_error = MODERATE if fix.kind == SETTINGS else LARGE
    if not baseline.needs_fix and baseline.error.value < min_error and fix.kind != WALLS:
        return False
    return fix.keeps_more or (is_better(fix) and fix.kind in CHEAP)


def sort_routes(routes: Sequence[RouteResult], baseline: DriveRates) -> tuple[RouteResult, ...]:
    """Sort routes by the main failure of all drives, the worst first.

    Parameters
    ----------
    routes : sequence of RouteResult
        The routes.
    baseline : DriveRates
        Rates of all drives.
    """
    step = 1 if baseline.is_mostly_lost else -1
    return tuple(sorted(routes, key=lambda route: route.rates.order[::step], reverse=True))


def rank_fixes(fixes: Sequence[FixResult]) -> list[FixResult]:
    """Rank fixes, the best first: of those that keep as many drives as the best, the cheapest.

    Parameters
    ----------
    fixes : sequence of FixResult
        The fixes.
    """
    keeping = [fix for fix in fixes if fix.keeps_more]
    best_lost = min(
        (fix.rates.lost for fix in keeping or filter(is_better, fixes)), default=NOTHING
    )

    def key(fix: FixResult) -> tuple[bool, bool, float, float]:
        is_improvement = is_better(fix)
        as_good = is_improvement and fix.rates.lost.value <= best_lost.high
        is_inferior = is_improvement and bool(keeping) and fix not in keeping
        order = float(KINDS.index(fix.kind)) if as_good else fix.rates.lost.value
        return not is_improvement, is_inferior or not as_good, order, fix.ratio.value

    return sorted(fixes, key=key)


def compute_drive_rates(outcome: Outcome, arrivals: Mapping[str, Arrivals]) -> DriveRates:
    """Compute the rates of drives along some routes.

    A route counts as much as any other in the closed loop, however often it was driven.

    Parameters
    ----------
    outcome : Outcome
        The open-loop drives.
    arrivals : mapping of str to Arrivals
        The closed-loop drives of each route; empty without any.
    """
    endings = Counter[str]()
    for drives in arrivals.values():
        endings.update(d.fault or d.outcome for d in drives.drives if d.outcome != ARRIVED)
    reached = missed = NOTHING
    if arrivals:
        counts = np.array([len(drives.drives) for drives in arrivals.values()])
        size = len(counts) ** 2 / (1 / counts).sum()
        shares = np.array([drives.count for drives in arrivals.values()]) / counts
        misses = [
            sum(not d.fault and d.outcome != ARRIVED for d in drives.drives)
            for drives in arrivals.values()
        ]
        reached, missed = (
            compute_wilson_interval(float(route_shares.mean()), size)
            for route_shares in (shares, np.array(misses) / counts)
        )
    n_closed = sum(len(drives.drives) for drives in arrivals.values())
    drive_set = outcome.drive_set
    return DriveRates(
        n_drives=outcome.lost.size,
        lost=drive_set.lost_rate,
        error=drive_set.error,
        off_at_end=drive_set.off_at_end_rate,
        n_closed=n_closed,
        reached=reached,
        missed=missed,
        endings=endings,
    )
