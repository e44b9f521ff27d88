"""AMCL's settings tuned by simulated drives along random shortest paths of a map."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence

from locplan._util.checks import whole
from locplan._util.machine import check_memory
from locplan._util.progress import ProgressCallback
from locplan._util.random_streams import random_of
from locplan.costs import Costmap
from locplan.maps import OccupancyGrid, check_grid
from locplan.robots import Robot
from locplan.simulation._drives import check_drives
from locplan.simulation._simulator import Simulator
from locplan.simulation.tuning._bench import Bench, TuningBench, random_paths
from locplan.simulation.tuning._files import PRODUCT
from locplan.simulation.tuning._lint import BeamsLeft, beams_left, filter_warnings
from locplan.simulation.tuning._results import NAV2, OWN, Tuning, judged
from locplan.simulation.tuning._search import Search
from locplan.simulation.tuning._space import LEVELS, candidates, described, nav2_defaults

PATHS, DRIVES = 20, 8
"""Number of random paths, and of drives along each at each level of disturbance."""
MAX_PATHS = 1000
"""Greatest number of paths."""
SEARCH, JUDGE, DRAW = 11, 12, 13
"""Streams of random numbers, from which the seeds of both sets of drives are drawn."""


def tune(
    grid: OccupancyGrid,
    robot: Robot | None = None,
    *,
    paths: int = PATHS,
    drives: int = DRIVES,
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
    whole("paths", paths, TuningBench.fewest_paths, MAX_PATHS)
    check_drives(drives)
    about = Simulator(grid, robot=robot, seed=seed, threads=threads)
    size = 5 * grid.cells.size * len(LEVELS) * about.robot.disturbances.worlds
    check_memory(
        f"{len(LEVELS)} levels of {about.robot.disturbances.worlds} worlds", size, "set fewer"
    )
    costs = Costmap.blank(grid, robot_radius=about.robot.radius)
    left = beams_left(about, robot_radius=about.robot.radius)

    def bench_of(own_seed: int, judging: bool) -> Bench:
        lines = random_paths(costs, paths, own_seed)
        return Bench(
            grid,
            about.robot,
            lines,
            drives,
            seed=own_seed,
            threads=threads,
        )

    return search_settings(
        bench_of,
        about.robot,
        paths,
        drives,
        left=left,
        others=others,
        seed=seed,
        progress=progress,
    )


def search_settings(
    bench_of: Callable[[int, bool], TuningBench],
    robot: Robot,
    paths: int,
    drives: int,
    *,
    left: BeamsLeft,
    others: Mapping[str, object] | None,
    seed: int,
    progress: ProgressCallback | None,
    drive: str = "",
    notes: Sequence[str] = (),
) -> Tuning:
    """Search settings on one bench, and judge what was found on another.

    Parameters
    ----------
    bench_of : callable
        Makes a bench of a seed, and of whether settings are judged on it.
    robot : Robot
        The robot, with the user's own settings of the filter.
    paths, drives : int
        Number of paths of each bench, and of drives along each.
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

    Returns
    -------
    Tuning
        The settings to use, and the evidence for them.
    """

    def bench(stream: int) -> TuningBench:
        own_seed = int(random_of(seed, stream).integers(2**31))
        return bench_of(own_seed, stream == JUDGE)

    steps, own = _steps(progress), robot.filter
    search = Search(bench(SEARCH), own, paths, drives)
    found = search.run(candidates(own, random_of(seed, DRAW)), steps)
    defaults = nav2_defaults(own)
    names = {own: OWN, defaults: NAV2}  # the latter's name if they are the same
    for each in (found.kept, found.frugal, found.best):
        names.setdefault(each, described(own, each))
    order = dict.fromkeys([own, found.kept, found.frugal, found.best, defaults])
    changes_model = found.kept.laser_model_type == PRODUCT != own.laser_model_type
    if changes_model and (others or {}).get("do_beamskip"):
        notes = (*notes, SKIPS)
    del search
    judge = bench(JUDGE)
    judge.drive([*order], paths, drives, progress=next(steps))
    return Tuning(
        judge.grid,
        robot,
        found.kept,
        tuple(judged(judge, names[each], each, own) for each in order),
        found.without,
        left,
        (*notes, *filter_warnings(own, judge.lidar, others), *left.warnings()),
        found.rungs,
        paths,
        drives,
        seed,
        judge.seed,
        drive,
    )


SKIPS = (
    "do_beamskip becomes false with the laser model, since only this one reads it, and it was not"
    " simulated"
)
SHARES = (0.17, 0.2, 0.23, 0.13, 0.27)
"""Shares of the time that the steps take: three rungs, what is put back, and the judgement."""


def _steps(progress: ProgressCallback | None) -> Iterator[ProgressCallback]:
    """Callbacks for the steps one after the other."""
    before = [0.0, *itertools.accumulate(SHARES)]
    for start, share in zip(before, SHARES, strict=False):

        def update(done: int, total: int, start: float = start, share: float = share) -> None:
            if progress:
                progress(round(1000 * (start + share * done / max(total, 1))), 1000)

        yield update
