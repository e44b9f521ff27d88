"""Settings of a comparison, and their description in the first line of a journal."""

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
from locplan.planning.queries import check_random_query_options, normalize_queries


@dataclass(frozen=True)
class RandomQueries:
    """Settings of random queries, which all fields of a map share."""

    count: int = 10
    """Number of queries per map, 1 to 10,000. More queries give narrower intervals."""
    min_distance: float = 5.0
    """Minimum straight distance between start and goal [m], >= 0. Lower it on a small map."""
    seed: int = 1
    """Seed of the random numbers, >= 0."""

    def __post_init__(self) -> None:
        check_random_query_options(self.count, self.seed, self.min_distance)


@dataclass(frozen=True)
class Execution:
    """Settings of the execution of a comparison; only the limits affect results."""

    workers: int | None = None
    """Number of parallel processes; by default the number of cores. With fewer, planning times are
    less disturbed."""
    time_limit: float | None = None
    """Time limit of planners that accept one and have none [s], above 0; by default OMPL's planners
    have 5 s."""
    memory: float | None = None
    """Memory limit of a run [bytes], on Linux; by default the workers share 80 % of the memory."""
    patience: float = 300.0
    """Time after which a planner without a time limit is killed [s], above 0. A planner with a
    limit is killed after twice the limit plus 10 s."""
    journal: str | os.PathLike[str] | None = None
    """File to which every completed run is appended; by default none. Runs in the file are not
    repeated, unless they crashed, hung or took too much memory. A file with other settings is
    refused."""
    force: bool = False
    """True discards the runs in the journal."""
    load_field: Callable[[OccupancyGrid, FieldConfig], CovarianceField] = load_or_compute
    """Function ``f(grid, config)`` that computes the field of a map or reads it from the cache."""
    progress: ProgressCallback | None = None
    """Function that is called with (done, total) runs."""

    def __post_init__(self) -> None:
        check_workers(self.workers)
        check_positive("patience", self.patience, "s")
        if self.memory is not None:
            check_positive("memory", self.memory, "bytes")
            check_memory("runs of so much memory", self.memory, "set less")


def resolve_queries(queries: Any) -> Any:
    """Return random queries, a file, a list of queries, or a mapping of these by map."""
    if isinstance(queries, Mapping):
        return {name: resolve_queries(map_queries) for name, map_queries in queries.items()}
    if is_integer(queries):
        return RandomQueries(queries)
    if isinstance(queries, (RandomQueries, str, os.PathLike)):
        return queries
    no_costmap: Any = None  # only random queries need a costmap
    return normalize_queries(no_costmap, queries, 0.0, 1)


def describe_queries(queries: Any) -> Any:
    """Return the result of `resolve_queries` as plain data for JSON."""
    if isinstance(queries, Mapping):
        return {str(name): describe_queries(map_queries) for name, map_queries in queries.items()}
    if isinstance(queries, (str, os.PathLike)):
        return read_text(Path(queries))
    if isinstance(queries, RandomQueries):
        return dataclasses.asdict(queries)
    return [dataclasses.asdict(query) for query in queries]


def describe_field_config(config: FieldConfig) -> list[Any]:
    """Return the settings of a field and its estimator's version as plain data for JSON."""
    return [config.to_json(), getattr(config.estimator, "version", None)]


def compute_map_digest(map_or_costmap: OccupancyGrid | Costmap) -> str:
    """Return a digest of the parts of a map or costmap that affect paths and measures."""
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


def collect_versions() -> dict[str, str]:
    """Return the versions of locplan, Python and the numerical libraries."""
    libraries = [name for name in ("numpy", "numba", "scipy", "ompl") if find_spec(name)]
    return {
        "locplan": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in libraries},
    }
