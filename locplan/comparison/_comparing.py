"""Comparing planners, in one call."""

from __future__ import annotations

import dataclasses
import os
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from numbers import Real
from typing import Any

from locplan import __version__
from locplan._util.progress import ProgressCallback
from locplan.comparison._cases import Source, named_configs, named_maps
from locplan.comparison._engine import Job, run_all
from locplan.comparison._result import Comparison
from locplan.comparison._specs import PlannerSpec, specs_of
from locplan.comparison._workers import PATIENCE, usable_cores
from locplan.comparison.report._data import Case
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.field import CovarianceField, Estimator, FieldConfig, load_or_compute
from locplan.maps import OccupancyGrid
from locplan.planners import AnyPlanner, Planner, Query

BASELINE = "any-angle"
"""To compare with, unless told otherwise and if it is there."""
PACKAGES = ("numpy", "numba", "scipy", "ompl")


def compare(
    maps: Any,
    planners: AnyPlanner | PlannerSpec | Sequence[AnyPlanner | PlannerSpec] = (
        "grid",
        "any-angle",
    ),
    queries: Any = 10,
    *,
    weights: Sequence[float] = (4.0,),
    seeds: Sequence[int] = (1,),
    configs: FieldConfig | Estimator | Mapping[str, FieldConfig | Estimator] | None = None,
    robot_radius: float = 0.25,
    criterion: str = "e",
    time_limit: float | None = None,
    least_distance: float = 5.0,
    query_seed: int = 1,
    baseline: str | None = None,
    workers: int | None = None,
    memory: float | None = None,
    patience: float = PATIENCE,
    journal: str | os.PathLike[str] | None = None,
    resume: bool = False,
    field_of: Callable[[OccupancyGrid, FieldConfig], CovarianceField] = load_or_compute,
    progress: ProgressCallback | None = None,
) -> Comparison:
    """Run every planner on every query of every map, in worker processes.

    A run that crashes, hangs or takes too much memory is a failure that is counted; the others go
    on.

    Parameters
    ----------
    maps : map, or sequence or mapping of them
        Each a map_server YAML, an OccupancyGrid, or a Costmap of one's own; a mapping names them.
    planners : sequence, or one of them
        Names with options, such as "BITstar:time_limit=2"; whatever else `locplan.plan` takes:
        functions ``f(costs, start, goal, **options)`` that return a `Path`, each with a costmap
        of its own, or objects such as ``planners.Ompl("BITstar", time_limit=2)``; or
        `PlannerSpec`.
    queries : int, path, sequence, or mapping of them by map
        How many to draw at random; a CSV of name, start_x, start_y, goal_x, goal_y [m], or a
        MovingAI .scen file (100 of it); or `Query` objects, or (start, goal) pairs.
    weights : sequence of float
        Metres of detour accepted per degenerate metre.
    seeds : sequence of int
        Of planners with random numbers; the others run once.
    configs : FieldConfig, or mapping of them by label
        What a robot may see: the same comparison is made for each.
    robot_radius : float
        [m]
    criterion : str
        What u is made of, see `Costmap.from_field`.
    time_limit : float, optional
        Of OMPL's planners that have none of their own [s].
    least_distance : float
        Between start and goal of random queries, in a straight line [m].
    query_seed : int
        Of random queries.
    baseline : str, optional
        The label of the planner to compare with: any-angle if it is there, else the first.
    workers : int, optional
        Processes at once; as many as there are cores.
    memory : float, optional
        What a run may take [bytes], on Linux; by default the workers share 80 % of the machine's.
    patience : float
        How long a planner without a time limit may take [s]. With one it is twice that and 10 s.
    journal : path, optional
        A file that runs are written to as they come.
    resume : bool
        Whether the journal may hold runs already: those of the same tasks are not made again, but
        for ones that crashed, hung or took too much memory.
    progress : callable, optional
        Called with the number of runs done and of all.
    field_of : callable
        Makes or reads the field of a map.

    Returns
    -------
    Comparison

    Raises
    ------
    LocplanError
        If anything is wrong with the input, before the first run.
    """
    if isinstance(planners, (str, Planner, PlannerSpec)) or callable(planners):
        planners = [planners]
    weights = [float(weights)] if isinstance(weights, Real) else list(weights)
    if not isinstance(seeds, Iterable):
        raise ConfigError(f"seeds must be a sequence of whole numbers, not {seeds!r}")
    specs = [spec.with_time_limit(time_limit) for spec in specs_of(planners)]
    labels = [spec.label for spec in specs]
    if baseline is None:
        baseline = BASELINE if BASELINE in labels else labels[0]
    if baseline not in labels:
        raise ConfigError(f"baseline {baseline!r} is none of the planners {', '.join(labels)}")
    sources: dict[Case, Source] = {}
    began = datetime.now(UTC).astimezone()

    def jobs() -> Iterator[Job]:
        headed = any(spec.planner.space != "R2" for spec in specs)
        for source, costs in _sources(
            maps,
            queries,
            configs,
            robot_radius,
            criterion,
            field_of,
            (least_distance, query_seed, headed),
        ):
            sources[source.case] = source
            yield Job(*source.case, costs, source.queries)

    runs = run_all(
        jobs(),
        specs,
        weights=weights,
        seeds=seeds,
        workers=workers,
        memory=memory,
        patience=patience,
        journal=journal,
        resume=resume,
        progress=progress,
    )
    return Comparison(
        tuple(runs),
        baseline,
        sources,
        {
            "locplan": __version__,
            "python": platform.python_version(),
            **{name: version(name) for name in PACKAGES},
            "machine": f"{platform.machine()}, {usable_cores()} cores",
            "workers": workers or usable_cores(),
            "began": began.isoformat(timespec="seconds"),
            "planners": {spec.label: spec.identity() for spec in specs},
            "weights": [float(weight) for weight in weights],
            "seeds": list(seeds),
            "time_limit": time_limit,
            "memory": memory,
            "patience": patience,
            "criterion": criterion,
            "random_queries": {"least_distance": least_distance, "seed": query_seed},
            "cases": [source.to_json() for source in sources.values()],
        },
    )


def _sources(
    maps: Any,
    queries: Any,
    configs: Any,
    robot_radius: float,
    criterion: str,
    field_of: Callable[[OccupancyGrid, FieldConfig], CovarianceField],
    drawn: tuple[float, int, bool],
) -> Iterator[tuple[Source, Costmap]]:
    """One of each map and settings; the queries of a map are the same in all settings."""
    for name, given in named_maps(maps).items():
        own = given if isinstance(given, Costmap) else None
        grid = given.grid if isinstance(given, Costmap) else given
        if isinstance(queries, Mapping) and name not in queries:
            raise ConfigError(f"there are no queries for map {name!r}")
        wanted = queries[name] if isinstance(queries, Mapping) else queries
        asked: tuple[Query, ...] = ()
        radius = robot_radius if own is None else own.robot_radius
        labels = {"own cost": None} if own else named_configs(configs)
        for label, config in labels.items():
            source = Source((name, label), grid, config, own, radius, criterion, asked, field_of)
            costs = source.costmap()
            if not asked:
                asked = source.find_queries(costs, wanted, *drawn)
                source = dataclasses.replace(source, queries=asked)
            yield source, costs
