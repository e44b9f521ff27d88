"""Choices for many queries: what they bring, and their folders."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from locplan._util.checks import file_path
from locplan._util.intervals import Interval, of_geometric_mean
from locplan._util.output import Results
from locplan._util.records import Column, Table
from locplan._util.tables import file_name
from locplan.errors import ConfigError, LocplanError
from locplan.planners import Query
from locplan.simulation._drives import LOST
from locplan.simulation.choice._choice import Choice
from locplan.simulation.choice._driven import Candidate


@dataclass(frozen=True)
class MapChoice:
    """The choice for one query."""

    map: str
    """Name of the map."""
    query: Query
    """Start and goal that were asked for."""
    choice: Choice
    """The candidates of the query, and the one to take."""

    @property
    def lengths(self) -> tuple[float, float]:
        """Length of the shortest and of the chosen path [m]; NaN without a path."""
        return self._both(lambda each: each.path.length)

    @property
    def errors(self) -> tuple[float, float]:
        """Typical error of both: geometric mean over the drives [m], or [rad] of headings."""
        return self._both(lambda each: each.driven.error.value if each.driven else math.nan)

    @property
    def lost(self) -> tuple[float, float]:
        """Share of lost drives of both, 0..1; NaN without a path."""
        return self._both(lambda each: each.driven.lost_rate.value if each.driven else math.nan)

    @property
    def off_at_end(self) -> tuple[float, float]:
        """Share of drives of both off by more than 1 m at the end, 0..1; NaN without a path."""
        return self._both(
            lambda each: each.driven.off_at_end_rate.value if each.driven else math.nan
        )

    def _both(self, value: Callable[[Candidate], float]) -> tuple[float, float]:
        both = self.choice.shortest, self.choice.chosen
        first, second = (math.nan if each is None else value(each) for each in both)
        return first, second


def _pair(name: str, values: str, unit: str = "") -> tuple[Column, Column]:
    """Columns of a pair of values, of the shortest and of the chosen path."""
    shortest = Column(f"{name}_shortest", unit, value=lambda each: getattr(each, values)[0])
    return shortest, Column(f"{name}_chosen", unit, value=lambda each: getattr(each, values)[1])


@dataclass(frozen=True, repr=False)
class Choices:
    """Choices for many queries; intervals are over the queries that have a path.

    Errors are those of the drives that confirmed the choice: those of paths that were taken are
    promised some 10 % too small.
    """

    files: ClassVar[Results] = Results("choices", ("choices.csv",))
    """The file of the folder that `save` writes, beside a folder for each choice."""

    choices: tuple[MapChoice, ...]
    """Choices in the order of the maps and of their queries."""

    def __repr__(self) -> str:
        ratio = f"error {self.error_ratio.value:.2f} of the shortest's"
        return f"Choices({len(self)} queries, {self.left} left the shortest, {ratio})"

    def __len__(self) -> int:
        return len(self.choices)

    def __iter__(self) -> Iterator[MapChoice]:
        return iter(self.choices)

    def __getitem__(self, number: int) -> MapChoice:
        return self.choices[number]

    @property
    def solved(self) -> tuple[MapChoice, ...]:
        """Choices for the queries that have a path."""
        return tuple(each for each in self.choices if each.choice.candidates)

    @property
    def left(self) -> int:
        """Number of queries for which another path than the shortest is recommended."""
        return sum(each.choice.best > 0 for each in self.solved)

    @property
    def error_ratio(self) -> Interval:
        """Ratio of the chosen paths' error to the shortest's: geometric mean over the queries."""
        return of_geometric_mean(np.array([e.errors[1] / e.errors[0] for e in self.solved]))

    @property
    def length_ratio(self) -> Interval:
        """Ratio of the chosen paths' length to the shortest's: geometric mean."""
        return of_geometric_mean(np.array([e.lengths[1] / e.lengths[0] for e in self.solved]))

    @property
    def lost(self) -> tuple[float, float]:
        """Share of lost drives along the shortest and the chosen paths: means over the queries."""
        return self._means("lost")

    @property
    def off_at_end(self) -> tuple[float, float]:
        """Share of drives off by more than 1 m at the end along both: means."""
        return self._means("off_at_end")

    def _means(self, name: str) -> tuple[float, float]:
        both = np.array([getattr(each, name) for each in self.solved] or [(math.nan, math.nan)])
        shortest, chosen = both.mean(axis=0).tolist()
        return shortest, chosen

    def table(self) -> Table:
        """A row per query: both ends, and the figures of the shortest and of the chosen path."""
        columns = (
            Column("map", title="map"),
            Column("query", title="query", value=lambda each: each.query.name),
            Column("start_x", "m", value=lambda each: each.query.start[0]),
            Column("start_y", "m", value=lambda each: each.query.start[1]),
            Column("goal_x", "m", value=lambda each: each.query.goal[0]),
            Column("goal_y", "m", value=lambda each: each.query.goal[1]),
            Column("chosen", value=lambda each: each.choice.taken),
            *_pair("length", "lengths", "m"),
            *_pair("error", "errors"),
            *(each for name in ("lost", "off_at_end") for each in _pair(name, name)),
        )
        return Table.of(columns, self.choices)

    def report(self) -> str:
        """Text of what the choices bring, one row per map and one of all maps."""
        names = dict.fromkeys(each.map for each in self)
        groups = {name: Choices(tuple(e for e in self if e.map == name)) for name in names}
        if len(groups) > 1:
            groups["all maps"] = self
        columns = (
            *(Column(name, title=name) for name in ("map", "queries")),
            Column("left", title="detours", digits=0),
            Column("length_ratio", title="length"),
            Column("error_ratio", title="error", interval=True),
            Column("off", title="lost,\noff at the end"),
        )
        rows = []
        for name, group in groups.items():
            both = group.lost, group.off_at_end
            rates = ("{:.0%} -> {:.0%}".format(*each) if group.solved else "-" for each in both)
            solved, shares = f"{len(group.solved)} of {len(group)}", "\n".join(rates)
            ratios = group.length_ratio.value, group.error_ratio
            rows.append((name, solved, group.left, *ratios, shares))
        return (
            f"{Table(columns, tuple(rows))}\ndetours leave the shortest path; chosen over shortest,"
            " by the drives that\nconfirmed it [95 % intervals]; lost, off at the end: by"
            f" > {LOST:g} m"
        )

    def save(self, folder: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the table and a folder for each choice, such as for ``locplan export --choice``.

        Parameters
        ----------
        folder : path
            Folder of the choices, which need not exist. A choice's folder in it has the query's
            name, behind the map's where there are several maps.
        force : bool, default False
            True overwrites files of the same names and removes other results; other files stay.

        Raises
        ------
        LocplanError
            If a file cannot be written, or two queries have the same name.
        """
        target = file_path("a folder of choices", folder)
        several = len({each.map for each in self}) > 1
        homes: dict[str, MapChoice] = {}
        for each in self:
            name = file_name(f"{each.map} {each.query.name}" if several else each.query.name)
            if name in homes:
                raise ConfigError(f"two choices would be saved as {name}; rename one")
            homes[name] = each
        with self.files.into(target, force=force).writing() as new:
            for name, each in homes.items():
                (new / name).mkdir()
                each.choice.write_files(new / name)
            self.table().write_csv(new / "choices.csv")


def read_choices(*paths: str | os.PathLike[str]) -> dict[str, Choice]:
    """Read choices from their folders, by the names of these folders.

    Parameters
    ----------
    *paths : path
        Folders that `Choice.save` wrote, or their choice.json; or folders of such folders, as
        `Choices.save` writes them.

    Raises
    ------
    LocplanError
        If a folder has no choice, a choice cannot be read, or two folders have the same name.
    """
    found: dict[str, Choice] = {}
    for path in (file_path("a folder of a choice", each) for each in paths):
        folders = [path.parent if path.is_file() else path]
        if path.is_dir() and not (path / CHOICE).exists():
            folders = sorted(file.parent for file in path.glob(f"*/{CHOICE}"))
        if not folders:
            raise LocplanError(f"{path}: has no choice; name a folder that plan or save wrote")
        for folder in folders:
            name = folder.resolve().name
            if name in found:
                raise LocplanError(f"two folders of choices are called {name}; rename one")
            found[name] = Choice.load(path if path.is_file() else folder)
    return found


CHOICE = f"{Choice.kind}{Choice.suffix}"
"""The file of a choice in its folder."""
