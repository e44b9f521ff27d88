"""The filter and the disturbances in a file of settings."""

from __future__ import annotations

import dataclasses
import os
from typing import Any, TypeVar

from locplan._util.checks import shown
from locplan.errors import ConfigError
from locplan.field._config_files import read_content
from locplan.simulation._settings import Amcl, Disturbances

Settings = TypeVar("Settings", Amcl, Disturbances)
PARTS = ("amcl", "disturbances")
"""Names of the parts of a file of settings, beside the field's "config"."""


def read_robot(path: str | os.PathLike[str]) -> tuple[Amcl, Disturbances]:
    """Read the filter and the disturbances of a file of settings.

    They are its "amcl" and "disturbances"; what it does not name has its default.

    Raises
    ------
    ConfigError
        If the file cannot be read, or has other settings or values.
    """
    content = read_content(path)
    held = content if isinstance(content, dict) else {}
    return (
        _made(path, PARTS[0], Amcl, held.get(PARTS[0], {})),
        _made(path, PARTS[1], Disturbances, held.get(PARTS[1], {})),
    )


def _made(path: str | os.PathLike[str], part: str, kind: type[Settings], given: Any) -> Settings:
    known = [each.name for each in dataclasses.fields(kind)]
    if not isinstance(given, dict):
        raise ConfigError(f"{path}: {part} must hold settings by name, not {shown(given)}")
    for name in given:
        if name not in known:
            raise ConfigError(f"{path}: {part} has no {shown(name)}; it has {', '.join(known)}")
    try:
        return kind(**given)
    except ConfigError as error:
        raise ConfigError(f"{path}: {part}: {error}") from None
