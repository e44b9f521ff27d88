"""The command that drives paths in simulated worlds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from locplan.cli._drive_options import DriveOptions
from locplan.cli._groups import (
    GENERAL,
    INPUT,
    DriveSeed,
    Folder,
    Force,
    Json,
    MapFiles,
    Pair,
    Text,
    command,
    option_group,
)
from locplan.cli._options import Computing, CostOptions, FieldOptions
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import read_paths, refuse, show, two_numbers
from locplan.errors import ConfigError

app = command(
    "simulate",
    "simulate lab.yaml --start 2,3 --goal 38,3 -o driven",
    "simulate lab.yaml --path planned/shortest.csv --path mine.csv -o driven",
    "simulate lab.yaml --random 20 -o queries",
    "simulate lab.yaml --drive monday.mcap --robot nav2_params.yaml -o replayed",
)

DRIVES = 100
"""Number of drives along each path."""
LEAST_DISTANCE = 10.0
"""Least distance from start to goal of random queries [m]."""


@option_group(GENERAL)
class Driven:
    """The paths that are driven, and how often."""

    path: Annotated[tuple[Path, ...], INPUT, Parameter(metavar="CSV")] = ()
    """Path that is driven (x_m,y_m), as plan wrote it; repeatable."""
    start: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """Start of the shortest and the aware path, x,y in metres."""
    goal: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """Goal of both paths, x,y in metres."""
    random: Pair | None = None
    """Number of random queries on each map, in place of a start; 5 or more give intervals."""
    least_distance: float | None = None
    """Least distance from start to goal of random queries, in metres; 10 by default."""
    drives: Pair | None = None
    """Number of drives along each path; 100 by default, and 20 of a recorded drive."""


@app.default
def simulate(
    maps: MapFiles,
    /,
    *,
    driven: Driven = Driven(),
    recorded: DriveOptions = DriveOptions(),
    robot_options: RobotOptions = RobotOptions(),
    seed: DriveSeed = 1,
    costs: CostOptions = CostOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    output: Folder = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Drive paths with AMCL in simulated worlds: its error, and how often it is lost (> 1 m).

    With --drive, AMCL runs on the odometry and the scans of a recorded drive instead, and its
    errors are those against the recorded poses.
    """
    from locplan import planners
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.costs import Costmap
    from locplan.maps import find_maps, load_map
    from locplan.simulation import _reports as reports, _routes as routes, simulate as drive

    recorded.check()
    if recorded.drive:
        unread = {name: value or None for name, value in vars(driven).items() if name != "drives"}
        refuse("with --drive", **unread, **vars(costs), **vars(options))
        refuse("with --drive", scheduler=computing.scheduler, cache_dir=computing.cache_dir)
        _replay(
            maps,
            driven.drives,
            recorded,
            robot_options,
            seed,
            computing.threads,
            output,
            force,
            json,
        )
        return
    start, goal = driven.start, driven.goal
    asked = bool(driven.path), bool(start or goal), driven.random is not None
    if asked.count(True) != 1 or bool(start) != bool(goal):
        raise ConfigError("give one of --path, --start with --goal, --random, and --drive")
    least = LEAST_DISTANCE if driven.least_distance is None else driven.least_distance
    if driven.random is None:
        refuse("without --random", least_distance=driven.least_distance)
    else:
        planners.check_random(driven.random, seed, least)
    if driven.path:
        own = {
            name: getattr(options, name) for name in ("preset", "template", "headings", "stride")
        }
        refuse("with --path: no path is planned", **vars(costs), **own)
    robot, config = options.simulated(robot_options)
    costs.check(config)
    drives, threads = driven.drives or DRIVES, computing.threads
    files = find_maps(*maps)
    if driven.random is None and len(files) > 1:
        raise ConfigError(
            f"one path is of one map: name one of these {len(files)}, or give --random"
        )
    grids = [load_map(file) for file in files]
    folder = None
    if output and driven.random is not None:
        pictures = reports.picture_names([grid.name for grid in grids])
        folder = reports.QUERIES.into(output, *pictures, force=force)
    elif output:
        folder = reports.SIMULATION.into(output, force=force)

    def drive_at_random(costmap: Costmap, count: int) -> routes.Routes:
        queries = planners.random_queries(costmap, count, seed, least_distance=least)
        with progress_bar(f"simulating in {costmap.grid.name}", "drives") as progress:
            return routes.simulate_queries(
                costmap,
                queries,
                robot,
                drives=drives,
                seed=seed,
                threads=threads,
                progress=progress,
            )

    with computing.of(config) as compute:
        if driven.random is not None:
            every = [
                drive_at_random(costs.costmap(each, compute(each), robot), driven.random)
                for each in grids
            ]
            with working("writing the results"):
                written = reports.write_routes(folder, every) if folder else []
            show(json, reports.routes_summary(every), reports.routes_table(every), *written)
            return
        if not (start and goal):
            paths, costmap = read_paths(driven.path), None
        else:
            query = planners.Query("asked", two_numbers("start", start), two_numbers("goal", goal))
            blank = Costmap.blank(grids[0], robot_radius=robot.radius)
            planners.check_ends(blank, query.start, query.goal)
            costmap = costs.costmap(grids[0], compute(grids[0]), robot)
            paths = routes.planned(costmap, query)
    if not paths:
        show(json, {"status": "unreachable"}, "unreachable: no path leads to the goal")
        return
    with progress_bar("simulating", "drives") as progress:
        result = drive(
            grids[0],
            paths,
            robot,
            drives=drives,
            seed=seed,
            threads=threads,
            costs=costmap,
            progress=progress,
        )
    with working("writing the results"):
        written = reports.write_simulation(folder, result) if folder else []
    show(json, result.summary(), reports.simulation_table(result), *written)


def _replay(
    maps: list[Path],
    runs: int | None,
    recorded: DriveOptions,
    robot_options: RobotOptions,
    seed: int,
    threads: int | None,
    output: Path | None,
    force: bool,
    json: bool,
) -> None:
    """Run AMCL on a recorded drive, and tell its errors against the recorded poses."""
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.recordings import _replay as core, _replay_reports as reports

    folder = reports.REPLAY.into(output, force=force) if output else None
    grid, recording = recorded.on_map(maps)
    robot = robot_options.on_drive(recording.lidar)
    robot_options.warn(robot)
    with progress_bar("replaying", "runs") as progress:
        result = core.replay(
            recording,
            grid,
            robot,
            runs=core.RUNS if runs is None else runs,
            seed=seed,
            threads=threads,
            progress=progress,
        )
    with working("writing the results"):
        written = reports.write_replay(folder, result) if folder else []
    show(json, result.summary(), reports.replay_table(result), *written)
