"""Where the planners that are compared shall go: from a file, or drawn at random."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError
from locplan.planners._protocol import Position

COLUMNS = ("name", "start_x", "start_y", "goal_x", "goal_y")
HEADINGS = ("start_heading_deg", "goal_heading_deg")
JOINED = 4
"""Neighbours by which cells hold together where no corner may be cut."""
CANDIDATES = 20
"""Of so many pairs at random, the one farthest from those before is taken."""
DRAWS = 4096
"""Pairs drawn at once."""


@dataclass(frozen=True)
class Query:
    """A way to be found."""

    name: str
    """What to call it; once on a map."""
    start: Position
    """World position [m], or pose with a heading [rad]."""
    goal: Position
    """The same."""


def read_queries(file: str | os.PathLike[str]) -> list[Query]:
    """Queries from a CSV file with the columns name, start_x, start_y, goal_x and goal_y [m].

    Columns start_heading_deg and goal_heading_deg [degrees] may follow, and be empty.

    Raises
    ------
    LocplanError
        If the file cannot be read, with the row that is wrong.
    """
    path = Path(file)
    rows = csv.reader(lines_of(path))
    try:
        header = [column.strip() for column in next(rows, [])]
        _check_header(path, header)
        queries: dict[str, Query] = {}
        for row in rows:
            if any(value.strip() for value in row):
                query = _query(f"{path}: row {rows.line_num}", header, row)
                if query.name in queries:
                    raise LocplanError(
                        f"{path}: row {rows.line_num}: there is another query named"
                        f" {query.name!r}; give each its own name"
                    )
                queries[query.name] = query
    except csv.Error as error:
        raise LocplanError(f"{path}: row {rows.line_num}: is no CSV ({error})") from None
    if not queries:
        raise LocplanError(f"{path}: has no queries; add a row for each below the header")
    return list(queries.values())


def random_queries(
    costs: Costmap, count: int, seed: int, *, least_distance: float, headed: bool = False
) -> list[Query]:
    """Queries at random that all can be solved, spread over the map.

    Start and goal are the centres of cells where the robot can stand, joined by a path that cuts
    no corners. Each pair is, of several at random, the one farthest from those before.

    Parameters
    ----------
    costs : Costmap
        For the robot's radius; weights do not matter.
    count : int
        How many, at least 1.
    seed : int
        Of the random numbers; the same seed gives the same queries.
    least_distance : float
        Between start and goal in a straight line [m].
    headed : bool
        Whether they have headings, at random as well.

    Raises
    ------
    ConfigError
        If no two positions that are joined lie so far apart, or a value is impossible.
    """
    if count < 1 or not 0 <= least_distance < math.inf:
        raise ConfigError(
            "random queries need a count of at least 1 and a least distance of at least 0 m,"
            f" not {count} and {least_distance:g}"
        )
    random = np.random.default_rng(seed)
    parts = _Parts.of(costs, least_distance)
    chosen = np.empty((0, 4))
    while len(chosen) < count:
        pairs = np.array([parts.draw(random) for _ in range(CANDIDATES)])
        chosen = np.vstack([chosen, _farthest(pairs, chosen)])
    digits = len(str(count))
    centres: list[tuple[Position, ...]] = [
        tuple(costs.grid.cell_to_world(int(row), int(col)) for row, col in pair.reshape(2, 2))
        for pair in chosen
    ]
    if headed:
        angles = random.uniform(-math.pi, math.pi, (count, 2)).tolist()
        centres = [
            tuple((*xy, angle) for xy, angle in zip(ends, turns, strict=True))
            for ends, turns in zip(centres, angles, strict=True)
        ]
    return [Query(f"random {n:0{digits}}", *ends) for n, ends in enumerate(centres, 1)]


def lines_of(path: Path) -> list[str]:
    """Of a text file; a LocplanError if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise LocplanError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise LocplanError(f"{path}: is no text; save it as UTF-8") from None


def _check_header(path: Path, header: Sequence[str]) -> None:
    if tuple(header[: len(COLUMNS)]) != COLUMNS or not set(header[len(COLUMNS) :]) <= set(HEADINGS):
        raise LocplanError(
            f"{path}: its header must be {','.join(COLUMNS)}, and if wanted"
            f" {','.join(HEADINGS)}, not {','.join(header)!r}"
        )


def _query(where: str, header: Sequence[str], row: Sequence[str]) -> Query:
    if len(row) != len(header):
        raise LocplanError(f"{where}: has {len(row)} values, but the header {len(header)} columns")
    values = dict(zip(header, (value.strip() for value in row), strict=True))
    if not values["name"]:
        raise LocplanError(f"{where}: name is empty; give the query one")
    return Query(values["name"], _pose(where, values, "start"), _pose(where, values, "goal"))


def _pose(where: str, values: Mapping[str, str], end: str) -> Position:
    x, y = (_number(where, f"{end}_{axis}", values[f"{end}_{axis}"]) for axis in "xy")
    heading = f"{end}_heading_deg"
    if not values.get(heading):
        return x, y
    return x, y, math.radians(_number(where, heading, values[heading]))


def _number(where: str, column: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise LocplanError(f"{where}: {column} must be a finite number, not {text!r}")
    return value


@dataclass(frozen=True)
class _Parts:
    """The parts of a map that are wide enough, to draw pairs of cells from."""

    cells: tuple[NDArray[np.int64], ...]
    """Of each part (n, 2) of (row, col)."""
    ends: tuple[NDArray[np.int64], ...]
    """The two cells of each part that are farthest apart, (2, 2)."""
    least: float
    """Distance of a pair [cells]."""

    @classmethod
    def of(cls, costs: Costmap, least_distance: float) -> _Parts:
        import cv2

        free = np.isfinite(costs.density)
        count, labels = cv2.connectedComponents(free.astype(np.uint8), connectivity=JOINED)
        flat = np.argsort(labels, axis=None, kind="stable")
        borders = np.searchsorted(labels.ravel()[flat], np.arange(1, count))
        every = [
            np.column_stack(np.unravel_index(part, free.shape))
            for part in np.split(flat, borders)[1:]
        ]
        if not every:
            raise ConfigError(f"{costs.grid.name or 'the map'}: has no cell where the robot fits")
        least = least_distance / costs.grid.resolution
        ends = [_farthest_apart(part) for part in every]
        widths = [_apart(*pair) for pair in ends]
        if max(widths) < least - 1e-9:
            raise ConfigError(
                f"{costs.grid.name or 'the map'}: no two positions that are joined lie"
                f" {least_distance:g} m apart; the farthest are"
                f" {max(widths) * costs.grid.resolution:.2f} m; choose a smaller least distance"
            )
        wide = [n for n, width in enumerate(widths) if width >= least - 1e-9]
        return cls(tuple(every[n] for n in wide), tuple(ends[n] for n in wide), least)

    def draw(self, random: np.random.Generator) -> NDArray[np.float64]:
        """Start and goal in one part, far enough apart: (row, col, row, col)."""
        pairs = np.array([len(part) ** 2 for part in self.cells], float)
        which = random.choice(len(self.cells), p=pairs / pairs.sum())
        part = self.cells[which]
        starts, goals = (part[random.integers(0, len(part), DRAWS)] for _ in range(2))
        fit = np.flatnonzero(_apart(starts, goals) >= self.least - 1e-9)
        if fit.size:
            return np.concatenate([starts[fit[0]], goals[fit[0]]])
        goal = self._beyond(part, self.ends[which][random.integers(2)], random)
        return np.concatenate([self._beyond(part, goal, random), goal])

    def _beyond(
        self, part: NDArray[Any], cell: NDArray[Any], random: np.random.Generator
    ) -> NDArray[Any]:
        """A cell of the part that is far enough from another one."""
        return np.asarray(random.choice(part[_apart(part, cell) >= self.least - 1e-9]))


def _apart(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.float64]:
    return np.asarray(np.hypot(*np.moveaxis(one - other, -1, 0)))


def _farthest_apart(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """The two of the cells (n, 2) that are farthest apart, (2, 2)."""
    import cv2

    hull = cv2.convexHull(cells.astype(np.int32)).reshape(-1, 2).astype(np.int64)
    distance = _apart(hull[:, None], hull[None])
    return np.asarray(hull[list(np.unravel_index(int(np.argmax(distance)), distance.shape))])


def _farthest(pairs: NDArray[np.float64], before: NDArray[np.float64]) -> NDArray[np.float64]:
    """The pair farthest from those before, whichever way round these are gone."""
    if not len(before):
        return np.asarray(pairs[0])
    known = np.vstack([before, before[:, [2, 3, 0, 1]]])
    nearest = np.linalg.norm(pairs[:, None] - known[None], axis=2).min(axis=1)
    return np.asarray(pairs[np.argmax(nearest)])
