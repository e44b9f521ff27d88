"""Messages of the library in the words of the command line: options as they are typed."""

from __future__ import annotations

import re
import sys

from locplan.cli._application import COMMANDS, application

KEYWORD = re.compile(
    r"(?<![\w:.\-/'\"=,<{])([a-z]+(?:_[a-z]+)*)"
    r"(?:=('[^']*'|\"[^\"]*\"|\([^()]*\)|[\w./-]*)|\b(?!['\":(=.]))"
)
"""A keyword of Python, with the value behind it if there is one."""


def options_as_typed(text: str) -> str:
    """Return a message with options of the command that runs in place of Python's keywords.

    Of a word without a value only one with an underscore is taken for a keyword.
    """
    if not re.search(r"[a-z]=|[a-z]_[a-z]", text):
        return text
    metavars = _options()

    def typed(match: re.Match[str]) -> str:
        name, value = match.groups()
        if name not in metavars or (value is None and "_" not in name):
            return match.group()
        flag = f"--{name.replace('_', '-')}"
        if not value or value == "True":
            return flag
        if value.startswith("("):  # such as (x, y, yaw), whose form on the command line differs
            value = metavars[name] or value[1:-1].replace(" ", "")
        return f"{flag} {value.strip(chr(39) + chr(34))}"

    return KEYWORD.sub(typed, text)


def _options() -> dict[str, str]:
    """The names of the options of the command that runs, in Python, and their metavars."""
    command = next((token for token in sys.argv[1:] if token in COMMANDS), "")
    if not command:
        return {}
    arguments = application(command)[command].assemble_argument_collection()
    flags = {name: each for each in arguments for name in each.names if name.startswith("--")}
    return {
        name.removeprefix("--").replace("-", "_"): str(each.parameter.metavar or "")
        for name, each in flags.items()
    }
