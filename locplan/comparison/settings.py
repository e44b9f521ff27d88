"""The settings of a comparison, and how the first line of its journal describes them."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from locplan import __version__
from locplan._support.checks import check_memory, check_positive, check_workers, is_integer
from locplan._support.progress import ProgressCallback
from locplan._support.reading import read_text
from locplan.field.config import FieldConfig
from locplan.field.field import CovarianceField
from locplan.field.store import load_or_compute
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap
from locplan.planning.queries import check_random, normalize_queries


@dataclass(frozen=True)
class RandomQueries:
    """Queries that are drawn at random, the same for all settings of a map's fields."""

    count: int = 10
    """Number of queries a map, 1 to 10,000. Intervals are over the queries: more narrow these."""
    min_distance: float = 5.0
    """Minimum straight distance between start and goal [m], >= 0. Lower it on a small map."""
    seed: int = 1
    """Seed of the random numbers, >= 0."""

    def __post_init__(self) -> None:
        check_random(self.count, self.seed, self.min_distance)


@dataclass(frozen=True)
class Execution:
    """How the runs of a comparison are made; but for its limits it changes no result."""

    workers: int | None = None
    """Number of processes at once; by default the number of cores. Fewer disturb each other's
    planning times less."""
    time_limit: float | None = None
    """Time limit of planners that take one and have none of their own [s], above 0; by default
    OMPL's have 5."""
    memory: float | None = None
    """Memory of a run [bytes], on Linux; by default the workers share 80 % of the machine's."""
    patience: float = 300.0
    """Time after which a planner without a time limit is ended [s], above 0. A planner with a limit
    is ended after twice that limit and 10 s."""
    journal: str | os.PathLike[str] | None = None
    """File that every run is written to as soon as it is done; by default there is none. Runs in it
    are not made again, except those that crashed, hung or took too much memory. A file of other
    settings is refused."""
    force: bool = False
    """True forgets the runs in the journal."""
    field_of: Callable[[OccupancyGrid, FieldConfig], CovarianceField] = load_or_compute
    """Function ``f(grid, config)`` that makes or reads the field of a map."""
    progress: ProgressCallback | None = None
    """Called with (done, total) runs."""

    def __post_init__(self) -> None:
        check_workers(self.workers)
        check_positive("patience", self.patience, "s")
        if self.memory is not None:
            check_positive("memory", self.memory, "bytes")
            check_memory("runs of so much memory", self.memory, "set less")


def resolve_queries(queries: Any) -> Any:
    """Return random queries, a file, queries, or a mapping of these."""
    if isinstance(queries, Mapping):
        return {name: resolve_queries(map_queries) for name, map_queries in queries.items()}
    if is_integer(queries):
        return RandomQueries(queries)
    if isinstance(queries, (RandomQueries, str, os.PathLike)):
        return queries
    nowhere: Any = None  # only random queries need a costmap
    return normalize_queries(nowhere, queries, 0.0, 1)


def describe_queries(queries: Any) -> Any:
    """Return what `resolved_queries` returned, fit for JSON."""
    if isinstance(queries, Mapping):
        return {str(name): describe_queries(map_queries) for name, map_queries in queries.items()}
    if isinstance(queries, (str, os.PathLike)):
        return read_text(Path(queries))
    if isinstance(queries, RandomQueries):
        return dataclasses.asdict(queries)
    return [dataclasses.asdict(query) for query in queries]


def describe_field_config(config: FieldConfig) -> list[Any]:
    """Return the settings of a field and the version of a user's estimator, fit for JSON."""
    return [config.to_json(), getattr(config.estimator, "version", None)]


def compute_map_digest(map_or_costmap: OccupancyGrid | Costmap) -> str:
    """Return a digest of everything in a map or costmap that paths and measures depend on."""
    if isinstance(map_or_costmap, OccupancyGrid):
        return map_or_costmap.digest
    content = hashlib.blake2b(digest_size=16)
    # The simulated choice takes its lidar from the settings.
    settings = map_or_costmap.settings and json.dumps(
        map_or_costmap.settings.to_json(), sort_keys=True
    )
    robot = [map_or_costmap.robot.digest] if map_or_costmap.robot else []
    digest_parts = (
        map_or_costmap.grid.digest,
        map_or_costmap.robot_radius,
        map_or_costmap.weight,
        settings,
        *robot,
    )
    content.update(repr(digest_parts).encode())
    for layer in (
        map_or_costmap.density,
        map_or_costmap.u,
        map_or_costmap.e,
        map_or_costmap.u_of_heading,
        map_or_costmap.e_of_heading,
    ):
        if layer is not None:
            content.update(np.ascontiguousarray(layer).view(np.uint8).data)
    return content.hexdigest()


def versions() -> dict[str, str]:
    """Return the versions of everything that computes."""
    libraries = [name for name in ("numpy", "numba", "scipy", "ompl") if find_spec(name)]
    return {
        "locplan": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in libraries},
    }
