"""Reading and writing a field's settings as a JSON file, which every command accepts."""

from __future__ import annotations

import json
import os
import warnings
from typing import Any

from locplan import __version__
from locplan._util.checks import file_path, instance
from locplan._util.files import check_target, replacing
from locplan._util.reading import MAX_JSON_BYTES, parsed_json, read_text
from locplan.errors import ConfigError, LocplanError
from locplan.field._config import FieldConfig

SUFFIX = ".json"


class CalibrationWarning(UserWarning):
    """Warning that the deviations of a field are not in metres."""


def save_config(path: str | os.PathLike[str], config: FieldConfig, **about: object) -> None:
    """Write the settings of a field as JSON, for `load_config` and every command's ``--config``.

    Parameters
    ----------
    path : path
        The file, named *.json; one that is there is replaced.
    config : FieldConfig
        The settings.
    **about
        Further entries of the file, fit for JSON, such as where the settings come from.

    Raises
    ------
    LocplanError
        If the file cannot be written, or its name does not end in .json.
    """
    target = file_path("a file of settings", path)
    instance("config", config, FieldConfig)
    check_target(target, SUFFIX)
    content = {"locplan": __version__, "config": config.to_json(), **about}
    with replacing(target) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def load_config(path: str | os.PathLike[str]) -> FieldConfig:
    """Read the settings of a field from a JSON file.

    They are the file's "config", as `save_config` or a command writes it, or the whole file.
    Missing settings take their defaults.

    Parameters
    ----------
    path : path
        The JSON file.

    Raises
    ------
    ConfigError
        If the file cannot be read, or holds other settings or values.

    Warns
    -----
    CalibrationWarning
        If the calibration that wrote the file found that deviations are not in metres.
    """
    content = read_content(path)
    settings = _settings(content)
    if not isinstance(settings, dict):
        raise ConfigError(f'{path}: must hold settings of a field, or them as its "config"')
    try:
        config = FieldConfig.from_json(settings)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    if content.get("in_metres", True) is not True:
        message = (
            f"{path}: deviations of this field are not in metres, as its calibration found; take it"
            " to rank places, or calibrate on other maps"
        )
        warnings.warn(CalibrationWarning(message), stacklevel=2)
    return config


def read_content(path: str | os.PathLike[str]) -> Any:
    """All that a JSON file of settings holds.

    Raises
    ------
    ConfigError
        If the file cannot be read, or is no JSON.
    """
    try:
        return parsed_json(read_text(file_path("a file of settings", path), MAX_JSON_BYTES))
    except LocplanError as error:
        raise ConfigError(str(error)) from None
    except ValueError:
        raise ConfigError(f"{path}: is no JSON; locplan calibrate writes such a file") from None


def _settings(content: Any) -> Any:
    if not isinstance(content, dict):
        return None
    return content.get("config", content)
