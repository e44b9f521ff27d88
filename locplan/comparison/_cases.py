"""The cases of a comparison: maps with the settings of their fields, and the queries on them."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from locplan.comparison._movingai import read_movingai_map, read_scenarios
from locplan.comparison.report._data import Case, Scene
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.field import CovarianceField, Estimator, FieldConfig, config_of
from locplan.maps import OccupancyGrid, load_map
from locplan.planners import Query, pareto_front, queries_of

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
