"""A command with its settings as a line for a shell, and as Python: the same settings in both."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any, NamedTuple


class Spelled(NamedTuple):
    """A setting that options of the commands and Python say differently, such as a robot."""

    words: Sequence[str]
    """Options of the commands."""
    code: str
    """The expression."""
    after: Sequence[str] = ()
    """Lines of code that follow the line that gives it a name."""
    argument: str = ""
    """Name of the function's argument, where it is not that of the setting."""


@dataclass(frozen=True)
class Recipe:
    """A command, the public function behind it, and the settings that both take."""

    command: str
    """Name of the command."""
    function: str
    """Name of the function, below locplan."""
    map_file: str
    """File of the map."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings by their names in Python: numbers, texts, True for a switch, positions (x, y) [m],
    lists of them for what is repeated, or `Spelled`; start and goal come first."""
    notes: Sequence[str] = ()
    """Comments that stand above both."""

    @property
    def shell(self) -> str:
        """The command, for a POSIX shell."""
        words = ["locplan", self.command, _argument(self.map_file)]
        for name, value in self.settings.items():
            words += _words(name, value)
        return "\n".join([*(f"# {note}" for note in self.notes), shlex.join(words)])

    @property
    def python(self) -> str:
        """The code; the last line gives the result its name."""
        call, before = ["grid"], []
        for name, value in self.settings.items():
            code, argument = _code(value), name
            if isinstance(value, Spelled):
                before += [f"{name} = {value.code}", *value.after]
                code, argument = name, value.argument or name
            call.append(code if name in ("start", "goal", "robot") else f"{argument}={code}")
        return "\n".join(
            [
                *(f"# {note}" for note in self.notes),
                "import locplan",
                "",
                f"grid = locplan.load_map({self.map_file!r})",
                *before,
                f"result = locplan.{self.function}({', '.join(call)})",
            ]
        )


def number_text(value: float) -> str:
    """The shortest text of just this number: near a cell's edge, rounding could change the cell."""
    text = f"{value:.12g}"
    return text if float(text) == value else repr(float(value))


def _words(name: str, value: Any) -> list[str]:
    """The words of a setting on the command line."""
    if isinstance(value, Spelled):
        return [*value.words]
    if value is None or value is False:
        return []
    option = f"--{name.replace('_', '-')}"
    if value is True:
        return [option]
    if isinstance(value, list):
        return [word for each in value for word in _words(name, each)]
    return [option, _text(value)]


def _text(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        return ",".join(map(_text, value))
    return number_text(value) if isinstance(value, float) else str(value)


def _code(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_code, value))}]"
    if isinstance(value, tuple):
        return f"({', '.join(map(_code, value))})"
    return number_text(value) if isinstance(value, float) else repr(value)


def _argument(file: str) -> str:
    """A file's name as an argument: one that begins with a dash would be an option."""
    return f"./{file}" if file.startswith("-") and not PurePath(file).is_absolute() else file
