"""Typed texts as the objects that they stand for, and options that a command does not read."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

from cyclopts import Group, Parameter

import locplan
from locplan._util.checks import MAX_AMOUNT, printable, shown
from locplan._util.public import field_docs
from locplan._util.reading import parsed_json
from locplan.errors import ConfigError, LocplanError

if TYPE_CHECKING:
    from cyclopts import Token


def parsed(parse: Callable[[str, str], Any], metavar: str, *, many: bool = False) -> Parameter:
    """A text that is parsed, with the option's name for errors; `many` gives a tuple of several."""

    def convert(_: object, tokens: Sequence[Token]) -> Any:
        values = tuple(parse(str(token.keyword), token.value) for token in tokens)
        return values if many else values[-1]

    # A text may begin with a minus sign, such as -2,3.
    return Parameter(converter=convert, n_tokens=1, allow_leading_hyphen=True, metavar=metavar)


def position(name: str, text: str) -> tuple[float, ...]:
    """The position X,Y in metres, or X,Y,DEG, whose heading in degrees becomes radians."""
    try:
        x, y, *heading = (float(v) for v in text.split(","))
        if len(heading) > 1:
            raise ValueError
    except ValueError:
        raise LocplanError(
            f"{name} must be X,Y in metres, such as 2.0,3.5, or X,Y,DEG with a heading,"
            f" not {shown(text)}"
        ) from None
    return (x, y, *map(math.radians, heading))


def numbers(name: str, text: str, count: int | None = None) -> tuple[float, ...]:
    """The numbers of an option, with commas between them."""
    with suppress(ValueError):
        values = tuple(map(float, text.split(",")))
        fit = all(abs(value) <= MAX_AMOUNT for value in values)  # False for NaN, too
        if fit and count in (None, len(values)):
            return values
    few = f"{count} numbers" if count else "numbers"
    raise LocplanError(f"{name} must be {few} with commas between, not {shown(text)}")


def two_numbers(name: str, text: str) -> tuple[float, ...]:
    """The two numbers of an option."""
    return numbers(name, text, 2)


def move(name: str, text: str) -> tuple[float, ...]:
    """A shift in metres with a turn in degrees, which becomes radians."""
    x, y, turn = numbers(name, text, 3)
    return x, y, math.radians(turn)


def rectangle(name: str, text: str) -> tuple[float, ...]:
    """Two corners of a rectangle."""
    return numbers(name, text, 4)


def region(name: str, text: str) -> tuple[float, ...] | str:
    """A rectangle, or the word all."""
    return text if text == "all" else rectangle(name, text)


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


def load_filter_map(
    filter_map: Path | None, grids: Sequence[locplan.OccupancyGrid]
) -> locplan.OccupancyGrid | None:
    """The map of a robot's filter, where it was named; it is of one map that is driven in."""
    if filter_map is None:
        return None
    grid = locplan.load_map(filter_map)
    locplan.simulation.check_of_one_map(grid, grids)
    return locplan.simulation.check_filter_map(grid, grids[0])


def read_paths(files: Sequence[Path]) -> dict[str, locplan.Path]:
    """Paths by the names of their files."""
    paths = {printable(file.stem): locplan.Path.load(file) for file in files}
    if len(paths) < len(files):
        raise LocplanError("two --path files have one name; rename one")
    return paths


def flag(name: str) -> str:
    """An option as it is typed."""
    return f"--{name.replace('_', '-')}"


def given_of(options: Any) -> dict[str, Any]:
    """The options that were given, by name."""
    return {name: value for name, value in vars(options).items() if value is not None}


def refuse(why: str, **options: object) -> None:
    """Raise a ConfigError if an option was given that is not read; `why` says when that is so."""
    for name, value in options.items():
        if value is not None:
            raise ConfigError(f"{flag(name)} is not read {why}; leave it out")


def check_has(name: str, switch: str, kind: str, having: Collection[str]) -> None:
    """Raise a ConfigError unless the kind is one of those that have the option."""
    if kind not in having:
        raise ConfigError(f"{flag(name)} is for {switch} {', '.join(having)}, not for {kind}")


def field_names(kind: Any) -> list[str]:
    """The names of a dataclass's fields."""
    return [each.name for each in dataclasses.fields(kind)]


def joint_options(kinds: Mapping[str, type], group: Group, but: Collection[str] = ()) -> type:
    """A dataclass with the options of all kinds but some; one that was not given is None."""
    docs: dict[str, dict[str, list[str]]] = {}
    types: dict[str, Any] = {}
    for kind, options in kinds.items():
        types |= get_type_hints(options)
        for name, doc in ((n, d) for n, d in field_docs(options).items() if n not in but):
            docs.setdefault(name, {}).setdefault(doc.removesuffix("."), []).append(kind)
    fields = []
    for name, sentences in docs.items():
        help = " ".join(f"{doc} ({', '.join(having)})." for doc, having in sentences.items())
        fields.append((name, Annotated[types[name] | None, Parameter(help=help)], None))
    own = {"__module__": __name__}
    joint = dataclasses.make_dataclass("JointOptions", fields, frozen=True, namespace=own)
    return Parameter(name="*", group=group)(joint)


def options_of(
    kinds: Mapping[str, type], kind: str, switch: str, joint: Any, **more: object
) -> Any:
    """The options of one kind from those given; `switch` is the option that chooses the kind.

    An option that is given and not for this kind is a ConfigError; others are then left out.
    """
    given = given_of(joint)
    for name in given:
        check_has(name, switch, kind, [n for n, each in kinds.items() if name in field_names(each)])
    known = field_names(kinds[kind])
    return kinds[kind](**given, **{name: more[name] for name in more if name in known})
