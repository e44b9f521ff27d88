"""Results in the cache that are no fields: trajectories, and the check of a map's walls."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from locplan._util.files import errors_in_one_line, make_folder
from locplan._util.reading import parsed_json, read_text
from locplan.errors import LocplanError
from locplan.field._cache import CHECK, KEPT, cache_folder, cache_limit, evict, lock_of, note_of
from locplan.maps import OccupancyGrid, Solidity, check_grid, solidity


@contextmanager
def kept(
    key: str, what: str, map_name: str, cache_dir: str | os.PathLike[str] | None = None
) -> Iterator[Path]:
    """Folder in the cache for a result that is no field; another process with this key waits.

    Parameters
    ----------
    key : str
        Digest of all that the result depends on, 32 hexadecimal digits.
    what, map_name : str
        What it is, and its map, for the list of the cache.
    cache_dir : path, optional
        See `cache_folder`.

    Raises
    ------
    LocplanError
        If the folder cannot be written.
    """
    entry = cache_folder(cache_dir) / f"{key}{KEPT}"
    make_folder(entry.parent)
    with errors_in_one_line(entry), lock_of(entry):
        entry.mkdir(exist_ok=True)
        note_of(entry).write_text(json.dumps([what, map_name, False]))
        yield entry
        note_of(entry).write_text(json.dumps([what, map_name, True]))
    evict(entry.parent, cache_limit(), entry)


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
    # The 1 rises when `solidity` finds something else.
    key = hashlib.sha256(repr(("walls", 1, grid.digest)).encode()).hexdigest()[:32]
    file = cache_folder(cache_dir) / f"{key}{KEPT}" / "walls.json"
    with suppress(LocplanError, TypeError, ValueError):
        return Solidity(*map(float, parsed_json(read_text(file))))
    found = solidity(grid)
    with suppress(LocplanError), kept(key, CHECK, grid.name, cache_dir) as folder:
        (folder / file.name).write_text(json.dumps(dataclasses.astuple(found)))
    return found
