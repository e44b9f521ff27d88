"""The commands about fields, their cache, and maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

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
    say_written,
    to_json,
)

app = typer.Typer(**STYLE)
cache = typer.Typer(help="The fields that were computed before.", **STYLE)
app.add_typer(cache, name="cache")


@app.command()
def field(
    maps: Annotated[
        list[Path],
        typer.Argument(metavar="MAP...", help="map_server YAML files, or their folders."),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Write the field here (.zarr; of many maps a folder)."),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw e over the map (.png, .pdf, .svg; of many maps a folder)."),
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
    """Compute how uncertain a pose match is all over a map, or over many."""
    from locplan.export import _results as reporting
    from locplan.export._batch import jobs_for, run_all

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
    jobs = jobs_for(maps, output, picture)
    with computing(config, threads, scheduler, cache_dir) as compute:
        if len(jobs) == 1:
            computed = jobs[0].run(compute)
            about = reporting.field_summary(computed)
            print(to_json(about) if as_json else reporting.field_table(computed))
            say_written(output, picture)
            return
        summaries = list(run_all(jobs, compute))
    print(to_json(summaries) if as_json else reporting.fields_table(summaries))
    errors = [about for about in summaries if about["error"]]
    if len(errors) < len(summaries):
        say_written(output, picture)
    if errors:
        raise typer.Exit(2)


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
    from locplan._util.files import make_folder
    from locplan.maps import environments, save_map

    make_folder(folder)
    for each in name or environments.names():
        grid = environments.make(
            each, resolution=resolution, boundary_noise=boundary_noise, seed=seed
        )
        stem = f"{each}_noise{boundary_noise:g}_seed{seed}" if boundary_noise else each
        save_map(grid, folder / f"{stem}.yaml")
        say_written(folder / f"{stem}.yaml")


@cache.command("list")
def cache_list(cache_dir: CacheDir = None, as_json: AsJson = False) -> None:
    """List the cached fields, the last used first."""
    from locplan.export import _results as reporting
    from locplan.field._cache import cache_folder, cache_limit, entries

    folder, limit = cache_folder(cache_dir), cache_limit()
    found = entries(folder)
    print(
        to_json(reporting.cache_summary(found))
        if as_json
        else reporting.cache_table(found, folder, limit)
    )


@cache.command("clear")
def cache_clear(
    older_than: Annotated[
        float, typer.Option(metavar="DAYS", min=0, help="Only those not used for so long.")
    ] = 0.0,
    cache_dir: CacheDir = None,
) -> None:
    """Remove cached fields, but for those being computed."""
    from locplan.export import _results as reporting
    from locplan.field._cache import cache_folder, remove_older

    removed, busy = remove_older(cache_folder(cache_dir), older_than)
    print(reporting.cleared(removed, busy))


@cache.command("path")
def cache_path(cache_dir: CacheDir = None) -> None:
    """Print the folder of the cached fields."""
    from locplan.field._cache import cache_folder

    print(cache_folder(cache_dir))
