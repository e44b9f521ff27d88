"""The command line: reads what was typed, calls the library, prints what came of it."""

from __future__ import annotations

import dataclasses
import json
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from locplan import __version__
from locplan.errors import ConfigError, LocplanError

if TYPE_CHECKING:
    from locplan.config import FieldConfig
    from locplan.field import CovarianceField
    from locplan.grid import OccupancyGrid

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

INTERRUPTED = 130
# Of click, which typer brings along in some versions and depends on in others.
_UsageError: type[Any] = typer.BadParameter.__bases__[0]

MapFile = Annotated[Path, typer.Argument(metavar="MAP", help="A map_server YAML file.")]
Preset = Annotated[str, typer.Option(help="default | paper (Eq. 8-10 as printed).")]
Range = Annotated[float, typer.Option("--range", help="Sensor range [m].")]
Template = Annotated[str, typer.Option(help="disc (the paper's) | visible (what a ray sees).")]
Stride = Annotated[float, typer.Option(help="Spacing of the evaluated cells [m].")]
Threads = Annotated[int | None, typer.Option(min=1, help="Threads; all cores by default.")]
CacheDir = Annotated[
    Path | None, typer.Option(help="Where fields are cached; LOCPLAN_CACHE does the same.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def main() -> None:
    """Run the command line; a user's error ends in one line on stderr and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without ² or ∫ shows ?
    try:
        with _warnings_as_lines():
            code = app(standalone_mode=False)
        if code == INTERRUPTED:
            _complain("interrupted", INTERRUPTED)
        sys.stdout.flush()
    except LocplanError as error:
        code = _complain(f"error: {error}", 2)
    except _UsageError as error:
        message = error.format_message()
        helps = "\n" in message  # of a command without any arguments
        code = _complain(message if helps else f"error: {message} (--help shows how)", 2)
    except (KeyboardInterrupt, typer.Abort):
        code = _complain("interrupted", INTERRUPTED)
    except BrokenPipeError:
        sys.stdout = sys.stderr = None
        code = 1
    except OSError as error:
        code = _complain(f"error: {error}", 1)
        sys.stdout = None
    sys.exit(code or 0)


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Plan paths along which a robot with a 2D lidar can still localize itself."""
    if version:
        print(f"locplan {__version__}")
        raise typer.Exit


@app.command()
def field(
    map_file: MapFile,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write the field here (.npz).")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw e over the map (.png, .pdf, .svg).")
    ] = None,
    preset: Preset = "default",
    sensor_range: Range = 6.0,
    template: Template = "disc",
    stride: Stride = 0.2,
    threads: Threads = None,
    cache_dir: CacheDir = None,
    as_json: AsJson = False,
) -> None:
    """Compute how uncertain a pose match is all over a map."""
    from locplan import reporting
    from locplan.files import PICTURES, check_target

    grid = _load(map_file)
    if output:
        check_target(output, ".npz")
    if picture:
        check_target(picture, *PICTURES)
    computed = _field(grid, _config(preset, sensor_range, template, stride), threads, cache_dir)
    if output:
        computed.save(output)
    if picture:
        from locplan import plotting

        plotting.save_figure(plotting.field_figure(computed), picture)
    print(_json(reporting.field_summary(computed)) if as_json else reporting.field_table(computed))
    _say_written(output, picture)


@app.command()
def plan(
    map_file: MapFile,
    start: Annotated[str, typer.Option(metavar="X,Y", help="Start [m].")],
    goal: Annotated[str, typer.Option(metavar="X,Y", help="Goal [m].")],
    weight: Annotated[
        float, typer.Option(help="Metres of detour accepted per metre of blind travel.")
    ] = 4.0,
    robot_radius: Annotated[float, typer.Option(help="Robot's radius [m].")] = 0.25,
    planner: Annotated[str, typer.Option(help="Which planner.")] = "grid",
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for the paths (CSV), plan.json and plan.png."),
    ] = None,
    preset: Preset = "default",
    sensor_range: Range = 6.0,
    template: Template = "disc",
    stride: Stride = 0.2,
    threads: Threads = None,
    cache_dir: CacheDir = None,
    as_json: AsJson = False,
) -> None:
    """Plan a path that the robot can localize on, beside the shortest one."""
    from locplan import planners, reporting
    from locplan.costmap import Costmap, check_weight
    from locplan.files import make_folder

    ends = _position("start", start), _position("goal", goal)
    grid = _load(map_file)
    config = _config(preset, sensor_range, template, stride)
    planners.check_planner(planner)
    planners.check_ends(Costmap.blank(grid, robot_radius=robot_radius), *ends)
    check_weight(weight)
    if output:
        make_folder(output)
    computed = _field(grid, config, threads, cache_dir)
    costs = Costmap.from_field(grid, computed, weight=weight, robot_radius=robot_radius)
    # Of the many shortest paths on a grid, the one that sees most: the comparison is fair.
    shortest = planners.plan(costs.with_weight(1e-6), *ends, planner=planner)
    plans = {
        "shortest": shortest.measured_on(costs),
        "localizability-aware": planners.plan(costs, *ends, planner=planner),
    }
    if output:
        reporting.write_plans(output, costs, computed, plans)
    print(
        _json(reporting.plans_summary(plans))
        if as_json
        else reporting.plans_table(plans, computed.e_unit)
    )
    _say_written(output)


@app.command()
def plot(
    map_file: MapFile,
    output: Annotated[Path, typer.Option("--output", "-o", help="The picture (.png, .pdf, .svg).")],
    scalar: Annotated[
        str, typer.Option(help="e | position_std | position_rms | heading_std.")
    ] = "e",
    preset: Preset = "default",
    sensor_range: Range = 6.0,
    template: Template = "disc",
    stride: Stride = 0.2,
    threads: Threads = None,
    cache_dir: CacheDir = None,
) -> None:
    """Draw the map with its field as a heat map."""
    from locplan import plotting
    from locplan.covariance import SCALARS
    from locplan.files import PICTURES, check_target

    if scalar not in SCALARS:
        raise ConfigError(f"--scalar must be one of {', '.join(SCALARS)}, not {scalar!r}")
    check_target(output, *PICTURES)
    grid = _load(map_file)
    computed = _field(grid, _config(preset, sensor_range, template, stride), threads, cache_dir)
    plotting.save_figure(plotting.field_figure(computed, scalar), output)
    _say_written(output)


@app.command()
def maps(
    folder: Annotated[Path, typer.Argument(help="Where to write them.")] = Path("maps"),
    name: Annotated[list[str] | None, typer.Option(help="Only this map; repeatable.")] = None,
    resolution: Annotated[float, typer.Option(help="Edge of a cell [m].")] = 0.05,
    boundary_noise: Annotated[
        float, typer.Option(help="Share of boundary cells that flip, as in a SLAM map.")
    ] = 0.0,
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
) -> None:
    """Write the generated maps as PGM and YAML."""
    from locplan import environments, save_map
    from locplan.files import make_folder

    make_folder(folder)
    for each in name or environments.names():
        grid = environments.make(
            each, resolution=resolution, boundary_noise=boundary_noise, seed=seed
        )
        stem = f"{each}_noise{boundary_noise:g}_seed{seed}" if boundary_noise else each
        save_map(grid, folder / f"{stem}.yaml")
        _say_written(folder / f"{stem}.yaml")


def _load(map_file: Path) -> OccupancyGrid:
    from locplan.map_files import load_map

    return load_map(map_file)


def _config(preset: str, sensor_range: float, template: str, stride: float) -> FieldConfig:
    from locplan.config import FieldConfig

    presets = {"default": FieldConfig, "paper": FieldConfig.paper}
    if preset not in presets:
        raise ConfigError(f"--preset must be one of {', '.join(presets)}, not {preset!r}")
    config = presets[preset](sensor_range=sensor_range)
    changes: dict[str, Any] = {"template": template, "stride": stride}
    return dataclasses.replace(config, **changes)


def _field(
    grid: OccupancyGrid, config: FieldConfig, threads: int | None, cache_dir: Path | None
) -> CovarianceField:
    from locplan.progress import progress_bar
    from locplan.store import load_or_compute

    with progress_bar(f"field of {grid.name}", "cells") as progress:
        return load_or_compute(
            grid, config, cache_dir=cache_dir, threads=threads, progress=progress
        )


def _position(name: str, text: str) -> tuple[float, float]:
    try:
        x, y = (float(v) for v in text.split(","))
    except ValueError:
        raise LocplanError(
            f"--{name} must be X,Y in metres, such as 2.0,3.5, not {text!r}"
        ) from None
    return x, y


def _json(about: Any) -> str:
    return json.dumps(about, indent=2)


def _say_written(*paths: Path | None) -> None:
    for path in paths:
        if path:
            print(f"wrote {path}", file=sys.stderr)


@contextmanager
def _warnings_as_lines() -> Iterator[None]:
    def show(message: Any, *_: Any, **__: Any) -> None:
        _complain(f"warning: {message}", 0)

    with warnings.catch_warnings():
        warnings.simplefilter("default")
        warnings.showwarning = show
        yield


def _complain(line: str, code: int) -> int:
    print(f"locplan: {line}", file=sys.stderr)
    return code
