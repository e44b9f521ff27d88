"""The command `simulate`: simulate drives along paths, or replay a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import locplan
from locplan._support.progress import show_progress_bar
from locplan.app.cli.application import command
from locplan.app.cli.arguments import (
    MapFiles,
    PairCount,
    PathFiles,
    Position,
    check_ends,
    read_paths,
    reject_options,
    show_default,
)
from locplan.app.cli.groups import (
    SEED,
    FieldOptions,
    FilterMapFile,
    OutputOptions,
    RecordingFile,
    RobotOptions,
    Seed,
    Threads,
    Weight,
    load_filter_map,
    load_recording,
)
from locplan.app.cli.log import LOG
from locplan.errors import ConfigError


def _default_distance() -> float:
    from locplan.planning.queries import MIN_DISTANCE

    return MIN_DISTANCE


def _default_drives() -> str:
    from locplan.recordings.replays import REPLAY_RUNS
    from locplan.simulation.drives import DEFAULT_DRIVES

    return f"{DEFAULT_DRIVES} or {REPLAY_RUNS}"


MinDistance = Annotated[float | None, show_default(_default_distance)]
DriveCount = Annotated[PairCount | None, show_default(_default_drives)]


@command(
    "simulate lab.yaml --start 2,3 --goal 38,3 -o simulated",
    "simulate lab.yaml --path planned/01-shortest.csv --path mine.csv -o simulated",
    "simulate lab.yaml --random 20 -o queries",
    "simulate lab.yaml --recording drive.npz --robot nav2_params.yaml -o replayed",
)
def simulate(
    maps: MapFiles,
    /,
    *,
    start: Position = None,
    goal: Position = None,
    path: PathFiles = (),
    random: PairCount | None = None,
    min_distance: MinDistance = None,
    recording: RecordingFile = None,
    weight: Weight = None,
    drives: DriveCount = None,
    closed_loop: PairCount | None = None,
    replan: float | None = None,
    robot: RobotOptions = RobotOptions(),
    filter_map: FilterMapFile = None,
    field: FieldOptions = FieldOptions(),
    seed: Seed = SEED,
    threads: Threads = None,
    output: OutputOptions = OutputOptions(),
) -> None:
    """Simulate drives with the robot's filter, and report its error and how often it gets lost.

    With --recording, replays the filter on the recorded odometry and scans instead.

    Parameters
    ----------
    maps
        Map YAML files, folders with one, or built-in maps.
    start
        Start of the shortest and the localizability-aware path, in metres.
    goal
        Goal of both paths, in metres.
    path
        Path to simulate (CSV of x,y). Repeatable.
    random
        Number of random queries per map, instead of --start and --goal.
    min_distance
        Minimum distance of random queries, in metres.
    weight
        Detour that avoiding a degenerate metre is worth, in metres.
    drives
        Number of drives per path, or of replays.
    closed_loop
        Number of additional closed-loop drives per path.
    replan
        Replanning interval of closed-loop drives, in seconds.
    """
    from locplan.field.config import equip_robot
    from locplan.maps.files import find_maps
    from locplan.planning import plans
    from locplan.planning.plans import plan_with_shortest
    from locplan.planning.queries import MIN_DISTANCE, check_random_query_options, random_queries
    from locplan.simulation import simulations
    from locplan.simulation.arrivals import ClosedLoopSettings
    from locplan.simulation.drives import DEFAULT_DRIVES
    from locplan.simulation.query_routes import RoutesOnMaps, simulate_queries
    from locplan.simulation.simulations import Simulation

    check_ends(start, goal)
    has_one_kind = bool(path) + (start is not None) + (random is not None) == 1
    if recording is None and not has_one_kind:
        raise ConfigError(
            "name the paths with one of --path, --start and --goal, --random, or --recording"
        )
    if random is None:
        reject_options("without --random", min_distance=min_distance)
    if closed_loop is None:
        reject_options("without --closed-loop", replan=replan)
    if path and recording is None:
        reject_options("with --path, which needs no plan", weight=weight, stride=field.stride)
    files = find_maps(*maps)
    if recording and len(files) > 1:
        raise ConfigError(f"a recording needs one map; name one of these {len(files)}")
    if random is None and len(files) > 1:
        raise ConfigError(f"a path needs one map; name one of these {len(files)}, or use --random")
    if recording:
        reject_options(
            "with --recording", start=start, goal=goal, path=path, random=random, weight=weight
        )
        reject_options(
            "with --recording", closed_loop=closed_loop, field=field.field, stride=field.stride
        )
        return _replay(recording, files[0], drives, robot, filter_map, seed, threads, output)
    simulated, config = field.resolve(robot.load())
    is_assumed = simulated.lidar is None
    simulated = equip_robot(simulated, config)
    robot.warn_of_filter_settings(simulated)
    grids = [locplan.load_map(file) for file in files]
    filter_grid = load_filter_map(filter_map, maps)

    def make_costmap(grid: locplan.OccupancyGrid) -> locplan.Costmap:
        computed = field.compute(grid, config, threads)
        return locplan.Costmap.from_field(computed, robot=simulated, weight=weight)

    if random is not None:
        reject_options("with --random", closed_loop=closed_loop)
        distance = MIN_DISTANCE if min_distance is None else min_distance
        check_random_query_options(random, seed, distance)
        kind = RoutesOnMaps
        output.check(kind.files, *kind.pictures([grid.name for grid in grids]))
        routes = []
        for grid in grids:
            costs = make_costmap(grid)
            queries = random_queries(costs, random, seed, min_distance=distance)
            with show_progress_bar(f"simulating in {grid.name}", "drives") as progress:
                routes.append(
                    simulate_queries(
                        costs,
                        queries,
                        simulated,
                        drives=drives or DEFAULT_DRIVES,
                        filter_map=filter_grid,
                        seed=seed,
                        threads=threads,
                        progress=progress,
                    )
                )
        return output.finish(kind(tuple(routes)))
    output.check(Simulation.files, *["arrivals.csv"] * bool(closed_loop))
    (grid,) = grids
    paths = read_paths(path)
    path_costs: locplan.Costmap | None = None
    if start and goal:
        if start == goal:
            raise ConfigError("--start and --goal are the same position; choose two positions")
        plans.check_ends(locplan.Costmap.blank(grid, robot=simulated), start, goal)
        path_costs = make_costmap(grid)
        aware_and_shortest = plan_with_shortest(path_costs, start, goal)
        paths = {
            name: plan.path for name, plan in aware_and_shortest.items() if plan.path is not None
        }
    if not paths:
        return output.show(
            {"status": "unreachable"}, "unreachable: no path leads from start to goal"
        )
    closed_loop_settings = None
    if closed_loop:
        closed_loop_settings = ClosedLoopSettings(drives=closed_loop, replan=replan)
    with show_progress_bar("simulating", "drives") as progress:
        result = simulations.simulate(
            grid,
            paths,
            simulated,
            costs=path_costs,
            drives=drives or DEFAULT_DRIVES,
            closed=closed_loop_settings,
            filter_map=filter_grid,
            seed=seed,
            threads=threads,
            progress=progress,
        )
    if is_assumed:
        title = simulated.known_lidar.title
        LOG.info("robot: assumed lidar %s; name yours with --lidar", title)
    output.finish(result)


def _replay(
    recording: Path,
    map_file: Path,
    runs: int | None,
    robot: RobotOptions,
    filter_map: Path | None,
    seed: int,
    threads: int | None,
    output: OutputOptions,
) -> None:
    """Replay the filter on a recording."""
    from locplan.recordings.replays import REPLAY_RUNS, Replay, replay

    output.check(Replay.files)
    robot.check_recorded()
    grid = locplan.load_map(map_file)
    ground_truth = load_recording(recording, grid, map_file)
    replayed = robot.load_recorded(ground_truth)
    robot.warn_of_filter_settings(replayed)
    with show_progress_bar("replaying", "runs") as progress:
        result = replay(
            ground_truth,
            grid,
            replayed,
            runs=runs or REPLAY_RUNS,
            filter_map=load_filter_map(filter_map, [map_file]),
            seed=seed,
            threads=threads,
            progress=progress,
        )
    output.finish(result)
