"""Typed texts as the objects that they stand for, and results as text."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locplan._util.checks import MAX_AMOUNT, printable, shown
from locplan._util.reading import parsed_json
from locplan.errors import ConfigError, LocplanError, one_line

if TYPE_CHECKING:
    from locplan.costs import Path as Route
    from locplan.maps import OccupancyGrid


def load(map_file: Path) -> OccupancyGrid:
    """The map in a file, or the only one in a folder."""
    from locplan.maps import load_map

    return load_map(map_file)


def load_filter_map(
    filter_map: Path | None, grids: Sequence[OccupancyGrid]
) -> OccupancyGrid | None:
    """The map of a robot's filter, where it was named; it is of one map that is driven in."""
    from locplan.simulation import check_filter_map, check_of_one_map

    if filter_map is None:
        return None
    grid = load(filter_map)
    check_of_one_map(grid, grids)
    return check_filter_map(grid, grids[0])


def read_paths(files: Sequence[Path]) -> dict[str, Route]:
    """Paths by the names of their files."""
    from locplan.costs import Path as Route

    paths = {printable(file.stem): Route.load(file) for file in files}
    if len(paths) < len(files):
        raise LocplanError("two --path files have one name; rename one")
    return paths


def position(name: str, text: str) -> tuple[float, ...]:
    """The position X,Y in metres, or X,Y,DEG, whose heading in degrees becomes radians."""
    try:
        x, y, *heading = (float(v) for v in text.split(","))
        if len(heading) > 1:
            raise ValueError
    except ValueError:
        raise LocplanError(
            f"--{name} must be X,Y in metres, such as 2.0,3.5, or X,Y,DEG with a heading,"
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
    raise LocplanError(f"--{name} must be {few} with commas between, not {shown(text)}")


def two_numbers(name: str, text: str) -> tuple[float, float]:
    """The two numbers of an option, with a comma between them."""
    first, second = numbers(name, text, 2)
    return first, second


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


def refuse(why: str, **options: object) -> None:
    """Raise a ConfigError if an option was given that is not read; `why` says when that is so."""
    for name, value in options.items():
        if value is not None:
            raise ConfigError(f"--{name.replace('_', '-')} is not read {why}; leave it out")


def show(as_json: bool, about: object, table: str, *written: Path | None) -> None:
    """Print a result as JSON or as a table for people, and tell on stderr what was written."""
    print(json.dumps(about, indent=2) if as_json else table)
    say_written(*written)


def say_written(*paths: Path | None) -> None:
    """Tell on stderr what was written."""
    for path in filter(None, paths):
        print(one_line(f"wrote {path}"), file=sys.stderr)
