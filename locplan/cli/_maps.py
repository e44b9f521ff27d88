"""The command that writes the generated maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import locplan
from locplan._util.results import ResultFolder
from locplan.cli._groups import command, option_group
from locplan.cli._output import Target, say_written

app = command("maps", "maps maps --name two_corridors --resolution 0.1")


@option_group("Options")
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


@option_group("Output")
class Replacing:
    """What is replaced."""

    force: bool = False
    """Replace files in the way, whoever wrote them."""


@app.default
def maps(
    output: Annotated[Path, Target] = Path("maps"),
    *,
    options: MapOptions = MapOptions(),
    replacing: Replacing = Replacing(),
) -> None:
    """Write the generated maps as PGM and YAML.

    Parameters
    ----------
    output
        Folder of the maps; maps by default.
    """
    environments, noise, seed = locplan.maps.environments, options.boundary_noise, options.seed
    names = options.name or environments.names()
    ending = f"_noise{noise:g}_seed{seed}" if noise else ""
    with ResultFolder(output, "maps", replacing.force).writing(others_stay=True) as new:
        for name in names:
            grid = environments.make(
                name, resolution=options.resolution, boundary_noise=noise, seed=seed
            )
            locplan.save_map(grid, new / f"{name}{ending}.yaml")
    say_written(*(output / f"{name}{ending}.yaml" for name in names))
