"""The command that writes the generated maps."""

from __future__ import annotations

from pathlib import Path

from locplan.cli._groups import GENERAL, Force, command, option_group
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
def maps(
    folder: Path = Path("maps"), *, options: MapOptions = MapOptions(), force: Force = False
) -> None:
    """Write the generated maps as PGM and YAML.

    Parameters
    ----------
    folder
        The maps are written here, in maps by default.
    """
    from locplan._util.results import ResultFolder
    from locplan.maps import environments, save_map

    noise, seed = options.boundary_noise, options.seed
    names = options.name or environments.names()
    ending = f"_noise{noise:g}_seed{seed}" if noise else ""
    with ResultFolder(folder, "maps", force).writing(others_stay=True) as new:
        for name in names:
            grid = environments.make(
                name, resolution=options.resolution, boundary_noise=noise, seed=seed
            )
            save_map(grid, new / f"{name}{ending}.yaml")
    say_written(*(folder / f"{name}{ending}.yaml" for name in names))
