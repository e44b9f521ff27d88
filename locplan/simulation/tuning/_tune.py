"""Tuning of AMCL: presets compete in simulated drives, and fresh drives judge the best one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from locplan._util.checks import whole
from locplan._util.progress import ProgressCallback, parts, scaled
from locplan.costs import Costmap
from locplan.maps import OccupancyGrid, check_grid
from locplan.robots import Robot
from locplan.robots.presets import amcl_presets, with_changes
from locplan.simulation._drives import check_drives
from locplan.simulation._simulator import Simulator
from locplan.simulation._worlds import check_of_one_map
from locplan.simulation.tuning._bench import TuningBench
from locplan.simulation.tuning._parameters import BeamsLeft, filter_warnings
from locplan.simulation.tuning._results import TriedPreset, Tuning
from locplan.simulation.tuning._simulated_cases import plan_random_paths, simulated_cases

FEWEST_PATHS = 5
"""Minimum number of paths, or of stretches of a recording: drives along few lines are alike."""


def tune(
    grid: OccupancyGrid | Sequence[OccupancyGrid],
    robot: Robot | None = None,
    *,
    paths: int = 16,
    drives: int = 4,
    filter_map: OccupancyGrid | None = None,
    others: Mapping[str, object] | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Tuning:
    """Find the preset of AMCL's settings that localizes a robot best on its map.

    The presets of `locplan.robots.presets` drive along random shortest paths, with the errors of
    odometry that the robot has and three times as large ones. The best preset and the user's
    settings then drive along other paths. It is to be used if it is better there by the verdict of
    `locplan.simulation.verdict`, and not worse at three times the errors of odometry.

    Parameters
    ----------
    grid : OccupancyGrid or sequence of OccupancyGrid
        The map, or several for one parameter file: all count together, and none may contradict.
    robot : Robot, optional
        The robot, such as `Robot.from_nav2` reads; by default one with Nav2's filter and a lidar
        of 6 m that sees all round.
    paths : int, default 16
        Number of random paths on each map on which the best preset is judged, 5 to 1000. Half as
        many other paths choose it.
    drives : int, default 4
        Number of drives along each path that judge, 2 to 100,000.
    filter_map : OccupancyGrid, optional
        The filter's map in the same frame, if it differs from `grid`; see `simulate`.
    others : mapping of str to object, optional
        Further parameters in the user's file, such as `z_short`, for the warnings.
    seed : int, default 1
        Seed of all random numbers, >= 0; equal seeds give equal results.
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
    >>> result.verdict in ("better", "undecided"), result.winner.min_particles
    (True, 20)
    """
    grids = as_list(grid)
    for one in grids:
        check_grid(one)
    check_of_one_map(filter_map, grids)
    whole("paths", paths, FEWEST_PATHS, 1000)
    check_drives(drives)
    simulators = [
        Simulator(one, robot, filter_map=filter_map, seed=seed, threads=threads) for one in grids
    ]
    known = simulators[0].robot
    n_choosing = max(FEWEST_PATHS, paths // 2)
    labels = number_names([one.name or "map" for one in grids]) if grids[1:] else [""]
    shared: Any = {"filter_map": filter_map, "seed": seed, "threads": threads}
    choosing, judging = [], []
    for one, label in zip(grids, labels, strict=True):
        ways = plan_random_paths(Costmap.blank(one, robot=known), paths + n_choosing, seed)
        choosing += simulated_cases(one, known, ways[paths:], label=label, **shared)
        judging += simulated_cases(one, known, ways[:paths], label=label, **shared)
    return choose_settings(
        TuningBench(choosing, judging, drives),
        known,
        grids,
        filter_map=filter_map,
        beams_left=min(map(BeamsLeft.on_map, simulators), key=lambda left: left.returned),
        others=others,
        seed=seed,
        progress=progress,
    )


def choose_settings(
    bench: TuningBench,
    robot: Robot,
    grids: Sequence[OccupancyGrid],
    *,
    filter_map: OccupancyGrid | None = None,
    beams_left: BeamsLeft,
    others: Mapping[str, object] | None = None,
    recording: str = "",
    notes: Sequence[str] = (),
    seed: int = 1,
    progress: ProgressCallback | None = None,
) -> Tuning:
    """Choose the best preset on a bench, and judge it by the drives of the bench that are left.

    Parameters
    ----------
    bench : TuningBench
        The cases in which settings drive.
    robot : Robot
        The robot with the user's settings of the filter.
    grids : sequence of OccupancyGrid
        The maps.
    filter_map, others, seed, progress
        See `tune`.
    beams_left : BeamsLeft
        Number of the compared beams that return.
    recording : str, default ""
        Names of the recordings whose stretches are the lines; empty for simulated drives.
    notes : sequence of str, default ()
        Limits of the result, next to the warnings.

    Returns
    -------
    Tuning
        The settings to use, and the evidence for them.
    """
    own = robot.amcl
    names = {with_changes(own, each): name for name, each in amcl_presets(own).items()}
    choosing, judging = parts(progress, [600, 400])
    best, driven = bench.choose([*names], scaled(choosing, 600))
    verdict, cases = bench.judge(own, best, scaled(judging, 400))
    tried = [TriedPreset.from_drives(names[amcl], amcl, driven[amcl]) for amcl in names]
    costs = bench.beams_per_metre(best) / bench.beams_per_metre(own)
    warned: tuple[str, ...] = ()
    if best.multiplies and not own.multiplies and (others or {}).get("do_beamskip"):
        skips = "do_beamskip becomes false with the laser model, since only this one reads it"
        warned = (f"{skips}, and it was not simulated",)
    return Tuning(
        grids=tuple(grids),
        robot=robot,
        tried=tuple(tried),
        candidate=best,
        cases=cases,
        candidate_verdict=verdict,
        beams_ratio=costs,
        beams_left=beams_left,
        warnings=(
            *warned,
            *filter_warnings(own, robot.known_lidar, others),
            *beams_left.warnings(),
        ),
        paths=len(bench.judging[0].lines),
        drives=bench.drives,
        seed=seed,
        recording=recording,
        filter_map=filter_map,
        notes=tuple(notes),
    )


def as_list(one_or_more: Any) -> list[Any]:
    """Return a map or a recording, or a sequence of them that is not empty, as a list.

    Parameters
    ----------
    one_or_more : object
        A map, a recording, or a sequence of them.
    """
    values = one_or_more
    is_sequence = isinstance(values, Sequence) and not isinstance(values, str) and len(values) > 0
    return [*values] if is_sequence else [values]


def number_names(names: Sequence[str]) -> list[str]:
    """Return names with a number behind those that stood before.

    Parameters
    ----------
    names : sequence of str
        The names.

    Examples
    --------
    >>> number_names(["hall", "lab", "hall"])
    ['hall', 'lab', 'hall 2']
    """
    counts = [names[:n].count(name) + 1 for n, name in enumerate(names)]
    pairs = zip(names, counts, strict=True)
    return [f"{name} {count}" if count > 1 else name for name, count in pairs]
