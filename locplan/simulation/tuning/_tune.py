"""Tuning of AMCL: the presets drive at levels of disturbance, and these drives choose one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from locplan._util.checks import whole
from locplan._util.progress import ProgressCallback
from locplan.costs import Costmap
from locplan.maps import OccupancyGrid, check_grid
from locplan.robots import Robot
from locplan.simulation._drives import check_drives
from locplan.simulation._simulator import Simulator
from locplan.simulation._worlds import check_of_one_map, poses_along
from locplan.simulation.levels import LEVELS, Level
from locplan.simulation.tuning._choose_preset import choose_preset
from locplan.simulation.tuning._parameters import BeamsLeft, warn_of_settings
from locplan.simulation.tuning._results import Tuning
from locplan.simulation.tuning._simulated_cases import plan_random_paths, simulated_cases

FEWEST_PATHS = 5
"""Minimum number of paths: drives along few of them are alike."""


def tune(
    grid: OccupancyGrid | Sequence[OccupancyGrid],
    robot: Robot | None = None,
    *,
    paths: int = 16,
    drives: int = 4,
    levels: Sequence[Level] = LEVELS,
    filter_map: OccupancyGrid | None = None,
    others: Mapping[str, object] | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Tuning:
    """Find the preset of AMCL's settings that localizes a robot best on its map.

    The user's settings and the presets of `locplan.robots.presets` drive along random shortest
    paths. A preset is to be used if it is better at the usual level of disturbance, and at no
    other level off at the end significantly more often, see `locplan.simulation.verdict`.

    Parameters
    ----------
    grid : OccupancyGrid or sequence of OccupancyGrid
        The map, or several for one parameter file: all count together at the usual level, and a
        preset must do no harm on any of them.
    robot : Robot, optional
        The robot, such as `Robot.from_nav2` reads; by default one with Nav2's filter and a lidar
        of 6 m that sees all round.
    paths : int, default 16
        Number of random paths on each map, 5 to 1000.
    drives : int, default 4
        Number of drives along each path, 2 to 100,000. At levels of disturbance all paths of a map
        have 64 drives at least.
    levels : sequence of Level, all by default
        The levels of disturbance, the usual one first; by default all of
        `locplan.simulation.levels`.
    filter_map : OccupancyGrid, optional
        The filter's map in the same frame, if it differs from `grid`; see `simulate`.
    others : mapping of str to object, optional
        Further parameters in the user's file, such as `z_short`, for the warnings.
    seed : int, default 1
        Seed of all random numbers, >= 0; equal seeds give equal results.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) drives of all settings.

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
    >>> result.winner.max_particles
    20
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
    ways = [plan_random_paths(Costmap.blank(one, robot=known), paths, seed) for one in grids]
    labels = number_names([one.name or "map" for one in grids]) if grids[1:] else [""]
    shared: Any = {"filter_map": filter_map, "seed": seed, "threads": threads}
    cases = [
        case
        for one, of_map, label in zip(grids, ways, labels, strict=True)
        for case in simulated_cases(
            one, known, of_map, levels, drives=drives, label=label, **shared
        )
    ]
    lines = [
        poses_along(path, one) for one, of_map in zip(grids, ways, strict=True) for path in of_map
    ]
    choice = choose_preset(known.amcl, cases, lines, progress=progress)
    beams_left = min(map(BeamsLeft.on_map, simulators), key=lambda left: left.returned)
    return Tuning(
        grids=tuple(grids),
        robot=known,
        choice=choice,
        beams_left=beams_left,
        warnings=warn_of_settings(known, choice.settings, beams_left, others),
        paths=paths,
        drives=drives,
        seed=seed,
        filter_map=filter_map,
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
