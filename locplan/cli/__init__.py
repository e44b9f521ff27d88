"""The command line, which reads options, calls the library, and prints results."""

from __future__ import annotations

import logging
import os
import re
import shutil
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from typing import Annotated, Any, cast

from cyclopts import (
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    Parameter,
    UnusedCliTokensError,
)

from locplan._util.checks import shown
from locplan._util.files import inputs_are_kept
from locplan._util.supervision import INTERRUPTED, end_if_supervised
from locplan.cli._application import COMMANDS, NOT_IN_METRES, SYSTEM_ERROR, WRONG_INPUT, application
from locplan.cli._groups import OUTPUT
from locplan.errors import CalibrationError, LocplanError, one_line

LOG = logging.getLogger("locplan.cli")
MIN_COLUMNS = 20
"""Width that a narrower terminal counts as [characters]: tables vanish, and help never ends."""


def main() -> None:
    """Run the command line; a user's error ends in one line on stderr and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without ² or ∫ shows ?
    _mend_environment()
    try:
        with _warnings_as_lines(), inputs_are_kept():
            _check_none_is_empty(sys.argv[1:])
            code = _launched(sys.argv[1:])
        for stream in filter(None, (sys.stdout, sys.stderr)):
            stream.flush()
    except CalibrationError as error:
        code = _complain(f"error: {error}", NOT_IN_METRES)
    except LocplanError as error:
        code = _complain(f"error: {error}", WRONG_INPUT)
    except CycloptsError as error:
        code = _complain(f"error: {_in_one_line(error)} (--help shows how)", WRONG_INPUT)
    except KeyboardInterrupt:
        end_if_supervised()
        code = _complain("interrupted", INTERRUPTED)
    except BrokenPipeError:
        sys.stdout = sys.stderr = None
        code = SYSTEM_ERROR
    except OSError as error:
        where = "the output" if error.filename is None else os.fsdecode(error.filename)
        code = _complain(f"error: {where}: {error.strerror or error}", SYSTEM_ERROR)
        sys.stdout = None
        end_if_supervised(code)  # no thread in the background outlives the output
    except MemoryError:
        code = _complain("error: the memory does not suffice; give less at a time", WRONG_INPUT)
    sys.exit(code or 0)


def _mend_environment() -> None:
    """Replace what the environment asks for and no command can do."""
    os.environ["MPLBACKEND"] = "agg"  # a notebook names its own, which may not be installed here
    columns = shutil.get_terminal_size().columns
    if "COLUMNS" in os.environ or columns < MIN_COLUMNS:
        os.environ["COLUMNS"] = str(max(MIN_COLUMNS, columns))


def _check_none_is_empty(tokens: list[str]) -> None:
    """Raise a LocplanError if an argument is empty, which as a path would be the folder here."""
    for before, token in zip(["", *tokens], tokens, strict=False):
        name, equals, value = token.partition("=")
        if equals and name.startswith("--") and not value.strip():
            raise LocplanError(f"{name} is empty; give it a value, or leave it out")
        if not token.strip():
            what = before if before.startswith("-") else "an argument"
            raise LocplanError(f"{what} is empty; give it a value, or leave it out")


def _launched(tokens: list[str]) -> int | None:
    """Run the command that is named, and import no other."""
    first = next((token for token in tokens if not token.startswith("-")), "")
    app = application(*({first} & set(COMMANDS)))
    app.meta.suppress_keyboard_interrupt = False

    @app.meta.default
    def launch(
        *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
        verbose: Annotated[bool, Parameter(alias="-v", group=OUTPUT)] = False,
    ) -> int | None:
        """Run a command.

        Parameters
        ----------
        verbose
            Show the log on stderr.
        """
        with _log_on_stderr(verbose):
            return cast("int | None", app(tokens))

    return cast("int | None", app.meta(tokens))


@contextmanager
def _log_on_stderr(wanted: bool) -> Iterator[None]:
    log, libraries = logging.getLogger("locplan"), logging.getLogger()
    # Without any handler Python itself shows what libraries warn of.
    handler = logging.StreamHandler() if wanted else logging.NullHandler()
    handler.setFormatter(logging.Formatter("%(name)s: %(message)s"))
    before = log.level
    libraries.addHandler(handler)
    if wanted:
        log.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        libraries.removeHandler(handler)
        log.setLevel(before)


@contextmanager
def _warnings_as_lines() -> Iterator[None]:
    def show(message: Any, category: type[Warning], *_: Any, **__: Any) -> None:
        if category.__module__.startswith("locplan."):
            _complain(f"warning: {message}", 0)
        else:  # that of a library says nothing to users
            LOG.debug("%s: %s", category.__name__, message)

    with warnings.catch_warnings():
        warnings.simplefilter("default")
        warnings.showwarning = show
        yield


def _in_one_line(error: CycloptsError) -> str:
    if isinstance(error, UnusedCliTokensError):
        tokens = error.unused_tokens or ()
        unexpected = f"unexpected: {' '.join(map(_short, tokens))}"
        numbers = all(re.fullmatch(r"-?[\d.]+", token) for token in tokens)
        return unexpected + "; write positions as X,Y with a comma" * numbers
    if isinstance(error, MissingArgumentError) and (argument := error.argument):
        guess = "".join(" ".join(str(error).split()).partition("Did you mean")[1:])
        return f"{argument.name} is missing{'. ' if guess else ''}{guess}"
    if isinstance(error, CoercionError) and (token := error.token) and (of := error.argument):
        choices = of.get_choices(force=True)
        if choices:
            name = token.keyword or of.name
            return f"{name} must be one of {', '.join(choices)}, not {shown(token.value)}"
    words = re.split(r"\s+", str(error).strip())
    return " ".join(map(_short, words)).removesuffix(".")


def _short(word: str) -> str:
    """A word as it is unless it is too long."""
    return word if len(word) <= 80 else f"{word[:70]}...{word[-7:]}"


def _complain(line: str, code: int) -> int:
    try:
        print(f"locplan: {one_line(line)}", file=sys.stderr, flush=True)
    except OSError:  # a full disk: the exit code alone says it
        sys.stderr = None
    return code
