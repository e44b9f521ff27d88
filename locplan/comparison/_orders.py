"""The orders of a comparison, each with all that a worker needs, and their shared costmaps.

Costmaps are shared by all processes: one file for each array, mapped into memory.
"""

from __future__ import annotations

import itertools
import logging
import math
import pickle
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from locplan._util.checks import shown
from locplan._util.progress import ProgressCallback
from locplan.comparison._journal import Journal
from locplan.comparison._specs import PlannerSpec
from locplan.comparison._statistics import Run, Task, grouped
from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError
from locplan.planners import Position, check_ends

if TYPE_CHECKING:
    from locplan.comparison._result import Case

LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Order:
    """A task with everything that a worker needs for it."""

    task: Task
    costs: Path
    """Folder of the shared costmap."""
    start: Position
    goal: Position
    planner: int
    """Index of the planner among those that the worker was given."""


def orders_of(
    case: Case,
    costs: Costmap,
    home: Path,
    specs: Sequence[PlannerSpec],
    weights: Sequence[float],
    seeds: Sequence[int],
) -> Iterator[Order]:
    """Yield the orders of a case, whose costmap is in the folder `home`."""
    _check_queries(case, costs, {spec.planner.space for spec in specs})
    for weight, query, (n, spec) in itertools.product(weights, case.queries, enumerate(specs)):
        for seed in spec.seeds(seeds):
            task = Task(case.map, case.config, query.name, weight, spec.label, int(seed))
            yield Order(task, home, query.start, query.goal, n)


def _check_queries(case: Case, costs: Costmap, spaces: Iterable[str]) -> None:
    """Raise a LocplanError unless all planners' spaces hold the ends of all queries."""
    names = [query.name for query in case.queries]
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"map {shown(case.map)} needs queries, each with a name of its own")
    for query, space in itertools.product(case.queries, {"R2", *spaces}):
        headed = slice(None) if space != "R2" else slice(2)
        try:
            check_ends(costs, query.start[headed], query.goal[headed], space=space)
        except LocplanError as error:
            where = f"map {shown(case.map)}, query {shown(query.name)}"
            raise LocplanError(f"{where}: {error}") from None


def runs_of(
    orders: Sequence[Order],
    specs: Sequence[PlannerSpec],
    start: Callable[[Sequence[Order]], Iterator[Run]],
    journal: Journal | None,
    progress: ProgressCallback | None,
) -> list[Run]:
    """Return the runs of all orders, in their order; those in the journal are not made again.

    Runs that were ended from outside are made again, and those of a user's planner that declares
    no version: nobody knows if it has changed.
    """
    known = journal.runs if journal else {}
    lasting = [spec.label for spec in specs if not spec.guarded or spec.version is not None]
    runs = {
        order.task: run
        for order in orders
        if (run := known.get(order.task)) and not run.ended and run.task.planner in lasting
    }
    for spec in specs:
        count = sum(task.planner == spec.label for task in runs)
        if spec.guarded and count:
            LOG.warning("planner %s: %d runs cached, version %s", spec.label, count, spec.version)
    if progress:
        progress(len(runs), len(orders))
    for run in start(_longest_first([o for o in orders if o.task not in runs], specs)):
        runs[run.task] = run
        if journal:
            journal.add(run)
        if progress:
            progress(len(runs), len(orders))
    return [runs[order.task] for order in orders]


def _longest_first(orders: Sequence[Order], specs: Sequence[PlannerSpec]) -> list[Order]:
    """Sort by costmap, and within each put long runs first, so that none is left at the end."""

    def limit(order: Order) -> float:
        spec = specs[order.planner]
        unknown = math.inf if spec.guarded else 0.0
        return unknown if spec.time_limit is None else spec.time_limit

    groups = grouped(orders, lambda order: (order.costs, order.task.weight))
    return [each for own in groups.values() for each in sorted(own, key=limit, reverse=True)]


def put_costmap(costs: Costmap, folder: Path) -> None:
    """Write a costmap into a new folder, each of its arrays to a file of its own."""
    # Paths are measured with these: made once for all, and in no planner's time.
    _ = costs.grid.clearance, costs.u_of_heading
    buffers: list[pickle.PickleBuffer] = []
    about = pickle.dumps(costs, protocol=5, buffer_callback=buffers.append)
    try:
        folder.mkdir()
        for n, buffer in enumerate(buffers):
            (folder / f"{n}.raw").write_bytes(buffer.raw())
        (folder / "about.pickle").write_bytes(about)
    except OSError as error:
        why = error.strerror or error
        raise LocplanError(f"{folder}: cannot be written ({why}); TMPDIR names another") from None


@lru_cache(maxsize=1)
def read_costmap(folder: Path) -> Costmap:
    """Read a costmap, whose read-only arrays all processes share in memory; the last is kept."""
    names = (folder / f"{n}.raw" for n in itertools.count())
    files = itertools.takewhile(Path.exists, names)
    buffers = [np.memmap(file, mode="r") for file in files]
    costs: Costmap = pickle.loads((folder / "about.pickle").read_bytes(), buffers=buffers)
    return costs


@lru_cache(maxsize=1)
def weighted_costmap(folder: Path, weight: float) -> Costmap:
    """The costmap with a weight, which is 0 for one without a field; the last one is kept."""
    costs = read_costmap(folder)
    if math.isnan(costs.weight) and weight == 0:
        return costs
    return costs if costs.weight == weight else costs.with_weight(weight)
