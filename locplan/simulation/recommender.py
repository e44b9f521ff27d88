"""Recommendation of a path: candidates, a race, a confirmation, and one answer."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import check_instance, check_integer, check_threads
from locplan._support.progress import ProgressCallback
from locplan.errors import ConfigError
from locplan.field.config import FieldConfig, equip_robot
from locplan.field.field import CovarianceField
from locplan.field.store import load_or_compute
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.occupancy import FREE
from locplan.maps.zones import Zones, normalize_zones
from locplan.planning.any_angle import AnyAngle
from locplan.planning.costmap import Costmap, check_costs, summarize_costs
from locplan.planning.layers import check_criterion
from locplan.planning.metrics import path_metrics
from locplan.planning.path import Path
from locplan.planning.plans import SHORTEST
from locplan.planning.protocol import LATTICE, Planner, PlannerResult, Position
from locplan.planning.results import Plan
from locplan.robots.robot import Robot
from locplan.simulation.candidates import (
    AWARE_WEIGHTS,
    Candidates,
    SearchRegion,
    UserCandidates,
    add_user_candidates,
    check_user_candidates,
    compute_path_deviation,
    field_config_from_cost_summary,
    format_failure,
    generate_candidates,
    parse_user_candidates,
)
from locplan.simulation.problem import (
    FieldFunction,
    Minimise,
    PlanningProblem,
    RecommendationSettings,
    normalize_settings,
)
from locplan.simulation.race import (
    Candidate,
    CandidateRunner,
    DriveStatistics,
    RaceResult,
    run_race,
)
from locplan.simulation.recommendation import Recommendation
from locplan.simulation.simulator import Simulator
from locplan.simulation.worlds import check_filter_map, summarize_filter_map


def recommend_path(
    grid: OccupancyGrid,
    start: Position,
    goal: Position,
    robot: Robot | None = None,
    *,
    costs: Costmap | FieldConfig | None = None,
    zones: Zones | None = None,
    candidates: Candidates = (),
    compute: FieldFunction | None = None,
    settings: RecommendationSettings | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Recommendation:
    """Recommend a path: simulate drives along candidates until one is shown to be better.

    Candidates are the shortest path, the shortest path on the robot's inflated costmap, paths clear
    of walls, ways around, and localizability-aware paths. They race over a few drives. Fresh drives
    of the leaders and the shortest path then estimate the ratio of their errors. A path replaces
    the shortest if its error is at least a tenth smaller and it loses no more drives. The robot
    must also reach the goal about as often in closed-loop drives. If the shortest path is kept,
    such drives of it show how often the robot reaches the goal.

    For a robot with an outline or a turning radius, the lattice planner plans all candidates, so
    that the robot can drive them.

    Without a known lidar, nothing is driven: the field's aware path is then recommended untested.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    start, goal : (x, y), or (x, y, heading) for planners with headings and car-like robots
        Positions in the world [m, rad].
    robot : Robot, optional
        The robot, such as ``Robot("turtlebot4")``, or from `Robot.load`. Its lidar may also come
        from a field that simulates one.
    costs : Costmap or FieldConfig, optional
        A costmap of this map, to plan on: ``Costmap.blank(grid)`` does without a field. Or settings
        of the field; by default it is `Fused` for the lidar, or `Sad` without one. A field that
        simulates a lidar has its `stride` near the aware paths, and twice the stride elsewhere.
    zones : Zones, optional
        The zones, unless `costs` is a costmap with its zones. No candidate crosses a no-go
        zone, nor do robots that plan again in closed-loop drives. Outside preferred zones every
        candidate but the shortest path pays 1 more per metre.
    candidates : sequence or mapping by name, default ()
        Further candidates: paths, arrays of positions (n, 2) [m], plans, Pareto fronts, planners
        or their names.
    compute : callable, optional
        Gives the field of a map at the lattice points of a mask; by default `load_or_compute`.
    settings : RecommendationSettings, optional
        Limits of the candidates, the number of drives, and the error that decides.
    seed : int, default 1
        Seed of all random numbers, >= 0; equal seeds give equal results, on any number of threads,
        unless the time limit ends the drives.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) drives; there may be fewer in the end.

    Returns
    -------
    Recommendation
        Its `path` is None if no path leads to the goal or keeps the limits; its status says why.

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
    >>> robot = locplan.Robot(locplan.Lidar(range=6.0, beams=60))
    >>> robot = robot.with_settings({"min_particles": 100, "max_particles": 100})
    >>> blank = locplan.Costmap.blank(grid)
    >>> settings = RecommendationSettings(drives=8)
    >>> ends = (2.0, 3.0), (38.0, 3.0)
    >>> recommendation = recommend_path(grid, *ends, robot, costs=blank, settings=settings)
    >>> recommendation.verdict
    'better'
    """
    check_grid(grid)
    settings = normalize_settings(settings)
    robot, user_costmap, config = _resolve_robot_and_field(grid, robot, costs)
    zones = normalize_zones(zones)
    if user_costmap is not None:
        if zones:
            raise ConfigError("the costmap has its own zones; leave zones out")
        zones = user_costmap.zones
    if settings.criterion is not None:
        check_criterion(settings.criterion, config)

    def compute_field(
        grid: OccupancyGrid, points: NDArray[np.bool_] | None = None, /
    ) -> CovarianceField:
        return load_or_compute(grid, config, points=points, threads=threads)

    user_candidates = parse_user_candidates(candidates)
    planners = [planner for planner in user_candidates.values() if isinstance(planner, Planner)]
    problem = PlanningProblem(
        grid,
        start,
        goal,
        settings,
        robot,
        user_costmap,
        config,
        compute or compute_field,
        zones,
    )
    default_space = LATTICE if problem.is_lattice_needed else "R2"
    space = next((planner.space for planner in planners if planner.space != "R2"), default_space)
    problem = problem.with_checked_places(space)
    check_user_candidates(user_candidates, problem)
    check_filter_map(settings.filter_map, grid)
    check_integer("seed", seed, 0)
    check_threads(threads)
    shortest = problem.plan_least_cost(problem.blank_costmap, limited=False)
    if shortest.path is None:
        return _make_recommendation(problem, seed, user_costmap, failed_plan=shortest)
    if reason := _find_reason_not_driven(problem, space):
        return _recommend_untested(problem, user_candidates, shortest, seed, reason)
    if problem.start == problem.goal and not settings.via:
        raise ConfigError("start and goal are the same place; move one of them")
    simulator = Simulator(
        grid, robot, filter_map=settings.filter_map, seed=seed, threads=threads, zones=zones
    )
    return _recommend_by_drives(problem, user_candidates, shortest.path, simulator, progress)


def _recommend_by_drives(
    problem: PlanningProblem,
    user_candidates: UserCandidates,
    first: Path,
    simulator: Simulator,
    progress: ProgressCallback | None,
) -> Recommendation:
    """Recommend one of the candidates by simulated drives."""
    settings = problem.settings
    costs, _ = problem.compute_costmap(
        lambda costs: SearchRegion.around_path(costs, first, problem).plan_aware_paths(
            AWARE_WEIGHTS
        )
    )
    shortest = problem.plan_shortest(costs) or first
    if settings.is_limited:
        within = problem.plan_least_cost(costs.for_shortest)
        if within.path is None:
            return _make_recommendation(problem, simulator.seed, costs, failed_plan=within)
        shortest = within.path
    region = SearchRegion.around_path(costs, shortest, problem)
    paths, left_out = generate_candidates(region, user_candidates)
    if settings.is_limited:  # planners find short paths, not always the shortest, within limits
        name = min(paths, key=lambda candidate_name: paths[candidate_name].length)
        if name != SHORTEST:
            left_out[name] = f"races as {SHORTEST!r}: no path within the limits is shorter"
            left_out[f"planned {SHORTEST}"] = f"{name!r} keeps the limits and is shorter"
            paths[SHORTEST] = paths.pop(name)
    runner = CandidateRunner(simulator, paths, settings, progress)
    until = math.inf if settings.time_limit is None else time.monotonic() + settings.time_limit
    race_result = run_race(
        runner,
        settings.compute_length_handicaps(
            [path.length / paths[SHORTEST].length for path in paths.values()]
        ),
        100.0 if settings.minimise == "lost" else 1.0,
        settings.drives,
        lambda: time.monotonic() > until,
    )
    arrivals = runner.drive_closed_loop(race_result)
    candidates = tuple(
        Candidate(
            name,
            path,
            path_metrics(costs, path),
            runner.summarize_drives(n, race_result),
            arrivals=arrivals.get(n),
        )
        for n, (name, path) in enumerate(paths.items())
    )
    return _make_recommendation(
        problem,
        simulator.seed,
        costs,
        candidates=candidates,
        left_out=left_out,
        judgement=race_result,
        rival=runner.drive_with_rival_filter(race_result),
    )


def _resolve_robot_and_field(
    grid: OccupancyGrid, robot: Robot | None, costs: Costmap | FieldConfig | None
) -> tuple[Robot, Costmap | None, FieldConfig]:
    """The robot, with the lidar of the field if it names none, the costmap, and the field."""
    robot = Robot() if robot is None else robot
    check_instance("robot", robot, Robot, 'such as locplan.Robot("turtlebot4")')
    user_costmap, config = None, costs
    if costs is not None and not isinstance(costs, FieldConfig):
        check_costs(costs)
        if costs.grid.digest != grid.digest:
            raise ConfigError("the costmap is that of another map")
        user_costmap, config = costs, costs.settings.config if costs.settings else None
    if robot.lidar is None and isinstance(config, FieldConfig):
        robot = dataclasses.replace(robot, lidar=getattr(config.estimator, "lidar", None))
    if not isinstance(config, FieldConfig):
        config = field_config_from_cost_summary({}, robot.lidar)
    return robot, user_costmap, config


def _find_reason_not_driven(problem: PlanningProblem, space: str) -> str:
    """Why nothing is driven; empty if candidates are."""
    radius = problem.robot.kinematics.turning_radius
    if not problem.is_lattice_needed and (radius or space not in ("R2", LATTICE)):
        paths_text = "Paths with a turning radius and a budget" if radius else "Paths with headings"
        return f"{paths_text} are not simulated yet."
    if problem.robot.lidar is None:
        return "Name the robot's lidar to simulate the paths: --lidar NAME, in Python Robot(NAME)."
    if not problem.settings.drives:
        return "Nothing was simulated, because of drives=0."
    return ""


def _make_recommendation(
    problem: PlanningProblem,
    seed: int,
    costs: Costmap | None,
    *,
    failed_plan: Plan | None = None,
    candidates: tuple[Candidate, ...] = (),
    note: str = "",
    left_out: Mapping[str, str] | None = None,
    judgement: RaceResult | None = None,
    rival: DriveStatistics | None = None,
) -> Recommendation:
    """Make a recommendation; without a path it has the status and the note of the failed plan."""
    return Recommendation(
        about={
            **summarize_costs(costs or problem.blank_costmap),
            **summarize_filter_map(problem.settings.filter_map),
        },
        start=problem.start,
        goal=problem.goal,
        settings=problem.settings,
        robot=problem.robot,
        candidates=candidates,
        seed=seed,
        status=failed_plan.status if failed_plan else "solved",
        note=failed_plan.note if failed_plan else note,
        left_out=left_out or {},
        judgement=judgement,
        rival=rival,
        costs=costs,
    )


def _recommend_untested(
    problem: PlanningProblem,
    user_candidates: UserCandidates,
    shortest: Plan,
    seed: int,
    reason: str,
) -> Recommendation:
    """Recommend the aware path of the field over the shortest path without any drive."""

    def plan_paths(costs: Costmap) -> list[Path]:
        plans = problem.plan_aware_and_shortest(costs)
        return [plan.path for plan in plans.values() if plan.path is not None]

    costs, field = problem.compute_costmap(plan_paths)
    planner = next(
        (candidate for candidate in user_candidates.values() if isinstance(candidate, Planner)),
        None,
    )
    plans = {SHORTEST: shortest.with_costs(costs)}
    if not math.isnan(costs.weight):
        plans = problem.plan_aware_and_shortest(costs, planner)
    paths = {name: plan.path for name, plan in plans.items() if plan.path is not None}
    left_out = {name: format_failure(plan) for name, plan in plans.items() if plan.path is None}
    add_user_candidates(
        user_candidates,
        paths,
        left_out,
        costs,
        problem,
        skipped_planner=planner if len(plans) > 1 else None,
    )
    last = plans[next(reversed(plans))]
    if last.path is None:
        return _make_recommendation(problem, seed, costs, failed_plan=last, left_out=left_out)
    candidates = []
    for name, path in paths.items():
        candidate = Candidate(name, path, path_metrics(costs, path))
        if field is not None:
            deviation = compute_path_deviation(path, field)
            candidate = dataclasses.replace(candidate, deviation=deviation)
        if candidate_plan := plans.get(name):
            candidate = dataclasses.replace(
                candidate,
                planner=candidate_plan.planner,
                history=candidate_plan.history,
                note=_format_plan_note(candidate_plan),
            )
        candidates.append(candidate)
    return _make_recommendation(
        problem, seed, costs, note=reason, candidates=tuple(candidates), left_out=left_out
    )


def _format_plan_note(candidate_plan: Plan) -> str:
    """Return the note of a plan on its path, without the note of its costmap."""
    note = (
        candidate_plan.note.removesuffix(candidate_plan.costs.estimator_note).rstrip("; ")
        if candidate_plan.costs
        else candidate_plan.note
    )
    sentences = [note] if note else []
    if not candidate_plan.minimises:
        sentences.append("any path, since its planner minimises nothing")
    if candidate_plan.bound is not None:
        sentences.append(f"no path within the budget is shorter than {candidate_plan.bound:.2f} m")
    return "; ".join(sentences)


@dataclass(frozen=True)
class RecommendingPlanner:
    """The planner that drives dissimilar paths in simulation, and returns the one it recommends.

    It drives on one thread, since a comparison's workers run at the same time.
    """

    name: ClassVar[str] = "simulated choice"
    space: ClassVar[str] = "R2"
    minimises: ClassVar[str | None] = "simulated error"

    drives: int = RecommendationSettings.drives
    """Maximum number of confirming drives of a path, 2 to 1024."""
    minimise: Minimise = RecommendationSettings.minimise
    """Error that decides: "rmse", "goal-error", "heading" or "lost"."""
    price: float = RecommendationSettings.price
    """What the logarithm of the length counts in the race, >= 0."""
    longest: float = RecommendationSettings.longest
    """Maximum length of a candidate, in lengths of the shortest path, >= 1."""
    bold: bool = False
    """Whether an undecided path is taken, too, see `RecommendationSettings`."""
    robot: Robot | str | None = None
    """The robot, or a file of it that `Robot.load` reads; its size is that of the costmap. By
    default it has Nav2's filter, and the lidar of the costmap's field."""
    seed: int | None = None
    """Seed of the drives, >= 0; by default 1, or each seed of a comparison."""

    def __post_init__(self) -> None:
        if isinstance(self.robot, str):  # once: workers need no file
            object.__setattr__(self, "robot", Robot.load(self.robot))

    def check(self) -> None:
        """Raise a ConfigError unless the options are within their ranges."""
        _ = self._settings
        if self.seed is not None:
            check_integer("seed", self.seed, 0)
        if self.robot is not None:
            check_instance("robot", self.robot, Robot)

    @property
    def _settings(self) -> RecommendationSettings:
        return RecommendationSettings(
            drives=self.drives,
            minimise=self.minimise,
            price=self.price,
            longest=self.longest,
            bold=self.bold,
            rival=None,
        )

    def prepare(self) -> None:
        """Load the kernels of the planners and of the drives."""
        grid = OccupancyGrid(np.full((8, 8), FREE, np.uint8), 0.1)
        costs = Costmap.blank(grid, robot=0.05)
        RecommendingPlanner(drives=2).solve(costs, (0.25, 0.35), (0.55, 0.35))

    def solve(self, costs: Costmap, start: Position, goal: Position) -> PlannerResult:
        """Choose among paths of this costmap, and return the chosen one.

        See `locplan.planning.Planner.solve`.
        """
        if start[:2] == goal[:2]:
            return AnyAngle().solve(costs, start, goal)
        config = costs.settings.config if costs.settings else None
        robot = equip_robot(None if isinstance(self.robot, str) else self.robot, config)
        recommendation = recommend_path(
            costs.grid,
            start[:2],
            goal[:2],
            robot,
            costs=costs,
            settings=self._settings,
            seed=1 if self.seed is None else self.seed,
            threads=1,
        )
        return PlannerResult(recommendation.path, recommendation.status)
