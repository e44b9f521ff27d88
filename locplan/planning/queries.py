"""Queries for the planners that are compared, from a file or drawn at random, and stations."""

from __future__ import annotations

import contextlib
import csv
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from locplan._support.checks import (
    check_file_path,
    check_integer,
    check_number,
    check_position,
    is_integer,
    short_repr,
)
from locplan._support.kernels.arrays import Array, Floats, Ints
from locplan._support.reading import read_text
from locplan._support.tables import parse_csv_cell
from locplan.errors import ConfigError, LocplanError
from locplan.planning.costmap import Costmap
from locplan.planning.grid import label_connected_parts
from locplan.planning.protocol import Position

COLUMNS = {
    "queries": ("name,start_x,start_y,goal_x,goal_y", "start_heading_deg,goal_heading_deg"),
    "stations": ("name,x,y", ""),
}
"""The columns of each kind of file, and those that may follow."""


@dataclass(frozen=True)
class Station:
    """A named position where robots have something to do."""

    name: str
    """The name, which no other station has."""
    x: float
    """World x [m]."""
    y: float
    """World y [m]."""

    def __post_init__(self) -> None:
        check_position(self.x, self.y, f"station {self.name}")


@dataclass(frozen=True)
class Query:
    """A start and a goal for a planner."""

    name: str
    """The query's name, which no other query on the map has."""
    start: Position
    """Position of the start in the world [m], or a pose with a heading [rad]."""
    goal: Position
    """Position of the goal in the world [m], or a pose with a heading [rad]."""


MIN_DISTANCE = 10.0
"""Default minimum distance between the ends of random queries that are simulated [m]."""


def check_random_query_options(count: int, seed: int, min_distance: float) -> None:
    """Raise a ConfigError unless random queries can be drawn; to be called before long work.

    Parameters
    ----------
    count : int
        Number of queries, 1 to 10,000.
    seed : int
        Seed of the random numbers, >= 0.
    min_distance : float
        Minimum distance between start and goal in a straight line [m], >= 0.
    """
    # The time to spread them over a map grows with the square of their number.
    check_integer("the number of random queries", count, 1, 10_000)
    check_integer("the seed of random queries", seed, 0)
    check_number("min_distance", min_distance, 0)


def normalize_queries(
    costs: Costmap, queries: Any, min_distance: float, seed: int, headed: bool = False
) -> tuple[Query, ...]:
    """Make queries in any form that functions of many queries accept.

    Parameters
    ----------
    costs : Costmap
        The costmap.
    queries : int, path or sequence
        Number of random ones, a CSV file, or a sequence of `Query` or (start, goal).
    min_distance : float
        Minimum distance from start to goal of random ones [m].
    seed : int
        Seed of random ones, >= 0.
    headed : bool, default False
        True gives random queries headings.

    Raises
    ------
    ConfigError
        If it is none of these.
    """
    if is_integer(queries):
        return tuple(random_queries(costs, queries, seed, min_distance=min_distance, headed=headed))
    if isinstance(queries, (str, os.PathLike)):
        return tuple(read_queries(queries))
    try:
        return tuple(
            query
            if isinstance(query, Query)
            else Query(f"query {n}", *(tuple(map(float, pose)) for pose in query))
            for n, query in enumerate(queries, 1)
        )
    except (TypeError, ValueError):
        raise ConfigError(
            "queries must be a number, a file, or a sequence of Query or (start, goal),"
            f" not {short_repr(queries)}"
        ) from None


def read_stations(path: str | os.PathLike[str]) -> list[Station]:
    """Read stations from a CSV file.

    Parameters
    ----------
    path : path
        File with columns name, x and y [m].

    Returns
    -------
    list of Station
        The stations in the order of the rows.

    Raises
    ------
    LocplanError
        If the file cannot be read, or a row is wrong.
    """
    rows = _read_rows_by_name(path, "stations")
    return [
        Station(name, *_parse_pose(place, values, "")) for name, (place, values) in rows.items()
    ]


def read_queries(path: str | os.PathLike[str]) -> list[Query]:
    """Read queries from a CSV file.

    Parameters
    ----------
    path : path
        File with columns name, start_x, start_y, goal_x and goal_y [m]; start_heading_deg and
        goal_heading_deg [deg] may follow, and be empty. Or a file with columns name, x and y [m]
        of stations; each pair of stations is a query.

    Returns
    -------
    list of Query
        The queries in the order of the rows, with headings in radians.

    Raises
    ------
    LocplanError
        If the file cannot be read, or a row is wrong.
    """
    rows = _read_rows_by_name(path, "queries", "stations")
    if all("start_x" in values for _, values in rows.values()):
        return [
            Query(name, _parse_pose(place, values, "start_"), _parse_pose(place, values, "goal_"))
            for name, (place, values) in rows.items()
        ]
    if len(rows) < 2:
        raise LocplanError(f"{path}: has one station; add a row for each, at least two")
    return [
        Query(f"{start.name} to {goal.name}", (start.x, start.y), (goal.x, goal.y))
        for start, goal in combinations(read_stations(path), 2)
    ]


def _parse_pose(row_location: str, values: Mapping[str, str], end: str) -> Position:
    """Return the position in the columns of an end, and its heading if there is one."""
    heading = f"{end}heading_deg"
    columns = [f"{end}x", f"{end}y", *([heading] if values.get(heading) else [])]
    pose = [_parse_number(row_location, column, values[column]) for column in columns]
    return (*pose[:2], *map(math.radians, pose[2:]))


def _parse_number(row_location: str, column: str, text: str) -> float:
    """Return the finite number in a column of a row."""
    with contextlib.suppress(ValueError):
        if math.isfinite(value := float(text)):
            return value
    raise LocplanError(f"{row_location}: {column} must be a finite number, not {short_repr(text)}")


def _read_rows_by_name(
    file: str | os.PathLike[str], *kinds: str
) -> dict[str, tuple[str, dict[str, str]]]:
    """Return the rows of a file by name: where each stands, and its values; empty lines are none.

    An apostrophe that keeps a name from being a formula in a spreadsheet is no part of the name.
    """
    path = check_file_path(f"a file of {kinds[0]}", file)
    lines = _read_lines(path)
    _, header = next(lines, ("", []))
    headers = []
    for kind in kinds:
        first, optional = COLUMNS[kind]
        columns, optional_columns = first.split(","), set(filter(None, optional.split(",")))
        if header[: len(columns)] == columns and set(header[len(columns) :]) <= optional_columns:
            break
        headers.append(f"{first}, and if wanted {optional}" if optional else first)
    else:
        text = f"{'; or '.join(headers)}, not {short_repr(','.join(header))}"
        raise LocplanError(f"{path}: its header must be {text}")
    rows = {}
    for place, line in lines:
        if not any(line):
            continue
        if len(line) != len(header):
            raise LocplanError(
                f"{place}: has {len(line)} values, but the header {len(header)} columns"
            )
        values = dict(zip(header, line, strict=True))
        name = values["name"] = parse_csv_cell(values["name"])
        if not name:
            raise LocplanError(f"{place}: name is empty; give each row one")
        if name in rows:
            raise LocplanError(
                f"{place}: another row is named {short_repr(name)}; give each row a unique name"
            )
        rows[name] = place, values
    if not rows:
        raise LocplanError(f"{path}: has no {kind}; add a row for each below the header")
    return rows


def _read_lines(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the place of each line of a CSV file, and its values."""
    lines = csv.reader(read_text(path).splitlines())
    try:
        for line in lines:
            yield f"{path}: row {lines.line_num}", [value.strip() for value in line]
    except csv.Error as error:
        raise LocplanError(f"{path}: row {lines.line_num}: is no CSV ({error})") from None


def random_queries(
    costs: Costmap, count: int, seed: int, *, min_distance: float, headed: bool = False
) -> list[Query]:
    """Draw queries at random that all can be solved, spread over the map.

    Start and goal are the centres of free cells, joined by a path that cuts
    no corners. Of several random pairs, the one farthest from all before is taken each time.

    Parameters
    ----------
    costs : Costmap
        The costmap, whose robot radius counts; its weight does not matter.
    count : int
        Number of queries, 1 to 10,000.
    seed : int
        Seed of the random numbers, >= 0; the same seed gives the same queries.
    min_distance : float
        Minimum distance between start and goal in a straight line [m], >= 0.
    headed : bool, default False
        True gives the queries random headings as well, for planners whose space has headings.

    Returns
    -------
    list of Query
        The queries, named "random 1" and so on.

    Raises
    ------
    ConfigError
        If no two connected positions lie so far apart, or a value is out of its range.
    """
    check_random_query_options(count, seed, min_distance)
    random = np.random.default_rng(seed)
    parts = _QuerySampler(costs, min_distance)
    query_pairs = np.empty((0, 4))
    while len(query_pairs) < count:
        pairs = np.array([parts.draw(random) for _ in range(20)])
        query_pairs = np.vstack([query_pairs, _find_farthest_pair(pairs, query_pairs)])
    angles = random.uniform(-math.pi, math.pi, (count, 2, int(headed)))  # none, or one an end
    queries = []
    for n, (pair, turns) in enumerate(zip(query_pairs.reshape(-1, 2, 2), angles, strict=True), 1):
        start, goal = (
            (*costs.grid.position(int(row), int(col)), *turn.tolist())
            for (row, col), turn in zip(pair, turns, strict=True)
        )
        queries.append(Query(f"random {n:0{len(str(count))}}", start, goal))
    return queries


class _QuerySampler:
    """The parts of a map that are wide enough, as cells (n, 2), to draw pairs of cells from."""

    def __init__(self, costs: Costmap, min_distance: float) -> None:
        count, labels = label_connected_parts(costs)
        flat = np.argsort(labels, axis=None, kind="stable")
        borders = np.searchsorted(labels.ravel()[flat], np.arange(1, count))
        part_cells = [
            np.column_stack(np.unravel_index(part, labels.shape))
            for part in np.split(flat, borders)[1:]
        ]
        if not part_cells:
            raise ConfigError(f"{costs.grid.name or 'the map'}: has no cell where the robot fits")
        self._min = min_distance / costs.grid.resolution - 1e-9
        ends = [_find_farthest_cells(part) for part in part_cells]
        widths = [_compute_distances(*pair) for pair in ends]
        if max(widths) < self._min:
            raise ConfigError(
                f"{costs.grid.name or 'the map'}: no two connected positions lie"
                f" {min_distance:g} m apart; the farthest are"
                f" {max(widths) * costs.grid.resolution:.2f} m; choose a smaller minimum distance"
            )
        wide = [n for n, width in enumerate(widths) if width >= self._min]
        self._cells, self._ends = [part_cells[n] for n in wide], [ends[n] for n in wide]

    def draw(self, random: np.random.Generator) -> Floats:
        """Draw start and goal in one part, far enough apart: (row, col, row, col)."""
        pairs = np.array([len(part) ** 2 for part in self._cells], float)
        part_index = random.choice(len(self._cells), p=pairs / pairs.sum())
        part = self._cells[part_index]
        starts, goals = (part[random.integers(0, len(part), 4096)] for _ in range(2))
        fit = np.flatnonzero(_compute_distances(starts, goals) >= self._min)
        if fit.size:
            return np.concatenate([starts[fit[0]], goals[fit[0]]])
        ends = [self._ends[part_index][random.integers(2)]]
        for _ in range(2):  # the goal is far from an end of the part, and the start from the goal
            ends.append(random.choice(part[_compute_distances(part, ends[-1]) >= self._min]))
        return np.concatenate(ends[:0:-1])


def _compute_distances(first: Array, second: Array) -> Floats:
    """Return the distances between cells (..., 2)."""
    return np.asarray(np.hypot(*np.moveaxis(first - second, -1, 0)))


def _find_farthest_cells(cells: Ints) -> Ints:
    """Return the two of the cells (n, 2) that are farthest apart, (2, 2)."""
    import cv2

    hull = cv2.convexHull(cells.astype(np.int32)).reshape(-1, 2).astype(np.int64)
    distance = _compute_distances(hull[:, None], hull[None])
    return np.asarray(hull[list(np.unravel_index(int(np.argmax(distance)), distance.shape))])


def _find_farthest_pair(pairs: Floats, before: Floats) -> Floats:
    """Return the pair that is farthest from those before, in whichever direction these lead."""
    if not len(before):
        return np.asarray(pairs[0])
    earlier_pairs = np.vstack([before, before[:, [2, 3, 0, 1]]])
    nearest = np.linalg.norm(pairs[:, None] - earlier_pairs[None], axis=2).min(axis=1)
    return np.asarray(pairs[np.argmax(nearest)])
