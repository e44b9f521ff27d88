"""Tables, sizes and ages for people to read, and numbers for CSV and JSON files."""

from __future__ import annotations

import contextlib
import csv
import json
import math
import re
import shutil
import textwrap
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from locplan._support.checks import short_repr
from locplan._support.files import write_text
from locplan._support.kernels.arrays import Floats
from locplan._support.output import replace_file
from locplan._support.reading import make_file_stamp
from locplan.errors import ConfigError

T = TypeVar("T")

TEXT_WIDTH, REPORT_WIDTH = 105, 100
"""Maximum width of text beside tables, and that of running text in reports [characters]."""
_DEVICES = {f"{port}{n}" for port in ("COM", "LPT") for n in "123456789"}
_DEVICES |= {"CON", "PRN", "AUX", "NUL"}
"""Names that Windows reserves, with any suffix."""
_FORMULA = re.compile(r"'*[=+\-@\t\r]")
"""Beginning of a formula of a spreadsheet, or of a text guarded by `format_csv_cell`."""


def write_csv(target: Path, values: Floats, header: str, number: str = "%.6f") -> None:
    """Write columns of numbers with a header as CSV, whole or not at all."""
    with (
        replace_file(target) as temporary,
        temporary.open("w", encoding="utf-8", newline="\n") as file,
    ):
        np.savetxt(file, values, number, delimiter=",", header=header, comments="")


def write_json(file: Path, kind: str, version: int, content: Mapping[str, object]) -> None:
    """Write numbers and texts with the kind and version of the file, as a whole or not at all."""
    with replace_file(file) as temporary:
        text = json.dumps({**make_file_stamp(kind, version), **content}, indent=2)
        write_text(temporary, text + "\n")


def write_csv_rows(target: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write rows of names and numbers, whole or not at all; unknown values are empty.

    Characters outside UTF-8, as in some file names, become question marks.
    """
    with (
        replace_file(target) as temporary,
        temporary.open("w", newline="", encoding="utf-8", errors="replace") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([format_csv_cell(value) for value in row] for row in rows)


def format_csv_cell(value: Any) -> Any:
    """Return a value for a CSV file: empty if not finite, and never a spreadsheet formula.

    Formulas get an apostrophe, as OWASP advises; numbers in texts stay.
    """
    if isinstance(value, str) and _FORMULA.match(value):
        with contextlib.suppress(ValueError):
            float(value)
            return value
        return f"'{value}"
    if isinstance(value, (str, int)):  # all digits of a seed count
        return value
    return f"{value:.9g}" if math.isfinite(value) else ""


def parse_csv_cell(text: str) -> str:
    """Return the original text of `format_csv_cell`."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text) else text


def nan_to_none(values: T) -> T:
    """Return values for JSON, with null for NaN and infinity at any depth."""
    cleaned: T = _nan_to_none(values)
    return cleaned


def _nan_to_none(values: Any) -> Any:
    if isinstance(values, Mapping):
        return {key: _nan_to_none(value) for key, value in values.items()}
    if isinstance(values, (list, tuple)):
        return [_nan_to_none(value) for value in values]
    return None if isinstance(values, float) and not math.isfinite(values) else values


def format_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, width: int | None = None
) -> str:
    """Return a table as text, at most as wide as the terminal, or as `width` [characters]."""
    from rich import box
    from rich.console import Console
    from rich.table import Column, Table
    from rich.text import Text

    # Plain text in a notebook and on a terminal, too: it may be written to a file.
    # A line of rich ends in a blank, which is cut off, so it may lie beyond the width.
    width = 1 + Console(width=width, force_jupyter=False).width
    console = Console(width=width, force_jupyter=False, color_system=None)
    titles = columns or [""] * max(map(len, rows), default=0)
    room = console.width - 3 * len(titles) - 1  # between the columns stand three characters
    widths = _choose_widths([*zip(titles, *rows, strict=True)], room)
    heads = [
        Column(Text(title), overflow="fold", width=wide)
        for title, wide in zip(titles, widths, strict=True)
    ]
    grid = Table(*heads, box=box.SIMPLE if columns else None, show_header=bool(columns))
    for row in rows:
        grid.add_row(*(Text(text) for text in row))  # a map's name may hold brackets
    with console.capture() as capture:
        console.print(grid)
    return "\n".join(line.rstrip() for line in capture.get().splitlines() if line.strip())


def format_aligned_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of few columns as text without wrapping."""
    from rich.cells import cell_len

    widths = [max(map(cell_len, column)) for column in zip(heads, *rows, strict=True)]
    lines = (
        "  ".join(
            cell + " " * (width - cell_len(cell)) for cell, width in zip(row, widths, strict=True)
        )
        for row in (heads, *rows)
    )
    return "\n".join(line.rstrip() for line in lines)


def _choose_widths(columns: Sequence[Sequence[str]], room: int) -> list[int | None]:
    """Return widths of columns that wrap headings before values, and only at spaces.

    None for each column if there is no room.
    """
    from rich.cells import cell_len

    # Words end at spaces, but not at unbreakable ones.
    min_widths = [max(map(cell_len, " ".join(texts).split(" "))) for texts in columns]
    if sum(min_widths) > room:
        return [None] * len(columns)
    wide = [max(map(cell_len, texts)) for texts in columns]
    values = [max(map(cell_len, ["", *texts[1:]])) for texts in columns]
    for floor in (np.maximum(values, min_widths), np.array(min_widths)):
        while sum(wide) > room and (wide > floor).any():
            wide[int(np.argmax(np.where(wide > floor, wide, 0)))] -= 1
    return [*wide]


UNBREAKABLE_SPACES = re.compile(r"(?<=\d) (?=%)|(?<=%) (?=\[)|(?<=\d,) (?=\d+\])")
"""Spaces at which a line is not broken."""


def wrap_lines(lines: Sequence[str]) -> list[str]:
    """Wrap lines to the width of the terminal, at most to a readable width.

    Numbers stay with their % sign and interval.
    """
    width = min(shutil.get_terminal_size((TEXT_WIDTH, 24)).columns, TEXT_WIDTH)
    bound_lines = (UNBREAKABLE_SPACES.sub("\xa0", text_line) for text_line in lines)
    return [
        part.replace("\xa0", " ") for line in bound_lines for part in textwrap.wrap(line, width)
    ]


def format_rounded_up(value: float) -> str:
    """Return a number of four digits that is not below the value, for a budget."""
    text = f"{value:.4g}"
    if float(text) < value:
        step = 10.0 ** (math.floor(math.log10(value)) - 3)
        text = f"{float(text) + step:.4g}"
    return text


def format_bytes(size: float) -> str:
    """Text of a size [bytes], such as 1.5 GB."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 999.5:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:,.4g} TB"


def format_area(area: float) -> str:
    """Text of an area [m^2], such as 1,234.5 m² or 0.25 m²."""
    return f"{area:,.1f} m²" if area >= 10 else f"{area:.3g} m²"


def format_age(moment: float) -> str:
    """Text of the time since a moment [s since the epoch], such as 5 min ago."""
    seconds = max(0.0, time.time() - moment)
    for size, unit in ((86400, "d"), (3600, "h"), (60, "min")):
        if seconds >= size:
            return f"{seconds / size:.0f} {unit} ago"
    return "just now"


def make_file_name(name: str) -> str:
    """Return a file name that all systems accept, with dashes for other characters.

    >>> make_file_name("dock 3/left"), make_file_name(".."), make_file_name("Aux.1")
    ('dock-3-left', '-', 'Aux-.1')
    """
    text = "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip(".") or "-"
    stem, dot, suffix = text.partition(".")
    return f"{stem}-{dot}{suffix}" if stem.upper() in _DEVICES else text


def check_file_names_differ(kind: str, names: Iterable[str]) -> None:
    """Raise a ConfigError if two names make the same file name, regardless of case."""
    names_by_file: dict[str, str] = {}
    for name in names:
        file = make_file_name(name).casefold()
        if file in names_by_file:
            pair = f"{short_repr(names_by_file[file])} and {short_repr(name)}"
            raise ConfigError(f"{kind} {pair} would be saved as one file; rename one")
        names_by_file[file] = name


def make_geojson_feature(
    kind: Literal["Point", "LineString", "Polygon"],
    coordinates: Any,
    properties: Mapping[str, Any],
    **members: Any,
) -> dict[str, Any]:
    """Return a GeoJSON feature; unknown properties are null."""
    geometry = {"type": kind, "coordinates": coordinates}
    return {
        "type": "Feature",
        **members,
        "properties": nan_to_none(dict(properties)),
        "geometry": geometry,
    }


def close_rings(*rings: ArrayLike) -> list[list[list[float]]]:
    """Return the coordinates of a polygon of rings (n, 2) [m], to 0.1 mm."""
    corners = (np.asarray(ring).round(4).tolist() for ring in rings)
    return [[*ring, ring[0]] for ring in corners]


def make_geojson_collection(
    name: str, features: Iterable[dict[str, Any]], **members: Any
) -> dict[str, Any]:
    """Return a GeoJSON collection of features."""
    return {"type": "FeatureCollection", "name": name, **members, "features": [*features]}


def write_geojson(
    file: Path, feature_collection: Mapping[str, Any], *, indent: int | None = None
) -> None:
    """Write a collection, as a whole or not at all."""
    text = json.dumps(feature_collection, allow_nan=False, indent=indent)
    with replace_file(file) as temporary:
        write_text(temporary, text + "\n")
