"""The offer to mend a map before anything is driven on it, whose check is paid once a map."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from locplan._util.files import replacing
from locplan.errors import ConfigError
from locplan.field import cache_folder
from locplan.maps import OccupancyGrid, faults
from locplan.robots import read_parameters

KEPT = {"solid": True, "fine": False}
"""What the file of a map in the cache says, and whether the map is solid."""


def check_concerned(parameters: Path | None) -> None:
    """Raise a ConfigError if Nav2's parameters have AMCL cast rays, which no black misleads.

    Parameters
    ----------
    parameters : path, optional
        File of Nav2's parameters; without it AMCL has its defaults, and is concerned.
    """
    if read_parameters(parameters).of("amcl").get("laser_model_type") == "beam":
        raise ConfigError(
            f"{parameters}: not concerned: AMCL's beam model casts rays, which end at the first"
            " black cell, so that the inside of walls does not mislead it"
        )


def offer(grid: OccupancyGrid, cache_dir: str | os.PathLike[str] | None = None) -> str | None:
    """Say in a sentence that a filter gets lost on a map, and that it can be mended; else None.

    Parameters
    ----------
    grid : OccupancyGrid
        The filter's map.
    cache_dir : path, optional
        Folder of the cache, which keeps the verdict by the map's digest; see
        `locplan.field.cache_folder`.
    """
    if not _is_solid(grid, cache_dir):
        return None
    return (
        f"{grid.name or 'the map'}: walls are black inside, so that AMCL's particles gain by"
        " standing in them; run locplan mend first, and give its map_amcl.yaml as --filter-map"
    )


def _is_solid(grid: OccupancyGrid, cache_dir: str | os.PathLike[str] | None) -> bool:
    """Whether a map is solid, from the cache if it was checked before."""
    file = cache_folder(cache_dir) / "walls" / f"{grid.digest}.txt"
    with suppress(OSError, ValueError, KeyError):
        return KEPT[file.read_text("utf-8").strip()]
    solid = faults(grid).is_solid
    with suppress(OSError):  # it is checked anew where the cache cannot be written
        file.parent.mkdir(parents=True, exist_ok=True)
        with replacing(file) as new:
            new.write_text("solid\n" if solid else "fine\n", "utf-8")
    return solid
