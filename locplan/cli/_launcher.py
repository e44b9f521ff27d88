"""The launch of one command, whose settings its folders of results keep."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Annotated, cast

from cyclopts import Parameter

from locplan._util.runs import Run, Setting, running
from locplan.cli import _application
from locplan.cli._groups import heading

if TYPE_CHECKING:
    from cyclopts.argument import Argument, ArgumentCollection


def launched(tokens: list[str]) -> tuple[int | None, Run]:
    """Run the command that is named, and import no other; return its exit code and its run."""
    first = next((token for token in tokens if not token.startswith("-")), "")
    app = _application.application(*({first} & _application.COMMANDS.keys()))
    app.meta.suppress_keyboard_interrupt = False

    @app.meta.default
    def launch(
        *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
        verbose: Annotated[bool, Parameter(alias="-v", group=heading("Output"))] = False,
    ) -> int | None:
        """Run a command.

        Parameters
        ----------
        verbose
            Show the log on stderr.
        """
        with _log_on_stderr(verbose):
            return cast("int | None", app(tokens))

    with running(Run("", {})) as run:
        app.config = (partial(_record, run),)
        return cast("int | None", app.meta(tokens)), run


def _record(run: Run, _: object, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Let folders of results have what was typed for each option, but those for the output."""
    typed = {each.names[0]: each for each in arguments}
    if "--output" not in typed:
        return  # it writes no results, or those of a page
    run.command = commands[0]
    given = {name: each for name, each in typed.items() if each.tokens}
    settings = {
        name.removeprefix("--").replace("-", "_").lower(): each
        for name, each in given.items()
        if heading("Output") not in (each.parameter.group or ())  # type: ignore[operator]
    }
    run.settings = {name: _typed(each) for name, each in settings.items()}
    run.files = frozenset(
        name for name, each in settings.items() if "pathlib.Path" in str(each.field_info.annotation)
    )


def _typed(argument: Argument) -> Setting:
    """What was typed for an option."""
    texts = [token.value for token in argument.tokens]
    if argument.hint is bool and texts == [""]:
        return True
    return texts if len(texts) > 1 else texts[0]


@contextmanager
def _log_on_stderr(shown: bool) -> Iterator[None]:
    log, libraries = logging.getLogger("locplan"), logging.getLogger()
    # Without any handler Python itself shows what libraries warn of.
    handler = logging.StreamHandler() if shown else logging.NullHandler()
    handler.setFormatter(logging.Formatter("%(name)s: %(message)s"))
    before = log.level
    libraries.addHandler(handler)
    if shown:
        log.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        libraries.removeHandler(handler)
        log.setLevel(before)
