"""Conversion of settings between dataclasses and objects of JSON."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, get_args, get_type_hints

from locplan._util.checks import shown
from locplan.errors import ConfigError

T = TypeVar("T")


def settings_of(owner: Any) -> dict[str, object]:
    """Settings as they come back from JSON; an object begins with its class variable `name`."""
    settings = {"name": type(owner).name} if hasattr(type(owner), "name") else {}
    for each in fields(owner):
        value = getattr(owner, each.name)
        value = list(value) if isinstance(value, tuple) else value
        settings[each.name] = settings_of(value) if is_dataclass(value) else value
    return settings


def kinds_of(owner: Any) -> list[type]:
    """The class of settings, and those of the settings in them."""
    values = [getattr(owner, each.name) for each in fields(owner)]
    inner = [kind for value in values if is_dataclass(value) for kind in kinds_of(value)]
    return [type(owner), *inner]


def is_ours(owner: Any) -> bool:
    """Return whether settings, and all settings in them, are of locplan's own classes."""
    return all(kind.__module__.startswith("locplan.") for kind in kinds_of(owner))


def made_of(kind: type[T], settings: Mapping[str, object]) -> T:
    """Make an object of a class from what `settings_of` returned; missing settings get defaults."""
    given = {name: value for name, value in settings.items() if name != "name"}
    hints, known = get_type_hints(kind), inspect.signature(kind).parameters
    for name in given:
        if name not in known:
            what = getattr(kind, "name", kind.__name__)
            raise ConfigError(f"{what} has no setting {shown(name)}; it has: {', '.join(known)}")
    made = {name: _nested(name, hints[name], value) for name, value in given.items()}
    try:
        return kind(**made)
    except TypeError as error:  # a setting without a default is missing
        raise ConfigError(" ".join(str(error).split())) from None


def _nested(name: str, hint: Any, value: object) -> object:
    if not isinstance(value, Mapping):
        return value
    kinds: list[Any] = [each for each in get_args(hint) or (hint,) if is_dataclass(each)]
    named = [kind for kind in kinds if getattr(kind, "name", None) == value.get("name")]
    if len(named) != 1:
        raise ConfigError(f"{name} cannot be made of {shown(dict(value))}")
    return made_of(named[0], value)
