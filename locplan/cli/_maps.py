"""The command that writes the generated maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from locplan.cli._groups import command
from locplan.cli._values import say_written

app = command("maps", "maps maps --name two_corridors --resolution 0.1")


@app.default
def maps(
    folder: Annotated[Path, Parameter(help="The maps are written here, in maps by default.")] = (
        Path("maps")
    ),
    *,
    name: Annotated[tuple[str, ...], Parameter(help="Only this map is written; repeatable.")] = (),
    resolution: Annotated[
        float, Parameter(help="The edge of a cell is 0.05 by default [m].")
    ] = 0.05,
    boundary_noise: Annotated[
        float, Parameter(help="This share of boundary cells flips, as in a SLAM map; 0..1.")
    ] = 0.0,
    seed: Annotated[int, Parameter(help="The noise has this seed.")] = 0,
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
