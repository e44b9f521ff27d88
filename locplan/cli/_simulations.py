"""The command that drives paths in simulated worlds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from locplan.cli._options import (
    STYLE,
    AsJson,
    CacheDir,
    ConfigFile,
    Estimator,
    FieldOfView,
    Headings,
    Preset,
    Range,
    Scheduler,
    SensorName,
    Stride,
    Template,
    Threads,
    computing,
    config_of,
    numbers,
    say_written,
    to_json,
)
from locplan.cli._simulated import Folder, LidarName, MapFiles, Params, Radius, Seed, Set, simulated
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.costs import Costmap, Path as Route
    from locplan.field import CovarianceField
    from locplan.maps import OccupancyGrid
    from locplan.simulation._routes import Routes

    Compute = Callable[[OccupancyGrid], CovarianceField]

app = typer.Typer(**STYLE)


@app.command()
def simulate(
    maps: MapFiles,
    path: Annotated[
        list[Path] | None,
        typer.Option(metavar="CSV", help="One of: paths (x_m,y_m) that plan wrote; repeatable."),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(metavar="X,Y", help="Or from here the shortest and the aware path ..."),
    ] = None,
    goal: Annotated[str | None, typer.Option(metavar="X,Y", help="... to here [m].")] = None,
    random: Annotated[
        int | None,
        typer.Option(
            min=2,
            help="Or both paths of so many queries at random on each map; 5 or more for intervals.",
        ),
    ] = None,
    least_distance: Annotated[
        float, typer.Option(help="Of random queries, from start to goal [m].")
    ] = 10.0,
    drives: Annotated[int, typer.Option(min=2, help="Simulated drives along each path.")] = 100,
    seed: Seed = 1,
    lidar: LidarName = None,
    params: Params = None,
    settings: Set = None,
    weight: Annotated[
        float, typer.Option(help="Metres of detour accepted per degenerate metre.")
    ] = 4.0,
    robot_radius: Radius = 0.25,
    output: Folder = None,
    config_file: ConfigFile = None,
    preset: Preset = "default",
    sensor_range: Range = None,
    estimator: Estimator = "sad",
    sensor: SensorName = None,
    field_of_view: FieldOfView = None,
    headings: Headings = 0,
    template: Template = "disc",
    stride: Stride = 0.2,
    threads: Threads = None,
    scheduler: Scheduler = None,
    cache_dir: CacheDir = None,
    as_json: AsJson = False,
) -> None:
    """Drive paths with AMCL in simulated worlds: its error, and how often it is lost (> 1 m)."""
    from locplan._util.files import check_folder
    from locplan._util.progress import progress_bar
    from locplan.costs._costmap import check_weight
    from locplan.maps import find_maps, load_map
    from locplan.simulation import _reports as reports, _routes as routes

    ends = start is not None, goal is not None
    if [bool(path), any(ends), random is not None].count(True) != 1 or any(ends) != all(ends):
        raise ConfigError("give one of --path, --start with --goal, and --random")
    check_weight(weight)
    config = config_of(
        preset,
        sensor_range,
        template,
        stride,
        estimator,
        sensor,
        field_of_view,
        headings,
        config_file,
    )
    simulated_lidar, amcl, disturbances = simulated(config, lidar, params, settings)
    shared: dict[str, Any] = {
        "lidar": simulated_lidar,
        "amcl": amcl,
        "disturbances": disturbances,
        "drives": drives,
        "seed": seed,
        "threads": threads,
    }
    files = find_maps(*maps)
    if random is None and len(files) > 1:
        raise ConfigError(
            f"one path is of one map: name one of these {len(files)}, or give --random"
        )
    grids = [load_map(file) for file in files]
    if output:
        check_folder(output)
    made_of: dict[str, Any] = {}
    with computing(config, threads, scheduler, cache_dir) as compute:
        if random is not None:
            costs = (_costs(grid, compute, weight, robot_radius) for grid in grids)
            every = [_at_random(each, random, least_distance, shared) for each in costs]
            written = reports.write_routes(output, every) if output else []
            print(
                to_json(reports.routes_summary(every)) if as_json else reports.routes_table(every)
            )
            say_written(*written)
            return
        if path:
            paths = _read(path)
        else:
            assert start is not None
            assert goal is not None
            query = numbers("start", start, 2), numbers("goal", goal, 2)
            paths, made_of = _planned(grids[0], compute, query, weight, robot_radius)
    if not paths:
        said = "unreachable: no path leads to the goal"
        print(to_json({"status": "unreachable"}) if as_json else said)
        return
    with progress_bar("simulating", "drives") as progress:
        result = routes.simulate(grids[0], paths, made_of=made_of, progress=progress, **shared)
    written = reports.write_simulation(output, result) if output else []
    print(to_json(result.summary()) if as_json else reports.simulation_table(result))
    say_written(*written)


def _read(files: Sequence[Path]) -> dict[str, Route]:
    """Paths by the names of their files."""
    from locplan.export._plain_files import read_path

    paths = {file.stem: read_path(file) for file in files}
    if len(paths) < len(files):
        raise ConfigError("paths are told apart by the names of their files; rename some")
    return paths


def _costs(grid: OccupancyGrid, compute: Compute, weight: float, robot_radius: float) -> Costmap:
    from locplan.costs import Costmap

    return Costmap.from_field(grid, compute(grid), weight=weight, robot_radius=robot_radius)


def _planned(
    grid: OccupancyGrid,
    compute: Compute,
    ends: tuple[Sequence[float], Sequence[float]],
    weight: float,
    robot_radius: float,
) -> tuple[dict[str, Route], dict[str, Any]]:
    """The shortest and the aware path, and what they were planned on; none without a path."""
    from locplan import planners
    from locplan.costs import Costmap, about_costs
    from locplan.planners import Query
    from locplan.simulation._routes import planned

    start, goal = ((xy[0], xy[1]) for xy in ends)
    planners.check_ends(Costmap.blank(grid, robot_radius=robot_radius), start, goal)
    costs = _costs(grid, compute, weight, robot_radius)
    return planned(costs, Query("asked", start, goal)), about_costs(costs)


def _at_random(costs: Costmap, count: int, least_distance: float, shared: dict[str, Any]) -> Routes:
    from locplan._util.progress import progress_bar
    from locplan.planners import random_queries
    from locplan.simulation._routes import simulate_queries

    queries = random_queries(costs, count, shared["seed"], least_distance=least_distance)
    with progress_bar(f"simulating in {costs.grid.name}", "drives") as progress:
        return simulate_queries(costs, queries, progress=progress, **shared)
