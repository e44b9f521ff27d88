"""Maps as callers of functions of many maps name them."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path as File
from typing import Any

from locplan._support.checks import short_repr
from locplan.errors import ConfigError
from locplan.maps.files import find_maps, load_map
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap


def name_maps(
    maps: Any, read: Callable[[File], OccupancyGrid] = load_map
) -> dict[str, OccupancyGrid | Costmap]:
    """Read maps in any form that functions of many maps accept, and name them.

    Parameters
    ----------
    maps : path, OccupancyGrid or Costmap, sequence or mapping of them
        Map files, folders of them, grids or costmaps; a mapping gives them names.
    read : callable, default `load_map`
        Function that reads a map's file.

    Returns
    -------
    dict of str to OccupancyGrid or Costmap
        The maps by name.

    Raises
    ------
    ConfigError
        If there is no map, an object is not a map, or two maps have the same name.
    """
    if isinstance(maps, Mapping) and maps:
        return {str(name): _load_map(map_source, read) for name, map_source in maps.items()}
    if isinstance(maps, (str, os.PathLike, OccupancyGrid, Costmap)):
        maps = [maps]
    maps_by_name: dict[str, OccupancyGrid | Costmap] = {}
    for n, argument in enumerate(maps, 1):
        for map_source in (
            find_maps(argument) if isinstance(argument, (str, os.PathLike)) else [argument]
        ):
            loaded = _load_map(map_source, read)
            grid = loaded.grid if isinstance(loaded, Costmap) else loaded
            name = grid.name or f"map {n}"
            if name in maps_by_name and isinstance(map_source, File):
                name = f"{map_source.resolve().parent.name}/{name}"
            if name in maps_by_name:
                raise ConfigError(
                    f"two maps are called {short_repr(name)}; give a mapping of names to maps"
                )
            maps_by_name[name] = loaded
    if not maps_by_name:
        raise ConfigError("there must be at least one map")
    return maps_by_name


def _load_map(map_source: Any, read: Callable[[File], OccupancyGrid]) -> OccupancyGrid | Costmap:
    if isinstance(map_source, (OccupancyGrid, Costmap)):
        return map_source
    if isinstance(map_source, (str, os.PathLike)):
        return read(File(map_source))
    raise ConfigError(
        f"a map must be a file, an OccupancyGrid or a Costmap, not {short_repr(map_source)}"
    )
