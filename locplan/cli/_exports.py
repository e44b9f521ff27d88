"""The command that exports to navigation stacks and to plain files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    numbers,
    say_written,
    to_json,
)
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.costs import Costmap, Path as Route

app = typer.Typer(**STYLE)

SUFFIXES = {"bag": ".mcap", "path": ".csv", "csv": ".csv", "npz": ".npz", "png": ".png"}
"""Of the formats that are one file; the others are folders."""
_MASK = ("planner", "planner-param")
OPTIONS = {
    "nav2-keepout": (*_MASK, "distro", "params"),
    "nav2-static": (*_MASK, "distro", "params"),
    "nav2-speed": ("slowest", "params"),
    "route-graph": ("spacing", "frame"),
    "bag": (*_MASK, "spacing", "path", "start", "goal", "frame"),
    "path": ("path", "start", "goal", "step", "frame"),
}
"""That only some formats have."""
FORMATS = (
    "nav2-keepout",
    "nav2-static",
    "nav2-speed",
    "ros-map",
    "route-graph",
    "bag",
    "path",
    "csv",
    "npz",
    "png",
)
SPACING, FRAME = 2.0, "map"


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
        float, typer.Option(help="Metres of detour accepted per degenerate metre.")
    ] = 4.0,
    criterion: Annotated[
        str,
        typer.Option(
            help="Of u: e | position_std | position_rms | heading_std | ambiguity | entropy."
        ),
    ] = "e",
    robot_radius: Annotated[float, typer.Option(help="Robot's radius [m].")] = 0.25,
    planner: Annotated[
        str | None,
        typer.Option(
            help="Of nav2-keepout, nav2-static and bag, whose costs shall be J: smac2d (default) |"
            " smac-hybrid | navfn | thetastar."
        ),
    ] = None,
    planner_param: Annotated[
        float | None,
        typer.Option(
            help="Its cost_travel_multiplier, cost_penalty or w_traversal_cost; such that"
            " weight · u just fits by default."
        ),
    ] = None,
    distro: Annotated[
        str | None, typer.Option(help="Of ROS 2: humble writes plugins in another way.")
    ] = None,
    params: Annotated[
        Path | None, typer.Option(help="Of Nav2: merge our parameters into this file's.")
    ] = None,
    slowest: Annotated[
        float | None,
        typer.Option(help="Of nav2-speed: share of the speed left where nothing is seen; 0.3."),
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option(min=0.1, help="Of route-graph's nodes, or of bag's ellipses [m]; 2."),
    ] = None,
    path: Annotated[
        list[Path] | None,
        typer.Option(metavar="CSV", help="Of bag and path: a path (x_m,y_m); bag takes several."),
    ] = None,
    start: Annotated[
        str | None, typer.Option(metavar="X,Y", help="Of bag and path: plan one from here [m] ...")
    ] = None,
    goal: Annotated[str | None, typer.Option(metavar="X,Y", help="... to here.")] = None,
    step: Annotated[
        float | None,
        typer.Option(min=0.001, help="Of path: greatest distance of its poses [m]; its corners."),
    ] = None,
    frame: Annotated[
        str | None, typer.Option(help="Of bag, path and route-graph; map by default.")
    ] = None,
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
    """Write cost maps, route graphs, bags and paths for navigation stacks, or plain files."""
    from locplan import export as exporting
    from locplan.costs import Costmap
    from locplan.export import _results as reporting

    given = {
        "planner": planner,
        "planner-param": planner_param,
        "distro": distro,
        "params": params,
        "slowest": slowest,
        "spacing": spacing,
        "path": path or None,
        "start": start,
        "goal": goal,
        "step": step,
        "frame": frame,
    }
    _check_options(to, {name: value for name, value in given.items() if value is not None})
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
    grid = load(map_file)
    target = output or Path(f"{grid.name}-{to}" + SUFFIXES.get(to, ""))
    _check_target(to, target)
    routes = _read_paths(path or [])
    ends = [numbers(name, text, 2) for name, text in (("start", start), ("goal", goal)) if text]
    if to == "path" and len(routes) + bool(ends) != 1:
        raise ConfigError("--to path needs one --path CSV, or --start and --goal")
    with computing(config, threads, scheduler, cache_dir) as compute:
        field = compute(grid)
    costs = Costmap.from_field(
        grid, field, weight=weight, robot_radius=robot_radius, criterion=criterion
    )
    if ends:
        routes["aware"] = _planned(costs, *ends)
    about: dict[str, Any] = {"map": grid.name, "to": to, "target": str(target)}
    kind: dict[str, Any] = {"planner": planner or "smac2d", "param": planner_param}
    if to in ("nav2-keepout", "nav2-static"):
        write = exporting.nav2_keepout if to == "nav2-keepout" else exporting.nav2_static
        about |= write(target, costs, **kind, distro=distro or "jazzy", params=params).summary()
    elif to == "nav2-speed":
        about["slowest"] = 0.3 if slowest is None else slowest
        exporting.nav2_speed(target, costs, slowest=about["slowest"], params=params)
    elif to == "ros-map":
        exporting.ros_map(target, costs)
    elif to == "route-graph":
        graph = exporting.route_graph(
            target, costs, spacing=spacing or SPACING, frame=frame or FRAME
        )
        about |= {"nodes": len(graph.nodes), "edges": len(graph.edges)}
        about["components"] = graph.components
    elif to == "bag":
        mask, conversion = exporting.keepout_mask(costs, **kind)
        exporting.bag(
            target,
            grid,
            mask=mask,
            field=field,
            paths=routes,
            frame=frame or FRAME,
            spacing=spacing or SPACING,
        )
        about |= {"paths": list(routes)} | conversion.summary()
    elif to == "path":
        (route,) = routes.values()
        exporting.path(target, route, frame=frame or FRAME, step=step)
        about["length_m"] = route.length
    else:
        exporting.field(target, field)
    print(to_json(about) if as_json else reporting.export_table(about))
    say_written(target)


def _check_options(to: str, given: Mapping[str, Any]) -> None:
    """Complain of options that the format does not have, or that are wrong, before long work."""
    from locplan import export as exporting
    from locplan.maps import read_parameters

    if to not in FORMATS:
        raise ConfigError(f"--to must be one of {', '.join(FORMATS)}, not {to!r}")
    for name in given:
        if name not in OPTIONS.get(to, ()):
            having = ", ".join(other for other, names in OPTIONS.items() if name in names)
            raise ConfigError(f"--{name} is for --to {having}, not for {to}")
    if ("start" in given) != ("goal" in given):
        raise ConfigError("--start and --goal belong together")
    if "slowest" in given:
        exporting.check_slowest(given["slowest"])
    exporting.check_planner(given.get("planner", "smac2d"), given.get("planner-param"))
    exporting.check_distro(given.get("distro", "jazzy"))
    read_parameters(given.get("params"))


def _check_target(to: str, target: Path) -> None:
    """Complain before long work."""
    from locplan._util.files import check_target
    from locplan.export import PATH_FILES, check_export_folder

    if to not in SUFFIXES:
        check_export_folder(target)
    else:
        check_target(target, *(PATH_FILES if to == "path" else (SUFFIXES[to],)))


def _read_paths(files: Sequence[Path]) -> dict[str, Route]:
    from locplan.export import read_path

    routes = {file.stem: read_path(file) for file in files}
    if len(routes) < len(files):
        raise ConfigError("two --path files have one name; rename one")
    return routes


def _planned(costs: Costmap, start: Sequence[float], goal: Sequence[float]) -> Route:
    from locplan.planners import plan

    found = plan(costs, tuple(start), tuple(goal), planner="any-angle")
    if found.path is None:
        raise ConfigError(f"no path leads from --start to --goal: {found.note or found.status}")
    return found.path
