"""The command that exports to navigation stacks and to plain files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from locplan.cli.options import (
    STYLE,
    AsJson,
    CacheDir,
    Estimator,
    FieldOfView,
    Headings,
    MapFile,
    Preset,
    Range,
    Scheduler,
    SensorName,
    Stride,
    Template,
    Threads,
    computing,
    config_of,
    load,
    position,
    say_written,
    to_json,
)
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.costmap import Costmap
    from locplan.path import Path as Route

app = typer.Typer(**STYLE)

SUFFIXES = {"bag": ".mcap", "path": ".csv", "csv": ".csv", "npz": ".npz", "png": ".png"}
"""Of the formats that are one file; the others are folders."""


@app.command()
def export(
    map_file: MapFile,
    to: Annotated[
        str,
        typer.Option(
            help="nav2-keepout | nav2-static | nav2-speed | ros-map | route-graph | bag | path"
            " (.csv, .json or .yaml) | csv | npz | png (of the field)."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File or folder; MAP-FORMAT here by default."),
    ] = None,
    weight: Annotated[
        float, typer.Option(help="Metres of detour accepted per metre of blind travel.")
    ] = 4.0,
    criterion: Annotated[
        str,
        typer.Option(
            help="Of u: e | position_std | position_rms | heading_std | ambiguity | entropy."
        ),
    ] = "e",
    robot_radius: Annotated[float, typer.Option(help="Robot's radius [m].")] = 0.25,
    planner: Annotated[
        str,
        typer.Option(
            help="Of nav2-keepout and nav2-static, whose costs shall be J: smac2d | smac-hybrid |"
            " navfn | thetastar."
        ),
    ] = "smac2d",
    planner_param: Annotated[
        float | None,
        typer.Option(
            help="Its cost_travel_multiplier, cost_penalty or w_traversal_cost; such that"
            " weight · u just fits by default."
        ),
    ] = None,
    distro: Annotated[
        str, typer.Option(help="Of ROS 2: humble names plugins in another way than later ones.")
    ] = "jazzy",
    params: Annotated[
        Path | None, typer.Option(help="Of Nav2: merge our parameters into this file's.")
    ] = None,
    slowest: Annotated[
        float, typer.Option(help="Of nav2-speed: share of the speed left where nothing is seen.")
    ] = 0.3,
    spacing: Annotated[
        float, typer.Option(min=0.1, help="Of route-graph's nodes, of bag's ellipses [m].")
    ] = 2.0,
    path: Annotated[
        list[Path] | None,
        typer.Option(metavar="CSV", help="Of bag and path: a path (x_m,y_m); bag takes several."),
    ] = None,
    start: Annotated[
        str | None, typer.Option(metavar="X,Y", help="Or plan one from here [m] ...")
    ] = None,
    goal: Annotated[str | None, typer.Option(metavar="X,Y", help="... to here.")] = None,
    frame: Annotated[str, typer.Option(help="Of bag, path and route-graph.")] = "map",
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
    """Write cost maps, route graphs, bags and paths for navigation stacks, or plain files."""
    from locplan import export as exporting
    from locplan import reporting
    from locplan.costmap import Costmap

    if to not in exporting.FORMATS:
        raise ConfigError(f"--to must be one of {', '.join(exporting.FORMATS)}, not {to!r}")
    if (start is None) != (goal is None):
        raise ConfigError("--start and --goal belong together")
    config = config_of(
        preset, sensor_range, template, stride, estimator, sensor, field_of_view, headings
    )
    grid = load(map_file)
    target = output or Path(f"{grid.name}-{to}" + SUFFIXES.get(to, ""))
    _check(to, target)
    routes = {file.stem: exporting.read_path(file) for file in path or []}
    if to == "path" and len(routes) + (start is not None) != 1:
        raise ConfigError("--to path needs one --path CSV, or --start and --goal")
    with computing(config, threads, scheduler, cache_dir) as compute:
        field = compute(grid)
    costs = Costmap.from_field(
        grid, field, weight=weight, robot_radius=robot_radius, criterion=criterion
    )
    if start and goal:
        routes["aware"] = _planned(costs, position("start", start), position("goal", goal))
    about: dict[str, Any] = {"map": grid.name, "to": to, "target": str(target)}
    if to in ("nav2-keepout", "nav2-static"):
        write = exporting.nav2_keepout if to == "nav2-keepout" else exporting.nav2_static
        conversion = write(
            target, costs, planner=planner, param=planner_param, distro=distro, params=params
        )
        about |= conversion.summary()
    elif to == "nav2-speed":
        exporting.nav2_speed(target, costs, slowest=slowest, params=params)
        about["slowest"] = slowest
    elif to == "ros-map":
        exporting.ros_map(target, costs)
    elif to == "route-graph":
        graph = exporting.route_graph(target, costs, spacing=spacing, frame=frame)
        about |= {"nodes": len(graph.nodes), "edges": len(graph.edges)}
    elif to == "bag":
        mask = exporting.percent(costs)
        exporting.bag(
            target, grid, mask=mask, field=field, paths=routes, frame=frame, spacing=spacing
        )
        about["paths"] = list(routes)
    elif to == "path":
        (route,) = routes.values()
        exporting.path(target, route, frame=frame)
        about["length_m"] = route.length
    else:
        exporting.field(target, field)
    print(to_json(about) if as_json else reporting.export_table(about))
    say_written(target)


def _check(to: str, target: Path) -> None:
    """Complain before long work."""
    from locplan.export import PATH_FILES
    from locplan.files import check_target

    if to == "path":
        check_target(target, *PATH_FILES)
    elif to in SUFFIXES:
        check_target(target, SUFFIXES[to])


def _planned(costs: Costmap, start: tuple[float, ...], goal: tuple[float, ...]) -> Route:
    from locplan.planners import plan

    found = plan(costs, start[:2], goal[:2], planner="any-angle")
    if found.path is None:
        raise ConfigError(f"no path leads from --start to --goal: {found.status}")
    return found.path
