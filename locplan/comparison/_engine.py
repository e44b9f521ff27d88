"""All runs of a comparison: maps x settings x weights x queries x planners x seeds."""

from __future__ import annotations

import hashlib
import json
import math
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from locplan import __version__
from locplan._util.checks import positive, whole
from locplan._util.progress import ProgressCallback
from locplan.comparison import _shared_costmaps as shared_costmaps
from locplan.comparison._journal import Journal
from locplan.comparison._runs import Run, Task
from locplan.comparison._specs import PlannerSpec, specs_of
from locplan.comparison._worker import Order
from locplan.comparison._workers import PATIENCE, Workers, check_platform, usable_cores
from locplan.costs import Costmap
from locplan.costs._costmap import check_weight
from locplan.errors import ConfigError, LocplanError
from locplan.planners import AnyPlanner, Query, check_ends

BY_CHANCE = ("crashed", "hung", "out of memory")
"""What may end otherwise with more memory or patience, or undisturbed: made anew on resuming."""


@dataclass(frozen=True)
class Job:
    """A map with a field, and where to go on it."""

    map: str
    """The map's name."""
    config: str
    """The label of the field's settings; once for a map."""
    costs: Costmap
    """For the robot's radius and of any weight: runs make it one of their own."""
    queries: Sequence[Query]


def run_all(
    jobs: Iterable[Job],
    planners: Sequence[AnyPlanner | PlannerSpec],
    *,
    weights: Sequence[float] = (4.0,),
    seeds: Sequence[int] = (1,),
    workers: int | None = None,
    memory: float | None = None,
    patience: float = PATIENCE,
    journal: str | os.PathLike[str] | None = None,
    resume: bool = False,
    progress: ProgressCallback | None = None,
) -> list[Run]:
    """Run every planner on every query, each run in a process that may fail.

    Parameters
    ----------
    jobs : iterable of Job
        May make each costmap when it is asked for: they are not kept in memory.
    planners : sequence of str, function, Planner or PlannerSpec
        See `PlannerSpec.of`.
    weights : sequence of float
        Metres of detour accepted per degenerate metre; 0 for costmaps without a field.
    seeds : sequence of int
        For planners with random numbers; the others run once, as seed 0.
    workers : int, optional
        Processes at once; as many as there are cores.
    memory : float, optional
        What a run may take [bytes], on Linux; by default the workers share 80 % of the machine's.
    patience : float
        How long a planner without a time limit may take [s]. With one it is twice that and 10 s.
    journal : path, optional
        A file that runs are written to as they come.
    resume : bool
        Whether the journal may hold runs already; those of the same tasks are not made again, but
        for ones that crashed, hung or took too much memory.
    progress : callable, optional
        Called with the number of runs done and of all.

    Returns
    -------
    list of Run
        By job, weight, query, planner and seed, in the order given.

    Raises
    ------
    LocplanError
        If anything is wrong with the input, before the first run.
    """
    check_platform()
    count = usable_cores() if workers is None else workers
    whole("workers", count)
    positive("patience", patience, "s")
    if memory is not None:
        positive("memory", memory, "bytes")
    weights, seeds = list(weights), [whole("each seed", seed) for seed in seeds]
    specs = specs_of(planners)
    for name, values in (("weight", weights), ("seed", seeds)):
        if not values or len(set(values)) < len(values):
            raise ConfigError(f"a comparison needs at least one {name}, and none of them twice")
    with ExitStack() as stack:
        book = stack.enter_context(Journal(journal, resume=resume)) if journal else None
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="locplan-")))
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


def _orders(
    jobs: Iterable[Job],
    specs: Sequence[PlannerSpec],
    weights: Sequence[float],
    seeds: Sequence[int],
    folder: Path,
) -> Iterator[Order]:
    """All orders, their costmaps shared."""
    labels: set[tuple[str, str]] = set()
    for number, job in enumerate(jobs):
        if (job.map, job.config) in labels:
            raise ConfigError(f"map {job.map!r} is there twice with {job.config!r}; rename one")
        labels.add((job.map, job.config))
        _check(job, specs, weights)
        home = folder / str(number)
        shared_costmaps.put(job.costs, home)
        decisive = [__version__, _content(job.costs)]
        for weight in map(float, weights):
            for query in job.queries:
                for n, spec in enumerate(specs):
                    for seed in spec.seeds(seeds):
                        task = Task(job.map, job.config, query.name, weight, spec.label, int(seed))
                        ends = query.start, query.goal
                        about = [*decisive, weight, *ends, spec.identity(), int(seed)]
                        yield Order(task, home, *ends, n, _digest(about))


def _check(job: Job, specs: Sequence[PlannerSpec], weights: Sequence[float]) -> None:
    """Raise a LocplanError unless all its runs can be begun."""
    names = [query.name for query in job.queries]
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"map {job.map!r} needs queries, each with a name of its own")
    for weight in weights:
        check_weight(weight)
        if weight and math.isnan(job.costs.weight):
            raise ConfigError(f"map {job.map!r} has no field, so that its only weight is 0")
    spaces = {spec.planner.space for spec in specs}
    for query in job.queries:
        for space in {"R2", *spaces}:
            headed = slice(None) if space != "R2" else slice(2)
            try:
                check_ends(job.costs, query.start[headed], query.goal[headed], space=space)
            except LocplanError as error:
                where = f"map {job.map!r}, query {query.name!r}"
                raise LocplanError(f"{where}: {error}") from None


def _longest_first(orders: Sequence[Order], specs: Sequence[PlannerSpec]) -> list[Order]:
    """Costmap after costmap, and on each what takes long first: no worker is left with it."""
    groups = {(order.costs, order.task.weight): None for order in orders}
    place = {group: n for n, group in enumerate(groups)}

    def key(order: Order) -> tuple[int, float]:
        limit = specs[order.planner].time_limit
        unknown = float("inf") if specs[order.planner].guarded else 0.0
        return place[order.costs, order.task.weight], -(unknown if limit is None else limit)

    return sorted(orders, key=key)


def _content(costs: Costmap) -> str:
    """A digest of all in a costmap that paths and measures depend on."""
    content = hashlib.blake2b(digest_size=16)
    content.update(repr((costs.grid.digest, costs.robot_radius)).encode())
    for layer in (costs.density, costs.u, costs.e, costs.u_of_heading, costs.e_of_heading):
        if layer is not None:
            content.update(np.ascontiguousarray(layer).view(np.uint8).data)
    return content.hexdigest()


def _digest(about: Any) -> str:
    text = json.dumps(about, sort_keys=True, default=repr)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()
