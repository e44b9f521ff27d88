"""Results and their tables, with columns declared once for text and files."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._support import tables
from locplan._support.checks import check_file_path
from locplan._support.output import ResultFiles
from locplan._support.public import DrawableResult, require_extra
from locplan._support.saved import StoredResult, to_plain_data

if TYPE_CHECKING:
    import pandas

FILE_DPI = 130
"""Pixels an inch of pictures in files."""
IN_FILES: dict[str, Any] = {"dpi": FILE_DPI, "bbox_inches": "tight", "pad_inches": 0.1}
"""How pictures are written into files."""


@dataclass(frozen=True)
class TableColumn:
    """A column of a table: name and unit in files, and format for people."""

    name: str
    """Name in files, which stands for the same quantity in all of them."""
    unit: str = ""
    """Unit in files, where lengths are in metres and angles in radians; empty without one."""
    title: str | None = None
    """Heading for people, without the unit; None for a column that is in files only."""
    digits: int = 2
    """Digits behind the point for people."""
    people: str = ""
    """Unit that people see instead: "cm", "deg" or "%"."""
    signed: bool = False
    """True if people see a plus before what is above 0."""
    interval: bool = False
    """True if the values are `Interval`s, which take three columns in files."""
    value: Callable[[Any], Any] | None = None
    """Gives a record's value; by default it is the attribute of this name."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns in files."""
        ends = ("", "_low", "_high") if self.interval else ("",)
        return tuple(f"{self.name}{end}" for end in ends)

    @property
    def heading(self) -> str:
        """Title and unit; a per cent sign stands behind each value instead."""
        unit = self.people or self.unit
        return f"{self.title} [{unit}]" if unit not in ("", "%") else str(self.title)

    def extract_value(self, record: object) -> Any:
        """Return the value of a record."""
        return self.value(record) if self.value else getattr(record, self.name)

    def text(self, value: Any) -> str:
        """Return a value as text for people; a dash if it is unknown."""
        if isinstance(value, str):
            return value
        middle, *ends = value if self.interval else (value,)
        if not math.isfinite(middle):
            return "-"
        # Small errors are shown in millimetres.
        exact = self.interval and self.unit == "m" and middle < 0.0995
        # z: no minus before what rounds to 0
        form = f"{'+' if self.signed else ''}z.{self.digits + exact}f"
        percent = "%" if self.people == "%" else ""
        scale = {"": 1.0, "cm": 100.0, "deg": math.degrees(1.0), "%": 100.0}[self.people]
        middle, *ends = (f"{scale * number:{form}}" for number in (middle, *ends))
        has_interval = self.interval and math.isfinite(value[1])
        # Without a space in it, an interval is never broken over two rows.
        return f"{middle}{percent} [{','.join(ends)}]" if has_interval else f"{middle}{percent}"


Outline = tuple[NDArray[np.float64], ...]
"""A polygon's corners, and those of its holes, (n, 2) each [m]."""
POSITION: tuple[TableColumn, ...] = TableColumn("x", "m", "x"), TableColumn("y", "m", "y")
POSE: tuple[TableColumn, ...] = (*POSITION, TableColumn("heading", "rad", "heading", 0, "deg"))
"""Columns of poses in the world, and of positions."""


@dataclass(frozen=True)
class Table:
    """Rows under declared columns; `print` shows it as text."""

    columns: tuple[TableColumn, ...]
    """The columns."""
    rows: tuple[tuple[Any, ...], ...]
    """A value for each column in each row: numbers in the column's unit, texts, or intervals."""

    @classmethod
    def from_records(
        cls, columns: Iterable[TableColumn], records: Iterable[object], *, number: str | None = None
    ) -> Table:
        """Return the table of some records.

        Parameters
        ----------
        columns : iterable of Column
            The columns.
        records : iterable
            The records, a row each.
        number : str, optional
            Heading of a first column, `number`, that counts the rows from 1; none by default.
        """
        declared = tuple(columns)
        rows = tuple(
            tuple(column.extract_value(record) for column in declared) for record in records
        )
        if number is None:
            return cls(declared, rows)
        counted = tuple((n, *row) for n, row in enumerate(rows, 1))
        return cls((TableColumn("number", title=number, digits=0), *declared), counted)

    def __len__(self) -> int:
        return len(self.rows)

    def __str__(self) -> str:
        return self.text()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns in files."""
        return tuple(name for column in self.columns for name in column.names)

    def text(self, first: int | None = None, width: int | None = None) -> str:
        """Return the table as text for people.

        Parameters
        ----------
        first : int, optional
            Number of the rows that are shown; all by default.
        width : int, optional
            Maximum width [characters]; the terminal's by default.
        """
        titled_columns = [n for n, column in enumerate(self.columns) if column.title is not None]
        heads = [self.columns[n].heading for n in titled_columns]
        rows = [[self.columns[n].text(row[n]) for n in titled_columns] for row in self.rows[:first]]
        return tables.format_table(heads, rows, width=width)

    def format_transposed(self) -> list[list[str]]:
        """Return heading and values of each column as a row, for few records side by side."""
        titled_columns = [
            (n, column) for n, column in enumerate(self.columns) if column.title is not None
        ]
        return [
            [titled_column.heading, *(titled_column.text(row[n]) for row in self.rows)]
            for n, titled_column in titled_columns
        ]

    def records(self) -> list[dict[str, Any]]:
        """Return the rows as plain data for JSON; unknown values are null."""
        return [
            tables.nan_to_none(dict(zip(self.names, row, strict=True)))
            for row in self._iterate_values()
        ]

    def write_csv(self, file: Path) -> None:
        """Write the rows as CSV, whole or not at all; unknown values are empty.

        Parameters
        ----------
        file : path
            The file.
        """
        tables.write_csv_rows(file, self.names, self._iterate_values())

    def write_geojson(
        self, file: Path, outlines: Iterable[ArrayLike | Outline], *, frame: str = "map"
    ) -> None:
        """Write each row with its outline, as a whole or not at all.

        Parameters
        ----------
        file : path
            The file; its name becomes the name of the collection.
        outlines : iterable of (n, 2) array, or of tuple of such arrays
            Corners of a polygon for each row [m], the last one not the first one again; of a tuple
            the further ones are its holes.
        frame : str, default "map"
            The frame of the corners, which each feature names.
        """
        features = []
        for properties, outline in zip(self.records(), outlines, strict=True):
            corners = tables.close_rings(*(outline if isinstance(outline, tuple) else [outline]))
            features.append(
                tables.make_geojson_feature("Polygon", corners, {**properties, "frame": frame})
            )
        tables.write_geojson(file, tables.make_geojson_collection(file.stem, features))

    def to_frame(self) -> pandas.DataFrame:
        """Return a data frame of pandas; raise a LocplanError if it is not installed."""
        require_extra("pandas", "tables", "a data frame")
        import pandas

        return pandas.DataFrame([*self._iterate_values()], columns=[*self.names])

    def _iterate_values(self) -> Iterator[Sequence[Any]]:
        """The values of each row by `names`."""
        for row in self.rows:
            pairs = zip(self.columns, row, strict=True)
            yield [number for c, value in pairs for number in (value if c.interval else (value,))]


def extract_values(columns: Iterable[TableColumn], record: object) -> dict[str, Any]:
    """Return the values of a record by the names of columns, fit for JSON; intervals are lists.

    Parameters
    ----------
    columns : iterable of Column
        The columns.
    record : object
        The record.
    """
    values = {column.name: column.extract_value(record) for column in columns}
    return dict(tables.nan_to_none(values))


class Result(DrawableResult):
    """Result of a command: numbers, text, a figure, and a folder with all of them."""

    files: ClassVar[ResultFiles]
    """The files of a folder of results."""
    version: ClassVar[int] = 1
    """Version of its JSON file, which rises when an older locplan could not read it."""
    if TYPE_CHECKING:
        report: Callable[..., str]

    def summary(self, *related_results: Any, **details: Any) -> dict[str, object]:
        """Return the result in numbers, fit for JSON: by default all of its fields.

        Parameters
        ----------
        *related_results, **details
            Related results, such as the drives that verify it.
        """
        return to_plain_data(self)

    def table(self) -> Table:
        """Return the table of the result."""
        raise NotImplementedError

    def save(
        self, folder: str | os.PathLike[str], *related_results: Any, force: bool = False
    ) -> None:
        """Write the summary as JSON, the figure, and the tables, whole or not at all.

        Parameters
        ----------
        folder : path
            Folder of the results, which need not exist.
        *related_results
            Arguments of `summary`.
        force : bool, default False
            True overwrites files of the same names and removes results of another command. It
            keeps the user's files.

        Raises
        ------
        LocplanError
            If a file cannot be written, or the folder holds files that are not earlier results of
            this kind.
        """
        target = self.files.make_output(check_file_path("a folder of results", folder), force=force)
        with target.writing() as new:
            self.write_files(new, *related_results)

    def write_files(self, folder: Path, *related_results: Any) -> None:
        """Write the files of `save` into an existing folder.

        Parameters
        ----------
        folder : path
            The folder.
        *related_results
            Arguments of `summary`.
        """
        kind = self.files.kind
        if isinstance(self, StoredResult) and self.suffix == ".json":
            self.write(folder / f"{kind}.json")
        else:
            content = self.summary(*related_results)
            tables.write_json(folder / f"{kind}.json", kind, self.version, content)
        if self.is_drawable:
            self.figure(*related_results).savefig(folder / f"{kind}.png", **IN_FILES)
        self._write(folder, *related_results)

    def _write(self, folder: Path, *related_results: Any) -> None:
        """Write the further files: by default the table as CSV."""
        (name,) = (file_name for file_name in self.files.names if file_name.endswith(".csv"))
        self.table().write_csv(folder / name)
