"""The command that compares planners."""

from __future__ import annotations

import shlex
import signal
import sys
from contextlib import ExitStack
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
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.field import CovarianceField, FieldConfig
    from locplan.maps import OccupancyGrid

app = typer.Typer(**STYLE)

JOURNAL = "runs.jsonl"
"""In the output folder: every run as it came."""


@app.command()
def compare(
    maps: Annotated[
        list[Path],
        typer.Argument(metavar="MAP...", help="map_server YAML files, their folders, or .map."),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for report.html, tables and logs.")
    ],
    planner: Annotated[
        list[str] | None,
        typer.Option(
            help="Such as BITstar:time_limit=2; repeatable. grid and any-angle by default."
        ),
    ] = None,
    weight: Annotated[
        list[float] | None,
        typer.Option(help="Metres of detour a degenerate metre; repeatable. 4."),
    ] = None,
    random: Annotated[
        int | None, typer.Option(min=1, help="So many queries at random on each map; 10.")
    ] = None,
    least_distance: Annotated[
        float, typer.Option(help="Of random queries, from start to goal [m].")
    ] = 5.0,
    seed: Annotated[int, typer.Option(min=0, help="Of random queries.")] = 1,
    queries: Annotated[
        Path | None,
        typer.Option(help="CSV of name,start_x,start_y,goal_x,goal_y [m], or MovingAI .scen."),
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of planners with random numbers.")] = 1,
    time_limit: Annotated[
        float | None, typer.Option(help="Of OMPL's planners without their own [s]; 5.")
    ] = None,
    baseline: Annotated[
        str | None, typer.Option(help="Planner to compare with; any-angle if it is there.")
    ] = None,
    ranges: Annotated[
        str | None, typer.Option(metavar="R1,R2", help="The same for each sensor range [m].")
    ] = None,
    robot_radius: Annotated[float, typer.Option(help="Robot's radius [m].")] = 0.25,
    criterion: Annotated[
        str,
        typer.Option(
            help="Of u: e | position_std | position_rms | heading_std | ambiguity | entropy."
        ),
    ] = "e",
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes at once; all cores by default.")
    ] = None,
    memory: Annotated[
        float | None, typer.Option(help="What a run may take [GB]; 80 % of all, shared.")
    ] = None,
    patience: Annotated[
        float, typer.Option(help="For planners without a time limit, before they hang [s].")
    ] = 300.0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on where an earlier run in --output ended.")
    ] = False,
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
    """Run planners side by side, and report which one is best, where and by how much."""
    from locplan import comparison
    from locplan._util.progress import progress_bar

    if random is not None and queries is not None:
        raise ConfigError("--random and --queries exclude one another")
    if ranges and sensor_range is not None:
        raise ConfigError("--range and --ranges exclude one another")
    reaches = numbers("ranges", ranges) if ranges else [sensor_range]
    made = [
        config_of(
            preset,
            reach,
            template,
            stride,
            estimator,
            sensor,
            field_of_view,
            headings,
            config_file,
        )
        for reach in reaches
    ]
    configs = {f"{config.estimator.name}, {config.estimator.reach:g} m": config for config in made}
    comparison.specs_of(planner or ["grid"])
    comparison.check_result_folder(output)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # and clean up
    with ExitStack() as stack:
        bar = stack.enter_context(progress_bar("runs", "runs"))

        def field_of(grid: OccupancyGrid, config: FieldConfig) -> CovarianceField:
            with computing(config, threads, scheduler, cache_dir) as compute:
                return compute(grid)

        result = comparison.compare(
            maps,
            planner or ["grid", "any-angle"],
            queries or random or 10,
            weights=weight or [4.0],
            seeds=range(1, seeds + 1),
            configs=configs,
            robot_radius=robot_radius,
            criterion=criterion,
            time_limit=time_limit,
            least_distance=least_distance,
            query_seed=seed,
            baseline=baseline,
            workers=workers,
            memory=None if memory is None else memory * 1e9,
            patience=patience,
            journal=output / JOURNAL,
            resume=resume,
            field_of=field_of,
            progress=bar,
        )
    written = result.save(output, command=shlex.join(["locplan", *sys.argv[1:]]))
    about: Any = result.to_json()
    print(to_json(about) if as_json else result.table())
    say_written(*written)
