"""Messages of the library with options as typed in place of Python's keywords."""

from __future__ import annotations

import re
import sys

from locplan.app.cli.application import COMMANDS, make_application

KEYWORD = re.compile(
    r"(?<!in Python )(?<![\w:.\-/'\"=,<{])([a-z]+(?:_[a-z]+)*)"
    r"(?:=('[^']*'|\"[^\"]*\"|\([^()]*\)|[\w./-]*)|\b(?!['\":(=.]))"
)
"""Pattern of a keyword in Python, with the value after it if there is one."""


def translate_options(text: str, command: str = "") -> str:
    """Return a message with options of a command in place of Python's keywords.

    A word without a value is replaced only if it has an underscore.

    Parameters
    ----------
    text : str
        The message.
    command : str, default ""
        The command. By default the running one.
    """
    # Options of a planner are typed as in Python, after --planner.
    if text.startswith("planner '") or not re.search(r"[a-z]=|[a-z]_[a-z]", text):
        return text
    metavars = _list_options(command)

    def replace_keyword(match: re.Match[str]) -> str:
        name, value = match.groups()
        if name not in metavars or (value is None and "_" not in name):
            return match.group()
        flag = f"--{name.replace('_', '-')}"
        if not value or value == "True":
            return flag
        if value.startswith("("):  # such as (x, y, yaw), whose form on the command line differs
            value = metavars[name] or value[1:-1].replace(" ", "")
        return f"{flag} {value.strip(chr(39) + chr(34))}"

    return KEYWORD.sub(replace_keyword, text)


def _list_options(command: str) -> dict[str, str]:
    """Return the names of a command's options in Python, and their metavars."""
    command = command or next((token for token in sys.argv[1:] if token in COMMANDS), "")
    if not command:
        return {}
    arguments = make_application(command)[command].assemble_argument_collection()
    flags = {
        name: argument for argument in arguments for name in argument.names if name.startswith("--")
    }
    return {
        name.removeprefix("--").replace("-", "_"): str(argument.parameter.metavar or "")
        for name, argument in flags.items()
    }
