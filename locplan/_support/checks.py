"""Checks of arguments: each returns the normalized value, or raises a ConfigError."""

from __future__ import annotations

import dataclasses
import difflib
import math
import os
import reprlib
from collections.abc import Callable, Collection, Iterable, Iterator
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

from locplan.errors import ConfigError, LocplanError, PoseError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from locplan._support.kernels.arrays import Floats

MAX_AMOUNT = 1e12
"""Maximum amount of a setting; with more, its powers and products would not be finite."""
RESOLUTIONS = (0.001, 10.0)
"""Minimum and maximum edge of a cell [m]; beyond, the number is hardly in metres."""
MAX_RANGE = 10_000.0
"""Maximum range of a lidar or a template [m]."""
FARTHEST = 1e8
"""Maximum coordinate of a position [m], beyond all those of maps; a float resolves 15 nm there."""


def check_number(name: str, value: object, low: float = -math.inf, high: float = math.inf) -> float:
    """Return a finite number within limits, and up to `MAX_AMOUNT`, as a float."""
    if is_number(value) and low <= float(value) <= high and abs(value) <= MAX_AMOUNT:
        return float(value)
    limits = "a number"
    if math.isfinite(low):
        limits = f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
        if not isinstance(value, Real):
            limits = f"a number {'of' if high == math.inf else 'from'} {limits}"
    raise ConfigError(
        f"{name} must be {limits}{_format_maximum(value)}, not"
        f" {short_repr(value)}{_format_quotes_remedy(value)}"
    )


def check_positive(name: str, value: object, unit: str = "") -> float:
    """Return a number above 0, and up to `MAX_AMOUNT`, as a float.

    `unit` is its unit in the error message. Nearly 0, whose reciprocal is too great, is refused.
    """
    if is_number(value) and 1 / MAX_AMOUNT <= value <= MAX_AMOUNT:
        return float(value)
    requirement = f"a positive number of {unit}" if unit else "positive"
    if not unit and not isinstance(value, Real):
        requirement = "a positive number"
    minimum_text = f" of at least {1 / MAX_AMOUNT:g}" if is_number(value) and 0 < value < 1 else ""
    raise ConfigError(
        f"{name} must be {requirement}{minimum_text}{_format_maximum(value)}, not"
        f" {short_repr(value)}{_format_quotes_remedy(value)}"
    )


def check_range(name: str, value: object) -> float:
    """Return the range of a lidar or a template as a float [m]."""
    return check_number(name, check_positive(name, value, "m"), 0.0, MAX_RANGE)


def check_integer(name: str, value: object, low: int = 1, high: float = math.inf) -> int:
    """Return a whole number within limits, and up to what 64 bits hold, as an int."""
    if not is_integer(value) or not low <= value <= min(high, 2**63 - 1):
        limits = f"of at least {low}" if high == math.inf else f"in {low}..{high}"
        limits += " and below 2^63" if is_integer(value) and value >= 2**63 else ""
        raise ConfigError(
            f"{name} must be a whole number {limits}, not"
            f" {short_repr(value)}{_format_quotes_remedy(value)}"
        )
    return int(value)


def check_choice(name: str, value: object, choices: Collection[str]) -> object:
    """Return the value if it is one of the choices."""
    if not (isinstance(value, str) and value in choices):
        choice_list, guess = ", ".join(choices), format_suggestion(value, choices)
        raise ConfigError(f"{name} must be one of {choice_list}, not {short_repr(value)}{guess}")
    return value


def format_suggestion(value: object, choices: Iterable[str]) -> str:
    """Return the end of an error about an unknown name: the most similar known one, if any.

    >>> format_suggestion("turtlebot_4", ["turtlebot3", "turtlebot4"])
    "; did you mean 'turtlebot4'?"
    """
    names = {name.lower(): name for name in choices}
    typed = value.lower()[:100] if isinstance(value, str) else ""
    similar = difflib.get_close_matches(typed, names, n=1) if typed else []
    return f"; did you mean {names[similar[0]]!r}?" if similar else ""


def check_instance(name: str, value: object, kind: type, remedy: str = "") -> object:
    """Return the value if it is an instance of a class; `remedy` explains how to get one."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        remedy_text = f"; {remedy}" if remedy else ""
        raise ConfigError(
            f"{name} must be {article} {kind.__name__}, not {short_repr(value)}{remedy_text}"
        )
    return value


def check_position(x: object, y: object = None, name: str = "a position") -> tuple[float, float]:
    """Return a position in the world, given as x and y or as (x, y), as two floats [m]."""
    coordinates = x if y is None else (x, y)
    try:
        first, second = (float(value) for value in coordinates)  # type: ignore[attr-defined]
    except (TypeError, ValueError, OverflowError):
        raise PoseError(
            f"{name} must be two numbers x, y in metres, not {short_repr(coordinates)}"
        ) from None
    if not (math.isfinite(first) and math.isfinite(second)):
        raise PoseError(f"{name} must be finite metres, not {first:g},{second:g}")
    if max(abs(first), abs(second)) > FARTHEST:
        raise PoseError(f"{name} must lie within ±{FARTHEST:g} m, not {first:g},{second:g}")
    return first, second


def parse_poses(raw_poses: ArrayLike) -> tuple[Floats, bool]:
    """Return positions or poses as an array, (n, 2) or (n, 3), and whether they are a single one.

    Parameters
    ----------
    raw_poses : (n, 2) or (n, 3) array, (x, y) or (x, y, heading)
        The poses [m, m, rad].

    Raises
    ------
    PoseError
        If they have another shape, or a number is not finite or too large.
    """
    import numpy as np

    fault = "poses must be an (n, 2) or (n, 3) array, or one x, y or x, y, heading [m, m, rad]"
    try:
        poses = np.asarray(raw_poses, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise PoseError(f"{fault}, not {short_repr(raw_poses)}") from None
    if poses.ndim not in (1, 2) or poses.shape[-1] not in (2, 3):
        raise PoseError(f"{fault}, not an array of shape {poses.shape}")
    is_single = poses.ndim == 1
    poses = np.atleast_2d(poses)
    is_usable = (np.abs(poses) <= FARTHEST).all(axis=1)
    if not is_usable.all():
        number = int(np.argmin(is_usable))
        text = ",".join(f"{value:g}" for value in poses[number])
        subject = "a pose" if is_single else f"pose {number} of the array"
        raise PoseError(f"{subject} must be finite numbers within ±{FARTHEST:g} m, not {text}")
    return poses, is_single


def check_file_path(name: str, value: object) -> Path:
    """Return the name of a file or folder as a Path; raise a LocplanError for other values."""
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    if not isinstance(value, str) or not is_file_name(value):
        raise LocplanError(f"{name} must be a path, not {short_repr(value)}")
    return Path(value)


def is_file_name(text: str) -> bool:
    """True if a text can name a file: it is not empty, and the system can encode it."""
    try:
        return bool(text.strip()) and b"\0" not in os.fsencode(text)
    except UnicodeEncodeError:  # half of a surrogate pair
        return False


def make_printable(name: str) -> str:
    """Return a name with U+FFFD for unprintable characters, such as invalid UTF-8."""
    return "".join(c if c.isprintable() else "\ufffd" for c in name)


def short_repr(value: object) -> str:
    """Return a short text of a value for an error message; for objects only the class.

    Length and depth are bounded, since the repr of nested lists could fill the memory.
    """
    plain = isinstance(value, (str, int, float, bool, type(None), list, tuple, dict))
    text = _SHORT.repr(value) if plain else f"a value of type {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:57]}..."


class _ShortRepr(reprlib.Repr):
    """A repr of bounded length and depth."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother = 3, 200, 200

    def repr_int(self, x: int, level: int) -> str:
        return f"a number of {x.bit_length()} bits" if x.bit_length() > 999 else repr(x)


_SHORT = _ShortRepr()


def _format_maximum(value: object) -> str:
    """Return the part of an error message on too large numbers."""
    return f" and at most {MAX_AMOUNT:g}" if is_number(value) and abs(value) > MAX_AMOUNT else ""


def _format_quotes_remedy(value: object) -> str:
    """Return the end of an error message on a number in quotes, as YAML files have them."""
    try:
        return "; remove the quotes" if isinstance(value, str) and is_number(float(value)) else ""
    except ValueError:
        return ""


def checked_setting(default: object, *limits: Any) -> Any:
    """Return a field of `Settings` with a check for the type of its default.

    `limits` are a number's minimum and maximum, or all words; or one of the checks above, with its
    arguments.
    """
    check: tuple[Any, ...] = limits
    if not (limits and callable(limits[0])):
        check = {
            bool: (check_instance, bool, "give true or false"),
            str: (check_choice, limits),
            int: (check_integer, *limits),
            float: (check_number, *limits),
        }[type(default)]
    return dataclasses.field(default=default, metadata={"check": check})


def derived_setting(make: Callable[[Any], object]) -> Any:
    """Return a field of `Settings` with a default computed from the settings.

    It is None until `__post_init__` sets it.
    """
    return dataclasses.field(default=None, metadata={"default": make})


class Settings:
    """Base of dataclasses of checked settings; the repr only shows changed settings."""

    def __post_init__(self: Any) -> None:
        for setting_field in dataclasses.fields(self):
            if check_spec := _find_check(type(self), setting_field.name):
                check, *limits = check_spec
                value = check(setting_field.name, getattr(self, setting_field.name), *limits)
                object.__setattr__(self, setting_field.name, value)

    def __repr__(self) -> str:
        changed = ", ".join(f"{name}={value!r}" for name, value in _find_changed_settings(self))
        return f"{type(self).__name__}({changed})"


def _find_check(owner: type, name: str) -> tuple[Any, ...]:
    """Return the check of a setting; a class that only changes the default inherits it."""
    declared = (vars(base).get("__dataclass_fields__", {}).get(name) for base in owner.__mro__)
    checks = (
        setting_field.metadata.get("check", ()) for setting_field in declared if setting_field
    )
    return next(filter(None, checks), ())


def describe_changed_settings(settings: Settings) -> list[str]:
    """Return name and value of each setting that differs from its default."""
    return [
        f"{name} {_format_setting_value(value)}" for name, value in _find_changed_settings(settings)
    ]


def _find_changed_settings(settings: Any) -> Iterator[tuple[str, Any]]:
    for setting_field in dataclasses.fields(settings):
        value, default_factory = (
            getattr(settings, setting_field.name),
            setting_field.default_factory,
        )
        default = (
            setting_field.default if default_factory is dataclasses.MISSING else default_factory()
        )
        if make := setting_field.metadata.get("default"):
            default = make(settings)
        if hasattr(value, "shape") or value != default:  # arrays have no one truth
            yield setting_field.name, value


def _format_setting_value(value: object) -> str:
    """Return the text of a parameter: a number, true or false, or a word without its package."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value).rpartition("::")[2]


def is_number(value: object) -> TypeGuard[float]:
    """True if a value is a finite real number that a float can hold, and not a bool."""
    try:
        return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:
        return False


def parse_finite_numbers(values: Any) -> tuple[float, ...]:
    """Return finite numbers as floats, or an empty tuple if any value is not a finite number."""
    import numpy as np

    try:
        numbers = tuple(float(v) for v in np.atleast_1d(np.asarray(values, dtype=np.float64)))
    except (TypeError, ValueError, OverflowError):
        return ()
    return numbers if all(map(math.isfinite, numbers)) else ()


def is_integer(value: object) -> TypeGuard[int]:
    """True if a value is a whole number, and not a bool."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def set_frozen_fields(owner: object, **values: object) -> None:
    """Set fields of a frozen dataclass while it is being made."""
    for name, value in values.items():
        object.__setattr__(owner, name, value)


def count_usable_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def get_usable_memory() -> int:
    """Return the memory that a computation may take [bytes]."""
    try:
        total_memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # Windows
        total_memory = 8_000_000_000
    # Share of the memory that a computation may take.
    return int(0.8 * total_memory)


def check_threads(threads: int | None) -> int:
    """Return a checked number of threads; by default the number of cores."""
    return _check_resource_limit("threads", threads, 32, 0)


def check_workers(workers: int | None) -> int:
    """Return a checked number of worker processes; by default the number of cores."""
    # Memory that a worker takes at least, with its libraries [bytes].
    return _check_resource_limit("workers", workers, 4, 300_000_000)


def _check_resource_limit(name: str, value: int | None, per_core: int, size: int) -> int:
    """Return a number limited by the cores, and by the memory for items of a size [bytes]."""
    cores = count_usable_cores()
    if value is None:
        return cores
    maximum, reason = per_core * cores, f"{per_core} for each of this machine's {cores} cores"
    if size * maximum > get_usable_memory():
        maximum = max(1, get_usable_memory() // size)
        memory, share = _format_gigabytes(get_usable_memory()), _format_gigabytes(size)
        reason = f"{memory} of this machine's memory, {share} each"
    if check_integer(name, value) > maximum:
        raise ConfigError(f"{name} must be at most {maximum} ({reason}), not {value}")
    return int(value)


def check_memory(data_name: str, size: float, remedy: str) -> None:
    """Raise a ConfigError if something takes more memory [bytes] than the machine has."""
    if size > get_usable_memory():
        raise ConfigError(
            f"{data_name} take {_format_gigabytes(size)} of memory, and this machine has"
            f" {_format_gigabytes(get_usable_memory())} for"
            f" them; {remedy}"
        )


def _format_gigabytes(size: float) -> str:
    return f"{size / 1e9:.3g} GB"
