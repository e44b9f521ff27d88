"""Results in the cache that are no fields, such as trajectories.

The `about.json` in a result's folder says what it is, of which map, and whether it is finished.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from locplan._util.files import errors_in_one_line, make_folder
from locplan.field._cache import KEPT, cache_folder, cache_limit, evict, lock_of, note_of


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
