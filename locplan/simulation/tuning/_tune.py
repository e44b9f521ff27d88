"""AMCL's settings tuned by simulated drives along random shortest paths of maps."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from locplan._util.checks import one_of, whole
from locplan._util.intervals import random_of
from locplan._util.progress import ProgressCallback, parts, scaled
from locplan.costs import Costmap
from locplan.maps import OccupancyGrid, check_grid
from locplan.robots import Amcl, Robot
from locplan.simulation._drives import Drives, check_drives
from locplan.simulation._simulator import Simulator
from locplan.simulation._worlds import check_of_one_map
from locplan.simulation.tuning._bench import DisturbanceLevel, TuningBench
from locplan.simulation.tuning._joined_bench import joined, several
from locplan.simulation.tuning._judged import Judged, judged_beside, recoveries
from locplan.simulation.tuning._results import OWN, Tuning
from locplan.simulation.tuning._search import STEPS, Search
from locplan.simulation.tuning._simulated_bench import LEVELS, TEN_TIMES, SimulatedBench
from locplan.simulation.tuning._space import (
    BeamsLeft,
    candidates,
    described,
    filter_warnings,
    nav2_defaults,
)

SEARCH, JUDGE, DRAW = 11, 12, 13
"""Streams of random numbers, from which the seeds of both sets of drives are drawn."""


def tune(
    grid: OccupancyGrid | Sequence[OccupancyGrid],
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

    Settings drive the same random shortest paths with the same seeds, with a third of, once and
    three times the errors of odometry. Successive halving finds the one with the least score at its
    worst level: the mean of ln RMSE, and 1 more for each lost drive. What it need not change is put
    back. Then it is judged on other paths, in other worlds: it is to be used if it is better than
    the user's own settings there, and worse at no level.

    Parameters
    ----------
    grid : OccupancyGrid or sequence of OccupancyGrid
        The map; or several, whose worst one counts.
    robot : Robot, optional
        The robot, such as `Robot.from_nav2` reads; by default one with Nav2's filter and a lidar
        of 6 m that sees all round.
    paths : int, default 20
        Number of random paths of the search, and of the judgement, 5 to 1000.
    drives : int, default 8
        Number of drives along each path at each level, 2 to 100,000.
    odometry : {"usual", "poor"}, default "usual"
        "poor" has once, three and ten times the errors of odometry.
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
    grids = several(grid)
    for each in grids:
        check_grid(each)
    check_of_one_map(filter_map, grids)
    whole("paths", paths, TuningBench.fewest_paths, 1000)
    check_drives(drives)
    one_of("odometry", odometry, LEVELS)
    about = [
        Simulator(each, robot, filter_map=filter_map, seed=seed, threads=threads) for each in grids
    ]
    known = about[0].robot
    costs = [Costmap.blank(each, robot=known) for each in grids]

    def bench_of(own_seed: int, judging: bool) -> TuningBench:
        levels: tuple[DisturbanceLevel, ...] = LEVELS[odometry]
        if judging and TEN_TIMES not in levels:  # where they may no longer hold
            levels = (*levels, TEN_TIMES)
        own: Any = {"filter_map": filter_map, "seed": own_seed, "threads": threads}
        ways = [SimulatedBench.paths(each, paths, own_seed) for each in costs]
        benches = [
            SimulatedBench(each, known, some, drives, levels=levels, **own)
            for each, some in zip(grids, ways, strict=True)
        ]
        return joined(benches, [each.name or "map" for each in grids])

    left = min((BeamsLeft.on_map(each) for each in about), key=lambda each: each.returned)
    return search_settings(bench_of, known, left=left, others=others, seed=seed, progress=progress)


def search_settings(
    bench_of: Callable[[int, bool], TuningBench],
    robot: Robot,
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
    left : BeamsLeft
        Number of the beams compared that return.
    others, seed, progress
        See `tune`.
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
    # Shares of the time that the first rungs, the steps, the last rung, what is put back and the
    # judgement take.
    shares = 80, 60, 90, *[40] * STEPS, 150, 200, 300
    steps = iter([scaled(*step) for step in zip(parts(progress, shares), shares, strict=True)])
    search = Search(bench(SEARCH), own)
    tried = candidates(own, random_of(seed, DRAW), like)
    kept, frugal, best, without = search.run(tried, steps)
    rungs, searched = tuple(search.rungs), {each.name for each in search.bench.levels}
    del search
    judge = bench(JUDGE)
    found, judged = _judged(judge, own, (kept, frugal, best), searched, next(steps))
    warned: tuple[str, ...] = ()
    if found.multiplies and not own.multiplies and (others or {}).get("do_beamskip"):
        skips = "do_beamskip becomes false with the laser model, since only this one reads it"
        warned = (f"{skips}, and it was not simulated",)
    return Tuning(
        judge.grids,
        robot,
        found,
        judged,
        without,
        left,
        (*warned, *filter_warnings(own, judge.lidar, others), *left.warnings()),
        rungs,
        len(judge.lines),
        judge.drives,
        seed,
        judge.seed,
        drive,
        None if judge.filter_map is judge.grid else judge.filter_map,
        tuple(notes),
    )


def _judged(
    judge: TuningBench,
    own: Amcl,
    found: tuple[Amcl, Amcl, Amcl],
    searched: Collection[str],
    progress: ProgressCallback,
) -> tuple[Amcl, tuple[Judged, ...]]:
    """Which of the settings found is the one to be used if it is better, and how all are judged.

    It is the first, but where that is not better here, or does not hold, the next that is better;
    of the first two the one that is lost on fewer replays of the whole of recorded drives.
    The levels named `searched` decide.
    """
    every, defaults = (len(judge.lines), judge.drives), nav2_defaults(own)
    decide = [n for n, level in enumerate(judge.levels) if level.name in searched]
    order = dict.fromkeys([own, *found[:2], defaults])
    judge.drive([*order], *every, decide, progress)
    tried = max(1, len({*found} - {own}))
    names = {own: OWN, defaults: "Nav2's defaults"}  # the latter's name if they are the same
    wholes: dict[Amcl, list[Drives]] = {}

    def judged(amcl: Amcl) -> Judged:
        judge.drive([amcl], *every, decide)
        for each in (own, amcl):
            wholes[each] = wholes.get(each) or judge.whole(each)
        name = names.get(amcl) or described(own, amcl)
        return judged_beside(judge, name, amcl, own, wholes, searched, tried)

    def losses(amcl: Amcl) -> int:
        return sum(int(each.lost.sum()) for each in wholes[amcl])

    # The third is driven only if neither of the others will do.
    choices = (found[:1],) if found[0] == own else (found[:2], found[2:])
    better = ([each for each in some if judged(each).better] for some in choices)
    candidate = min(next(filter(None, better), found[:1]), key=losses)
    shown = own, candidate
    judge.drive([*shown], *every)  # at levels that only these two are said for
    told = {each: replace(judged(each), recoveries=recoveries(judge, each)) for each in shown}
    return candidate, tuple(told.get(each) or judged(each) for each in order | told)
