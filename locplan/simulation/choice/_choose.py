"""The simulated choice: drive a handful of dissimilar paths, and take the one that is best."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import number, one_of, positive
from locplan._util.poses import Poses
from locplan._util.progress import ProgressCallback
from locplan.costs import Costmap, Path, check_costs, path_metrics
from locplan.errors import ConfigError, LocplanError
from locplan.field import CovarianceField, FieldConfig, Fused, equipped, load_or_compute
from locplan.maps import OccupancyGrid, check_grid
from locplan.planners import (
    LONGEST_ALTERNATIVE,
    Position,
    alternatives,
    check_ends,
    plan,
    planned_near_paths,
)
from locplan.robots import Robot
from locplan.simulation._drives import Drives, check_drives
from locplan.simulation._motion import poses_along
from locplan.simulation._scores import (
    MINIMISED,
    Minimise,
    is_settled,
    log_errors,
    price_of,
    selected,
    worst_error,
)
from locplan.simulation._simulator import Simulator
from locplan.simulation.choice._candidates import Candidates, own_paths
from locplan.simulation.choice._choice import Candidate, Choice

FEW_DRIVES = 8
"""Number of drives of each candidate by default."""


def choose(
    grid: OccupancyGrid,
    start: Position,
    goal: Position,
    robot: Robot | None = None,
    *,
    costs: Costmap | None = None,
    candidates: Candidates = (),
    longest: float = LONGEST_ALTERNATIVE,
    minimise: Minimise = "rmse",
    price: float | None = None,
    drives: int = FEW_DRIVES,
    time_limit: float | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Choice:
    """Drive a handful of dissimilar paths in simulation, and choose among them.

    Candidates are the shortest path, detours around it, and the paths of least cost by `Fused` (or
    by the field of `costs`) at weights 4 and 12; see `locplan.planners.alternatives`. Each is
    driven with the same worlds and seeds. Its score is the mean over the drives of ln RMSE. The
    least score wins, and the shortest path stays unless the winner's error is less by a tenth.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    start, goal : (x, y)
        Positions in the world [m].
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your own, such as `Robot.from_nav2` reads.
    costs : Costmap, optional
        Costmap of a field of this map, to plan on; by default that of `Fused` for the lidar, whose
        spacing is 0.2 m near the candidates and 0.4 m elsewhere.
    candidates : sequence or mapping by name, default ()
        Further candidates: paths, arrays of positions (n, 2) [m], plans, Pareto fronts, planners
        or their names.
    longest : float, default 1.5
        Greatest length of an alternative, in lengths of the shortest path, >= 1. Raise it where a
        long detour is worth driving.
    minimise : str, default "rmse"
        "rmse" of the position, "goal-error" (the same over the last metre), "heading" (the same of
        the heading), or "lost", the share of drives off by more than 1 m at any time, which
        replaces the shortest path if it is lower by at least a quarter.
    price : float, optional
        Metres of detour that are accepted for a halved error, above 0; by default length does not
        count.
    drives : int, default 8
        Greatest number of drives of each candidate, 2 to 100,000. They end early where the ones
        that are left cannot change the choice. Raise it where candidates are close.
    time_limit : float, optional
        Time after which no further round of drives begins [s], above 0; at least two are driven.
        By default there is none.
    seed : int, default 1
        Seed of all random numbers, >= 0; equal seeds give equal choices, on any number of threads,
        unless the time limit ends the drives.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) drives.

    Returns
    -------
    Choice
        Its `path` is None if no path leads to the goal (`status` "unreachable"), or if the robot's
        outline meets a wall on all that were found ("not found": headings are not searched).

    Raises
    ------
    PoseError
        If start or goal lies outside the map or in a blocked cell.
    LocplanError
        If a setting is out of its range, or a candidate cannot be driven.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> choice = choose(grid, (2.0, 3.0), (38.0, 3.0), costs=locplan.Costmap.blank(grid))
    >>> choice.chosen.name, choice.why
    ('way around 2', '0% of drives lost instead of 62%, for 9.6 m more')
    """
    check_grid(grid)
    check_choice(longest, minimise, price, drives, time_limit)
    if costs is not None:
        check_costs(costs)
    robot = equipped(robot, costs.settings.config if costs and costs.settings else None)
    simulator = Simulator(grid, robot=robot, seed=seed, threads=threads)
    here = costs or Costmap.blank(grid, robot_radius=robot.radius)
    begin, end = check_way(here, start, goal)
    if costs is None and plan(here, begin, end).path is None:
        costs = here  # no field is worth its time
    if costs is None:
        config = FieldConfig(Fused.of(robot.known_lidar))
        costs = costmap_near_candidates(
            grid,
            config,
            (begin, end),
            longest,
            lambda points: load_or_compute(grid, config, points=points, threads=threads),
            lambda field: Costmap.from_field(grid, field, robot_radius=robot.radius),
        )
    elif costs.grid.digest != grid.digest:
        raise ConfigError("the costmap is that of another map")
    own = own_paths(costs, begin, end, candidates)
    paths = alternatives(costs, begin, end, longest=longest, others=own)
    left_out = without_collisions(paths, robot, grid)
    lines = lines_along(paths, grid)
    extra = np.array([path.length for path in paths.values()])
    prices = price_of(extra - extra[:1], price)
    worst = np.pi if minimise == "heading" else worst_error(grid.shape, grid.resolution)
    errors, scores = _driven(
        simulator, list(lines.values()), prices, minimise, worst, drives, time_limit, progress
    )
    driven = {
        name: Drives(line, each) for (name, line), each in zip(lines.items(), errors, strict=True)
    }
    lost = np.array([each.lost.mean() for each in driven.values()])
    made = tuple(
        Candidate(name, path, path_metrics(costs, path), driven[name], float(score), float(cost))
        for (name, path), score, cost in zip(paths.items(), scores, prices, strict=True)
    )
    best = selected(scores + prices, lost, minimise)[0] if made else 0
    return Choice(costs, begin, end, made, best, minimise, price, robot, drives, seed, left_out)


def without_collisions(
    paths: dict[str, Path], robot: Robot, grid: OccupancyGrid
) -> tuple[str, ...]:
    """Drop the paths on which the robot's outline meets a wall, and return their names."""
    outline = robot.outline
    if outline is None:
        return ()
    met = [name for name, path in paths.items() if outline.first_collision(grid, path)]
    for name in met:
        del paths[name]
    return tuple(met)


def costmap_near_candidates(
    grid: OccupancyGrid,
    config: FieldConfig,
    ends: tuple[Position, Position],
    longest: float,
    field_of: Callable[[NDArray[np.bool_]], CovarianceField],
    costmap_of: Callable[[CovarianceField], Costmap],
    shown: Callable[[], AbstractContextManager[object]] = nullcontext,
) -> Costmap:
    """Costmap of a field that is fine near the alternatives of a choice.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    config : FieldConfig
        Settings of the field.
    ends : (start, goal)
        Positions x, y in the world [m].
    longest : float
        Greatest length of an alternative, in lengths of the shortest path.
    field_of : callable
        Gives the field at the lattice points of a mask.
    costmap_of : callable
        Gives the costmap of such a field.
    shown : callable, default nullcontext
        Gives a context in which the alternatives are planned, such as a sign of life.

    Returns
    -------
    Costmap
        The costmap on which the alternatives were planned last.
    """

    def planned(field: CovarianceField) -> tuple[Costmap, dict[str, Path]]:
        with shown():
            costs = costmap_of(field)
            return costs, alternatives(costs, *ends, longest=longest)

    _, (costs, _) = planned_near_paths(
        grid, config, field_of, planned, lambda found: found[1].values()
    )
    return costs


def check_choice(
    longest: float,
    minimise: Minimise,
    price: float | None,
    drives: int,
    time_limit: float | None = None,
) -> None:
    """Check the settings of a choice; to be called before long work.

    Parameters
    ----------
    longest, minimise, price, drives, time_limit
        See `choose`.

    Raises
    ------
    ConfigError
        If one is out of its range.
    """
    check_drives(drives)
    number("longest", longest, 1.0)
    one_of("minimise", minimise, MINIMISED)
    for name, value in (("price", price), ("time_limit", time_limit)):
        if value is not None:
            positive(name, value)


def check_way(costs: Costmap, start: Position, goal: Position) -> tuple[Position, Position]:
    """Start and goal as numbers, if the robot can stand at both, and they are two places."""
    begin, end = check_ends(costs, start, goal)
    if begin == end:
        raise ConfigError("start and goal are one place; a choice needs a way to drive")
    return begin, end


def check_candidates(
    costs: Costmap, start: Position, goal: Position, candidates: Candidates = ()
) -> None:
    """Check the way of a choice and the user's own candidates; to be called before long work.

    Parameters
    ----------
    costs : Costmap
        A costmap of the map, which may be blank.
    start, goal : (x, y)
        Positions in the world [m].
    candidates : sequence or mapping by name, default ()
        See `choose`.

    Raises
    ------
    LocplanError
        If the robot cannot stand at an end, or a candidate does not join the two, or leaves the
        free cells.
    """
    check_way(costs, start, goal)
    lines_along(own_paths(costs, start, goal, candidates), costs.grid)


def lines_along(paths: Mapping[str, Path], grid: OccupancyGrid) -> dict[str, Poses]:
    """Poses along each path; a LocplanError names the candidate that cannot be driven."""
    lines = {}
    for name, path in paths.items():
        try:
            lines[name] = poses_along(path, grid)
        except LocplanError as error:
            raise LocplanError(f"candidate {name}: {error}") from None
    return lines


def _driven(
    simulator: Simulator,
    lines: list[Poses],
    prices: NDArray[np.float64],
    minimise: Minimise,
    worst: float,
    drives: int,
    time_limit: float | None,
    progress: ProgressCallback | None,
) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
    """Errors of each line's drives, and the mean of their logarithms."""
    if not lines:
        return [], np.empty(0)
    until = None if time_limit is None else time.monotonic() + time_limit
    distances = [Drives(line, np.empty((0, 0, 3))).distance for line in lines]

    def scores_of(errors: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Log error of each drive of each line, (lines, drives)."""
        pairs = zip(distances, errors, strict=True)
        return np.array([log_errors(*pair, minimise, worst) for pair in pairs])

    def enough(errors: list[NDArray[np.float64]]) -> bool:
        done = len(errors[0])
        if done < 2:
            return False
        if until is not None and time.monotonic() > until:
            return True
        sums = scores_of(errors).sum(axis=1)
        lost = np.array([Drives(lines[n], each).lost.sum() for n, each in enumerate(errors)])
        several = len(lines) > 1
        return several and is_settled(sums, lost, prices, done, drives, minimise, worst)

    errors = simulator.drive_together(lines, drives, enough=enough, progress=progress)
    return errors, scores_of(errors).mean(axis=1)
