"""The application: its commands, their launch, and the exit codes."""

from __future__ import annotations

import ast
import inspect
import pkgutil
import sys
import textwrap
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast, get_args

from cyclopts import App, Group, Parameter
from cyclopts.help import DefaultFormatter

from locplan import __version__
from locplan._support.runs import RunRecord, Setting, record_run
from locplan._support.supervision import INTERRUPTED, TERMINATED
from locplan.app.cli.log import show_log

if TYPE_CHECKING:
    from cyclopts.argument import Argument, ArgumentCollection
    from cyclopts.help import HelpPanel
    from rich.console import Console, ConsoleOptions

SYSTEM_ERROR, WRONG_INPUT, LIMIT_EXCEEDED = 1, 2, 4
EXIT_CODES = {
    0: "success",
    SYSTEM_ERROR: "system error",
    WRONG_INPUT: "wrong input",
    LIMIT_EXCEEDED: "limit of check --fail-if exceeded",
    INTERRUPTED: "Ctrl-C",
    TERMINATED: "SIGTERM",
}
"""Meaning of each exit code."""
INSTALL_COMPLETION = "--install-completion"
COMMANDS = {
    "check": "Start",
    "explore": "Start",
    "info": "Start",
    "plan": "Plan",
    "compare": "Plan",
    "tune": "Localize",
    "simulate": "Localize",
    "recording": "Localize",
    "locate": "Localize",
    "repair": "Site",
    "landmarks": "Site",
    "export": "Hand over",
    "field": "Hand over",
    "cache": "Upkeep",
}
"""Heading of each command in the help. The command's module in this package has its name."""


WORDS = {
    "u": "degeneracy, from 0 (localizable) to 1 (degenerate)",
    "e": "uncertainty of a match with the map: sqrt(det(covariance)) [m² rad]",
    "J": "cost of a path: length + weight * degenerate metres (∫u ds) [m]",
}
"""Words that the help of a command can explain."""


def command(*examples: str, words: str = "") -> Callable[[Callable[..., int | None]], App]:
    """Return a decorator that turns a function into a command with examples in its help."""
    explained = [f"  {word}  {WORDS[word]}" for word in words]

    def decorate(function: Callable[..., int | None]) -> App:
        app = App(name=function.__name__)
        app.default(function)
        summary = (inspect.getdoc(function) or "").partition("\nParameters\n---")[0].strip()
        lines = [summary, "", "Examples", *map(wrap_example, examples)]
        app.help = "\n".join([*lines, *(["", "Words", *explained] if words else [])])
        return app

    return decorate


def wrap_example(words: str) -> str:
    """Return a command for a shell, with a backslash at the end of each line but the last.

    >>> print(wrap_example("info lab.yaml"))
      locplan info lab.yaml
    """
    lines = textwrap.wrap(
        f"locplan {words}",
        96,  # with the backslash 98, for terminals of 100 columns
        initial_indent="  ",
        subsequent_indent="      ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return " \\\n".join(lines)


def read_summary(name: str) -> str:
    """Return the first paragraph of a command's docstring without importing its module.

    Importing all commands would take most of the time of `locplan --help`.
    """
    module = sys.modules.get(f"locplan.app.cli.{name}")
    if module:
        return str(getattr(module, name).help).partition("\n\n")[0]
    source = pkgutil.get_data("locplan.app.cli", f"{name}.py") or b""
    functions = [node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)]
    docstrings = [ast.get_docstring(node) or "" for node in functions if node.name == name]
    return " ".join("".join(docstrings).partition("\n\n")[0].split())


OPTIONS = Group("Options", sort_key=10)
ROBOT = Group("Robot", sort_key=11)
COMPUTATION = Group("Computation", sort_key=12)
OUTPUT = Group("Output", sort_key=13)
"""Headings of the options in the help, in their order."""


def format_default(value: Any) -> str | None:
    """Return a default for the help; None if an option is off or has no value."""
    if value is None or value is False or value == ():
        return None
    return f"{value:g}" if isinstance(value, float) else str(value)


def make_application(*names: str) -> App:
    """Return the command line with some commands; without names, list all but import none."""
    app = App(
        name="locplan",
        help="Plan paths along which a robot with a 2D lidar can still localize itself.",
        version=f"locplan {__version__}",
        help_flags=("-h", "--help"),
        version_flags="--version",
        help_format="plaintext",
        help_formatter=FilledFormatter(),
        help_epilogue=(
            f"Exit codes: {', '.join(f'{code} {text}' for code, text in EXIT_CODES.items())}."
        ),
        group_parameters=OPTIONS,
        default_parameter=Parameter(
            negative=(), show_default=format_default, json_list=False, json_dict=False
        ),
        suppress_keyboard_interrupt=False,
        exit_on_error=False,
        print_error=False,
        result_action="return_value",
    )
    titles = dict.fromkeys(COMMANDS.values())  # in their order
    headings = {title: Group(title, sort_key=n) for n, title in enumerate(titles)}
    for n, (name, title) in enumerate(COMMANDS.items()):
        if name in (names or COMMANDS):
            group: Any = headings[title]
            if names:
                source = f"locplan.app.cli.{name}:{name}"
                app.command(source, name=name, group=group, sort_key=n)
            else:
                app.command(App(help=read_summary(name), name=name, group=group, sort_key=n))
    flags = (Group("Help", sort_key=20),)
    app.register_install_completion_command(
        INSTALL_COMPLETION, help="Install completion for your shell."
    )
    for flag in (*app.help_flags, *app.version_flags, INSTALL_COMPLETION):
        app[flag].group = flags
    return app


def run_tokens(tokens: list[str]) -> tuple[int | None, RunRecord]:
    """Run a command without importing the others; return its exit code and its run."""
    first = next((token for token in tokens if not token.startswith("-")), "")
    completing = INSTALL_COMPLETION in tokens  # completion needs all commands
    app = make_application(*(COMMANDS if completing else {first} & COMMANDS.keys()))
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
            Show details of the log on stderr.
        """
        with show_log(is_verbose=verbose):
            command = app(tokens)  # a callable with its options, or the exit code
            return cast("int | None", command() if callable(command) else command)

    with record_run(RunRecord("", {})) as run:
        app.config = (partial(_record_settings, run),)
        return cast("int | None", app.meta(tokens)), run


def _record_settings(
    run: RunRecord, _: object, commands: tuple[str, ...], arguments: ArgumentCollection
) -> None:
    """Note the options as typed for run.yaml, except those of the output."""
    arguments_by_name = {argument.names[0]: argument for argument in arguments}
    if "--output" not in arguments_by_name:
        return  # such as cache, which writes no results
    run.command = commands[0]
    entered = {name: argument for name, argument in arguments_by_name.items() if argument.tokens}
    settings = {
        name.removeprefix("--").replace("-", "_").lower(): argument
        for name, argument in entered.items()
        if OUTPUT not in (argument.parameter.group or ())  # type: ignore[operator]
    }
    run.settings = {name: _setting_from_argument(argument) for name, argument in settings.items()}
    run.files = frozenset(
        name
        for name, argument in settings.items()
        if _contains_path(argument.field_info.annotation)
    )


def _contains_path(kind: Any) -> bool:
    """Return True if an option's type contains paths."""
    return kind is Path or any(map(_contains_path, get_args(kind)))


def _setting_from_argument(argument: Argument) -> Setting:
    """Return an option's value as typed."""
    texts = [token.value for token in argument.tokens]
    if argument.hint is bool and texts == [""]:
        return True
    return texts if len(texts) > 1 else texts[0]


class FilledFormatter(DefaultFormatter):
    """Help formatter that joins the lines that paragraphs have in the source.

    Examples keep their lines.
    """

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Write a group of options or commands."""
        for panel_entry in panel.entries:
            _fill_paragraphs(panel_entry.description)
        super().__call__(console, options, panel)

    def render_description(self, console: Console, options: ConsoleOptions, text: Any) -> None:
        """Write the description of a command."""
        _fill_paragraphs(text)
        super().render_description(console, options, text)


def _fill_paragraphs(description: Any) -> None:
    """Join the lines of each paragraph of a description, in place."""
    text = getattr(description, "primary_renderable", None)
    if text is not None:
        paragraphs = text.plain.split("\n\n")
        text.plain = "\n\n".join(
            paragraph
            if paragraph.startswith(("Examples\n", "Words\n"))
            else " ".join(paragraph.split())
            for paragraph in paragraphs
        )
