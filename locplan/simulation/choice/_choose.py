"""The choice of a path: candidates, a race, a confirmation, and one answer."""

from __future__ import annotations

import dataclasses
import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import instance
from locplan._util.progress import ProgressCallback
from locplan.costs import Costmap, Path, about_costs, check_costs, check_criterion, path_metrics
from locplan.errors import ConfigError
from locplan.field import CovarianceField, FieldConfig, Fused, Sad, load_or_compute
from locplan.maps import OccupancyGrid, check_grid
from locplan.planners import SHORTEST, Plan, Position, check_ends
from locplan.robots import Robot
from locplan.simulation._arguments import about_filter
from locplan.simulation._simulator import Simulator
from locplan.simulation.choice._ask import Ask, Candidates, Own, why_without
from locplan.simulation.choice._candidates import WEIGHTS, Part, candidates_of
from locplan.simulation.choice._choice import Choice
from locplan.simulation.choice._driven import Candidate
from locplan.simulation.choice._driver import Driver
from locplan.simulation.choice._race import judged
from locplan.simulation.choice._settings import ChoiceSettings
from locplan.simulation.choice._source import Compute, Source, deviation_along

PRICE_OF_LOSS = {"lost": 100.0}
"""What a lost drive adds to the logarithm of its error in the race, 1 by default."""
NO_LIDAR = (
    "nothing is driven: name the robot's lidar (--lidar NAME, in Python robot=locplan.Robot(NAME))"
    " to drive candidates with its filter, and to have one recommended"
)
CAR_LIKE = "nothing is driven or recommended: paths with headings or a turning radius are not yet"
UNDRIVEN = "nothing is driven, as asked, and nothing is recommended"


def choose(
    grid: OccupancyGrid,
    start: Position,
    goal: Position,
    robot: Robot | None = None,
    *,
    costs: Costmap | FieldConfig | None = None,
    candidates: Candidates = (),
    compute: Compute | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
    **settings: Any,
) -> Choice:
    """Choose the path to take: drive candidates in simulation until one is shown to be better.

    Candidates are the shortest path, the one on the robot's own inflated costmap, paths clear of
    walls, ways around, and localizability-aware paths. They race over a few drives; the winner and
    the shortest are then driven afresh until the ratio of their errors is known. Only a path that
    is clearly better, and does not lose more drives, replaces the shortest.

    Where the robot's lidar is not known, nothing is driven: the aware path of the field is then
    given beside the shortest one.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    start, goal : (x, y), or (x, y, heading) for planners with headings
        Positions in the world [m, rad].
    robot : Robot, optional
        The robot, which is known when its lidar is, such as ``Robot("turtlebot4")``, or what
        `Robot.from_nav2` reads. A field that simulates a lidar names it, too.
    costs : Costmap or FieldConfig, optional
        A costmap of this map, to plan on: ``Costmap.blank(grid)`` does without a field. Or settings
        of the field; by default it is `Fused` for the lidar, or `Sad` without one. A field that
        simulates a lidar is evaluated every 0.2 m near the aware paths and 0.4 m elsewhere.
    candidates : sequence or mapping by name, default ()
        Further candidates: paths, arrays of positions (n, 2) [m], plans, Pareto fronts, planners
        or their names.
    compute : callable, optional
        Gives the field of a map at the lattice points of a mask; by default `load_or_compute`.
    seed : int, default 1
        Seed of all random numbers, >= 0; equal seeds give equal choices, on any number of threads,
        unless the time limit ends the drives.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) drives; there may be fewer in the end.
    **settings
        Fields of `ChoiceSettings`: limits of the candidates, and what decides.

    Returns
    -------
    Choice
        Its `path` is None if no path leads to the goal or keeps the limits; `status` says why.

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
    >>> robot = locplan.Robot(locplan.Lidar(range=6.0))
    >>> blank = locplan.Costmap.blank(grid)
    >>> choice = choose(grid, (2.0, 3.0), (38.0, 3.0), robot, costs=blank, drives=8)
    >>> choice.verdict
    'clearly better'
    """
    check_grid(grid)
    asked = ChoiceSettings.of(settings)
    robot, source = _robot_and_source(grid, robot, costs, compute, threads)
    if asked.criterion is not None:
        check_criterion(asked.criterion, source.config)
    blank = source.blank(grid, robot.radius)
    own = Own.of(candidates)
    begin, *via, end = check_ends(blank, start, goal, asked.via, space=own.space)
    ask = Ask(grid, begin, end, dataclasses.replace(asked, via=tuple(via)), robot)
    ask.check()
    own.check(ask)
    simulator = Simulator(  # checks them
        grid, robot, filter_map=asked.filter_map, seed=seed, threads=threads
    )
    shortest = ask.flat.planned(blank, limited=False)
    if shortest.path is None:
        return _made(ask, seed, shortest, source.given)
    why_not = _why_not(ask, own)
    if why_not:
        return _planned_only(ask, own, source, shortest, seed, why_not)
    if begin == end and not via:
        raise ConfigError("start and goal are one place; a choice needs a way to drive")
    return _driven(ask, own, source, shortest.path, simulator, progress)


def _driven(
    ask: Ask,
    own: Own,
    source: Source,
    first: Path,
    simulator: Simulator,
    progress: ProgressCallback | None,
) -> Choice:
    """The choice among candidates that are driven."""
    asked = ask.settings
    longest = asked.longest * first.length
    costs, _ = source.costs(
        ask, lambda costs: Part.about(costs, first, longest, ask).aware_paths(WEIGHTS)
    )
    shortest, nothing = ask.shortest(costs) or first, _made(ask, simulator.seed, None, costs)
    if asked.is_limited:
        within = ask.planned(costs.with_weight(1e-6))
        if within.path is None:
            return _made(ask, simulator.seed, within, costs)
        shortest = within.path
    part = Part.about(costs, shortest, asked.longest * shortest.length, ask)
    paths, left_out = candidates_of(part, own)
    if asked.is_limited:  # planners find short paths, not always the shortest, within limits
        paths = _shortest_first(paths)
    driver = Driver(simulator, paths, asked, progress)
    until = math.inf if asked.time_limit is None else time.monotonic() + asked.time_limit
    found = judged(
        driver,
        asked.price * np.log([path.length / paths[SHORTEST].length for path in paths.values()]),
        PRICE_OF_LOSS.get(asked.minimise, 1.0),
        asked.drives,
        lambda: time.monotonic() > until,
    )
    made = tuple(
        Candidate(name, path, path_metrics(costs, path), driver.shown(n, found))
        for n, (name, path) in enumerate(paths.items())
    )
    return dataclasses.replace(
        nothing,
        candidates=made,
        left_out=left_out,
        judgement=found,
        rival=driver.rival(found),
    )


def _shortest_first(paths: dict[str, Path]) -> dict[str, Path]:
    """Paths, of which the shortest one stands first and is called so."""
    name = min(paths, key=lambda each: paths[each].length)
    others = {each: path for each, path in paths.items() if each not in (name, SHORTEST)}
    return {SHORTEST: paths[name], **others}


def _robot_and_source(
    grid: OccupancyGrid,
    robot: Robot | None,
    costs: Costmap | FieldConfig | None,
    compute: Compute | None,
    threads: int | None,
) -> tuple[Robot, Source]:
    """The robot, with the lidar of the field if it names none, and where the costmap is from."""
    robot = Robot() if robot is None else robot
    instance("robot", robot, Robot, 'such as locplan.Robot("turtlebot4")')
    given, config = None, costs
    if costs is not None and not isinstance(costs, FieldConfig):
        check_costs(costs)
        if costs.grid.digest != grid.digest:
            raise ConfigError("the costmap is that of another map")
        given, config = costs, costs.settings.config if costs.settings else None
    if robot.lidar is None and isinstance(config, FieldConfig):
        robot = dataclasses.replace(robot, lidar=getattr(config.estimator, "lidar", None))
    if not isinstance(config, FieldConfig):
        config = FieldConfig(Fused.of(robot.lidar) if robot.lidar else Sad())
    kept = config

    def computed(
        grid: OccupancyGrid, points: NDArray[np.bool_] | None = None, /
    ) -> CovarianceField:
        return load_or_compute(grid, kept, points=points, threads=threads)

    return robot, Source(given, config, compute or computed)


def _why_not(ask: Ask, own: Own) -> str:
    """Why nothing is driven; empty if candidates are."""
    if own.space != "R2" or ask.robot.kinematics.turning_radius:
        return CAR_LIKE
    if ask.robot.lidar is None:
        return NO_LIDAR
    return "" if ask.settings.drives else UNDRIVEN


def _made(ask: Ask, seed: int, shortest: Plan | None, costs: Costmap | None) -> Choice:
    """A choice without candidates, with why there is no path, if so."""
    costs_shown = costs or Costmap.blank(ask.grid, robot_radius=ask.robot.radius)
    return Choice(
        about={**about_costs(costs_shown), **about_filter(ask.settings.filter_map)},
        start=ask.start,
        goal=ask.goal,
        candidates=(),
        settings=ask.settings,
        robot=ask.robot,
        seed=seed,
        status=shortest.status if shortest else "solved",
        note=shortest.note if shortest else "",
        costs=costs,
    )


def _planned_only(
    ask: Ask,
    own: Own,
    source: Source,
    shortest: Plan,
    seed: int,
    why_not: str,
) -> Choice:
    """The aware path of the field beside the shortest one, of which none is driven."""

    def drafted(costs: Costmap) -> list[Path]:
        plans = ask.flat.beside_shortest(costs)
        return [plan.path for plan in plans.values() if plan.path is not None]

    costs, field = source.costs(ask, drafted)
    plans = {SHORTEST: shortest.measured_on(costs)}
    if costs.settings is not None:
        plans = ask.beside_shortest(costs, own.planner)
    paths = {name: plan.path for name, plan in plans.items() if plan.path is not None}
    left_out = {name: why_without(plan) for name, plan in plans.items() if plan.path is None}
    own.add_to(paths, left_out, costs, ask, but=own.planner)
    last = plans[next(reversed(plans))]
    made = []
    for name, path in paths.items():
        own_plan = plans.get(name)
        made.append(
            Candidate(
                name,
                path,
                path_metrics(costs, path),
                deviation=(math.nan, math.nan) if field is None else deviation_along(path, field),
                planner=own_plan.planner if own_plan else "",
                note=note_on(own_plan) if own_plan else "",
                history=own_plan.history if own_plan else (),
            )
        )
    return dataclasses.replace(
        _made(ask, seed, last, costs),
        status="solved" if last.path else last.status,
        note=why_not if last.path else last.note,
        candidates=tuple(made) if last.path else (),
        left_out=left_out,
    )


def note_on(made: Plan) -> str:
    """What a plan says of its path beside its metrics."""
    said = [made.note] if made.note else []
    if not made.minimises:
        said.append("any path, since its planner minimises nothing")
    if made.bound is not None:
        said.append(f"no path within the budget is shorter than {made.bound:.2f} m")
    return "; ".join(said)
