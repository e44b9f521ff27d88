"""The drives of a check: baseline, each fix alone, and the best fixes combined."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from locplan._support.progress import ProgressCallback, split_progress
from locplan.advice import fixes as _fixes
from locplan.advice.driving import Scenario, ScenarioRunner
from locplan.advice.failures import FailurePassage, attribute_failures, find_failure_passage
from locplan.advice.fixes import (
    CHEAP,
    CORRECTED_MAP,
    FULL_RANGE,
    KINDS,
    REPAIRED_MAP,
    SETTINGS,
    Fix,
)
from locplan.advice.map_reading import MapCorrection
from locplan.advice.preset_choice import LevelCase, PresetChoice
from locplan.advice.rates import (
    LARGE_ERROR,
    DriveRates,
    FixResult,
    RouteResult,
    compute_drive_rates,
    is_helpful,
    is_loss_rate_low,
    rank_fixes,
    sort_routes,
)
from locplan.advice.recorded import RecordingEvidence
from locplan.advice.settings import choose_settings, do_recordings_contradict
from locplan.advice.trials import (
    DrivesOnRoutes,
    FixTrial,
    compare_fix,
    confirm_fixes,
    select_fixes,
    try_fix,
)
from locplan.advice.weak_spots import WeakSpot
from locplan.field.field import CovarianceField
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap
from locplan.robots.amcl import Amcl
from locplan.simulation.arrivals import Arrivals
from locplan.simulation.driver import FIRST_CHOOSING_DRIVE, FIRST_FRESH_DRIVE
from locplan.simulation.levels import NO_FAULT
from locplan.simulation.problem import RecommendationSettings
from locplan.simulation.recommendation import Recommendation
from locplan.simulation.recommender import recommend_path
from locplan.simulation.verdict import BETTER, DriveSet, RatePair, Verdict, compare_drives

FAILING = 16
"""Number of closed-loop drives along a route on which a drive fails, unless routes are long."""
LONG, MIN_SHARE = 30.0, 1 / 3
"""Mean length of routes above which they have fewer drives [m], and the minimum share of drives.
A long route has more places where drives fail."""
LOSING, LOSING_LENGTH = 3, 100.0
"""Maximum number of routes for which other paths are tried, and their maximum length together [m]:
a dozen candidates drive along each."""
LONGEST_ROUTES = 400.0
"""Maximum total length of the routes for trying poles [m]: three poles help on small sites."""


@dataclass(frozen=True)
class CheckEffort:
    """Amount of simulated drives."""

    max_routes: int
    """Maximum number of routes between places far apart."""
    n_trial_drives: int
    """Number of drives, along all routes together, after which a fix must lead."""
    n_drives: int
    """Number of drives of the baseline and of each leading fix."""
    n_closed: int
    """Number of closed-loop drives."""
    n_confirming: int
    """Maximum number of confirming drives of a path; 0 tries no paths."""
    tries_landmarks: bool
    """True if landmarks are tried."""
    drives_all_levels: bool = False
    """True if all settings are simulated at all levels of disturbance, not only until one wins."""


EFFORTS = {
    "quick": CheckEffort(4, 12, 32, 16, 0, False),
    "usual": CheckEffort(6, 24, 96, 48, 16, True),
    "thorough": CheckEffort(6, 48, 288, 96, 64, True, drives_all_levels=True),
}


class BaselineDrives(NamedTuple):
    """Drives of the robot on the map, both as the user has them."""

    rates: DriveRates
    """Rates of all drives."""
    routes: tuple[RouteResult, ...]
    """The routes, first those with the highest rate of the main failure."""
    spots: tuple[WeakSpot, ...]
    """The places where drives fail, and the other weak spots."""
    passage: FailurePassage | None
    """The place where robots fail even with perfect localization, if most failures are of that
    kind."""


class FixTrials:
    """Runner of the drives of one check: baseline, fixes and their combination.

    Parameters
    ----------
    scenario : Scenario
        The site of the baseline.
    effort : Effort
        Amount of drives.
    evidence : Recorded
        Evidence from recorded drives.
    seed : int
        Seed of all random numbers.
    threads : int or None
        Number of threads.
    """

    def __init__(
        self,
        scenario: Scenario,
        effort: CheckEffort,
        evidence: RecordingEvidence,
        seed: int,
        threads: int | None,
    ) -> None:
        self.scenario, self.effort, self.seed, self.threads = scenario, effort, seed, threads
        self.fixes_by_kind: dict[str, Fix] = {}
        self.preset_choice: PresetChoice | None = None
        self._evidence = evidence
        self.recommended_kinds: tuple[str, ...] = ()
        mean_length = sum(path.length for path in scenario.paths.values()) / len(scenario.paths)
        share = min(1.0, max(MIN_SHARE, LONG / mean_length))
        n_trial, n_full, closed = (
            math.ceil(number * share / len(scenario.paths))
            for number in (effort.n_trial_drives, effort.n_drives, effort.n_closed)
        )
        self._failing = math.ceil(FAILING * share)
        # Fixes are chosen, judged, and what is recommended confirmed, on drives of their own.
        self._trial_numbers, self._numbers = (
            range(FIRST_CHOOSING_DRIVE, FIRST_CHOOSING_DRIVE + n_trial),
            range(n_full),
        )
        self._fresh = range(FIRST_FRESH_DRIVE, FIRST_FRESH_DRIVE + n_full)
        self._closed = closed
        self._n_closed = dict.fromkeys(scenario.paths, closed)
        self._drive = _fixes.make_scenario_runner(seed, threads)
        self._arrivals: dict[str, dict[str, Arrivals]] = defaultdict(dict)

    def drive_baseline(
        self, spots: Sequence[WeakSpot], progress: ProgressCallback
    ) -> BaselineDrives:
        """Simulate the baseline, and count the failed drives of each place.

        Parameters
        ----------
        spots : sequence of WeakSpot
            The weak spots of the map.
        progress : callable
            Called with (done, total).
        """
        paths = self.scenario.paths
        n_drives = len(self._numbers) * len(paths)
        steps = split_progress(progress, [n_drives, n_drives])
        self._before = outcome = self._drive(self.scenario, self._numbers, steps[0])
        arrivals = self._drive_closed(self.scenario, self._n_closed)
        # A route with a failure is driven often enough to be ranked.
        for name, lost in zip(paths, outcome.lost, strict=True):
            if lost.any() or (name in arrivals and arrivals[name].failure_counts):
                self._n_closed[name] = max(self._failing, self._n_closed[name])
        arrivals = self._drive_closed(self.scenario, self._n_closed)
        steps[1](n_drives, n_drives)
        spots, failures = attribute_failures(
            spots, paths, [*outcome.lost_at], arrivals, self.scenario.world
        )
        rates = compute_drive_rates(outcome, arrivals)
        routes = [
            RouteResult(name, path, _compute_route_rates(outcome, n, name, arrivals), *failures[n])
            for n, (name, path) in enumerate(paths.items())
        ]
        passage = None
        if rates.fails_if_localized:
            passage = find_failure_passage(
                self.scenario.world, self.scenario.robot, paths, arrivals
            )
        self._baseline = BaselineDrives(rates, sort_routes(routes, rates), spots, passage)
        return self._baseline

    def try_fixes(
        self,
        correction: MapCorrection,
        repaired_map: OccupancyGrid,
        costs: Costmap,
        field: CovarianceField,
        progress: ProgressCallback,
    ) -> Iterator[FixResult]:
        """Yield the result of each applicable fix, cheap ones first.

        Paths and poles are tried only if drives still get lost with the cheap fixes.

        Parameters
        ----------
        reading : Reading
            How the map's file should be read.
        repaired_map : OccupancyGrid
            The repaired map for the filter.
        costs, field
            The costmap and the field, for recommended paths.
        progress : callable
            Called with (done, total).
        """
        first, second = split_progress(progress, [200, 150])
        fixes = [*_fixes.iterate_fixes(self.scenario, correction, repaired_map)]
        rates, passage = self._baseline.rates, self._baseline.passage
        is_localized = not rates.needs_fix and rates.error.value < LARGE_ERROR
        if passage and is_localized:
            # No change of localization gets the robot through.
            fixes = [fix for fix in fixes if fix.kind == CORRECTED_MAP]
        if isinstance(self.scenario.robot.filter, Amcl) and (
            self._evidence.replays or not (passage and is_localized)
        ):
            self.preset_choice = self._choose_preset()
            fixes += filter(None, [_fixes.make_preset_fix(self.preset_choice)])
        results = []
        for fix, step in zip(fixes, split_progress(first, [1] * len(fixes)), strict=True):
            results.append(self._try_fix(fix))
            yield results[-1]
            step(1, 1)
        if self.effort.n_confirming and self._is_still_lost(results):
            recommendations = self._recommend_paths(costs, field, second)
            if other_paths := _fixes.choose_paths_fix(
                self.scenario, recommendations, self._score_scenario
            ):
                results.append(self._try_fix(other_paths))
                yield results[-1]
        length = sum(path.length for path in self.scenario.paths.values())
        is_small = self.effort.tries_landmarks and length <= LONGEST_ROUTES
        if not is_small or is_loss_rate_low(rates.lost) or not self._is_still_lost(results):
            return
        if poles := _fixes.make_poles_fix(self.scenario, self.threads):
            yield self._try_fix(poles)

    def _choose_preset(self) -> PresetChoice:
        """Choose AMCL's settings. At the usual level, reuse the numbers of the fixes' drives."""

        def drive_usual(amcl: Amcl, numbers: range) -> DriveSet:
            return self._drive(_fixes.with_filter_settings(self.scenario, amcl), numbers).drive_set

        looks = [len(self._trial_numbers)] if len(self._trial_numbers) < len(self._numbers) else []
        return choose_settings(
            self.scenario,
            LevelCase(NO_FAULT.name, drive_usual, (*looks, len(self._numbers))),
            self._evidence,
            drives_all=self.effort.drives_all_levels,
            seed=self.seed,
            threads=self.threads,
        )

    def _is_still_lost(self, results: Sequence[FixResult]) -> bool:
        """True if drives get lost with the best combination of fixes so far."""
        return not is_loss_rate_low(
            self._drive_with_fixes(self._select_fixes(results), self._numbers).drive_set.lost_rate
        )

    def _select_fixes(self, results: Sequence[FixResult]) -> tuple[str, ...]:
        """Select the fixes that help together."""
        order = [
            result.kind
            for result in rank_fixes(results)
            if is_helpful(result, self._baseline.rates)
        ]
        return select_fixes(
            self._certain_fix_kinds,
            [kind for kind in order if kind not in self._certain_fix_kinds],
            self._drive_with_fixes,
            self._numbers,
            costly_kinds=[kind for kind in KINDS if kind not in CHEAP],
        )

    @property
    def _certain_fix_kinds(self) -> tuple[str, ...]:
        return tuple(kind for kind, fix in self.fixes_by_kind.items() if fix.is_certain)

    def _score_scenario(self, scenario: Scenario) -> float:
        before = self._drive(self.scenario, self._trial_numbers)
        return compare_fix(before, self._drive(scenario, self._trial_numbers)).score

    def _recommend_paths(
        self, costs: Costmap, field: CovarianceField, progress: ProgressCallback
    ) -> dict[str, Recommendation]:
        """Return the recommended paths of the routes that lose most drives."""
        scenario, recommendations = self.scenario, {}
        losses = dict(zip(scenario.paths, self._before.lost.sum(axis=1), strict=True))
        losing = [name for name, path in scenario.paths.items() if path.length <= LOSING_LENGTH]
        losing = sorted(filter(losses.get, losing), key=lambda name: -losses[name])[:LOSING]
        lengths = np.cumsum([scenario.paths[name].length for name in losing])
        losing = losing[: int((lengths <= LOSING_LENGTH).sum())]
        for name, step in zip(losing, split_progress(progress, [100] * len(losing)), strict=True):
            start, goal = map(tuple, scenario.paths[name].xy[[0, -1]].tolist())
            recommendation = recommend_path(
                scenario.world,
                start,
                goal,
                scenario.robot,
                costs=costs,
                settings=RecommendationSettings(
                    drives=self.effort.n_confirming,
                    rival=None,
                    filter_map=None
                    if scenario.filter_map is scenario.world
                    else scenario.filter_map,
                ),
                seed=self.seed,
                threads=self.threads,
            )
            recommendations[name] = recommendation.with_field(field)
            step(100, 100)
        return recommendations

    def _try_fix(self, fix: Fix) -> FixResult:
        """Simulate drives with a fix, and stop early if it does not lead."""
        self.fixes_by_kind[fix.kind] = fix
        scenario = fix.apply(self.scenario)
        if fix.kind == SETTINGS:  # the choice of the preset has driven with it already
            outcome = self._drive(scenario, self._numbers)
            trial = FixTrial(compare_fix(self._before, outcome), outcome, False)
        else:
            before_few = self._drive(self.scenario, self._trial_numbers)
            baseline_drives = (self._trial_numbers, before_few), (self._numbers, self._before)
            trial = try_fix(partial(self._drive, scenario), *baseline_drives)
        # The closed loop is simulated only for fixes that may be recommended.
        is_candidate = trial.contrast.verdict.word == BETTER
        return self._make_result(
            fix, scenario, trial, self._drive_closed(scenario) if is_candidate else {}
        )

    def _make_result(
        self, fix: Fix, scenario: Scenario, trial: FixTrial, arrivals: Mapping[str, Arrivals]
    ) -> FixResult:
        old, new = (
            sum(p.length for p in compared_scenario.paths.values())
            for compared_scenario in (self.scenario, scenario)
        )
        return FixResult(
            fix.kind,
            fix.title,
            fix.detail,
            fix.effort,
            trial.contrast.verdict.word,
            compute_drive_rates(trial.outcome, arrivals),
            trial.contrast.gain,
            trial.contrast.verdict.ratio,
            (new - old) / len(scenario.paths),
            trial.contrast.has_fewer_lost,
        )

    def combine_fixes(
        self, results: Sequence[FixResult], progress: ProgressCallback
    ) -> tuple[DriveRates, DriveRates, Verdict | None]:
        """Combine the fixes that help, and confirm the combination by fresh drives.

        Parameters
        ----------
        results : sequence of FixResult
            The fixes that were tried.
        progress : callable
            Called with (done, total).

        Returns
        -------
        before, after, verdict
            Rates of the drives without and with the fixes, and their verdict.
        """
        rates = self._baseline.rates
        selected = self._select_fixes(results)
        if self._do_recordings_contradict(selected):
            selected = self._certain_fix_kinds
        if selected:
            combination = confirm_fixes(
                self._certain_fix_kinds,
                selected,
                self._drive_with_fixes,
                self._numbers,
                self._fresh,
            )
            self.recommended_kinds = combination.kinds
        progress(1, 1)
        if not self.recommended_kinds:
            return rates, rates, None
        scenario = _fixes.apply_fixes(self.fixes_by_kind, self.recommended_kinds, self.scenario)
        before = compute_drive_rates(
            combination.before, self._drive_closed(self.scenario, self._n_closed)
        )
        after = compute_drive_rates(combination.after, self._drive_closed(scenario))
        verdict = compare_drives(combination.before.drive_set, combination.after.drive_set)
        return before, after, _add_reached_rates(verdict, before, after)

    def _do_recordings_contradict(self, kinds: tuple[str, ...]) -> bool:
        """True if a recorded drive contradicts a fix of the filter's map or range."""
        if not {FULL_RANGE, REPAIRED_MAP} & {*kinds}:
            return False
        fixed = _fixes.apply_fixes(self.fixes_by_kind, kinds, self.scenario)
        return do_recordings_contradict(self.scenario, fixed, self._evidence)

    def _drive_with_fixes(self, kinds: tuple[str, ...], numbers: range) -> DrivesOnRoutes:
        return self._drive(_fixes.apply_fixes(self.fixes_by_kind, kinds, self.scenario), numbers)

    def _drive_closed(
        self, scenario: Scenario, counts: Mapping[str, int] | None = None
    ) -> dict[str, Arrivals]:
        """Drive each route in closed loop until it has its number of drives; cache the drives."""
        route_arrivals = self._arrivals[scenario.digest]
        missing: dict[range, list[str]] = defaultdict(list)
        for name in scenario.paths:
            count = counts[name] if counts else self._closed
            missing[
                range(len(route_arrivals[name].drives) if name in route_arrivals else 0, count)
            ].append(name)
        for numbers, names in missing.items():
            if numbers:
                part = replace(scenario, paths={name: scenario.paths[name] for name in names})
                new_arrivals = ScenarioRunner(part, self.seed, self.threads).drive_closed_loop(
                    numbers
                )
                for name, arrivals in zip(names, new_arrivals, strict=False):
                    earlier_drives = route_arrivals[name].drives if name in route_arrivals else ()
                    route_arrivals[name] = Arrivals((*earlier_drives, *arrivals.drives))
        return dict(route_arrivals)


def _compute_route_rates(
    route_drives: DrivesOnRoutes, route_number: int, name: str, arrivals: Mapping[str, Arrivals]
) -> DriveRates:
    closed = {name: arrivals[name]} if name in arrivals else {}
    return compute_drive_rates(route_drives.select(slice(route_number, route_number + 1)), closed)


def _add_reached_rates(verdict: Verdict, before: DriveRates, after: DriveRates) -> Verdict:
    """Return a verdict with the rates of closed-loop drives that reach the goal."""
    if not before.n_closed:
        return verdict
    return replace(verdict, reached=RatePair(before.reached, after.reached))
