"""The headings of the help and how it is written, the makers of commands, and common options."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, dataclass_transform

from cyclopts import App, Group, Parameter
from cyclopts.help import DefaultFormatter
from cyclopts.validators import Number

from locplan._util.files import keep_input

if TYPE_CHECKING:
    from cyclopts.help import HelpPanel
    from rich.console import Console, ConsoleOptions

EXAMPLE_WIDTH = 76
"""Longest line of an example; a longer one goes on in the next line [characters]."""
Options = TypeVar("Options")

ROBOT = Group("Robot", sort_key=0)
GENERAL = Group("Options", sort_key=1)
DRIVE = Group("Recorded drive", sort_key=2)
PLANNER = Group("Planner", sort_key=3)
COSTS = Group("Costs", sort_key=4)
SIMULATION = Group("Simulation", sort_key=5)
FIELD = Group("Field", sort_key=6)
COMPUTING = Group("Computing", sort_key=7)
OUTPUT = Group("Output", sort_key=8)
OUTPUT_OPTION = "--output"


def _keep(_: object, files: Path | Sequence[Path] | None) -> None:
    for file in [files] if isinstance(files, Path) else files or ():
        keep_input(file)


def _keep_maps(_: object, maps: Path | Sequence[Path] | None) -> None:
    from locplan.maps import source_files

    for path in [maps] if isinstance(maps, Path) else maps or ():
        _keep(None, source_files(path))


INPUT, MAP_INPUT = Parameter(validator=_keep), Parameter(name="MAP", validator=_keep_maps)
"""Of a file that is read: no result is written over it."""

MapFile = Annotated[
    Path, MAP_INPUT, Parameter(help="Map: a map_server YAML file, or a folder with one.")
]
MapFiles = Annotated[
    list[Path],
    MAP_INPUT,
    Parameter(help="Maps: map_server YAML files, or folders of them."),
]
FilterMap = Annotated[
    Path | None,
    Parameter(
        group=ROBOT,
        validator=_keep_maps,
        metavar="MAP",
        help="Map of the robot's filter, in the same frame, where it is not the one driven in.",
    ),
]
Text = Annotated[str, Parameter(allow_leading_hyphen=True)]
"""A text that may begin with a minus sign, such as -2,3."""
MAX_COUNT = 100_000
"""Greatest number of things that an option can ask for."""
Count = Annotated[int, Parameter(validator=Number(gte=1, lte=MAX_COUNT))]
Pair = Annotated[int, Parameter(validator=Number(gte=2, lte=MAX_COUNT))]
"""A number of things of which there must be two at least."""
Seed = Annotated[int, Parameter(validator=Number(gte=0, lte=2**63 - 1))]
Json = Annotated[bool, Parameter(name="--json", group=OUTPUT, help="Print the result as JSON.")]


Force = Annotated[
    bool,
    Parameter(group=OUTPUT, help="Replace files in the way, whoever wrote them."),
]


def results(what: str) -> Parameter:
    """The option that says where results go."""
    return Parameter(name=(OUTPUT_OPTION, "-o"), group=OUTPUT, help=what)


def command(name: str, *examples: str) -> App:
    """A command; its examples are shown at the end of its help."""
    lines = ["Example", *map(example, examples)]
    return App(name=name, help_epilogue="\n".join(lines))


@dataclass_transform(frozen_default=True)
def option_group(heading: Group) -> Callable[[type[Options]], type[Options]]:
    """The decorator that makes a class a frozen dataclass of options under a heading."""

    def made(kind: type[Options]) -> type[Options]:
        return Parameter(name="*", group=heading)(dataclass(frozen=True)(kind))

    return made


Folder = Annotated[Path | None, results("Folder for pictures, JSON and CSV.")]
DriveSeed = Annotated[
    Seed, Parameter(group=SIMULATION, help="Seed of all random numbers; 1 by default.")
]


@option_group(SIMULATION)
class AtPlaces:
    """The number of places drawn at random, and of the simulations at each."""

    places: Pair = 100
    """Number of places on each map; 100 by default."""
    drives: Count | None = None
    """Number of drives of 10 m to each place; 16 by default."""
    scans: Count | None = None
    """Number of single scans matched at each place; 16 by default."""


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
