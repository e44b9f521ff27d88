"""What is compared on: maps with the settings of their fields, and the queries on them."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from locplan.comparison._movingai import read_movingai_map, read_scenarios
from locplan.comparison.report._data import Case, Scene
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.field import CovarianceField, Estimator, FieldConfig
from locplan.field._config import config_of
from locplan.maps import OccupancyGrid, find_maps, load_map
from locplan.planners import Query, pareto_front, random_queries, read_queries

MAX_SCENARIOS = 100
"""Of a MovingAI file, evenly over its lengths: some have fifteen thousand."""


@dataclass(frozen=True, eq=False)
class Source:
    """A map with one kind of field, made anew whenever it is needed: fields are cached."""

    case: Case
    grid: OccupancyGrid
    config: FieldConfig | None
    """None for a costmap of one's own."""
    own: Costmap | None
    robot_radius: float
    """[m]"""
    criterion: str
    queries: tuple[Query, ...]
    field_of: Callable[[OccupancyGrid, FieldConfig], CovarianceField]

    def to_json(self) -> dict[str, Any]:
        """All that it is made of but its cells."""
        return {
            "map": self.case[0],
            "digest": self.grid.digest,
            "field": self.case[1],
            "config": None if self.config is None else self.config.to_json(),
            "robot_radius": self.robot_radius,
            "queries": [dataclasses.asdict(query) for query in self.queries],
        }

    def field(self) -> CovarianceField | None:
        return None if self.config is None else self.field_of(self.grid, self.config)

    def costmap(self, field: CovarianceField | None = None) -> Costmap:
        """Of any weight: runs make it one of their own."""
        if self.own is not None:
            return self.own
        field = field or self.field()
        assert field is not None
        return Costmap.from_field(
            self.grid, field, robot_radius=self.robot_radius, criterion=self.criterion
        )

    def find_queries(
        self, costs: Costmap, wanted: Any, least_distance: float, seed: int, headed: bool
    ) -> tuple[Query, ...]:
        """What was asked for as queries: see `locplan.compare`."""
        if isinstance(wanted, int) and not isinstance(wanted, bool):
            far: dict[str, Any] = {"least_distance": least_distance, "headed": headed}
            return tuple(random_queries(costs, wanted, seed, **far))
        if isinstance(wanted, (str, os.PathLike)):
            if Path(wanted).suffix == ".scen":
                return tuple(read_scenarios(wanted, self.grid, count=MAX_SCENARIOS))
            return tuple(read_queries(wanted))
        try:
            return tuple(
                one if isinstance(one, Query) else Query(f"query {n}", *map(_pose, one))
                for n, one in enumerate(wanted, 1)
            )
        except (TypeError, ValueError):
            raise ConfigError(
                "queries must be a number, a file, or a sequence of Query or (start, goal),"
                f" not {wanted!r}"
            ) from None

    def scene(self, paths: int, front_time: float) -> Scene | None:
        """What pictures need: some queries, and the exact front of the first; None without e."""
        field = self.field()
        if field is None:
            return None
        costs = self.costmap(field)
        first = self.queries[0]
        ends = first.start[:2], first.goal[:2]
        front = pareto_front(costs, *ends, objective="e", time_limit=front_time)
        return Scene(
            costs,
            field,
            {query.name: (query.start, query.goal) for query in self.queries[:paths]},
            front if len(front) else None,
            first.name,
        )


def named_maps(maps: Any) -> dict[str, OccupancyGrid | Costmap]:
    """Maps by name: of files, folders of them, grids or costmaps.

    Raises
    ------
    LocplanError
        If one cannot be read, is something else, or two have one name.
    """
    if isinstance(maps, Mapping):
        return {str(name): _map(one) for name, one in maps.items()}
    if isinstance(maps, (str, os.PathLike, OccupancyGrid, Costmap)):
        maps = [maps]
    named: dict[str, OccupancyGrid | Costmap] = {}
    for n, given in enumerate(maps, 1):
        for one in find_maps(given) if isinstance(given, (str, os.PathLike)) else [given]:
            loaded = _map(one)
            grid = loaded.grid if isinstance(loaded, Costmap) else loaded
            name = grid.name or f"map {n}"
            if name in named and isinstance(one, Path):
                name = f"{one.resolve().parent.name}/{name}"
            if name in named:
                raise ConfigError(f"two maps are called {name!r}; give a mapping of names to maps")
            named[name] = loaded
    if not named:
        raise ConfigError("a comparison needs at least one map")
    return named


def named_configs(
    configs: FieldConfig | Estimator | Mapping[str, FieldConfig | Estimator] | None,
) -> dict[str, FieldConfig]:
    """Settings by label."""
    if configs is None or isinstance(configs, (FieldConfig, Estimator)):
        config = config_of(configs)
        return {f"{config.estimator.name}, {config.estimator.reach:g} m": config}
    if not isinstance(configs, Mapping) or not configs:
        raise ConfigError("configs must be a FieldConfig, or a mapping of labels to them")
    return {label: config_of(config) for label, config in configs.items()}


def _map(given: Any) -> OccupancyGrid | Costmap:
    if isinstance(given, (OccupancyGrid, Costmap)):
        return given
    if isinstance(given, (str, os.PathLike)):
        return read_movingai_map(given) if Path(given).suffix == ".map" else load_map(given)
    raise ConfigError(f"a map must be a file, an OccupancyGrid or a Costmap, not {given!r}")


def _pose(given: Sequence[float]) -> tuple[float, ...]:
    return tuple(float(v) for v in given)
