"""Checks of arguments: each returns the value as it is kept, or raises one clear line."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable, Collection, Iterable
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeGuard, cast

from locplan.errors import ConfigError, LocplanError, PoseError


def number(name: str, value: object, low: float = -math.inf, high: float = math.inf) -> float:
    """Return a finite number within limits as a float."""
    if is_number(value) and low <= float(value) <= high:
        return float(value)
    limits = "a number"
    if math.isfinite(low):
        limits = f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
    raise ConfigError(f"{name} must be {limits}, not {shown(value)}")


def positive(name: str, value: object, unit: str = "") -> float:
    """Return a finite number above 0 as a float; `unit` is its unit in the error message."""
    if not (is_number(value) and value > 0):
        what = f"a positive number of {unit}" if unit else "positive"
        raise ConfigError(f"{name} must be {what}, not {shown(value)}")
    return float(value)


def whole(name: str, value: object, low: int = 1, high: float = math.inf) -> int:
    """Return a whole number within limits as an int."""
    if not is_whole(value) or not low <= value <= high:
        limits = f"of at least {low}" if high == math.inf else f"in {low}..{high}"
        raise ConfigError(f"{name} must be a whole number {limits}, not {shown(value)}")
    return int(value)


def one_of(name: str, value: object, choices: Collection[str]) -> None:
    """Raise a ConfigError unless the value is one of some words."""
    if not (isinstance(value, str) and value in choices):
        raise ConfigError(f"{name} must be one of {', '.join(choices)}, not {shown(value)}")


def instance(name: str, value: object, kind: type, remedy: str = "") -> None:
    """Raise a ConfigError unless the value is of a class; `remedy` says how to get one."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        how = f"; {remedy}" if remedy else ""
        raise ConfigError(f"{name} must be {article} {kind.__name__}, not {shown(value)}{how}")


def position(x: object, y: object = None, name: str = "a position") -> tuple[float, float]:
    """Return a position in the world, given as x and y or as (x, y), as two floats [m]."""
    given = x if y is None else (x, y)
    try:
        first, second = (float(value) for value in given)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise PoseError(f"{name} must be two numbers x, y in metres, not {shown(given)}") from None
    if not (math.isfinite(first) and math.isfinite(second)):
        raise PoseError(f"{name} must be finite metres, not {first:g},{second:g}")
    return first, second


def file_path(name: str, value: object) -> Path:
    """The name of a file as a Path; anything else is a LocplanError."""
    if not isinstance(value, (str, os.PathLike)):
        raise LocplanError(f"{name} must be a path, not {shown(value)}")
    return Path(value)


def shown(value: object) -> str:
    """Short text of a value for an error message; only the class of arrays and other objects."""
    plain = isinstance(value, (str, int, float, bool, type(None), list, tuple, dict))
    text = repr(value) if plain else f"a value of type {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:57]}..."


class Settings:
    """Settings in a dataclass whose repr names only what is not by default."""

    def __repr__(self) -> str:
        shown_fields = []
        for each in dataclasses.fields(cast("Any", self)):
            value = getattr(self, each.name)
            made = each.default_factory
            default = each.default if made is dataclasses.MISSING else made()
            if value != default:
                shown_fields.append(f"{each.name}={value!r}")
        return f"{type(self).__name__}({', '.join(shown_fields)})"


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a finite real number, and no bool."""
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def is_whole(value: object) -> TypeGuard[int]:
    """Return whether a value is a whole number, and no bool."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def keep(owner: object, **values: object) -> None:
    """Set fields of a frozen dataclass while it is being made."""
    for name, value in values.items():
        object.__setattr__(owner, name, value)


def keep_checked(
    owner: object, names: Iterable[str], check: Callable[..., object], *limits: object
) -> None:
    """Set these fields of a frozen dataclass to what one of the checks above makes of them."""
    for name in names:
        keep(owner, **{name: check(name, getattr(owner, name), *limits)})
