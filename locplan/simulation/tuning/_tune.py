"""AMCL's settings tuned by simulated drives along random shortest paths of a map.

The search is successive halving of settings drawn at random, then steps from the best ones along
each axis; what of the best hardly matters is put back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from locplan._util.checks import one_of, whole
from locplan._util.intervals import random_of
from locplan._util.progress import ProgressCallback, parts, scaled
from locplan.costs import Costmap
from locplan.maps import OccupancyGrid, check_grid
from locplan.robots import Amcl, Robot
from locplan.simulation._drives import check_drives
from locplan.simulation._simulator import Simulator
from locplan.simulation.tuning._bench import DisturbanceLevel, TuningBench
from locplan.simulation.tuning._judged import judged_beside
from locplan.simulation.tuning._results import OWN, Tuning
from locplan.simulation.tuning._simulated_bench import LEVELS, TEN_TIMES, SimulatedBench
from locplan.simulation.tuning._space import (
    BeamsLeft,
    beside,
    candidates,
    changed_axes,
    described,
    filter_warnings,
    nav2_defaults,
)

WORSE, WORSE_AT_A_COST = math.log(1.02), math.log(1.1)
"""Increase of the logarithm of the error up to which a change is put back, and one that makes the
filter compare more beams a metre."""
STEPS = 3
"""Maximum number of steps from the best two settings, each along every axis."""
SEARCH, JUDGE, DRAW = 11, 12, 13
"""Streams of random numbers, from which the seeds of both sets of drives are drawn."""


def tune(
    grid: OccupancyGrid,
    robot: Robot | None = None,
    *,
    paths: int = 20,
    drives: int = 8,
    odometry: str = "usual",
    filter_map: OccupancyGrid | None = None,
    others: Mapping[str, object] | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Tuning:
    """Find settings of AMCL that localize a robot better on its map than its own ones.

    Settings drive the same random shortest paths with the same seeds, at three levels of
    disturbance: with a third of, once and three times the errors of odometry. The one whose error
    at its worst level is least is found by successive halving; what it need not change is put
    back. Then it is judged against the user's own on other paths, in other worlds.

    The first rungs of the search drive at the strongest level alone, the worst one of nearly every
    setting; the others are driven for those that could be chosen.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your own, such as `Robot.from_nav2` reads.
    paths : int, default 20
        Number of random paths, 5 to 1000; the search and the judgement have their own. More of
        them narrow the intervals.
    drives : int, default 8
        Number of drives along each path at each level, 2 to 100,000.
    odometry : {"usual", "poor"}, default "usual"
        "poor" searches for a robot whose odometry drifts up to ten times as much as that of
        `robot`: at once, three and ten times its errors.
    filter_map : OccupancyGrid, optional
        The filter's map in the same frame, where it differs from `grid`; see `simulate`.
    others : mapping of str to object, optional
        Further parameters in the user's file, such as `z_short`, for the warnings.
    seed : int, default 1
        Seed of all random numbers, >= 0; equal seeds give equal results, but for times of the CPU.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) in thousandths of the work.

    Returns
    -------
    Tuning
        The settings to use, and the evidence for them.

    Raises
    ------
    LocplanError
        If the map has no two free positions 2 m apart that are joined, or a number is out of its
        range.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> robot = locplan.Robot().changed({"min_particles": 20, "max_particles": 20})
    >>> result = tune(grid, robot, paths=5, drives=2)
    >>> result.judged[0].name, result.winner.min_particles
    ('your settings', 20)
    """
    check_grid(grid)
    whole("paths", paths, TuningBench.fewest_paths, 1000)
    check_drives(drives)
    one_of("odometry", odometry, LEVELS)
    about = Simulator(grid, robot, filter_map=filter_map, seed=seed, threads=threads)
    costs = Costmap.blank(grid, robot=about.robot)

    def bench_of(own_seed: int, judging: bool) -> SimulatedBench:
        lines = SimulatedBench.paths(costs, paths, own_seed)
        levels: tuple[DisturbanceLevel, ...] = LEVELS[odometry]
        if judging and TEN_TIMES not in levels:  # where they may no longer hold
            levels = (*levels, TEN_TIMES)
        own: Any = {
            "levels": levels,
            "filter_map": filter_map,
            "seed": own_seed,
            "threads": threads,
        }
        return SimulatedBench(grid, about.robot, lines, drives, **own)

    left = BeamsLeft.on_map(about)
    own: Any = {"left": left, "others": others, "seed": seed, "progress": progress}
    return search_settings(bench_of, about.robot, drives, **own)


def search_settings(
    bench_of: Callable[[int, bool], TuningBench],
    robot: Robot,
    drives: int,
    *,
    left: BeamsLeft,
    others: Mapping[str, object] | None,
    seed: int,
    progress: ProgressCallback | None,
    drive: str = "",
    notes: Sequence[str] = (),
    like: Sequence[Amcl] = (),
) -> Tuning:
    """Search settings on one bench, and judge what was found on another.

    Parameters
    ----------
    bench_of : callable
        Makes a bench of a seed, and of whether settings are judged on it.
    robot : Robot
        The robot, with the user's own settings of the filter.
    drives : int
        Number of drives along each path of a bench.
    left : BeamsLeft
        Number of the beams compared that return.
    others : mapping of str to object or None
        Further parameters in the user's file, for the warnings.
    seed : int
        Seed of all random numbers, >= 0.
    progress : callable or None
        Called with (done, total) in thousandths of the work.
    drive : str, default ""
        Name of the recorded drive, if the paths are its stretches.
    notes : sequence of str, default ()
        What limits the result, beside the warnings.

    like : sequence of Amcl, default ()
        Settings that are tried besides those drawn at random.

    Returns
    -------
    Tuning
        The settings to use, and the evidence for them.
    """

    def bench(stream: int) -> TuningBench:
        own_seed = int(random_of(seed, stream).integers(2**31))
        return bench_of(own_seed, stream == JUDGE)

    own = robot.amcl
    # Shares of the time that the rungs, with the steps before the last one, what is put back, and
    # the judgement take.
    shares = 130, 120, *[50] * STEPS, 180, 130, 290
    steps = iter([scaled(*step) for step in zip(parts(progress, shares), shares, strict=True)])
    search = Search(bench(SEARCH), own, drives)
    tried = candidates(own, random_of(seed, DRAW), like)
    kept, frugal, best, without = search.run(tried, steps)
    defaults = nav2_defaults(own)
    names = {own: OWN, defaults: "Nav2's defaults"}  # the latter's name if they are the same
    for each in (kept, frugal, best):
        names.setdefault(each, described(own, each))
    order = dict.fromkeys([own, kept, frugal, best, defaults])
    warned: tuple[str, ...] = ()
    if kept.multiplies and not own.multiplies and (others or {}).get("do_beamskip"):
        skips = "do_beamskip becomes false with the laser model, since only this one reads it"
        warned = (f"{skips}, and it was not simulated",)
    rungs, searched = tuple(search.rungs), len(search.bench.levels)
    del search
    judge = bench(JUDGE)
    judge.drive([*order], len(judge.lines), drives, progress=next(steps))
    wholes = {each: judge.whole(each) for each in order}
    return Tuning(
        judge.grid,
        robot,
        kept,
        tuple(judged_beside(judge, names[each], each, own, wholes, searched) for each in order),
        without,
        left,
        (*warned, *filter_warnings(own, judge.lidar, others), *left.warnings()),
        rungs,
        len(judge.lines),
        drives,
        seed,
        judge.seed,
        drive,
        None if judge.filter_map is judge.grid else judge.filter_map,
        tuple(notes),
    )


class Search:
    """Search among settings that all drive on one bench.

    Parameters
    ----------
    bench : Bench
        What drives them.
    own : Amcl
        The user's own settings.
    drives : int
        Number of drives along each path of the last rung.
    """

    def __init__(self, bench: TuningBench, own: Amcl, drives: int) -> None:
        self.bench, self.own, paths = bench, own, len(bench.lines)
        # Nearly every setting is worst there; other levels are driven where they can matter.
        self.strongest = [len(bench.levels) - 1]
        # A quarter, then half of the paths and of the drives, and how many settings stay.
        self.parts = [
            (max(1, paths // part), max(1, drives // part), stay)
            for part, stay in ((4, 16), (2, 5))
        ]
        self.last = paths, drives
        self.rungs: list[tuple[int, int, int]] = []

    def run(
        self, settings: Sequence[Amcl], progress: Iterator[ProgressCallback]
    ) -> tuple[Amcl, Amcl, Amcl, dict[str, float]]:
        """Find the best of the settings, the first of which is the user's own.

        `progress` has a callback for each rung and step, and one for what is put back.

        Returns
        -------
        kept : Amcl
            The best one with the user's own values put back where that costs next to nothing.
        frugal : Amcl
            Best setting, of those that compare no more beams a metre than the user's own.
        best : Amcl
            Setting that is best at its worst level.
        without : dict of str to float
            Error without each change of the best setting, relative to that with it, by axis.
        """
        staying = list(settings)
        for paths, drives, stay in self.parts:
            self.bench.drive(staying, paths, drives, self.strongest, next(progress))
            self.rungs.append((len(staying), paths, drives))
            ranked = self._ranked(staying, paths, drives)
            staying = self._first(ranked, stay)
        for each_step in [next(progress) for _ in range(STEPS)]:
            near = [each for amcl in staying[:2] for each in beside(self.own, amcl)]
            self.bench.drive(near, paths, drives, self.strongest, each_step)
            self.rungs.append((len(near), paths, drives))
            ranked = self._ranked([*ranked, *near], paths, drives)
            if self._first(ranked, stay) == staying:
                break
            staying = self._first(ranked, stay)
        self.bench.drive(staying, *self.last, self.strongest, next(progress))
        self.rungs.append((len(staying), *self.last))
        best = self._least(staying)
        frugal = self._least([amcl for amcl in staying if self._is_frugal(amcl)])
        kept, without = self._put_back(best, next(progress))
        return kept, frugal, best, without

    def _ranked(self, settings: Sequence[Amcl], paths: int, drives: int) -> list[Amcl]:
        """The settings, the best first."""
        every = dict.fromkeys(settings)
        return sorted(every, key=lambda amcl: self._known(amcl, paths, drives))

    def _first(self, ranked: Sequence[Amcl], count: int) -> list[Amcl]:
        """The best, and the best two that compare no more beams than the user's own."""
        frugal = [amcl for amcl in ranked if self._is_frugal(amcl)]
        return [*dict.fromkeys([*ranked[:count], *frugal[:2]])]

    def _is_frugal(self, amcl: Amcl) -> bool:
        return self.beams(amcl) <= self.beams(self.own)

    def beams(self, amcl: Amcl) -> int:
        """Beams that a setting compares on one drive along every path."""
        return self.bench.updates(amcl) * amcl.max_beams

    def _known(self, amcl: Amcl, paths: int, drives: int) -> float:
        """Logarithm of the error at the worst of the levels that were driven."""
        return float(np.nanmax(self.bench.means(amcl, paths, drives)))

    def _least(self, settings: Sequence[Amcl]) -> Amcl:
        """Setting with the least error at its worst level.

        A setting's other levels can only make it worse, so they are driven for the best so far
        until one stays the best.
        """
        while True:
            best = min(settings, key=lambda amcl: self._known(amcl, *self.last))
            if not np.isnan(self.bench.means(best, *self.last)).any():
                return best
            self.bench.drive([best], *self.last)

    def _put_back(self, best: Amcl, progress: ProgressCallback) -> tuple[Amcl, dict[str, float]]:
        """The best setting with what gains next to nothing put back, and what each change gains."""
        axes, worst = changed_axes(self.own, best), self._known(best, *self.last)
        single = {axis: axis.put(best, axis.of(self.own)) for axis in axes}
        self.bench.drive([*single.values()], *self.last, self.strongest, progress)
        losses = {axis: self._known(amcl, *self.last) - worst for axis, amcl in single.items()}
        kept = best
        for axis in sorted(axes, key=lambda axis: losses[axis]):
            tried = axis.put(kept, axis.of(self.own))
            costs = self.beams(kept) > self.beams(tried)
            bound = self._known(kept, *self.last) + (WORSE_AT_A_COST if costs else WORSE)
            if losses[axis] <= WORSE_AT_A_COST and self._within(tried, bound):
                kept = tried
        return kept, {axis.name: math.exp(loss) for axis, loss in losses.items()}

    def _within(self, amcl: Amcl, bound: float) -> bool:
        """Whether the logarithm of the error is up to a bound at every level."""
        for levels in (self.strongest, None):
            self.bench.drive([amcl], *self.last, levels)
            if self._known(amcl, *self.last) > bound:
                return False
        return True
