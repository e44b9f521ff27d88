"""How the help of commands is written: paragraphs fill the terminal's width."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

from cyclopts.help import DefaultFormatter

if TYPE_CHECKING:
    from cyclopts.help import HelpPanel
    from rich.console import Console, ConsoleOptions

EXAMPLE_WIDTH = 76
"""Longest line of an example; a longer one goes on in the next line [characters]."""


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


def example(words: str) -> str:
    """A command as it is typed in a shell; a long one goes on behind a backslash.

    >>> print(example("info lab.yaml"))
      locplan info lab.yaml
    """
    width = EXAMPLE_WIDTH - len(" \\")
    lines = textwrap.wrap(
        f"locplan {words}",
        width,
        initial_indent="  ",
        subsequent_indent="      ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return " \\\n".join(lines)
