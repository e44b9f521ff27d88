"""All runs of a comparison: maps x settings x weights x queries x planners x seeds."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from locplan import __version__
from locplan._util.checks import positive, shown, whole
from locplan._util.leftovers import temporary_folder
from locplan._util.machine import check_memory, check_workers
from locplan._util.progress import ProgressCallback
from locplan.comparison import _shared_costmaps as shared_costmaps
from locplan.comparison._journal import Journal
from locplan.comparison._runs import Run, Task
from locplan.comparison._specs import PlannerSpec, specs_of
from locplan.comparison._worker import Order
from locplan.comparison._workers import PATIENCE, Workers, check_platform
from locplan.costs import Costmap, check_weight
from locplan.errors import ConfigError, LocplanError
from locplan.planners import MAX_SEED, AnyPlanner, Query, check_ends

BY_CHANCE = ("crashed", "hung", "out of memory")
"""Statuses that may differ the next time: a resumed comparison makes these runs again."""
MAX_SEEDS = 1000
"""Greatest number of seeds."""


@dataclass(frozen=True)
class Job:
    """A map with a field, and the queries on it."""

    map: str
    """The map's name."""
    config: str
    """The label of the field's settings, which differs between the jobs of a map."""
    costs: Costmap
    """The costmap; its weight counts only if no weights are given."""
    queries: Sequence[Query]


def run_all(
    jobs: Iterable[Job],
    planners: Sequence[AnyPlanner | PlannerSpec],
    *,
    weights: Sequence[float] | None = None,
    seeds: Iterable[int] = (1,),
    workers: int | None = None,
    memory: float | None = None,
    patience: float = PATIENCE,
    journal: str | os.PathLike[str] | None = None,
    resume: bool = False,
    anew: bool = False,
    progress: ProgressCallback | None = None,
) -> list[Run]:
    """Run every planner on every query in worker processes, see `locplan.compare`.

    `jobs` may make each costmap when it is asked for: they are not kept in memory. The runs are
    returned by job, weight, query, planner and seed, in the order given.
    """
    check_platform()
    count = check_workers(workers)
    positive("patience", patience, "s")
    if memory is not None:
        positive("memory", memory, "bytes")
        check_memory("runs of so much memory", memory, "set less")
    weights = None if weights is None else list(weights)
    seeds = [whole("each seed", seed, 1, MAX_SEED) for seed in checked_seeds(seeds)]
    specs = specs_of(planners)
    if weights is not None:
        _check_each_once("weight", weights)
    _check_each_once("seed", seeds)
    with ExitStack() as stack:
        book = stack.enter_context(Journal(journal, resume=resume, anew=anew)) if journal else None
        folder = stack.enter_context(temporary_folder())
        pool = stack.enter_context(
            Workers(specs, count, memory=memory, patience=patience, scratch=folder)
        )
        orders = list(_orders(jobs, specs, weights, seeds, folder))
        done = {order.task: book.runs.get((order.task, order.digest)) for order in orders if book}
        runs = {task: run for task, run in done.items() if run and run.status not in BY_CHANCE}
        left = [order for order in orders if order.task not in runs]
        digests = {order.task: order.digest for order in left}
        if progress:
            progress(len(runs), len(orders))
        for run in pool.run(_longest_first(left, specs)):
            runs[run.task] = run
            if book:
                book.add(run, digests[run.task])
            if progress:
                progress(len(runs), len(orders))
    return [runs[order.task] for order in orders]


def _check_each_once(name: str, values: Sequence[float]) -> None:
    """Raise a ConfigError if there are no values, or one of them twice."""
    if not values or len(set(values)) < len(values):
        raise ConfigError(f"a comparison needs at least one {name}, and none of them twice")


def checked_seeds(seeds: Iterable[int]) -> list[int]:
    """Return seeds as a list; a ConfigError unless they are some, and not too many."""
    try:
        first = list(itertools.islice(seeds, MAX_SEEDS + 1))
    except TypeError:
        raise ConfigError(f"seeds must be several whole numbers, not {shown(seeds)}") from None
    if len(first) > MAX_SEEDS:
        raise ConfigError(f"a comparison has at most {MAX_SEEDS:,} seeds")
    return first


def _orders(
    jobs: Iterable[Job],
    specs: Sequence[PlannerSpec],
    weights: Sequence[float] | None,
    seeds: Sequence[int],
    folder: Path,
) -> Iterator[Order]:
    """All orders; their costmaps are written into the folder."""
    labels: set[tuple[str, str]] = set()
    identities = [spec.identity() for spec in specs]
    for number, job in enumerate(jobs):
        if (job.map, job.config) in labels:
            raise ConfigError(
                f"map {shown(job.map)} is there twice with {shown(job.config)}; rename one"
            )
        labels.add((job.map, job.config))
        asked = [0.0 if math.isnan(job.costs.weight) else job.costs.weight]
        asked = asked if weights is None else [float(weight) for weight in weights]
        _check(job, specs, asked)
        home = folder / str(number)
        shared_costmaps.put(job.costs, home)
        decisive = [__version__, _content(job.costs)]
        for weight in asked:
            for query in job.queries:
                for n, spec in enumerate(specs):
                    for seed in spec.seeds(seeds):
                        task = Task(job.map, job.config, query.name, weight, spec.label, int(seed))
                        ends = query.start, query.goal
                        about = [*decisive, weight, *ends, identities[n], int(seed)]
                        text = json.dumps(about, sort_keys=True, default=repr)
                        digest = hashlib.blake2b(text.encode(), digest_size=16).hexdigest()
                        yield Order(task, home, *ends, n, digest)


def _check(job: Job, specs: Sequence[PlannerSpec], weights: Sequence[float]) -> None:
    """Raise a LocplanError unless all runs of a job can begin."""
    names = [query.name for query in job.queries]
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"map {shown(job.map)} needs queries, each with a name of its own")
    for weight in weights:
        check_weight(weight)
        if weight and math.isnan(job.costs.weight):
            raise ConfigError(f"map {shown(job.map)} has no field, so that its only weight is 0")
    spaces = {spec.planner.space for spec in specs}
    for query in job.queries:
        for space in {"R2", *spaces}:
            headed = slice(None) if space != "R2" else slice(2)
            try:
                check_ends(job.costs, query.start[headed], query.goal[headed], space=space)
            except LocplanError as error:
                where = f"map {shown(job.map)}, query {shown(query.name)}"
                raise LocplanError(f"{where}: {error}") from None


def _longest_first(orders: Sequence[Order], specs: Sequence[PlannerSpec]) -> list[Order]:
    """Sort by costmap, and within each put long runs first, so that none is left at the end."""
    groups = dict.fromkeys((order.costs, order.task.weight) for order in orders)
    place = {group: n for n, group in enumerate(groups)}

    def key(order: Order) -> tuple[int, float]:
        spec = specs[order.planner]
        unknown = math.inf if spec.guarded else 0.0
        limit = unknown if spec.time_limit is None else spec.time_limit
        return place[order.costs, order.task.weight], -limit

    return sorted(orders, key=key)


def _content(costs: Costmap) -> str:
    """A digest of everything in a costmap that paths and measures depend on."""
    content = hashlib.blake2b(digest_size=16)
    # The simulated choice takes its lidar from the settings.
    settings = costs.settings and json.dumps(costs.settings.to_json(), sort_keys=True)
    content.update(repr((costs.grid.digest, costs.robot_radius, settings)).encode())
    for layer in (costs.density, costs.u, costs.e, costs.u_of_heading, costs.e_of_heading):
        if layer is not None:
            content.update(np.ascontiguousarray(layer).view(np.uint8).data)
    return content.hexdigest()
