"""Types of the command line's arguments: how texts are parsed, checked, and shown in the help."""

from __future__ import annotations

import hashlib
import inspect
import math
import re
import runpy
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._support.checks import MAX_AMOUNT, short_repr
from locplan._support.files import protect_input
from locplan._support.reading import parse_json, read_text
from locplan.app.cli.application import format_default
from locplan.errors import ConfigError, LocplanError, format_one_line

if TYPE_CHECKING:
    from cyclopts import Token


def make_parser(
    parse: Callable[[str, str], Any], metavar: str, *, is_repeatable: bool = False
) -> Parameter:
    """Return a parameter that parses texts with a function of the option's name and the text.

    A repeatable option returns a tuple.
    """

    def convert(_: object, tokens: Sequence[Token]) -> Any:
        values = tuple(parse(str(token.keyword), token.value) for token in tokens)
        return values if is_repeatable else values[-1]

    # A text may begin with a minus sign, such as -2,3.
    return Parameter(converter=convert, n_tokens=1, allow_leading_hyphen=True, metavar=metavar)


def show_default(read: Callable[[], object]) -> Parameter:
    """Return a parameter that reads its default from the library only when the help is shown."""
    return Parameter(show_default=lambda _: format_default(read()))


def make_validator(check: Callable[[Any], object]) -> Parameter:
    """Return a parameter that checks each value with a function before the command runs."""

    def validate(_: object, values: Any) -> None:
        for value in values if isinstance(values, (list, tuple)) else [values]:
            if value is not None:
                check(value)

    return Parameter(validator=validate)


def parse_position(name: str, text: str) -> tuple[float, float]:
    """Return the position of a text X,Y [m]."""
    pose = parse_pose(name, text)
    if len(pose) != 2:
        raise LocplanError(f"{name} must be X,Y in metres, such as 2.0,3.5, not {short_repr(text)}")
    return pose[0], pose[1]


def parse_pose(name: str, text: str) -> tuple[float, ...]:
    """Return the position of a text X,Y [m], or the pose of X,Y,DEG [m, m, rad]."""
    with suppress(ValueError):
        x, y, *heading = values = [float(value) for value in text.split(",")]
        # False for NaN as well
        if len(heading) <= 1 and all(abs(value) <= MAX_AMOUNT for value in values):
            return (x, y, *map(math.radians, heading))
    raise LocplanError(
        f"{name} must be X,Y in metres, such as 2.0,3.5, or X,Y,DEG with a heading in degrees, not"
        f" {short_repr(text)}"
    )


def parse_numbers(name: str, text: str, count: int | None = None) -> tuple[float, ...]:
    """Return the numbers of a text with commas between them."""
    with suppress(ValueError):
        values = tuple(map(float, text.split(",")))
        is_in_range = all(abs(value) <= MAX_AMOUNT for value in values)  # False for NaN as well
        if is_in_range and count in (None, len(values)):
            return values
    amount = f"{count} numbers" if count else "numbers"
    raise LocplanError(f"{name} must be {amount} separated by commas, not {short_repr(text)}")


def parse_shift(name: str, text: str) -> tuple[float, float, float]:
    """Return the shift and turn of a text X,Y,DEG [m, m, rad]."""
    x, y, turn = parse_numbers(name, text, 3)
    return x, y, math.radians(turn)


def parse_settings(
    texts: Sequence[str], option: str, example: str, *, allows_words: bool = False
) -> dict[str, Any]:
    """Return settings by name from texts such as range=2.0 or k_nearest=false."""
    settings: dict[str, Any] = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            settings[name] = parse_json(value)
        except ValueError:
            if not (allows_words and value):
                raise LocplanError(
                    f"{option} must be NAME=VALUE, such as {example}, not {short_repr(text)}"
                ) from None
            settings[name] = value
    return settings


def protect_map_files(path: Path) -> None:
    """Protect the files of a map that is read from being overwritten by results."""
    from locplan.maps.files import list_source_files

    for file in list_source_files(path):
        protect_input(file)


def reject_options(reason: str, **options: object) -> None:
    """Raise a ConfigError if an option was given that the command ignores.

    Parameters
    ----------
    reason : str
        When it is ignored, such as "without --random".
    **options
        The values of options by their names in Python.
    """
    for name, value in options.items():
        if value is not None and value is not False and value != ():
            raise ConfigError(f"--{name.replace('_', '-')} has no effect {reason}; remove it")


def _convert_count(_: object, tokens: Sequence[Token]) -> int:
    """Return a whole number; raise a LocplanError for fractions, which cyclopts would round."""
    token = tokens[-1]
    with suppress(ValueError, OverflowError):
        number = float(token.value)
        if (count := int(number if "." in token.value else token.value)) == number:
            return count
    raise LocplanError(f"{token.keyword} must be a whole number, not {short_repr(token.value)}")


INTEGER = Parameter(converter=_convert_count)
Integer = Annotated[int, INTEGER]
"""Whole number whose range the library checks."""
INPUT = make_validator(protect_input)
"""Parameter of a file that is read: no result overwrites it."""
MAP = Parameter("MAP"), make_validator(protect_map_files)

MapFile = Annotated[Path, *MAP]
"""Map as a positional argument."""
MapFiles = Annotated[list[Path], *MAP]
Position = Annotated[tuple[float, float] | None, make_parser(parse_position, "X,Y")]
Pose = Annotated[Any, make_parser(parse_pose, "X,Y[,DEG]")]
Poses = Annotated[tuple[Any, ...], make_parser(parse_pose, "X,Y[,DEG]", is_repeatable=True)]
Positions = Annotated[tuple[Any, ...], make_parser(parse_position, "X,Y", is_repeatable=True)]
Ranges = Annotated[tuple[float, ...] | None, make_parser(parse_numbers, "R1,R2")]
Limits = Annotated[Any, make_parser(partial(parse_numbers, count=2), "MIN,MAX")]
Shift = Annotated[Any, make_parser(parse_shift, "X,Y,DEG")]
InputFile = Annotated[Path | None, INPUT, Parameter(metavar="FILE")]
PathFiles = Annotated[tuple[Path, ...], INPUT, Parameter(metavar="CSV")]
InputFiles = Annotated[tuple[Path, ...], INPUT, Parameter(metavar="FILE")]
InputFolders = Annotated[tuple[Path, ...], INPUT, Parameter(metavar="FOLDER")]
Count = Annotated[int, INTEGER, Parameter(validator=Number(gte=1, lte=100_000))]
PairCount = Annotated[int, INTEGER, Parameter(validator=Number(gte=2, lte=100_000))]
"""Number of objects of which there must be at least two."""
Switch = Annotated[bool, Parameter(negative=())]


PlannerTexts = Annotated[tuple[str, ...], Parameter(metavar="NAME|FILE")]
_FUNCTION = re.compile(r"(?P<file>.+\.py)(:(?P<name>[^:]*)(:(?P<options>.*))?)?", re.DOTALL)
"""Pattern of a function in a file, such as my.py:plan or my.py:plan:step=2."""


def parse_planners(texts: Sequence[str]) -> list[locplan.comparison.planners.PlannerSpec]:
    """Return the planners of texts such as grid, BITstar:time_limit=2 or my.py:plan."""
    return [_load_planner(text) for text in texts]


def _load_planner(text: str) -> locplan.comparison.planners.PlannerSpec:
    from locplan.comparison.planners import PlannerSpec, parse_options
    from locplan.planning.requests import make_planner

    function = _FUNCTION.fullmatch(text)
    if function is None:
        return PlannerSpec.parse(text)
    file, name = Path(function["file"]), function["name"] or ""
    if not name.isidentifier():
        example = f"--planner {file}:plan"
        raise ConfigError(f"{text}: add the function f(costs, start, goal), such as {example}")
    protect_input(file)
    code = load_function(file, name)
    options = parse_options(text, function["options"] or "")
    planner = make_planner(code, options)
    label = ":".join(filter(None, (file.name, name, function["options"])))
    return PlannerSpec(label, planner)


def load_function(file: Path, name: str) -> Callable[..., Any]:
    """Return a function of a Python file, which may import modules of its folder."""
    source = read_text(file)
    sys.path.insert(0, str(file.absolute().parent))
    try:
        # No module can be imported by this name, so workers receive the code itself.
        values = runpy.run_path(str(file), run_name="planner of the command line")
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise LocplanError(
            format_one_line(f"{file}: cannot be run ({reason}); fix the code")
        ) from None
    if not inspect.isfunction(values.get(name)):
        names = [
            key for key, value in values.items()
            if inspect.isfunction(value) and value.__code__.co_filename == str(file)
        ]  # fmt: skip
        function_text = f"use one of {', '.join(names)}" if names else "the file defines none"
        raise ConfigError(f"{file}: has no function {short_repr(name)}; {function_text}")
    function: Any = values[name]
    if not hasattr(function, "version"):  # a comparison runs an edited planner again
        function.version = hashlib.sha256(source.encode()).hexdigest()[:8]
    return cast("Callable[..., Any]", function)


def read_paths(files: Sequence[Path]) -> dict[str, locplan.Path]:
    """Return paths by file name; files of the same name get the name of their folder in front."""
    from locplan._support.checks import make_printable

    stems = [file.stem for file in files]
    paths: dict[str, locplan.Path] = {}
    for file, stem in zip(files, stems, strict=True):
        is_repeated = stems.count(stem) > 1
        name = make_printable(f"{file.absolute().parent.name}/{stem}" if is_repeated else stem)
        if name in paths:
            raise LocplanError(f"two --path files have the name {name}; rename one")
        paths[name] = locplan.Path.load(file)
    return paths


def check_ends(start: object, goal: object) -> None:
    """Raise a ConfigError if only one of start and goal was given."""
    if (start is None) != (goal is None):
        raise ConfigError("--start and --goal belong together; pass both or neither")
