"""Maps and scenarios of the MovingAI benchmarks (movingai.com)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from locplan._util.checks import file_path, shown
from locplan._util.reading import read_text
from locplan.errors import LocplanError, MapError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, load_map
from locplan.planners import Query

PASSABLE = ".GS"
"""Letters of passable cells in the MovingAI benchmarks."""


def read_map(file: Path) -> OccupancyGrid:
    """Read a map of map_server or, if its name ends in .map, of MovingAI."""
    return read_movingai_map(file) if file.suffix == ".map" else load_map(file)


def read_movingai_map(file: str | os.PathLike[str], resolution: float = 1.0) -> OccupancyGrid:
    """The map of a MovingAI benchmark: passable cells are free, all others are walls.

    The file's first row of cells is the map's top, which has the greatest y.

    Parameters
    ----------
    file : path
        The .map file.
    resolution : float, default 1.0
        Edge of a cell [m].

    Raises
    ------
    LocplanError
        If the file cannot be read, or is no such map.
    """
    path = file_path("a map file", file)
    lines = read_text(path).splitlines()
    if "map" not in lines[:8] or not lines[0].startswith("type"):
        raise MapError(f"{path}: is no MovingAI map; its first line must be 'type octile'")
    rows = [row for row in lines[lines.index("map") + 1 :] if row]
    if len({len(row) for row in rows}) != 1:
        raise MapError(f"{path}: its rows must all have one length; download it anew")
    letters = np.frombuffer("".join(rows[::-1]).encode("latin-1", "replace"), np.uint8)
    passable = np.isin(letters, list(PASSABLE.encode())).reshape(len(rows), -1)
    cells = np.where(passable, np.uint8(FREE), np.uint8(OCCUPIED))
    return OccupancyGrid(cells, resolution, name=path.stem)


def read_scenarios(
    file: str | os.PathLike[str], grid: OccupancyGrid, *, count: int | None = None
) -> list[Query]:
    """The scenarios of a MovingAI benchmark as queries, from cell centre to cell centre.

    The rows of a .scen file count from the map's top.

    Parameters
    ----------
    file : path
        The .scen file.
    grid : OccupancyGrid
        The map that the scenarios are for.
    count : int, optional
        Greatest number of queries, taken evenly over the file, where they are sorted by length;
        all by default.

    Raises
    ------
    LocplanError
        If the file cannot be read, or a scenario is not for this map.
    """
    path = file_path("a file of scenarios", file)
    lines = read_text(path).splitlines()
    if not lines or not lines[0].startswith("version"):
        raise LocplanError(f"{path}: is no MovingAI scenario; its first line must be 'version 1'")
    queries = [
        _scenario(path, number, line, grid)
        for number, line in enumerate(lines[1:], 2)
        if line.strip()
    ]
    if count is None or count >= len(queries):
        return queries
    return [queries[n] for n in np.linspace(0, len(queries) - 1, count).round().astype(int)]


def _scenario(path: Path, number: int, line: str, grid: OccupancyGrid) -> Query:
    fields = line.split()
    try:
        cols, rows, start_col, start_row, goal_col, goal_row = map(int, fields[-7:-1])
    except ValueError:
        raise LocplanError(f"{path}: line {number}: is no scenario: {shown(line)}") from None
    if (rows, cols) != grid.shape:
        raise LocplanError(
            f"{path}: line {number}: is for a map of {shown(cols)} x {shown(rows)} cells, but"
            f" {grid.name or 'this one'} has {grid.shape[1]} x {grid.shape[0]}"
        )
    if not (grid.contains(start_row, start_col) and grid.contains(goal_row, goal_col)):
        raise LocplanError(f"{path}: line {number}: begins or ends outside its map: {shown(line)}")
    start = grid.cell_to_world(rows - 1 - start_row, start_col)
    goal = grid.cell_to_world(rows - 1 - goal_row, goal_col)
    return Query(f"scenario {number - 1}", start, goal)
