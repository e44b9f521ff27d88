"""Conversion of settings between dataclasses and objects of JSON."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeVar, get_args, get_type_hints

from locplan.errors import ConfigError

T = TypeVar("T")


def settings_of(value: object) -> dict[str, object]:
    """Settings as values for JSON; an object begins with its class variable `name`, if any."""
    fields: dict[str, object] = {}
    if hasattr(type(value), "name"):
        fields["name"] = getattr(type(value), "name")  # noqa: B009 - of the class, not a field
    for each in _fields(type(value)):
        setting = getattr(value, each.name)
        fields[each.name] = settings_of(setting) if dataclasses.is_dataclass(setting) else setting
    return fields


def made_of(kind: type[T], settings: Mapping[str, object]) -> T:
    """Make an object of a class from what `settings_of` returned; missing settings get defaults.

    Raises
    ------
    ConfigError
        If a setting is unknown, missing, or out of its range.
    """
    given = {name: value for name, value in settings.items() if name != "name"}
    hints, known = get_type_hints(kind), [each.name for each in _fields(kind)]
    for name in given:
        if name not in known:
            what = getattr(kind, "name", kind.__name__)
            raise ConfigError(f"{what} has no setting {name!r}; it has: {', '.join(known)}")
    made = {name: _nested(name, hints[name], value) for name, value in given.items()}
    try:
        return kind(**made)
    except TypeError as error:  # a setting without a default is missing
        raise ConfigError(" ".join(str(error).split())) from None


def _nested(name: str, hint: Any, value: object) -> object:
    if not isinstance(value, Mapping):
        return value
    kinds: list[Any] = [each for each in get_args(hint) or (hint,) if _is_settings(each)]
    named = [kind for kind in kinds if getattr(kind, "name", None) == value.get("name")]
    if len(named) != 1:
        raise ConfigError(f"{name} cannot be made of {dict(value)!r}")
    return made_of(named[0], value)


def _is_settings(kind: object) -> bool:
    return isinstance(kind, type) and dataclasses.is_dataclass(kind)


def _fields(kind: Any) -> tuple[dataclasses.Field[Any], ...]:
    return dataclasses.fields(kind)
