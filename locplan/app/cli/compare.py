"""The command `compare`: compare planners over maps and queries."""

from __future__ import annotations

import dataclasses
import shlex
import sys
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

import locplan
from locplan._support.progress import show_progress_bar_from_first_step
from locplan.app.cli.application import command
from locplan.app.cli.arguments import (
    Count,
    InputFile,
    MapFiles,
    PlannerTexts,
    Ranges,
    parse_planners,
    reject_options,
    show_default,
)
from locplan.app.cli.groups import (
    SEED,
    FieldOptions,
    OutputOptions,
    RobotOptions,
    Seed,
    Threads,
    load_zones,
    with_range,
)
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.comparison.settings import RandomQueries

Weights = Annotated[tuple[float, ...], Parameter(metavar="METRES")]


def _random_queries() -> type[RandomQueries]:
    from locplan.comparison.settings import RandomQueries

    return RandomQueries


QueryCount = Annotated[Count | None, show_default(lambda: _random_queries().count)]
MinDistance = Annotated[float | None, show_default(lambda: _random_queries().min_distance)]


@command(
    "compare lab.yaml -o compared --planner any-angle --planner BITstar:time_limit=2 --seeds 5",
    "compare lab.yaml hall.yaml -o compared --queries queries.csv --planner my.py:plan",
    words="ueJ",
)
def compare(
    maps: MapFiles,
    /,
    *,
    planner: PlannerTexts = (),
    baseline: str | None = None,
    queries: InputFile = None,
    random: QueryCount = None,
    min_distance: MinDistance = None,
    seeds: Count = 1,
    weight: Weights = (),
    zones: InputFile = None,
    ranges: Ranges = None,
    time_limit: float | None = None,
    patience: float = 300.0,
    memory: float | None = None,
    workers: Count | None = None,
    robot: RobotOptions = RobotOptions(),
    field: FieldOptions = FieldOptions(),
    seed: Seed = SEED,
    threads: Threads = None,
    output: OutputOptions = OutputOptions(),
) -> None:
    """Compare planners on the same queries, and report the best one.

    Parameters
    ----------
    maps
        Map YAML files, folders with one, MovingAI maps, or built-in maps.
    planner
        Planner of `locplan info`, or a function such as my.py:plan. Repeatable.
    baseline
        Planner to compare the others with.
    queries
        Queries (CSV), stations (CSV of name,x,y) or MovingAI .scen.
    random
        Number of random queries per map.
    min_distance
        Minimum distance from start to goal, in metres.
    seeds
        Number of runs of a randomized planner.
    weight
        Detour that avoiding a degenerate metre is worth, in metres. Repeatable.
    zones
        Zones (GeoJSON) or a keepout mask (map YAML) for all maps.
    ranges
        Lidar ranges to compare, in metres.
    time_limit
        Time limit of OMPL planners, in seconds. [default: 5]
    patience
        Time after which a run is killed, in seconds.
    memory
        Memory limit of a run, in GB.
    workers
        Number of parallel runs. [default: all cores]
    """
    from locplan.comparison.planners import make_specs
    from locplan.comparison.result import Comparison
    from locplan.comparison.settings import Execution, RandomQueries

    if output.output is None:
        raise ConfigError("name a folder for the results with --output")
    if queries is not None and random is not None:
        raise ConfigError("--random and --queries exclude each other; remove one")
    if queries is not None:
        reject_options("with --queries", min_distance=min_distance, seed=seed != SEED)
    random_queries = RandomQueries(
        count=RandomQueries.count if random is None else random,
        min_distance=RandomQueries.min_distance if min_distance is None else min_distance,
        seed=seed,
    )
    planners = make_specs(parse_planners(planner)) if planner else None
    compared_robot, config = field.resolve(robot.load())
    configs = (
        [config] if ranges is None else [with_range(config, lidar_range) for lidar_range in ranges]
    )
    output.check(Comparison.files)
    with show_progress_bar_from_first_step("comparing planners", "runs") as progress:
        execution = Execution(
            workers=workers,
            time_limit=time_limit,
            patience=patience,
            memory=None if memory is None else memory * 1e9,
            journal=output.output / "runs.jsonl",
            force=output.force,
            load_field=lambda grid, config: field.compute(grid, config, threads),
            progress=progress,
        )
        result = locplan.compare(
            maps,
            planners,
            queries or random_queries,
            compared_robot,
            configs={f"{c.estimator.name}, {c.estimator.reach:g} m": c for c in configs},
            weights=weight or None,
            zones=load_zones(zones),
            seeds=range(1, seeds + 1),
            baseline=baseline,
            execution=execution,
        )
    output.finish(dataclasses.replace(result, command=shlex.join(["locplan", *sys.argv[1:]])))
