"""The application, the registry of its commands, and its exit codes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cyclopts import App, Group, Parameter
from cyclopts.help import DefaultFormatter

from locplan import __version__
from locplan._util.supervision import INTERRUPTED
from locplan.cli._groups import heading

if TYPE_CHECKING:
    from cyclopts.help import HelpPanel
    from rich.console import Console, ConsoleOptions

SYSTEM_ERROR, WRONG_INPUT, NOT_IN_METRES = 1, 2, 3
EXPLAINED = (
    f"The exit code is 0 for a result, {SYSTEM_ERROR} where the system fails, {WRONG_INPUT} for a"
    f" wrong input, {NOT_IN_METRES} where calibrate finds that deviations cannot be in metres, and"
    f" {INTERRUPTED} after Ctrl-C."
)
COMMANDS = {
    "explore": "Start",
    "info": "Start",
    "plan": "Plan",
    "pareto": "Plan",
    "compare": "Plan",
    "tune": "Localize",
    "simulate": "Localize",
    "evaluate": "Localize",
    "calibrate": "Localize",
    "locate": "Localize",
    "landmarks": "The site",
    "features": "The site",
    "twins": "The site",
    "export": "Hand over",
    "plot": "Hand over",
    "field": "Upkeep",
    "cache": "Upkeep",
    "maps": "Upkeep",
    "run": "Upkeep",
    "completion": "Upkeep",
}
"""The heading of each command in the help; it is the `app` of the module of its name."""


def application(*names: str) -> App:
    """The command line with these commands, all of them by default."""
    app = App(
        name="locplan",
        help="Plan paths along which a robot with a 2D lidar can still localize itself.",
        version=f"locplan {__version__}",
        help_flags=("-h", "--help"),
        version_flags="--version",
        help_format="plaintext",
        help_formatter=Filling(),
        help_epilogue=EXPLAINED,
        group_parameters=heading("Options"),
        default_parameter=Parameter(
            negative=(), show_default=False, json_list=False, json_dict=False
        ),
        suppress_keyboard_interrupt=False,
        exit_on_error=False,
        print_error=False,
        result_action="return_value",
    )
    names_of = dict.fromkeys(COMMANDS.values())  # in their order
    headings = {name: Group(name, sort_key=n) for n, name in enumerate(names_of)}
    for n, name in enumerate(COMMANDS):
        if name in (names or COMMANDS):
            app.command(f"locplan.cli._{name}:app", name=name)
            # It is imported now, so that the help knows its first sentence.
            app[name].group, app[name].sort_key = headings[COMMANDS[name]], n
    flags = (Group("Help", sort_key=len(headings)),)
    for flag in (*app.help_flags, *app.version_flags):
        app[flag].group = flags
    return app


class Filling(DefaultFormatter):
    """The usual help, without the line ends and indents that texts have in the source."""

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Write a group of options or commands."""
        for entry in panel.entries:
            _fill(entry.description)
        super().__call__(console, options, panel)

    def render_description(self, console: Console, options: ConsoleOptions, text: Any) -> None:
        """Write what a command does."""
        _fill(text)
        super().render_description(console, options, text)


def _fill(description: Any) -> None:
    """Join the lines of each paragraph of a text of cyclopts', which adds choices behind it."""
    text = getattr(description, "primary_renderable", None)
    if text is not None:
        paragraphs = text.plain.split("\n\n")
        text.plain = "\n\n".join(" ".join(each.split()) for each in paragraphs)
