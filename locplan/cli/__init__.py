"""The command line: reads what was typed, calls the library, prints what came of it."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from typing import Annotated, Any

import typer

from locplan import __version__
from locplan.cli import (
    _compare as compare,
    _evidence as evidence,
    _exports as exports,
    _fields as fields,
    _figures as figures,
    _plans as plans,
    _simulations as simulations,
)
from locplan.cli._options import STYLE
from locplan.errors import LocplanError

app = typer.Typer(**STYLE)
app.add_typer(fields.app)
app.add_typer(figures.app)
app.add_typer(plans.app)
app.add_typer(exports.app)
app.add_typer(compare.app)
app.add_typer(simulations.app)
app.add_typer(evidence.app)

INTERRUPTED = 130
# Of click, which typer brings along in some versions and depends on in others.
_UsageError: type[Any] = typer.BadParameter.__bases__[0]


def main() -> None:
    """Run the command line; a user's error ends in one line on stderr and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without ² or ∫ shows ?
    try:
        with _warnings_as_lines():
            code = app(standalone_mode=False)
        if code == INTERRUPTED:
            _complain("interrupted", INTERRUPTED)
        sys.stdout.flush()
    except LocplanError as error:
        code = _complain(f"error: {error}", 2)
    except _UsageError as error:
        message = error.format_message()
        helps = "\n" in message  # of a command without any arguments
        code = _complain(message if helps else f"error: {message} (--help shows how)", 2)
    except (KeyboardInterrupt, typer.Abort):
        code = _complain("interrupted", INTERRUPTED)
    except BrokenPipeError:
        sys.stdout = sys.stderr = None
        code = 1
    except OSError as error:
        code = _complain(f"error: {error}", 1)
        sys.stdout = None
    sys.exit(code or 0)


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Plan paths along which a robot with a 2D lidar can still localize itself."""
    if version:
        print(f"locplan {__version__}")
        raise typer.Exit


@contextmanager
def _warnings_as_lines() -> Iterator[None]:
    def show(message: Any, *_: Any, **__: Any) -> None:
        _complain(f"warning: {message}", 0)

    with warnings.catch_warnings():
        warnings.simplefilter("default")
        warnings.showwarning = show
        yield


def _complain(line: str, code: int) -> int:
    print(f"locplan: {line}", file=sys.stderr)
    return code
