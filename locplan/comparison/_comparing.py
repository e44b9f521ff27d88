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
from locplan._util.checks import is_whole, shown
from locplan._util.machine import check_workers, usable_cores
from locplan._util.progress import ProgressCallback
from locplan.comparison._cases import Source, named_configs, read_map
from locplan.comparison._engine import Job, checked_seeds, run_all
from locplan.comparison._result import Comparison
from locplan.comparison._specs import PlannerSpec, specs_of
from locplan.comparison._workers import PATIENCE
from locplan.comparison.report._data import Case
from locplan.costs import ROBOT_RADIUS, Costmap, named_maps
from locplan.errors import ConfigError
from locplan.field import CovarianceField, Estimator, FieldConfig, load_or_compute
from locplan.maps import OccupancyGrid
from locplan.planners import DEFAULT, AnyPlanner, Planner, Query, check_random

BASELINE = DEFAULT
"""The planner that the others are compared with by default, if it is there."""
PLANNERS = ("grid", DEFAULT)
"""The planners that are compared by default."""
PACKAGES = ("numpy", "numba", "scipy", "ompl")


def compare(
    maps: Any,
    planners: AnyPlanner | PlannerSpec | Sequence[AnyPlanner | PlannerSpec] = PLANNERS,
    queries: Any = 10,
    *,
    weights: Sequence[float] | None = None,
    seeds: Iterable[int] = (1,),
    configs: FieldConfig | Estimator | Mapping[str, FieldConfig | Estimator] | None = None,
    robot_radius: float = ROBOT_RADIUS,
    criterion: str | None = None,
    time_limit: float | None = None,
    least_distance: float = 5.0,
    query_seed: int = 1,
    baseline: str | None = None,
    workers: int | None = None,
    memory: float | None = None,
    patience: float = PATIENCE,
    journal: str | os.PathLike[str] | None = None,
    resume: bool = False,
    anew: bool = False,
    field_of: Callable[[OccupancyGrid, FieldConfig], CovarianceField] = load_or_compute,
    progress: ProgressCallback | None = None,
) -> Comparison:
    """Run every planner on every query of every map, in worker processes.

    A run that crashes, hangs or takes too much memory is counted as a failure; the others go on.

    Parameters
    ----------
    maps : map, or sequence or mapping of them
        Each map is a map_server YAML file, an OccupancyGrid or a Costmap; a mapping names them.
    planners : sequence, or one of them, default ("grid", "any-angle")
        Names with options, such as "BITstar:time_limit=2"; "simulated choice", which drives each
        candidate path with the lidar of the field, and takes drives, minimise, price, longest and
        params (a parameter file of Nav2) as options; functions ``f(costs, start, goal,
        **options)`` that return a `Path`, each with a costmap of its own; objects such as
        ``planners.Ompl("BITstar", time_limit=2)``; or `PlannerSpec`.
    queries : int, path, sequence, or mapping of them by map, default 10
        Number of random queries, 1 to 10,000 a map; a CSV file of name, start_x, start_y, goal_x,
        goal_y [m], or a MovingAI .scen file (100 of its queries); `Query` objects, or (start, goal)
        pairs [m]. Intervals are over the queries: more of them narrow these.
    weights : sequence of float, optional
        Metres of detour accepted per degenerate metre, >= 0; each estimator's own by default. Give
        several to see how the planners trade length.
    seeds : iterable of int, default (1,)
        Seeds of planners with random numbers, each 1 to 2^32 - 1; the others run once. Give several
        where a planner's paths scatter.
    configs : FieldConfig or Estimator, or mapping of them by label, optional
        Settings of the fields: the comparison is made for each of them; `Sad()` by default.
    robot_radius : float, default 0.25
        Radius of the robot [m], >= 0; a Costmap has its own.
    criterion : str, optional
        Scalar that u is made of, see `Costmap.from_field`; the estimator's own by default.
    time_limit : float, optional
        Time limit of planners that take one and have none of their own [s], above 0; by default
        OMPL's have 5.
    least_distance : float, default 5.0
        Least straight distance between start and goal of random queries [m], >= 0. Lower it on a
        small map.
    query_seed : int, default 1
        Seed of the random queries, >= 0.
    baseline : str, optional
        Label of the planner to compare with; by default any-angle if it is there, else the first.
    workers : int, optional
        Number of processes at once; by default the number of cores. Fewer disturb each
        other's planning times less.
    memory : float, optional
        Memory of a run [bytes], on Linux; by default the workers share 80 % of the machine's.
    patience : float, default 300.0
        Time after which a planner without a time limit is ended [s], above 0. A planner with a
        limit is ended after twice that limit and 10 s.
    journal : path, optional
        File that every run is written to as soon as it is done; by default there is none.
    anew : bool, default False
        True forgets the runs in the journal.
    resume : bool, default False
        True lets the journal hold runs already. Their tasks are not run again, except for those
        that crashed, hung or took too much memory.
    field_of : callable, default `load_or_compute`
        Function ``f(grid, config)`` that makes or reads the field of a map.
    progress : callable, optional
        Called with (done, total) runs.

    Returns
    -------
    Comparison
        All runs, and their statistics as tables, a report or JSON.

    Raises
    ------
    LocplanError
        If anything is wrong with the input, before the first run.
    """
    if isinstance(planners, (str, Planner, PlannerSpec)) or callable(planners):
        planners = [planners]
    weights = [float(weights)] if isinstance(weights, Real) else weights
    check_workers(workers)
    check_random(queries if is_whole(queries) else 1, query_seed, least_distance)
    seeds = checked_seeds(seeds)
    specs = [spec.with_time_limit(time_limit) for spec in specs_of(planners)]
    labels = [spec.label for spec in specs]
    if baseline is None:
        baseline = BASELINE if BASELINE in labels else labels[0]
    if baseline not in labels:
        raise ConfigError(f"baseline {shown(baseline)} is none of the planners {', '.join(labels)}")
    sources: dict[Case, Source] = {}
    began = datetime.now(UTC).astimezone()

    def jobs() -> Iterator[Job]:
        """One job for each map and settings; a map's queries are the same in all settings."""
        headed = any(spec.planner.space != "R2" for spec in specs)
        for name, given in named_maps(maps, read_map).items():
            own, grid = (given, given.grid) if isinstance(given, Costmap) else (None, given)
            if isinstance(queries, Mapping) and name not in queries:
                raise ConfigError(f"there are no queries for map {shown(name)}")
            wanted = queries[name] if isinstance(queries, Mapping) else queries
            asked: tuple[Query, ...] = ()
            radius = robot_radius if own is None else own.robot_radius
            settings = {"own cost": None} if own else named_configs(configs)
            for label, config in settings.items():
                case = name, label
                scalar = criterion or config.estimator.criterion if config else None
                source = Source(case, grid, config, own, radius, scalar, asked, field_of)
                costs, _ = source.costmap()
                if not asked:
                    asked = source.find_queries(costs, wanted, least_distance, query_seed, headed)
                sources[case] = dataclasses.replace(source, queries=asked)
                yield Job(name, label, costs, asked)

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
        anew=anew,
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
            "weights": list(dict.fromkeys(run.task.weight for run in runs)),
            "seeds": seeds,
            "time_limit": time_limit,
            "memory": memory,
            "patience": patience,
            "random_queries": {"least_distance": least_distance, "seed": query_seed},
            "cases": [source.to_json() for source in sources.values()],
        },
    )
