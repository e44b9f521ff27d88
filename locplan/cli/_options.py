"""Options that commands share, and what becomes of them."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from locplan.errors import ConfigError, LocplanError

if TYPE_CHECKING:
    from locplan.costs import Footprint
    from locplan.field import CovarianceField, FieldConfig
    from locplan.maps import OccupancyGrid

STYLE: dict[str, Any] = {
    "add_completion": False,
    "no_args_is_help": True,
    "rich_markup_mode": None,
    "pretty_exceptions_enable": False,
    "context_settings": {"help_option_names": ["-h", "--help"]},
}

MapFile = Annotated[Path, typer.Argument(metavar="MAP", help="A map_server YAML file.")]
ConfigFile = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE.json",
        help="All settings of the field, as calibrate wrote them; only --range may differ.",
    ),
]
Preset = Annotated[str, typer.Option(help="default | paper (Eq. 8-10 as printed).")]
Range = Annotated[
    float | None, typer.Option("--range", help="Lidar range [m]; 6, or the sensor's own.")
]
Estimator = Annotated[
    str,
    typer.Option(
        help="sad (the paper's) | fisher | scan: the last two know the sensor (see --sensor)."
    ),
]
SensorName = Annotated[
    str | None,
    typer.Option(
        "--sensor",
        metavar="NAME",
        help="rplidar-a1 | utm-30lx | lms291 | urg-04lx.",
    ),
]
FieldOfView = Annotated[
    float | None, typer.Option("--field-of-view", help="Of the sensor [deg]; 360, or its own.")
]
Headings = Annotated[
    int,
    typer.Option(
        show_default=False, help="Of the field; 1 if the sensor sees all round, else 8, by default."
    ),
]
Template = Annotated[str, typer.Option(help="disc (the paper's) | visible (what a ray sees).")]
Stride = Annotated[float, typer.Option(help="Spacing of the evaluated cells [m].")]
Threads = Annotated[int | None, typer.Option(min=1, help="Threads; all cores by default.")]
Scheduler = Annotated[
    str | None, typer.Option(metavar="tcp://HOST:PORT", help="Compute on this dask cluster.")
]
CacheDir = Annotated[
    Path | None, typer.Option(help="Where fields are cached; LOCPLAN_CACHE does the same.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def load(map_file: Path) -> OccupancyGrid:
    """The map in a file, or the only one in a folder."""
    from locplan.maps import find_maps, load_map

    found = find_maps(map_file)
    if len(found) > 1:
        raise LocplanError(f"{map_file}: holds {len(found)} maps; name one, such as {found[0]}")
    return load_map(found[0])


def config_of(
    preset: str,
    sensor_range: float | None,
    template: str,
    stride: float,
    estimator: str = "sad",
    sensor_name: str | None = None,
    field_of_view: float | None = None,
    headings: int = 0,
    config_file: Path | None = None,
) -> FieldConfig:
    from locplan.field import FieldConfig, Lidar, Sad
    from locplan.field._registry import estimator_class

    if config_file is not None:
        given = preset, template, stride, estimator, sensor_name, field_of_view, headings
        if given != ("default", "disc", 0.2, "sad", None, None, 0):
            raise ConfigError(
                "--config has all settings of the field; besides it only --range may be given, none"
                " of --preset, --estimator, --template, --sensor, --field-of-view, --headings and"
                " --stride"
            )
        return _with_range(config_file, sensor_range)
    if preset not in ("default", "paper"):
        raise ConfigError(f"--preset must be one of default, paper, not {preset!r}")
    if estimator == "sad":
        if sensor_name or field_of_view is not None or headings:
            raise ConfigError(
                "--sensor, --field-of-view and --headings are for --estimator fisher and scan"
            )
        made = Sad.paper() if preset == "paper" else Sad()
        template_: Any = template
        sad = dataclasses.replace(
            made, template=template_, range=made.range if sensor_range is None else sensor_range
        )
        return FieldConfig(sad, stride=stride)
    if preset != "default" or template != "disc":
        raise ConfigError("--preset and --template are for --estimator sad")
    lidar = Lidar.preset(sensor_name) if sensor_name else Lidar(range=6.0)
    wished = {"range": sensor_range, "field_of_view_deg": field_of_view}
    wanted: dict[str, Any] = {name: value for name, value in wished.items() if value is not None}
    kind: Any = estimator_class(estimator)
    return FieldConfig(kind(dataclasses.replace(lidar, **wanted)), stride=stride, headings=headings)


def _with_range(config_file: Path, sensor_range: float | None) -> FieldConfig:
    """The settings in a file, perhaps with another range."""
    from locplan.field import load_config

    config = load_config(config_file)
    if sensor_range is None:
        return config
    estimator: Any = config.estimator
    if estimator.casts_rays:
        lidar = dataclasses.replace(estimator.lidar, range=sensor_range)
        changed = dataclasses.replace(estimator, lidar=lidar)
    else:
        changed = dataclasses.replace(estimator, range=sensor_range)
    return dataclasses.replace(config, estimator=changed)


@contextmanager
def computing(
    config: FieldConfig, threads: int | None, scheduler: str | None, cache_dir: Path | None
) -> Iterator[Callable[[OccupancyGrid], CovarianceField]]:
    """What gives the field of a map: read, or computed here or on a cluster."""
    from locplan._util.progress import progress_bar
    from locplan.field import load_or_compute
    from locplan.field._cluster import executor_of

    with executor_of(scheduler) if scheduler else nullcontext() as executor:

        def compute(grid: OccupancyGrid) -> CovarianceField:
            with progress_bar(f"field of {grid.name}", "cells") as progress:
                return load_or_compute(
                    grid,
                    config,
                    cache_dir=cache_dir,
                    threads=threads,
                    executor=executor,
                    progress=progress,
                )

        yield compute


def position(name: str, text: str) -> tuple[float, ...]:
    """X,Y in metres, or X,Y,DEG: the heading in degrees becomes radians."""
    try:
        x, y, *heading = (float(v) for v in text.split(","))
        degrees = (heading or [0.0])[0]
        if len(heading) > 1:
            raise ValueError
    except ValueError:
        raise LocplanError(
            f"--{name} must be X,Y in metres, such as 2.0,3.5, or X,Y,DEG with a heading,"
            f" not {text!r}"
        ) from None
    return (x, y, math.radians(degrees)) if heading else (x, y)


def numbers(name: str, text: str, count: int | None = None) -> list[float]:
    """Numbers with commas between them, of an option."""
    try:
        values = [float(v) for v in text.split(",")]
    except ValueError:
        values = []
    if not values or not all(map(math.isfinite, values)) or len(values) != (count or len(values)):
        wanted = f"{count} numbers" if count else "numbers"
        raise LocplanError(f"--{name} must be {wanted} with commas between, not {text!r}")
    return values


def settings_of(
    texts: Sequence[str],
    option: str = "setting",
    example: str = "range=2.0",
    *,
    words: bool = False,
) -> Any:
    """Settings by name, such as range=2.0 or k_nearest=false, and perhaps name=word."""
    settings: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        try:
            settings[name] = json.loads(value)
        except json.JSONDecodeError:
            if not (words and equals and value):
                raise LocplanError(
                    f"--{option} must be NAME=VALUE, such as {example}, not {text!r}"
                ) from None
            settings[name] = value
    return settings


def outline_of(text: str | None) -> Footprint | None:
    """A footprint as Nav2's parameter files have it, such as [[0.3,0.2],[0.3,-0.2],[-0.3,0]]."""
    from locplan.costs import Footprint

    if text is None:
        return None
    try:
        return Footprint(json.loads(text))
    except json.JSONDecodeError:
        raise LocplanError(
            f"--footprint must be corners such as [[0.3,0.2],[0.3,-0.2],[-0.3,0]], not {text!r}"
        ) from None


def to_json(about: Any) -> str:
    return json.dumps(about, indent=2)


def say_written(*paths: Path | None) -> None:
    for path in paths:
        if path:
            print(f"wrote {path}", file=sys.stderr)
