"""The command line: reads options, calls the library, and prints results."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Sequence
from io import TextIOWrapper

from cyclopts import CoercionError, CycloptsError, MissingArgumentError, UnusedCliTokensError

from locplan._support.checks import format_suggestion, short_repr
from locplan._support.files import protect_inputs
from locplan._support.supervision import INTERRUPTED, end_if_supervised
from locplan._support.user_cache import choose_user_cache
from locplan.app.cli.application import COMMANDS, SYSTEM_ERROR, WRONG_INPUT, run_tokens
from locplan.app.cli.log import print_line
from locplan.app.cli.wording import translate_options
from locplan.errors import LocplanError

__all__ = ["COMMANDS", "main"]
MIN_COLUMNS = 20
"""Minimum terminal width [characters]: on narrower ones tables vanish and the help never ends."""


def main() -> None:
    """Run the command line; a user's error ends in one line on stderr and exit code 2."""
    _fix_environment()
    try:
        with protect_inputs():
            _check_no_empty_argument(sys.argv[1:])
            code, _ = run_tokens(sys.argv[1:])
        _flush_output()
    except (LocplanError, CycloptsError, MemoryError) as error:
        notes = getattr(error, "__notes__", ())  # such as lines to save in a file
        print_line(f"error: {_format_error(error)}", *notes)
        code = WRONG_INPUT
    except KeyboardInterrupt:
        end_if_supervised()
        print_line("interrupted")
        code = INTERRUPTED
    except OSError as error:
        code = _report_os_error(error)
    sys.exit(code or 0)


def _report_os_error(error: OSError) -> int:
    """Report an error of the operating system unless the output is closed; return the code."""
    if isinstance(error, BrokenPipeError):
        sys.stdout = sys.stderr = None
        return SYSTEM_ERROR
    text = str(error)  # of a library, without a number
    if error.errno is not None:
        subject = "the output" if error.filename is None else os.fsdecode(error.filename)
        text = f"{subject}: {error.strerror or error}"
    print_line(f"error: {text}")
    sys.stdout = None
    end_if_supervised(SYSTEM_ERROR)  # background threads must not outlive the output
    return SYSTEM_ERROR


def _flush_output() -> None:
    """Write out buffered output, so that a full disk is reported as an error."""
    for stream in filter(None, (sys.stdout, sys.stderr)):
        stream.flush()


def _fix_environment() -> None:
    """Replace settings of the environment that would make commands fail."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without ² or ∫ shows ?
    os.environ["MPLBACKEND"] = "agg"  # a notebook sets its own, which may not be installed here
    if not (os.environ.get("MPLCONFIGDIR") or os.access(os.path.expanduser("~"), os.W_OK)):
        folder, substitute = choose_user_cache()  # otherwise matplotlib warns in each run
        os.environ["MPLCONFIGDIR"] = str((substitute or folder) / "matplotlib")
    columns = shutil.get_terminal_size().columns
    if "COLUMNS" in os.environ or columns < MIN_COLUMNS:
        os.environ["COLUMNS"] = str(max(MIN_COLUMNS, columns))


def _check_no_empty_argument(tokens: list[str]) -> None:
    """Raise a LocplanError if an argument is empty: as a path it would be the current folder."""
    for before, token in zip(["", *tokens], tokens, strict=False):
        name, equals, value = token.partition("=")
        if equals and name.startswith("--") and not value.strip():
            raise LocplanError(f"{name} is empty; add a value or remove the option")
        if not token.strip():
            is_option = before.startswith("-")
            subject, kind = (before, "option") if is_option else ("an argument", "argument")
            raise LocplanError(f"{subject} is empty; add a value or remove the {kind}")


def _format_error(error: Exception) -> str:
    """Return the text of an error for the user."""
    if isinstance(error, CycloptsError):
        return f"{_format_usage_error(error)} (see --help)"
    if isinstance(error, MemoryError):
        return "out of memory; try a smaller map or fewer threads"
    return translate_options(str(error))


def _format_usage_error(error: CycloptsError) -> str:
    """Return one line about wrong options or arguments."""
    if isinstance(error, UnusedCliTokensError):
        return _describe_unexpected_arguments(error.unused_tokens or ())
    if isinstance(error, MissingArgumentError) and (argument := error.argument):
        guess = "".join(" ".join(str(error).split()).partition("Did you mean")[1:])
        return f"{argument.name} is missing{'. ' if guess else ''}{guess}"
    if isinstance(error, CoercionError) and (line := _describe_choices(error)):
        return line
    words = re.split(r"\s+", str(error).strip())
    return " ".join(map(_shorten_word, words)).removesuffix(".")


def _describe_choices(error: CoercionError) -> str:
    """Return a line that lists an option's choices; empty if the option has none."""
    if not (error.argument and error.token):
        return ""
    choices = error.argument.get_choices(force=True) or ()
    name, value = error.token.keyword or error.argument.name, error.token.value
    if not choices:
        return ""
    guess = format_suggestion(value, choices)
    return f"{name} must be one of {', '.join(choices)}, not {short_repr(value)}{guess}"


def _describe_unexpected_arguments(tokens: Sequence[str]) -> str:
    """Return a line about arguments that the command does not take."""
    numbers = all(re.fullmatch(r"-?[\d.]+", token) for token in tokens)
    remedy = "; write positions as X,Y with a comma" if numbers else ""
    return f"unexpected argument: {' '.join(map(_shorten_word, tokens))}{remedy}"


def _shorten_word(word: str) -> str:
    """Return a word, shortened in the middle if it is very long."""
    return word if len(word) <= 80 else f"{word[:70]}...{word[-7:]}"
