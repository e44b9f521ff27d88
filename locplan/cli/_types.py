"""Headings of the help, commands and groups of options, and the types of what is typed."""

from __future__ import annotations

import dataclasses
import inspect
import math
import textwrap
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    TypeVar,
    Union,
    cast,
    dataclass_transform,
    get_args,
    get_origin,
)

from cyclopts import App, Group, Parameter
from cyclopts.validators import Number

import locplan
from locplan._util.checks import MAX_AMOUNT, shown
from locplan._util.files import keep_input
from locplan._util.reading import parsed_json
from locplan.errors import ConfigError, LocplanError

if TYPE_CHECKING:
    from cyclopts import Token

Kind = TypeVar("Kind")
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


def under(title: str, **more: Any) -> Parameter:
    """What puts one option under another heading than its group's."""
    return Parameter(group=heading(title), **more)


class Options:
    """Options of a command; those that were not given are None, False or ()."""

    def given(self, *groups: type | str) -> dict[str, Any]:
        """The options that were given, by name: those of groups, or with these names.

        A group may be any dataclass, such as the settings of a recipe that are options by name.
        """
        named = ([group] if isinstance(group, str) else field_names(group) for group in groups)
        values = {name: getattr(self, name, None) for names in named for name in names}
        missing = (None, False, ())
        return {n: value for n, value in values.items() if not any(value is m for m in missing)}

    def refuse(self, why: str, *groups: type | str) -> None:
        """Raise a ConfigError if an option was given that is not read; `why` says when."""
        for name in self.given(*groups):
            raise ConfigError(f"{flag(name)} is not read {why}; leave it out")


@dataclass_transform(
    frozen_default=True, kw_only_default=True, field_specifiers=(dataclasses.field,)
)
def option_group(title: str) -> Callable[[type[Kind]], type[Kind]]:
    """The decorator that makes a class a frozen dataclass of options under a heading."""

    def made(kind: type[Kind]) -> type[Kind]:
        # In its module alone: an option may have the name of what parses it.
        for name, hint in inspect.get_annotations(kind, locals={}, eval_str=True).items():
            if getattr(vars(kind).get(name), "kw_only", True) is False:
                continue  # it has its place, such as a map, and stands among the arguments
            more = getattr(hint, "__metadata__", ())  # which may name another heading
            bare = hint.__origin__ if more else hint
            count = [WHOLE] if _is_count(hint) else []
            kind.__annotations__[name] = Annotated[(bare, under(title), *count, *more)]
        return dataclasses.dataclass(frozen=True, kw_only=True, eq=False, repr=False)(kind)

    return made


def _is_count(hint: Any) -> bool:
    """Whether an option takes one whole number, or none."""
    optional = get_origin(hint) in (Annotated, Union, UnionType)
    return hint is int or (optional and any(map(_is_count, get_args(hint))))


def _whole(_: object, tokens: Sequence[Token]) -> int:
    """The whole number of an option, which cyclopts would round."""
    last = tokens[-1]
    with suppress(ValueError, OverflowError):
        if (value := int(float(last.value) if "." in last.value else last.value)) == float(
            last.value
        ):
            return value
    raise LocplanError(f"{last.keyword} must be a whole number, not {shown(last.value)}")


WHOLE = Parameter(converter=_whole)


def named(name: str, *examples: str) -> App:
    """A command; its examples are shown at the end of its help."""
    return App(name=name, help_epilogue="\n".join(["Example", *map(example, examples)]))


@dataclass_transform(
    frozen_default=True, kw_only_default=True, field_specifiers=(dataclasses.field,)
)
def command(*examples: str) -> Callable[[type | Callable[..., int | None]], App]:
    """The decorator of a command, whose help ends in these examples.

    A command is a function, or a class whose bases are groups of options, whose fields are options
    of its own, and which is called.
    """

    def made(does: type | Callable[..., int | None]) -> App:
        app = named(does.__name__, *examples)
        app.default(_with_options(does) if isinstance(does, type) else does)
        return app

    return made


def _with_options(kind: type) -> type:
    """The class of a command as a dataclass, of which a map has its place and no name."""
    made: Any = option_group("Options")(kind)
    signature = inspect.signature(made)
    made.__signature__ = signature.replace(
        parameters=[
            each if each.kind is each.KEYWORD_ONLY else each.replace(kind=each.POSITIONAL_ONLY)
            for each in signature.parameters.values()
        ]
    )
    return cast("type", made)


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


def parsed(parse: Callable[[str, str], Any], metavar: str, *, many: bool = False) -> Parameter:
    """A text that is parsed, with the option's name for errors; `many` gives a tuple of several."""

    def convert(_: object, tokens: Sequence[Token]) -> Any:
        values = tuple(parse(str(token.keyword), token.value) for token in tokens)
        return values if many else values[-1]

    # A text may begin with a minus sign, such as -2,3.
    return Parameter(converter=convert, n_tokens=1, allow_leading_hyphen=True, metavar=metavar)


def position(name: str, text: str, *, headed: bool = True) -> tuple[float, ...]:
    """The position X,Y in metres, or X,Y,DEG, whose heading in degrees becomes radians."""
    with suppress(ValueError):
        x, y, *heading = values = [float(v) for v in text.split(",")]
        # False for NaN, too
        if len(heading) <= headed and all(abs(value) <= MAX_AMOUNT for value in values):
            return (x, y, *map(math.radians, heading))
    more = ", or X,Y,DEG with a heading in degrees" if headed else ""
    raise LocplanError(f"{name} must be X,Y in metres, such as 2.0,3.5{more}, not {shown(text)}")


def numbers(name: str, text: str, count: int | None = None) -> tuple[float, ...]:
    """The numbers of an option, with commas between them."""
    with suppress(ValueError):
        values = tuple(map(float, text.split(",")))
        fit = all(abs(value) <= MAX_AMOUNT for value in values)  # False for NaN, too
        if fit and count in (None, len(values)):
            return values
    few = f"{count} numbers" if count else "numbers"
    raise LocplanError(f"{name} must be {few} with commas between, not {shown(text)}")


two_numbers = partial(numbers, count=2)


def checked(check: Callable[[Any], object]) -> Parameter:
    """What raises an error where a value that was given is out of range, or each of several."""

    def validate(_: object, given: Any) -> None:
        for value in given if isinstance(given, (list, tuple)) else [given]:
            if value is not None:
                check(value)

    return Parameter(validator=validate)


def keep_map(path: Path) -> None:
    """Let no result be written over a map that is read."""
    for file in locplan.maps.source_files(path):
        keep_input(file)


INPUT = checked(keep_input)
"""Of a file that is read: no result is written over it."""
MAPS = Parameter("MAP"), checked(keep_map)


@dataclasses.dataclass(frozen=True)
class OneMap(Options):
    """The map of a command."""

    map_file: Annotated[
        Path,
        *MAPS,
        Parameter(
            help="Map: a map_server YAML file, a folder with one, or a built-in map:"
            f" {', '.join(locplan.maps.BUILT_IN)}."
        ),
    ]


@dataclasses.dataclass(frozen=True)
class ManyMaps(Options):
    """The maps of a command."""

    maps: Annotated[
        list[Path],
        *MAPS,
        Parameter(help="Maps: map_server YAML files, folders of them, or built-in maps."),
    ]


XY = Annotated[tuple[float, float] | None, parsed(partial(position, headed=False), "X,Y")]
"""A position, if it is given [m]."""
Pose = Annotated[Any, parsed(position, "X,Y[,DEG]")]
Poses = Annotated[tuple[Any, ...], parsed(position, "X,Y[,DEG]", many=True)]
Ranges = Annotated[tuple[float, ...] | None, parsed(numbers, "R1,R2")]
Csv = Annotated[tuple[Path, ...], INPUT, Parameter(metavar="CSV")]
"""Files of paths."""
ConfigFile = Annotated[Path | None, INPUT, Parameter(metavar="FILE.json")]
Count = Annotated[int, Parameter(validator=Number(gte=1, lte=100_000))]
Pair = Annotated[int, Parameter(validator=Number(gte=2, lte=100_000))]
"""A number of things of which there must be two at least."""
Seed = Annotated[int, Parameter(validator=Number(gte=0, lte=2**63 - 1))]
Target = Parameter(name=("--output", "-o"))
"""The option that says where results go."""


def settings_of(
    texts: Sequence[str], option: str, example: str, *, words: bool = False
) -> dict[str, Any]:
    """Settings by name, such as range=2.0 or k_nearest=false, and with `words` name=word."""
    settings: dict[str, Any] = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            settings[name] = parsed_json(value)
        except ValueError:
            if not (words and value):
                raise LocplanError(
                    f"--{option} must be NAME=VALUE, such as {example}, not {shown(text)}"
                ) from None
            settings[name] = value
    return settings


def flag(name: str) -> str:
    """An option as it is typed."""
    return f"--{name.replace('_', '-')}"


def check_read(
    given: Iterable[str], switch: str, kind: str, readers: Mapping[str, Collection[str]]
) -> None:
    """Raise a ConfigError unless the kind that a switch chooses reads all that was given.

    `readers` are the options that each kind reads.
    """
    for name in given:
        having = [each for each, names in readers.items() if name in names]
        if kind not in having:
            raise ConfigError(f"{flag(name)} is for {switch} {', '.join(having)}, not for {kind}")


def field_names(kind: Any) -> list[str]:
    """The names of a dataclass's fields."""
    return [each.name for each in dataclasses.fields(kind)]
