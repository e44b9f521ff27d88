"""The cases of a comparison: maps with the settings of their fields, and the queries on them.

Maps and scenarios of the MovingAI benchmarks (movingai.com) are read here, too.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from locplan._util.checks import file_path, shown
from locplan._util.reading import read_text
from locplan.comparison.report._data import Case, Scene
from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError, MapError
from locplan.field import CovarianceField, Estimator, FieldConfig, config_of
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, load_map
from locplan.planners import Query, pareto_front, queries_of

PASSABLE = ".GS"
"""Letters of passable cells in the MovingAI benchmarks."""
MAX_SCENARIOS = 100
"""Greatest number of queries from a MovingAI file, which may hold fifteen thousand."""


@dataclass(frozen=True, eq=False)
class Source:
    """A map with one kind of field, which is read from the cache whenever it is needed."""

    case: Case
    grid: OccupancyGrid
    config: FieldConfig | None
    """The settings of the field; None for a user's own costmap."""
    own: Costmap | None
    """The user's own costmap, which has no field."""
    robot_radius: float
    """Radius of the robot [m]."""
    criterion: str | None
    """The scalar that u is made of; None for a user's own costmap."""
    queries: tuple[Query, ...]
    field_of: Callable[[OccupancyGrid, FieldConfig], CovarianceField]
    """The function that makes or reads a field."""

    def to_json(self) -> dict[str, Any]:
        """Everything that the case is made of, with a digest of the map's cells."""
        return {
            "map": self.case[0],
            "digest": self.grid.digest,
            "field": self.case[1],
            "config": None if self.config is None else self.config.to_json(),
            "criterion": self.criterion,
            "robot_radius": self.robot_radius,
            "queries": [dataclasses.asdict(query) for query in self.queries],
        }

    def costmap(self) -> tuple[Costmap, CovarianceField | None]:
        """The costmap, of the estimator's own weight, and the field that it is made of."""
        if self.config is None:
            assert self.own is not None
            return self.own, None
        field = self.field_of(self.grid, self.config)
        radius = self.robot_radius
        costs = Costmap.from_field(self.grid, field, robot_radius=radius, criterion=self.criterion)
        return costs, field

    def find_queries(
        self, costs: Costmap, wanted: Any, least_distance: float, seed: int, headed: bool
    ) -> tuple[Query, ...]:
        """Queries from a number, a file or a sequence, see `locplan.compare`."""
        if isinstance(wanted, (str, os.PathLike)) and Path(wanted).suffix == ".scen":
            return tuple(read_scenarios(wanted, self.grid, count=MAX_SCENARIOS))
        return queries_of(costs, wanted, least_distance, seed, headed)

    def scene(self, name: str, front_time: float | None) -> Scene | None:
        """The case with its queries, for pictures; None without a field.

        It has the front of the named query, of length against degenerate metres, unless
        `front_time` [s] is None.
        """
        costs, field = self.costmap()
        if field is None:
            return None
        queries = {query.name: (query.start, query.goal) for query in self.queries}
        start, goal = queries[name]
        front = None
        if front_time is not None:
            front = pareto_front(costs, start[:2], goal[:2], time_limit=front_time)
        return Scene(field, queries, front if front is not None and len(front) else None, name)


def named_configs(
    configs: FieldConfig | Estimator | Mapping[str, FieldConfig | Estimator] | None,
) -> dict[str, FieldConfig]:
    """The settings of fields by label."""
    if configs is None or isinstance(configs, (FieldConfig, Estimator)):
        config = config_of(configs)
        return {f"{config.estimator.name}, {config.estimator.reach:g} m": config}
    if not isinstance(configs, Mapping) or not configs:
        raise ConfigError("configs must be a FieldConfig, or a mapping of labels to them")
    return {label: config_of(config) for label, config in configs.items()}


def read_map(file: Path) -> OccupancyGrid:
    """Read a map of map_server or, if its name ends in .map, of MovingAI."""
    return read_movingai_map(file) if file.suffix == ".map" else load_map(file)


def read_movingai_map(file: str | os.PathLike[str], resolution: float = 1.0) -> OccupancyGrid:
    """The map of a MovingAI benchmark: passable cells are free, all others are walls.

    The file's first row of cells is the map's top, which has the greatest y.
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

    The rows of a .scen file count from the map's top. At most `count` queries are taken, evenly
    over the file, where they are sorted by length.
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
