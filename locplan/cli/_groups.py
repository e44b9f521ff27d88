"""The headings of the help, the makers of commands and of groups of options, and their types."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, TypeVar, dataclass_transform

from cyclopts import App, Group, Parameter
from cyclopts.validators import Number

import locplan
from locplan._util.checks import check_threads
from locplan._util.files import keep_input
from locplan.cli._values import numbers, parsed, two_numbers

Options = TypeVar("Options")
HEADINGS = (
    "Robot",
    "Options",
    "Recorded drive",
    "Format",
    "Planner",
    "Costs",
    "Simulation",
    "Field",
    "Computing",
    "Output",
)
"""The headings of a command's options, in their order."""


@cache
def heading(name: str) -> Group:
    """A heading of the help."""
    return Group(name, sort_key=HEADINGS.index(name))


@dataclass_transform(frozen_default=True)
def option_group(name: str) -> Callable[[type[Options]], type[Options]]:
    """The decorator that makes a class a frozen dataclass of options under a heading."""

    def made(kind: type[Options]) -> type[Options]:
        return Parameter(name="*", group=heading(name))(dataclass(frozen=True)(kind))

    return made


def command(name: str, *examples: str) -> App:
    """A command; its examples are shown at the end of its help."""
    return App(name=name, help_epilogue="\n".join(["Example", *map(example, examples)]))


def example(words: str) -> str:
    """A command as it is typed in a shell; a long one goes on behind a backslash.

    >>> print(example("info lab.yaml"))
      locplan info lab.yaml
    """
    lines = textwrap.wrap(
        f"locplan {words}",
        74,  # with the backslash 76, so that it stands in a terminal of 80
        initial_indent="  ",
        subsequent_indent="      ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return " \\\n".join(lines)


def _keep(_: object, files: Path | Sequence[Path] | None) -> None:
    for file in [files] if isinstance(files, Path) else files or ():
        keep_input(file)


def keep_maps(_: object, maps: Path | Sequence[Path] | None) -> None:
    """Let no result be written over a map that is read."""
    for path in [maps] if isinstance(maps, Path) else maps or ():
        _keep(None, locplan.maps.source_files(path))


def _bearable(_: object, threads: int | None) -> None:
    check_threads(threads)


INPUT = Parameter(validator=_keep)
"""Of a file that is read: no result is written over it."""
MapFile = Annotated[
    Path,
    Parameter("MAP", validator=keep_maps),
    Parameter(help="Map: a map_server YAML file, or a folder with one."),
]
MapFiles = Annotated[
    list[Path],
    Parameter("MAP", validator=keep_maps),
    Parameter(help="Maps: map_server YAML files, or folders of them."),
]
FilterMap = Annotated[
    Path | None,
    Parameter(
        group=heading("Robot"),
        validator=keep_maps,
        metavar="MAP",
        help="Map of the robot's filter, in the same frame, where it is not the one driven in.",
    ),
]
XY = Annotated[tuple[float, float] | None, parsed(two_numbers, "X,Y")]
"""A position, if it is given [m]."""
Ranges = Annotated[tuple[float, ...] | None, parsed(numbers, "R1,R2")]
Csv = Annotated[tuple[Path, ...], INPUT, Parameter(metavar="CSV")]
"""Files of paths."""
Count = Annotated[int, Parameter(validator=Number(gte=1, lte=100_000))]
Pair = Annotated[int, Parameter(validator=Number(gte=2, lte=100_000))]
"""A number of things of which there must be two at least."""
Seed = Annotated[int, Parameter(validator=Number(gte=0, lte=2**63 - 1))]
DriveSeed = Annotated[
    Seed, Parameter(group=heading("Simulation"), help="Seed of all random numbers; 1 by default.")
]
Threads = Annotated[
    int | None,
    Parameter(
        group=heading("Computing"),
        validator=_bearable,
        help="Number of threads; all cores by default.",
    ),
]
