"""Questions of the page: what it can ask for, values that are checked, and taking them back."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, NoReturn, TypeVar

from locplan._support.checks import is_number, number, one_of, position, printable, shown, whole
from locplan._support.progress import ProgressCallback
from locplan.errors import ConfigError, LocplanError

Default = TypeVar("Default")
Read = TypeVar("Read")
MAX_WEIGHT = 1000.0
"""Maximum weight that the page can ask for."""
MAX_MESSAGE = 200_000
"""Maximum length of a message [characters]."""
MAX_ID = 2**53
"""Maximum number of a question, the greatest whole number of JavaScript."""


@dataclass(frozen=True)
class Ask:
    """A question: what to do, its number, and the values that it came with."""

    do: str
    """Name of what to do."""
    id: int
    """Number of the question, which its answer has, too."""
    values: Mapping[str, Any]
    """All values of the message."""

    def has(self, name: str) -> bool:
        """Whether there is a value other than null."""
        return self.values.get(name) is not None

    def position(self, name: str) -> tuple[float, float]:
        """A position in the world, [x, y] [m]."""
        return position(self._kept(name, _is_pair, "[x, y] in metres"), name=name)

    def positions(self, name: str, most: int = 50) -> list[tuple[float, float]]:
        """Positions in the world, [[x, y], ...] [m]; none without a value."""
        what = f"up to {most} positions [x, y]"
        values = self._listed(name, most, _is_pair, what) if self.has(name) else []
        return [position(value, name=name) for value in values]

    def number(self, name: str, low: float, high: float, default: Default) -> float | Default:
        """A number within limits, or the default."""
        return self._read(name, lambda value: number(name, value, low, high), default)

    def whole(self, name: str, low: int, high: int, default: Default) -> int | Default:
        """A whole number within limits, or the default."""
        return self._read(name, lambda value: whole(name, value, low, high), default)

    def one_of(self, name: str, choices: Collection[str], default: Default) -> str | Default:
        """One of some words, or the default."""
        if self.has(name):
            one_of(name, self.values[name], choices)
        return self._read(name, str, default)

    def text(self, name: str, default: Default) -> str | Default:
        """A short text in one line, or the default."""
        if self.has(name):
            self._kept(name, _is_short, "a text of at most 200 characters in one line")
        return self._read(name, str, default)

    def _read(self, name: str, read: Callable[[Any], Read], default: Default) -> Read | Default:
        """The value as it is read, or the default where it is null or not there."""
        value = self.values.get(name)
        return default if value is None else read(value)

    def flag(self, name: str) -> bool:
        """True or false; false without a value."""
        kinds = bool, type(None)
        return bool(self._kept(name, lambda value: isinstance(value, kinds), "true or false"))

    def mapping(self, name: str) -> dict[str, Any]:
        """An object, whose values are yet to be checked; empty without a value."""
        kinds = dict, type(None)
        found = self._kept(name, lambda value: isinstance(value, kinds), "an object")
        return dict(found or {})

    def items(self, name: str, most: int) -> list[Ask]:
        """Objects of a list, each to be read as a question is."""
        what = f"a list of up to {most} objects"
        values = self._listed(name, most, lambda value: isinstance(value, dict), what)
        return [Ask(self.do, self.id, value) for value in values]

    def _listed(
        self, name: str, most: int, is_right: Callable[[Any], bool], what: str
    ) -> list[Any]:
        def are_right(values: Any) -> bool:
            return isinstance(values, list) and len(values) <= most and all(map(is_right, values))

        return list(self._kept(name, are_right, what))

    def _kept(self, name: str, is_right: Callable[[Any], bool], what: str) -> Any:
        """The value; a ConfigError says what it must be if it is not right."""
        value = self.values.get(name)
        if not is_right(value):
            raise ConfigError(f"{name} must be {what}, not {shown(value)}")
        return value


class Unanswerable(LocplanError):
    """A message that is no question, with its number where it has one."""

    def __init__(self, message: str, number: int | None = None) -> None:
        super().__init__(message)
        self.number = number


def read_ask(text: str, known: Collection[str]) -> Ask:
    """Read a question from a message.

    Raises
    ------
    Unanswerable
        If it is none.
    """
    if len(text) > MAX_MESSAGE:
        raise Unanswerable(f"a message has at most {MAX_MESSAGE:,} characters, not {len(text):,}")
    try:
        values = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError):
        raise Unanswerable("a message must be an object of JSON") from None
    if not isinstance(values, dict):
        raise Unanswerable("a message must be an object of JSON")
    number, do = values.get("id"), values.get("do")
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number <= MAX_ID:
        raise Unanswerable("a question needs an id, a whole number from 0 on")
    if not isinstance(do, str) or do not in known:
        raise Unanswerable(f"do must be one of {', '.join(known)}, not {shown(do)}", number)
    return Ask(do, number, values)


def _refuse(constant: str) -> NoReturn:
    raise ValueError(constant)


def _is_short(value: object) -> bool:
    return isinstance(value, str) and len(value) <= 200 and value == printable(value)


def _is_pair(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(is_number, value))


class Cancelled(Exception):
    """Long work was cancelled; it is no error of the user's, and never reaches one."""


class Cancel:
    """A token that one thread sets and the thread of the long work looks at.

    The library knows one honest way to end early: its progress callback raises. So work ends at its
    next progress call, and no sooner: what goes before the first one, such as a search, runs out.

    Examples
    --------
    >>> token = Cancel()
    >>> watched = token.watching(lambda done, total: print(done, "of", total))
    >>> watched(1, 8)
    1 of 8
    >>> token.cancel()
    >>> watched(2, 8)
    Traceback (most recent call last):
    locplan.app.explorer.requests.Cancelled
    """

    def __init__(self, over: Callable[[], bool] = lambda: False) -> None:
        self._set, self._over = threading.Event(), over

    def cancel(self) -> None:
        """Ask the work to end; may be called from any thread, and more than once."""
        self._set.set()

    @property
    def cancelled(self) -> bool:
        """Whether the work was asked to end, or is over."""
        return self._set.is_set() or self._over()

    def check(self) -> None:
        """Raise `Cancelled` if the work was asked to end."""
        if self.cancelled:
            raise Cancelled

    def watching(self, progress: ProgressCallback | None = None) -> ProgressCallback:
        """A progress callback that raises `Cancelled`, and else hands on to `progress`."""

        def update(done: int, total: int) -> None:
            self.check()
            if progress:
                progress(done, total)

        return update


@dataclass(frozen=True)
class Work:
    """Progress and end of an answer that takes long."""

    progress: Callable[..., None]
    """Function of (done, total) or (done, total, doing) that shows it on the page; it raises
    `Cancelled` once the question was taken back."""
    cancel: Cancel
    """The token that says so."""
