"""The command that writes the generated maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from locplan.cli._groups import GENERAL, Force, command, option_group, results
from locplan.cli._values import say_written

app = command("maps", "maps maps --name two_corridors --resolution 0.1")


@option_group(GENERAL)
class MapOptions:
    """The maps that are written."""

    name: tuple[str, ...] = ()
    """Map to write, by default all; repeatable."""
    resolution: float = 0.05
    """Edge of a cell, in metres; 0.05 by default."""
    boundary_noise: float = 0.0
    """Share of boundary cells that flip, as in a SLAM map; 0..1."""
    seed: int = 0
    """Seed of the noise; 0 by default."""


@app.default
def maps(
    output: Annotated[Path, results("Folder of the maps; maps by default.")] = Path("maps"),
    *,
    options: MapOptions = MapOptions(),
    force: Force = False,
) -> None:
    """Write the generated maps as PGM and YAML."""
    from locplan._util.results import ResultFolder
    from locplan.maps import environments, save_map

    noise, seed = options.boundary_noise, options.seed
    names = options.name or environments.names()
    ending = f"_noise{noise:g}_seed{seed}" if noise else ""
    with ResultFolder(output, "maps", force).writing(others_stay=True) as new:
        for name in names:
            grid = environments.make(
                name, resolution=options.resolution, boundary_noise=noise, seed=seed
            )
            save_map(grid, new / f"{name}{ending}.yaml")
    say_written(*(output / f"{name}{ending}.yaml" for name in names))
