"""Questions of the page, with checked values, and tokens that cancel their answers."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from locplan._support.checks import (
    check_choice,
    check_number,
    check_position,
    is_integer,
    is_number,
    make_printable,
    short_repr,
)
from locplan.errors import ConfigError, LocplanError

Default = TypeVar("Default")
MAX_WEIGHT = 1000.0
"""Maximum weight in a question."""
MAX_MESSAGE = 1_000_000
"""Maximum length of a message [characters]."""
MAX_TEXT = 5000
"""Maximum length of a text in a question [characters]."""


@dataclass(frozen=True)
class Question:
    """A question of the page."""

    do: str
    """Name of the question."""
    id: int
    """Number of the question, which its answer repeats."""
    values: Mapping[str, Any]
    """All values of the message."""

    def has(self, name: str) -> bool:
        """Return True if a value is present and not null."""
        return self.values.get(name) is not None

    def position(self, name: str) -> tuple[float, float]:
        """Return a position in the world, [x, y] [m]."""
        return check_position(
            self._check_value(name, _is_position_pair, "[x, y] in metres"), name=name
        )

    def positions(self, name: str, limit: int = 50) -> list[tuple[float, float]]:
        """Return positions in the world, [[x, y], ...] [m]; none without a value."""
        expected = f"up to {limit} positions [x, y]"
        values = (
            self._check_list(name, limit, _is_position_pair, expected) if self.has(name) else []
        )
        return [check_position(value, name=name) for value in values]

    def number(self, name: str, low: float, high: float, default: Default) -> float | Default:
        """Return a number within limits, or the default."""
        return check_number(name, self.values[name], low, high) if self.has(name) else default

    def choice(self, name: str, choices: Collection[str], default: Default) -> str | Default:
        """Return one of the choices, or the default."""
        return str(check_choice(name, self.values[name], choices)) if self.has(name) else default

    def text(self, name: str, default: Default) -> str | Default:
        """Return a text in one line, or the default."""
        expected = f"a text of at most {MAX_TEXT} characters in one line"
        return (
            str(self._check_value(name, _is_single_line, expected)) if self.has(name) else default
        )

    def flag(self, name: str) -> bool:
        """Return a boolean; False without a value."""
        kinds = bool, type(None)
        return bool(
            self._check_value(name, lambda value: isinstance(value, kinds), "true or false")
        )

    def mapping(self, name: str) -> dict[str, Any]:
        """Return an object whose values are not checked; empty without a value."""
        kinds = dict, type(None)
        value = self._check_value(name, lambda value: isinstance(value, kinds), "an object")
        return dict(value or {})

    def items(self, name: str, limit: int) -> list[Question]:
        """Return the objects of a list as questions."""
        expected = f"a list of up to {limit} objects"
        values = self._check_list(name, limit, lambda value: isinstance(value, dict), expected)
        return [Question(self.do, self.id, value) for value in values]

    def _check_list(
        self, name: str, limit: int, is_item: Callable[[Any], bool], expected: str
    ) -> list[Any]:
        def is_right(values: Any) -> bool:
            return isinstance(values, list) and len(values) <= limit and all(map(is_item, values))

        return list(self._check_value(name, is_right, expected))

    def _check_value(self, name: str, is_right: Callable[[Any], bool], expected: str) -> Any:
        """Return a value; raise a ConfigError that names the expected kind if it is wrong."""
        value = self.values.get(name)
        if not is_right(value):
            raise ConfigError(f"{name} must be {expected}, not {short_repr(value)}")
        return value


def _is_single_line(value: object) -> bool:
    return isinstance(value, str) and len(value) <= MAX_TEXT and value == make_printable(value)


def _is_position_pair(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(is_number, value))


class BadMessage(LocplanError):
    """Error of a message that is no valid question, with the message's number if it has one."""

    def __init__(self, message: str, number: int | None = None) -> None:
        super().__init__(message)
        self.number = number


def read_question(text: str, names: Collection[str]) -> Question:
    """Read a question from a message.

    Raises
    ------
    BadMessage
        If the message is no valid question.
    """
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        raise BadMessage("a message must be a JSON object") from None
    if not isinstance(values, dict):
        raise BadMessage("a message must be a JSON object")
    number, do = values.get("id"), values.get("do")
    if not is_integer(number) or number < 0:
        raise BadMessage("a question needs an id, a whole number from 0 on")
    if not isinstance(do, str) or do not in names:
        raise BadMessage(f"do must be one of {', '.join(names)}, not {short_repr(do)}", number)
    return Question(do, number, values)


def format_sentence(text: str) -> str:
    """Return a text with a capital letter and a full stop.

    Examples
    --------
    >>> format_sentence("no path joins them; move one")
    'No path joins them; move one.'
    """
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith(('.', '?', '!')) else '.'}"


class Cancelled(Exception):
    """Signal that work was cancelled. It is not an error."""


class CancelToken:
    """Token that one thread sets to cancel the work of another.

    The work ends at its next check, at the latest when it reports progress.

    Examples
    --------
    >>> token = CancelToken()
    >>> token.check()
    >>> token.cancel()
    >>> token.check()
    Traceback (most recent call last):
    locplan.app.explorer.messages.Cancelled
    """

    def __init__(self, is_over: Callable[[], bool] = lambda: False) -> None:
        self._event, self._is_over = threading.Event(), is_over

    def cancel(self) -> None:
        """Cancel the work. Can be called from any thread, repeatedly."""
        self._event.set()

    @property
    def is_cancelled(self) -> bool:
        """True if the work was cancelled or is obsolete."""
        return self._event.is_set() or self._is_over()

    def check(self) -> None:
        """Raise `Cancelled` if the work was cancelled or is obsolete."""
        if self.is_cancelled:
            raise Cancelled


@dataclass(frozen=True)
class QuestionJob:
    """Callbacks of an answer that takes long: progress and cancellation."""

    progress: Callable[..., None]
    """Function of (done, total) that shows the progress on the page; it raises `Cancelled` if the
    question was cancelled."""
    check: Callable[[], None]
    """Function that raises `Cancelled` if the question was cancelled."""
