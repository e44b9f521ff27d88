"""The command that draws: fields as the paper draws them, and matches at a place."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from locplan.cli._options import (
    STYLE,
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
)
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.field import CovarianceField, Sad
    from locplan.maps import OccupancyGrid

app = typer.Typer(**STYLE)

OF_FIELDS = ("field", "e", "ellipses")
AT_A_PLACE = ("distribution", "models")


@app.command()
def plot(
    map_file: MapFile,
    output: Annotated[Path, typer.Option("--output", "-o", help="The picture (.png, .pdf, .svg).")],
    figure: Annotated[
        str,
        typer.Option(
            help="field (a scalar as a heat map) | e (linear, as the paper has it) | ellipses |"
            " distribution (mismatch over the window, --at) | models (all seven, --at)."
        ),
    ] = "field",
    scalar: Annotated[
        str,
        typer.Option(
            help="Of field: e | position_std | position_rms | heading_std; of scan: ambiguity |"
            " entropy."
        ),
    ] = "e",
    ranges: Annotated[
        str | None,
        typer.Option(metavar="R1,R2", help="Of e and ellipses: these ranges side by side [m]."),
    ] = None,
    limits: Annotated[
        str | None, typer.Option(metavar="LOW,HIGH", help="Of e: the ends of the colours.")
    ] = None,
    spacing: Annotated[
        float, typer.Option(min=0.1, help="Of ellipses: least distance between them [m].")
    ] = 2.0,
    magnify: Annotated[float, typer.Option(min=0.01, help="Of ellipses: factor on them.")] = 1.0,
    at: Annotated[
        str | None, typer.Option(metavar="X,Y", help="Of distribution and models: where [m].")
    ] = None,
    axis: Annotated[str, typer.Option(help="Of models: x | y | theta.")] = "x",
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
) -> None:
    """Draw the map with its field, or how well a place matches its surroundings."""
    from locplan import plotting
    from locplan._util.files import PICTURES, check_target
    from locplan.field import SCALARS
    from locplan.plotting._captions import how

    if figure not in OF_FIELDS + AT_A_PLACE:
        known = ", ".join(OF_FIELDS + AT_A_PLACE)
        raise ConfigError(f"--figure must be one of {known}, not {figure!r}")
    reaches = numbers("ranges", ranges) if ranges else [sensor_range]
    configs = [
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
    layers = [layer.name for layer in configs[0].estimator.layers]
    if scalar not in (*SCALARS, *layers):
        known = ", ".join((*SCALARS, *layers))
        more = "; ambiguity and entropy are of --estimator scan" if estimator != "scan" else ""
        raise ConfigError(f"--scalar must be one of {known}, not {scalar!r}{more}")
    if figure in AT_A_PLACE and estimator != "sad":
        raise ConfigError(f"--figure {figure} is of --estimator sad")
    if ranges and figure not in ("e", "ellipses"):
        raise ConfigError("--ranges is for --figure e and ellipses")
    check_target(output, *PICTURES)
    place = numbers("at", at, 2) if at else None
    colours = numbers("limits", limits, 2) if limits else None
    if colours and colours[0] >= colours[1]:
        raise ConfigError(f"--limits must rise, not {limits!r}")
    grid = load(map_file)
    if figure in AT_A_PLACE:
        if place is None:
            raise ConfigError(f"--figure {figure} needs --at X,Y")
        sad: Any = configs[0].estimator
        drawn = _at_a_place(figure, grid, place, axis, sad)
    else:
        fields = {}
        for config in configs:
            with computing(config, threads, scheduler, cache_dir) as compute:
                fields[f"{grid.name}: {how(config)}, range {config.estimator.reach:g} m"] = compute(
                    grid
                )
        drawn = _of_fields(figure, fields, scalar, colours, spacing, magnify)
    plotting.save_figure(drawn, output)
    say_written(output)


def _of_fields(
    figure: str,
    fields: dict[str, CovarianceField],
    scalar: str,
    limits: list[float] | None,
    spacing: float,
    magnify: float,
) -> Any:
    from locplan import plotting

    if figure == "e":
        return plotting.e_figure(fields, (limits[0], limits[1]) if limits else None)
    if figure == "ellipses":
        return plotting.ellipses_figure(fields, spacing=spacing, magnify=magnify)
    return plotting.field_figure(next(iter(fields.values())), scalar)


def _at_a_place(
    figure: str, grid: OccupancyGrid, place: list[float], axis: str, estimator: Sad
) -> Any:
    from locplan import paper
    from locplan.paper.template_matching import along_axis, mismatch

    x, y = place
    title = f"{grid.name} at {x:g}, {y:g} m, range {estimator.range:g} m"
    if figure == "models":
        return paper.models_figure(*along_axis(grid, x, y, axis, estimator), axis, title)
    window = estimator.window.on(grid.resolution)
    return paper.distribution_figure({title: mismatch(grid, x, y, estimator)}, window)
