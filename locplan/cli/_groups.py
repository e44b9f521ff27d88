"""The headings of options in the help, from the top, and what makes a command."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar, dataclass_transform

from cyclopts import App, Group, Parameter

Options = TypeVar("Options")

GENERAL = Group("Options", sort_key=1)
PLANNER = Group("Planner", sort_key=2)
COSTS = Group("Costs", sort_key=3)
SIMULATION = Group("Simulation", sort_key=4)
FIELD = Group("Field", sort_key=5)
COMPUTING = Group("Computing", sort_key=6)
OUTPUT = Group("Output", sort_key=7)


def command(name: str, *examples: str) -> App:
    """A command; its examples are shown at the end of its help."""
    lines = ["Example", *(f"  locplan {example}" for example in examples)]
    return App(name=name, help_epilogue="\n".join(lines))


@dataclass_transform(frozen_default=True)
def option_group(heading: Group) -> Callable[[type[Options]], type[Options]]:
    """What makes a class a frozen dataclass of options under a heading."""

    def made(kind: type[Options]) -> type[Options]:
        return Parameter(name="*", group=heading)(dataclass(frozen=True)(kind))

    return made
