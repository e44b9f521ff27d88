"""The check of a map's walls, kept in the cache by the map's digest, so that it is paid once."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from contextlib import suppress

from locplan._util.reading import parsed_json, read_text
from locplan.errors import LocplanError
from locplan.field._cache import CHECK, KEPT, cache_folder
from locplan.field._kept import kept
from locplan.maps import OccupancyGrid, Solidity, check_grid, solidity

VERSION = 1
"""Version of what `solidity` finds, which rises when it finds something else."""


def kept_solidity(grid: OccupancyGrid, cache_dir: str | os.PathLike[str] | None = None) -> Solidity:
    """Whether the inside of a map's walls misleads a filter, read from the cache if it is there.

    Where the cache cannot be read or written, the walls are checked anew.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    cache_dir : path, optional
        See `cache_folder`.

    Raises
    ------
    LocplanError
        If it is no map, or the cache folder is no path.
    """
    check_grid(grid)
    key = hashlib.sha256(repr(("walls", VERSION, grid.digest)).encode()).hexdigest()[:32]
    file = cache_folder(cache_dir) / f"{key}{KEPT}" / "walls.json"
    with suppress(LocplanError, TypeError, ValueError):
        return Solidity(*map(float, parsed_json(read_text(file))))
    found = solidity(grid)
    with suppress(LocplanError), kept(key, CHECK, grid.name, cache_dir) as folder:
        (folder / file.name).write_text(json.dumps(dataclasses.astuple(found)))
    return found
