"""The names of built-in maps."""

from __future__ import annotations

import os
from difflib import get_close_matches
from pathlib import Path

BUILT_IN = ("places", "hall", "two_corridors", "office", "warehouse")
"""Names of the built-in maps."""


def is_built_in(path: Path) -> bool:
    """True if a path is the name of a built-in map, and no file or folder has this name.

    Parameters
    ----------
    path : Path
        The path, as the user wrote it.
    """
    return str(path) in BUILT_IN and not os.path.lexists(path)


def remedy_for(name: str) -> str:
    """Return the remedy for a name that no built-in map has."""
    if similar := get_close_matches(name, BUILT_IN, 1):
        return f"did you mean {similar[0]}? The built-in maps are {', '.join(BUILT_IN)}"
    return f"give a map's YAML file, or a built-in map: {', '.join(BUILT_IN)}"
