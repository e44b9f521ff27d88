"""The orders of a comparison: each task with everything that decides it, and its run."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from locplan import __version__
from locplan._util.checks import shown
from locplan._util.progress import ProgressCallback
from locplan.comparison._journal import Journal
from locplan.comparison._result import Case
from locplan.comparison._runs import Run, Task
from locplan.comparison._specs import PlannerSpec
from locplan.comparison._worker import Order
from locplan.comparison._workers import Workers
from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError
from locplan.planners import check_ends

BY_CHANCE = ("crashed", "hung", "out of memory")
"""Statuses that may differ the next time: a resumed comparison makes these runs again."""


def orders_of(
    case: Case,
    costs: Costmap,
    home: Path,
    specs: Sequence[PlannerSpec],
    weights: Sequence[float],
    seeds: Sequence[int],
) -> Iterator[Order]:
    """The orders of a case, whose costmap is in the folder `home`."""
    _check_queries(case, costs, {spec.planner.space for spec in specs})
    decisive = [__version__, _content(costs)]
    identities = [spec.identity() for spec in specs]
    for weight, query, (n, spec) in itertools.product(weights, case.queries, enumerate(specs)):
        for seed in spec.seeds(seeds):
            task = Task(case.map, case.config, query.name, weight, spec.label, int(seed))
            ends = query.start, query.goal
            about = [*decisive, weight, *ends, identities[n], int(seed)]
            text = json.dumps(about, sort_keys=True, default=repr)
            digest = hashlib.blake2b(text.encode(), digest_size=16).hexdigest()
            yield Order(task, home, *ends, n, digest)


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


def runs_of(
    orders: Sequence[Order],
    specs: Sequence[PlannerSpec],
    workers: Workers,
    journal: Journal | None,
    progress: ProgressCallback | None,
) -> list[Run]:
    """The runs of all orders, in their order; those that the journal has are not made again."""
    known = journal.runs if journal else {}
    done = {order.task: known.get((order.task, order.digest)) for order in orders}
    runs = {task: run for task, run in done.items() if run and run.status not in BY_CHANCE}
    left = [order for order in orders if order.task not in runs]
    digests = {order.task: order.digest for order in left}
    if progress:
        progress(len(runs), len(orders))
    for run in workers.run(_longest_first(left, specs)):
        runs[run.task] = run
        if journal:
            journal.add(run, digests[run.task])
        if progress:
            progress(len(runs), len(orders))
    return [runs[order.task] for order in orders]


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
