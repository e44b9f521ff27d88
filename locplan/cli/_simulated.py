"""Options of the commands that simulate, and what becomes of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from locplan.cli._options import settings_of
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.field import FieldConfig, Lidar
    from locplan.simulation._settings import Amcl, Disturbances

MapFiles = Annotated[
    list[Path],
    typer.Argument(metavar="MAP...", help="map_server YAML files, or their folders."),
]
LidarName = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Simulated: rplidar-a1 | utm-30lx | lms291 | urg-04lx; that of the field by default.",
    ),
]
Params = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Nav2's parameters, for those of its amcl.")
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Of AMCL (alpha1, max_particles, laser_model_type, ...) or of what it is up against"
        " (boundary_noise, outliers, heading_bias_deg, ...); examples/README.md lists all.",
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Of all random numbers.")]
Radius = Annotated[float, typer.Option(help="Robot's radius [m].")]
Folder = Annotated[
    Path | None, typer.Option("--output", "-o", help="Folder for pictures, JSON and CSV.")
]
PlaceCount = Annotated[int, typer.Option(min=2, help="On each map.")]
ScanCount = Annotated[int, typer.Option(min=1, help="Single scans matched at each place.")]
DriveCount = Annotated[int, typer.Option(min=1, help="To each place, of 10 m.")]


def simulated(
    config: FieldConfig, lidar: str | None, params: Path | None, settings: Sequence[str] | None
) -> tuple[Lidar, Amcl, Disturbances]:
    """The filter and what it is up against; the lidar is the field's unless one is named."""
    from locplan.field import Lidar
    from locplan.simulation._nav2 import read_amcl
    from locplan.simulation._settings import SHORT_LIDAR, Amcl, Disturbances, changed

    amcl, disturbances = read_amcl(params) if params else Amcl(), Disturbances()
    if lidar:
        try:
            sensor = Lidar.preset(lidar.lower())
        except ConfigError as error:
            raise ConfigError(f"--lidar: {error}") from None
    else:
        own = getattr(config.estimator, "lidar", None)
        sensor = own or dataclasses.replace(SHORT_LIDAR, range=config.estimator.reach)
    changes = settings_of(settings or (), "set", "alpha1=0.05", words=True)
    return sensor, *changed(amcl, disturbances, changes)
