"""The offer to mend a map before anything is driven on it."""

from __future__ import annotations

from pathlib import Path

from locplan.errors import ConfigError
from locplan.maps import OccupancyGrid, solidity
from locplan.robots import read_parameters


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


def offer(grid: OccupancyGrid) -> str | None:
    """Say in a sentence that a filter gets lost on a map, and that it can be mended; else None.

    Parameters
    ----------
    grid : OccupancyGrid
        The filter's map.
    """
    if not solidity(grid).is_solid:
        return None
    return (
        f"{grid.name or 'the map'}: walls are black inside, so that AMCL's particles gain by"
        " standing in them; run locplan repair first, and give its map_amcl.yaml as --filter-map"
    )
