"""Rates of simulated drives, along routes and with fixes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from locplan._support.intervals import Interval, compute_wilson_interval
from locplan._support.kernels.arrays import Floats
from locplan.advice.fixes import CHEAP, CORRECTED_MAP, KINDS, SETTINGS
from locplan.advice.trials import DrivesOnRoutes
from locplan.planning.path import Path
from locplan.simulation.arrivals import ARRIVED, FOLLOWER_FAULT, WORLD_FAULT, Arrivals
from locplan.simulation.verdict import BETTER

MAX_LOST_RATE = 0.01
"""Loss rate that needs no fix; a higher rate counts if its whole interval is above."""
MAX_MISSED_RATE = 0.03
"""The same for closed-loop drives that miss the goal because of localization."""
LARGE_ERROR = 0.25
"""Typical error above which a fix may be recommended although no drive is lost [m]."""
MODERATE_ERROR = 0.1
"""The same for AMCL settings, which only take a parameter file [m]."""
UNKNOWN_RATE = Interval(math.nan, math.nan, math.nan)


def is_loss_rate_low(loss_rate: Interval) -> bool:
    """True if the loss rate may be low enough to need no fix."""
    return loss_rate.low <= MAX_LOST_RATE


@dataclass(frozen=True)
class DriveRates:
    """Rates of the simulated drives along one route, or along all routes."""

    n_drives: int
    """Number of open-loop drives."""
    lost: Interval
    """Share of the open-loop drives that were lost, 0..1."""
    error: Interval
    """Error of a typical open-loop drive: geometric mean of the RMSE of the position [m]."""
    off_at_end: Interval = UNKNOWN_RATE
    """Share of the open-loop drives that are off at the end, 0..1."""
    n_closed: int = 0
    """Number of closed-loop drives."""
    reached: Interval = UNKNOWN_RATE
    """Share of the closed-loop drives that reach the goal, the mean over the routes, 0..1; NaN
    without any."""
    missed: Interval = UNKNOWN_RATE
    """Share of the closed-loop drives that miss the goal because of localization, 0..1; NaN
    without any."""
    endings: Mapping[str, int] = field(default_factory=dict)
    """Number of failed closed-loop drives by their ending: "elsewhere", "aborted", "timed out"; or
    "follower" or "world", which fail even with perfect localization."""

    @property
    def has_failure(self) -> bool:
        """True if a drive was lost or did not reach the goal."""
        return self.lost.value > 0 or bool(self.endings)

    @property
    def needs_fix(self) -> bool:
        """True if a drive was lost, or missed the goal because of localization."""
        return self.lost.value > 0 or self.missed.value > 0

    @property
    def is_reliable(self) -> bool:
        """True if drives are rarely lost, and rarely miss the goal because of localization."""
        return is_loss_rate_low(self.lost) and not self.missed.low > MAX_MISSED_RATE

    @property
    def fails_if_localized(self) -> bool:
        """True if most failed closed-loop drives fail even with perfect localization."""
        localized = self.endings.get(FOLLOWER_FAULT, 0) + self.endings.get(WORLD_FAULT, 0)
        return localized >= 2 and 2 * localized >= sum(self.endings.values())

    @property
    def is_mostly_lost(self) -> bool:
        """True if getting lost is the main failure, not missing the goal."""
        return not 1 - self.reached.value > self.lost.value

    @property
    def failure_shares(self) -> tuple[float, float]:
        """Shares of lost drives, and of drives that miss the goal, 0..1."""
        return self.lost.value, 0.0 if math.isnan(self.reached.value) else 1 - self.reached.value


@dataclass(frozen=True, repr=False)
class RouteResult:
    """Baseline results of one route."""

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
    """Letters of the places where closed-loop drives miss the goal."""
    stopped_at: Floats = field(default_factory=lambda: np.empty((0, 2)), compare=False)
    """Positions where closed-loop drives end that do not reach the goal, (n, 2) [m]."""

    def __repr__(self) -> str:
        lost, missed = self.rates.failure_shares
        return f"RouteResult({self.name}: {lost:.0%} lost, {1 - missed:.0%} reach the goal)"


@dataclass(frozen=True)
class FixResult:
    """Results of one fix, compared with the baseline."""

    kind: str
    """"walls", "map", "range", "settings", "paths" or "landmarks"."""
    title: str
    """The fix in a few words."""
    detail: str
    """What exactly is changed."""
    effort: str
    """The work that it takes, in words."""
    verdict: str
    """"better", "worse", "no difference" or "undecided"; after a few drives if it did not lead."""
    rates: DriveRates
    """Rates of the drives with it."""
    gain: Interval
    """Share of drives no longer lost minus share of drives newly lost, -1..1."""
    ratio: Interval
    """Geometric mean of the ratio of the error with the fix to the error without it."""
    longer: float
    """Mean extra length of a route with it [m]."""
    has_fewer_lost: bool = False
    """True if it is better because fewer drives get lost."""


def is_better(fix: FixResult) -> bool:
    """True if a fix is better than the baseline."""
    return fix.verdict == BETTER


def is_helpful(fix: FixResult, baseline: DriveRates) -> bool:
    """True if a fix is worth being recommended.

    A cheap fix may also be recommended for a lower error. If no drive fails because of
    localization, only fixes of a large error are helpful, and corrections of unread walls, since
    planners would drive through them.

    Parameters
    ----------
    fix : FixResult
        The fix.
    baseline : DriveRates
        Drives of the baseline.
    """
    min_error = MODERATE_ERROR if fix.kind == SETTINGS else LARGE_ERROR
    if not baseline.needs_fix and baseline.error.value < min_error and fix.kind != CORRECTED_MAP:
        return False
    return fix.has_fewer_lost or (is_better(fix) and fix.kind in CHEAP)


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
    return tuple(sorted(routes, key=lambda route: route.rates.failure_shares[::step], reverse=True))


def rank_fixes(fixes: Sequence[FixResult]) -> list[FixResult]:
    """Rank fixes, the best first; among fixes with equal loss rates, the cheapest comes first.

    Parameters
    ----------
    fixes : sequence of FixResult
        The fixes.
    """
    keeping = [fix for fix in fixes if fix.has_fewer_lost]
    best_lost = min(
        (fix.rates.lost for fix in keeping or filter(is_better, fixes)), default=UNKNOWN_RATE
    )

    def key(fix: FixResult) -> tuple[bool, bool, float, float]:
        is_improvement = is_better(fix)
        as_good = is_improvement and fix.rates.lost.value <= best_lost.high
        is_inferior = is_improvement and bool(keeping) and fix not in keeping
        order = float(KINDS.index(fix.kind)) if as_good else fix.rates.lost.value
        return not is_improvement, is_inferior or not as_good, order, fix.ratio.value

    return sorted(fixes, key=key)


def compute_drive_rates(
    route_drives: DrivesOnRoutes, arrivals: Mapping[str, Arrivals]
) -> DriveRates:
    """Compute the rates of drives along some routes.

    In closed loop all routes have equal weight, whatever their number of drives.

    Parameters
    ----------
    route_drives : Outcome
        The open-loop drives.
    arrivals : mapping of str to Arrivals
        The closed-loop drives of each route; empty without any.
    """
    endings = Counter[str]()
    for drives in arrivals.values():
        endings.update(d.fault or d.outcome for d in drives.drives if d.outcome != ARRIVED)
    reached = missed = UNKNOWN_RATE
    if arrivals:
        counts = np.array([len(drives.drives) for drives in arrivals.values()])
        size = len(counts) ** 2 / (1 / counts).sum()
        shares = np.array([drives.n_reached for drives in arrivals.values()]) / counts
        misses = [
            sum(not d.fault and d.outcome != ARRIVED for d in drives.drives)
            for drives in arrivals.values()
        ]
        reached, missed = (
            compute_wilson_interval(float(route_shares.mean()), size)
            for route_shares in (shares, np.array(misses) / counts)
        )
    n_closed = sum(len(drives.drives) for drives in arrivals.values())
    drive_set = route_drives.drive_set
    return DriveRates(
        n_drives=route_drives.lost.size,
        lost=drive_set.lost_rate,
        error=drive_set.error,
        off_at_end=drive_set.off_at_end_rate,
        n_closed=n_closed,
        reached=reached,
        missed=missed,
        endings=endings,
    )
