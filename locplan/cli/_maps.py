"""The command that writes the generated maps."""

from __future__ import annotations

from pathlib import Path

from locplan.cli._groups import GENERAL, command, option_group
from locplan.cli._values import say_written

app = command("maps", "maps maps --name two_corridors --resolution 0.1")


@option_group(GENERAL)
class MapOptions:
    """The maps that are written."""

    name: tuple[str, ...] = ()
    """Only this map is written; repeatable."""
    resolution: float = 0.05
    """The edge of a cell is 0.05 by default [m]."""
    boundary_noise: float = 0.0
    """This share of boundary cells flips, as in a SLAM map; 0..1."""
    seed: int = 0
    """The seed of the noise is 0 by default."""


@app.default
def maps(folder: Path = Path("maps"), *, options: MapOptions = MapOptions()) -> None:
    """Write the generated maps as PGM and YAML.

    Parameters
    ----------
    folder
        The maps are written here, in maps by default.
    """
    from locplan._util.files import make_folder
    from locplan.maps import environments, save_map

    make_folder(folder)
    noise, seed = options.boundary_noise, options.seed
    for each in options.name or environments.names():
        grid = environments.make(
            each, resolution=options.resolution, boundary_noise=noise, seed=seed
        )
        stem = f"{each}_noise{noise:g}_seed{seed}" if noise else each
        save_map(grid, folder / f"{stem}.yaml")
        say_written(folder / f"{stem}.yaml")
