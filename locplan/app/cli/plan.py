"""The command `plan`: recommend a path, or compute the Pareto front."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

import locplan
from locplan._support.progress import show_progress_bar_from_first_step, show_spinner
from locplan._support.runs import format_argument, get_command_line
from locplan.app.cli.application import command
from locplan.app.cli.arguments import (
    InputFile,
    Integer,
    MapFile,
    PathFiles,
    PlannerTexts,
    Pose,
    Poses,
    Switch,
    parse_planners,
    read_paths,
    reject_options,
    show_default,
)
from locplan.app.cli.groups import (
    SEED,
    FieldOptions,
    FilterMapFile,
    OutputOptions,
    RobotOptions,
    Seed,
    Threads,
    Weight,
    load_filter_map,
    load_zones,
    print_zones,
)
from locplan.app.cli.log import LOG
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.planning.protocol import Planner
    from locplan.simulation.problem import RecommendationSettings

HALF = 0.5
"""Share of failed drives above which `plan` suggests `check`."""
MAX_DRIVES = 1024
"""Maximum number of confirming drives that `plan` suggests."""
ROBOT_OPTIONS = "--robot", "--lidar", "--set", "--filter-map"
Error = Literal["rmse", "lost", "goal-error", "heading"]
FRONT_TIME = 30.0
"""Time limit of the search for a front [s]."""


def _import_settings() -> type[RecommendationSettings]:
    from locplan.simulation.problem import RecommendationSettings

    return RecommendationSettings


MaxLength = Annotated[float | None, show_default(lambda: _import_settings().longest)]
DriveCount = Annotated[Integer | None, show_default(lambda: _import_settings().drives)]
Minimised = Annotated[
    Error | None, Parameter(show_choices=False), show_default(lambda: _import_settings().minimise)
]


@command(
    "plan lab.yaml --start 2,3 --goal 38,3 --lidar turtlebot4 --robot nav2.yaml -o planned",
    "plan lab.yaml --start 2,3 --goal 38,3 --planner BITstar:time_limit=2",
    "plan lab.yaml --start 2,3 --goal 38,3 --front -o front",
    words="ueJ",
)
def plan(
    map_file: MapFile,
    /,
    *,
    start: Pose,
    goal: Pose,
    via: Poses = (),
    planner: PlannerTexts = (),
    path: PathFiles = (),
    weight: Weight = None,
    longest: MaxLength = None,
    max_e: Annotated[float | None, Parameter(metavar="E")] = None,
    budget: Annotated[float | None, Parameter(metavar="METRES")] = None,
    front: Switch = False,
    drives: DriveCount = None,
    thorough: Switch = False,
    minimise: Minimised = None,
    zones: InputFile = None,
    robot: RobotOptions = RobotOptions(),
    filter_map: FilterMapFile = None,
    field: FieldOptions = FieldOptions(),
    seed: Seed = SEED,
    threads: Threads = None,
    output: OutputOptions = OutputOptions(),
) -> None:
    """Recommend a path along which the robot can localize.

    Simulates candidate paths until one is better than the shortest path.
    Without a lidar, plans the shortest and the localizability-aware path only.

    Parameters
    ----------
    map_file
        Map YAML, folder with one, or built-in map.
    start
        Start pose, in metres and degrees.
    goal
        Goal pose, in metres and degrees.
    via
        Waypoint, in metres and degrees. Repeatable.
    planner
        Planner of `locplan info`, or a function such as my.py:plan. Repeatable.
    path
        Further candidate (CSV of x,y). Repeatable.
    weight
        Detour that avoiding a degenerate metre is worth, in metres.
    longest
        Maximum length, as a multiple of the shortest path.
    max_e
        Maximum e of a cell on the path, in m² rad.
    budget
        Maximum degenerate metres (∫u ds) of a path.
    front
        Compute the Pareto front of length and degeneracy instead.
    drives
        Maximum number of confirming drives. 0 simulates nothing.
    thorough
        Simulate 40 closed-loop drives instead of 16.
    minimise
        Error to minimise: rmse, lost, goal-error or heading.
    zones
        Zones (GeoJSON) or a keepout mask (map YAML).
    """
    if front:
        reject_options(
            "with --front",
            via=via,
            planner=planner,
            path=path,
            weight=weight,
            longest=longest,
            max_e=max_e,
            budget=budget,
            drives=drives,
            thorough=thorough,
            minimise=minimise,
            seed=seed != SEED,
            filter_map=filter_map,
        )
        return _show_pareto_front(map_file, start, goal, zones, robot, field, threads, output)
    simulated, config = field.resolve(robot.load())
    if simulated.lidar is not None and drives != 0:
        robot.warn_of_filter_settings(simulated)
    if simulated.outline and budget is not None:
        radius = simulated.outline.inscribed_radius
        LOG.info(
            "--budget plans for a circular robot of radius %.3g m inside the footprint", radius
        )
    candidates: dict[str, locplan.Path | Planner] = {**read_paths(path)}
    for name, candidate in _parse_planners(planner, seed, via, max_e, budget).items():
        if name in candidates:
            raise ConfigError(
                f"a --path file and a --planner are both named {name}; rename the file"
            )
        candidates[name] = candidate
    output.check(locplan.Recommendation.files, "history.png")
    grid = locplan.load_map(map_file)
    polygons = load_zones(zones, grid)
    settings = _import_settings()
    with show_progress_bar_from_first_step("simulating the candidates", "drives") as progress:
        recommendation = locplan.recommend_path(
            grid,
            start,
            goal,
            simulated,
            costs=config,
            candidates=candidates,
            compute=lambda grid, points=None: field.compute(grid, config, threads, points),
            zones=polygons,
            settings=settings(
                via=via,
                max_e=max_e,
                budget=budget,
                longest=settings.longest if longest is None else longest,
                weight=weight,
                minimise=minimise or settings.minimise,
                drives=settings.drives if drives is None else drives,
                thorough=thorough,
                filter_map=load_filter_map(filter_map, [map_file]),
            ),
            seed=seed,
            threads=threads,
            progress=progress,
        )
    output.finish(recommendation)
    if output.json:
        return
    print_zones(zones, polygons)
    if step := _suggest_next_step(recommendation, str(map_file), robot, output):
        print(f"\nNext: {step[0]}", *step[1:], sep="\n  ")


def _parse_planners(
    texts: tuple[str, ...], seed: int, via: Any, max_e: float | None, budget: float | None
) -> dict[str, Planner]:
    """Return planners by label; raise a ConfigError if one ignores a limit.

    Randomized planners get the seed unless their options set one.
    """
    from locplan.planning.requests import has_option, make_planner, with_options

    planners = {}
    for spec in parse_planners(texts):
        make_planner(spec.planner, via=[*via], max_e=max_e, budget=budget)
        (planner_seed,) = spec.select_seeds([seed])
        is_random = has_option(spec.planner, "seed")
        planners[spec.label] = (
            with_options(spec.planner, seed=planner_seed) if is_random else spec.planner
        )
    return planners


def _suggest_next_step(
    recommendation: locplan.Recommendation,
    map_file: str,
    robot: RobotOptions,
    output: OutputOptions,
) -> tuple[str, ...]:
    """Return the next step and its commands; empty if nothing is left to do."""
    words, map_word = get_command_line(), format_argument(map_file)
    recommended = recommendation.recommended_candidate
    robot_words = [word for word in words if word.partition("=")[0] in ROBOT_OPTIONS]
    save_words = ["-o", str(output.output or "planned")]
    if recommended is None:
        info_command = shlex.join(["locplan", "info", map_word])
        return "list the rooms and the faults of the map:", info_command
    if recommendation.judgement is None:
        simulate = shlex.join([*words, "--lidar=turtlebot4", *save_words])
        has_lidar = recommendation.robot.lidar is not None
        return () if has_lidar else ("simulate the paths with your lidar, for example:", simulate)
    if recommendation.is_tuning_first:
        tune = shlex.join(["locplan", "tune", map_word, *robot_words, "-o", "tuned"])
        # `tune` writes a copy of this file.
        copied = f"--robot={robot.find_nav2_file('amcl')}"
        other_words = [word for word in words if word != copied]
        plan_again = shlex.join([*other_words, "--robot=tuned/nav2_params.yaml", *save_words])
        return "tune the filter, then plan with the tuned settings:", tune, plan_again
    statistics, arrivals = recommended.driven, recommended.arrivals
    is_lost = statistics is not None and statistics.lost_rate.value >= HALF
    if is_lost or (arrivals is not None and arrivals.arrival_rate.value <= HALF):
        check = shlex.join(["locplan", "check", map_word, *robot_words, "-o", "report"])
        return "find out why the robot fails, and which fix helps most:", check
    if recommendation.is_undecided:
        other_words = [word for word in words if word.partition("=")[0] != "--drives"]
        drives = min(2 * recommendation.settings.drives, MAX_DRIVES)
        more_drives = [*other_words, f"--drives={drives}", *save_words]
        return "simulate more drives:", shlex.join(more_drives)
    if output.output is None:
        save = shlex.join([*words, *save_words])
        return "save the path, a picture and all candidates:", save
    if recommendation.best:
        export = ["--to", "nav2-keepout", f"--choice={output.output}", "-o", "mask"]
        files = [word for word in robot_words if word.startswith("--robot=")]
        command_line = shlex.join(["locplan", "export", map_word, *export, *files])
        return "write a mask that makes Nav2 follow the path:", command_line
    return ()


def _show_pareto_front(
    map_file: Any,
    start: Any,
    goal: Any,
    zones_file: Any,
    robot: RobotOptions,
    field: FieldOptions,
    threads: int | None,
    output: OutputOptions,
) -> None:
    """Compute and show the Pareto front of length and degeneracy."""
    from locplan.field.summary import describe_field
    from locplan.planning.plans import check_ends

    if len(start) > 2 or len(goal) > 2:
        raise ConfigError("--front ignores headings; write --start and --goal as X,Y")
    on_map, config = field.resolve(robot.load())
    grid = locplan.load_map(map_file)
    zones = load_zones(zones_file, grid)
    check_ends(locplan.Costmap.blank(grid, robot=on_map, zones=zones), start, goal)
    output.check(locplan.ParetoFront.files)
    computed = field.compute(grid, config, threads)
    costs = locplan.Costmap.from_field(computed, robot=on_map, zones=zones)
    with show_spinner("searching the front"):
        front = locplan.pareto_front(costs, start, goal, time_limit=FRONT_TIME)
    output.finish(front)
    if not output.json:
        print_zones(zones_file, zones)
        print(describe_field(computed))
