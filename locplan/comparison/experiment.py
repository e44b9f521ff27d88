"""Comparison of planners: maps x settings x weights x queries x planners x seeds."""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from locplan._support.checks import (
    check_choice,
    check_instance,
    check_integer,
    check_workers,
    count_usable_cores,
    short_repr,
)
from locplan._support.output import temporary_folder
from locplan.comparison.benchmarks import read_benchmark_map, read_scenarios
from locplan.comparison.journal import RunJournal
from locplan.comparison.planners import PlannerSpec, find_costmap_robot, make_specs
from locplan.comparison.result import Comparison, MapCase
from locplan.comparison.runs import PlannerJob, make_jobs, run_jobs, write_costmap
from locplan.comparison.settings import (
    Execution,
    RandomQueries,
    collect_versions,
    compute_map_digest,
    describe_field_config,
    describe_queries,
    resolve_queries,
)
from locplan.comparison.workers import WorkerPool
from locplan.errors import ConfigError
from locplan.field.config import FieldConfig, config_from_settings
from locplan.field.estimator import Estimator
from locplan.field.fisher import Fused
from locplan.maps.grid import OccupancyGrid
from locplan.maps.zones import Zones, check_zones_on_map, normalize_zones
from locplan.planning.costmap import Costmap
from locplan.planning.layers import check_weight
from locplan.planning.named_maps import name_maps
from locplan.planning.protocol import LATTICE, MAX_SEED, Planner
from locplan.planning.queries import Query, normalize_queries
from locplan.planning.requests import AnyPlanner
from locplan.planning.robot_fit import default_planner
from locplan.robots.robot import Robot


def compare(
    maps: Any,
    planners: AnyPlanner | PlannerSpec | Sequence[AnyPlanner | PlannerSpec] | None = None,
    queries: Any = 10,
    robot: Robot | None = None,
    *,
    configs: FieldConfig | Estimator | Mapping[str, FieldConfig | Estimator] | None = None,
    weights: Sequence[float] | float | None = None,
    criterion: str | None = None,
    zones: Zones | None = None,
    seeds: Iterable[int] = (1,),
    baseline: str | None = None,
    execution: Execution | None = None,
) -> Comparison:
    """Run every planner on every query of every map, in worker processes.

    A run that crashes, hangs or takes too much memory counts as a failure; the next runs continue.

    Parameters
    ----------
    maps : map, or sequence or mapping of them
        Each map is a map_server YAML file, an OccupancyGrid or a Costmap; a mapping names them.
    planners : sequence, or one of them, optional
        By default "grid" and the planner for the robot: "lattice" if it has an outline or a turning
        radius, otherwise "any-angle". Names with options, such as "BITstar:time_limit=2";
        "simulated choice", which simulates drives on each candidate path and has the options
        drives, minimise, price, longest and robot (a robot file); functions
        ``f(costs, start, goal, **options)`` that return a `Path`; objects such as
        ``planners.Ompl("BITstar", time_limit=2)``; or `PlannerSpec`.
    queries : int, RandomQueries, path, sequence, or mapping of them by map, default 10
        Number of random queries per map, 1 to 10,000; a CSV file of name, start_x, start_y, goal_x,
        goal_y [m], or a MovingAI .scen file (100 of its queries); `Query` objects, or (start, goal)
        pairs [m]. More queries give narrower intervals.
    robot : Robot, optional
        The robot, whose radius the costmaps use; by default 0.25 m. A Costmap keeps its robot. A
        simulated choice simulates this robot, with the lidar of each field if the fields differ in
        it.
    configs : FieldConfig or Estimator, or mapping of them by label, optional
        Settings of the fields to compare; by default `Fused` for the robot's lidar,
        or `Sad()` without a lidar.
    weights : float or sequence of float, optional
        Metres of detour accepted per degenerate metre, >= 0; by default the estimator's. Several
        weights show how the planners trade length for localizability.
    criterion : str, optional
        Scalar that u is based on, see `Costmap.from_field`; by default the estimator's.
    zones : Zones, optional
        The zones of all maps: no path crosses a no-go one, and J rises by 1 per metre
        outside preferred ones. A Costmap keeps its zones.
    seeds : iterable of int, default (1,)
        Seeds of planners with random numbers, each 1 to 2^32 - 1; other planners run once. Use
        several if a planner's paths vary.
    baseline : str, optional
        Label of the planner to compare with; by default the planner for the robot if it is
        compared, otherwise the first.
    execution : Execution, optional
        Number of workers, limits of time and memory, and the journal.

    Returns
    -------
    Comparison
        All runs, and their statistics as tables, a report or JSON.

    Raises
    ------
    LocplanError
        If any input is invalid; raised before the first run.
    """
    execution = execution or Execution()
    queries = resolve_queries(queries)
    weight_list = [float(weights)] if isinstance(weights, (int, float)) else weights
    if weight_list is not None:
        _check_distinct("weight", weight_list)
    seeds = _check_seeds(seeds)
    fields = name_configs(configs, robot)
    robot_planner = default_planner(robot or find_costmap_robot(maps))
    planners = ("grid", robot_planner) if planners is None else planners
    specs = _make_specs(planners, _select_simulated_robot(robot, fields), execution.time_limit)
    labels = [spec.label for spec in specs]
    baseline = baseline or max(labels, key=lambda label: label == robot_planner)
    check_choice("baseline", baseline, labels)
    began = datetime.now(UTC).astimezone()
    radius = (robot or Robot()).radius
    zones = normalize_zones(zones)
    make_case = partial(MapCase, robot_radius=radius, load_field=execution.load_field, zones=zones)
    maps_by_name = name_maps(maps, read_benchmark_map)
    for name, map_or_costmap in maps_by_name.items():
        if isinstance(map_or_costmap, OccupancyGrid):
            check_zones_on_map(zones, map_or_costmap)
        elif zones:
            raise ConfigError(
                f"map {short_repr(name)} is a costmap, which keeps its zones; remove zones"
            )
    settings = {
        "versions": collect_versions(),
        "maps": {
            name: compute_map_digest(map_or_costmap)
            for name, map_or_costmap in maps_by_name.items()
        },
        "fields": {label: describe_field_config(config) for label, config in fields.items()},
        "criterion": criterion,
        **({"zones": zones.digest} if zones else {}),
        "queries": describe_queries(queries),
        "planners": {spec.label: spec.identity() for spec in specs},
        "weights": weight_list and [float(weight) for weight in weight_list],
        "seeds": seeds,
        "robot": robot and robot.summary(),
    }
    with (
        nullcontext()
        if execution.journal is None
        else RunJournal(execution.journal, settings, force=execution.force) as journal,
        temporary_folder() as folder,
        WorkerPool(
            specs,
            check_workers(execution.workers),
            memory=execution.memory,
            patience=execution.patience,
            scratch=folder,
        ) as workers,
    ):
        cases: list[MapCase] = []
        jobs: list[PlannerJob] = []
        headed = any(spec.planner.space not in ("R2", LATTICE) for spec in specs)
        for case, costs in _make_cases(maps_by_name, fields, criterion, queries, headed, make_case):
            home = folder / str(len(cases))
            costs = costs if robot is None else dataclasses.replace(costs, robot=robot)
            write_costmap(costs, home)  # on disk, so that only one is in memory
            jobs += make_jobs(
                case, costs, home, specs, _check_weights(weight_list, case, costs), seeds
            )
            cases.append(case)
        runs = run_jobs(jobs, specs, workers.perform_jobs, journal, execution.progress)
    description = _describe_comparison(execution, specs, queries, began) | {
        "weights": list(dict.fromkeys(run.task.weight for run in runs)),
        "seeds": seeds,
        "robot": robot and robot.summary(),
    }
    return Comparison(tuple(runs), baseline, {case.key: case for case in cases}, description)


def _describe_comparison(
    execution: Execution, specs: Sequence[PlannerSpec], queries: Any, began: datetime
) -> dict[str, Any]:
    """Return versions, machine, planners, random queries and limits as plain data for JSON."""
    return {
        **collect_versions(),
        "machine": f"{platform.machine()}, {count_usable_cores()} cores",
        "workers": execution.workers or count_usable_cores(),
        "began": began.isoformat(timespec="seconds"),
        "planners": {spec.label: spec.identity() for spec in specs},
        **{name: getattr(execution, name) for name in ("time_limit", "memory", "patience")},
        "random_queries": dataclasses.asdict(queries)
        if isinstance(queries, RandomQueries)
        else None,
    }


def _make_specs(planners: Any, robot: Robot | None, time_limit: float | None) -> list[PlannerSpec]:
    is_single = isinstance(planners, (str, Planner, PlannerSpec)) or callable(planners)
    specs = make_specs([planners] if is_single else planners)
    return [spec.with_time_limit(time_limit).with_robot(robot) for spec in specs]


def name_configs(
    configs: FieldConfig | Estimator | Mapping[str, FieldConfig | Estimator] | None,
    robot: Robot | None = None,
) -> dict[str, FieldConfig]:
    """Return the settings of fields by label."""
    if robot is not None:
        check_instance("robot", robot, Robot)
    if configs is None and robot is not None and robot.lidar is not None:
        configs = Fused(robot.lidar)
    if configs is None or isinstance(configs, (FieldConfig, Estimator)):
        config = config_from_settings(configs)
        return {f"{config.estimator.name}, {config.estimator.reach:g} m": config}
    if not isinstance(configs, Mapping) or not configs:
        raise ConfigError("configs must be a FieldConfig, or a mapping of labels to them")
    return {label: config_from_settings(config) for label, config in configs.items()}


def _select_simulated_robot(robot: Robot | None, fields: Mapping[str, FieldConfig]) -> Robot | None:
    """Return the robot to simulate, without its lidar if the fields have different lidars."""
    lidars = {getattr(config.estimator, "lidar", None) for config in fields.values()}
    if robot is None or lidars <= {robot.lidar, None}:
        return robot
    return dataclasses.replace(robot, lidar=None)


def _check_seeds(seeds: Iterable[int]) -> list[int]:
    try:
        first = list(itertools.islice(seeds, 1001))
    except TypeError:
        raise ConfigError(f"seeds must be several whole numbers, not {short_repr(seeds)}") from None
    if len(first) > 1000:
        raise ConfigError("a comparison has at most 1,000 seeds")
    _check_distinct("seed", first)
    return [check_integer("each seed", seed, 1, MAX_SEED) for seed in first]


def _check_distinct(name: str, values: Sequence[float]) -> None:
    """Raise a ConfigError if there are no values, or one of them twice."""
    if not values or len(set(values)) < len(values):
        raise ConfigError(f"a comparison needs at least one {name}, and none of them twice")


def _make_cases(
    maps: Mapping[str, OccupancyGrid | Costmap],
    fields: Mapping[str, FieldConfig],
    criterion: str | None,
    queries: Any,
    has_headings: bool,
    make_case: partial[MapCase],
) -> Iterator[tuple[MapCase, Costmap]]:
    """Yield a case and its costmap for each map and field; cases of a map share its queries."""
    for name, map_or_costmap in maps.items():
        if isinstance(queries, Mapping) and name not in queries:
            raise ConfigError(f"there are no queries for map {short_repr(name)}; add some")
        map_queries = queries[name] if isinstance(queries, Mapping) else queries
        case_queries: tuple[Query, ...] = ()
        if isinstance(map_or_costmap, Costmap):
            cases = [
                MapCase(
                    name,
                    "own cost",
                    map_or_costmap.grid,
                    map_or_costmap.robot_radius,
                    user_costmap=map_or_costmap,
                )
            ]
        else:
            cases = [
                make_case(
                    name,
                    label,
                    map_or_costmap,
                    settings=config,
                    criterion=criterion or config.estimator.criterion,
                )
                for label, config in fields.items()
            ]
        for case in cases:
            costs, _ = case.costmap()
            case_queries = case_queries or _make_queries(map_queries, costs, has_headings)
            yield dataclasses.replace(case, queries=case_queries), costs


def _make_queries(query_source: Any, costs: Costmap, has_headings: bool) -> tuple[Query, ...]:
    """Return the queries of a case, drawn at random or read from a file if necessary."""
    if isinstance(query_source, RandomQueries):
        return normalize_queries(
            costs, query_source.count, query_source.min_distance, query_source.seed, has_headings
        )
    if isinstance(query_source, (str, os.PathLike)) and Path(query_source).suffix == ".scen":
        # A file may hold fifteen thousand.
        return tuple(read_scenarios(query_source, costs.grid, count=100))
    return normalize_queries(costs, query_source, 0.0, 1, has_headings)


def _check_weights(weights: Sequence[float] | None, case: MapCase, costs: Costmap) -> list[float]:
    """Return the checked weights of a case; by default the costmap's weight."""
    costmap_weight = 0.0 if math.isnan(costs.weight) else costs.weight
    case_weights = [costmap_weight] if weights is None else [float(weight) for weight in weights]
    for weight in case_weights:
        check_weight(weight)
    if any(case_weights) and math.isnan(costs.weight):
        raise ConfigError(
            f"map {short_repr(case.map)} has no field, so its weight must be 0; leave weights out"
        )
    return case_weights
