"""Runs of a comparison: jobs for workers, shared costmaps, and the run of a planner."""

from __future__ import annotations

import dataclasses
import itertools
import logging
import math
import pickle
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from locplan._support.checks import short_repr
from locplan._support.progress import ProgressCallback
from locplan.comparison.journal import RunJournal
from locplan.comparison.planners import PlannerSpec
from locplan.comparison.statistics import MEASURES, PlannerRun, RunTask, group_records
from locplan.errors import ConfigError, LocplanError
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path as Route
from locplan.planning.path_check import find_path_faults
from locplan.planning.plans import check_ends
from locplan.planning.protocol import Position
from locplan.planning.results import Plan

if TYPE_CHECKING:
    from locplan.comparison.result import MapCase


LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class PlannerJob:
    """A task with the data that a worker needs to run it."""

    task: RunTask
    costs: Path
    """Folder of the shared costmap."""
    start: Position
    goal: Position
    planner: int
    """Index of the planner in the worker's list."""


def make_jobs(
    case: MapCase,
    costs: Costmap,
    costmap_folder: Path,
    specs: Sequence[PlannerSpec],
    weights: Sequence[float],
    seeds: Sequence[int],
) -> Iterator[PlannerJob]:
    """Yield the jobs of a case, whose costmap is in the folder `costmap_folder`."""
    _check_queries(case, costs, {spec.planner.space for spec in specs})
    for weight, query, (planner_index, spec) in itertools.product(
        weights, case.queries, enumerate(specs)
    ):
        for seed in spec.select_seeds(seeds):
            task = RunTask(case.map, case.config, query.name, weight, spec.label, int(seed))
            yield PlannerJob(task, costmap_folder, query.start, query.goal, planner_index)


def _check_queries(case: MapCase, costs: Costmap, spaces: Iterable[str]) -> None:
    """Raise a LocplanError unless all ends of queries are valid for all planners."""
    names = [query.name for query in case.queries]
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"map {short_repr(case.map)} needs queries with distinct names")
    for query, space in itertools.product(case.queries, {"R2", *spaces}):
        headed = slice(None) if space != "R2" else slice(2)
        try:
            check_ends(costs, query.start[headed], query.goal[headed], space=space)
        except LocplanError as error:
            query_text = f"map {short_repr(case.map)}, query {short_repr(query.name)}"
            raise LocplanError(f"{query_text}: {error}") from None


def run_jobs(
    jobs: Sequence[PlannerJob],
    specs: Sequence[PlannerSpec],
    perform_jobs: Callable[[Sequence[PlannerJob]], Iterator[PlannerRun]],
    journal: RunJournal | None,
    progress: ProgressCallback | None,
) -> list[PlannerRun]:
    """Return the runs of all jobs in their order; runs in the journal are not repeated.

    Runs that crashed, hung or ran out of memory are repeated. So are runs of a user's planner
    without a version, because it may have changed.
    """
    journal_runs = journal.runs if journal else {}
    lasting = [spec.label for spec in specs if not spec.is_user_planner or spec.version is not None]
    runs = {
        job.task: run
        for job in jobs
        if (run := journal_runs.get(job.task))
        and not run.is_aborted
        and run.task.planner in lasting
    }
    for spec in specs:
        count = sum(task.planner == spec.label for task in runs)
        if spec.is_user_planner and count:
            LOG.info("planner %s: %d runs cached, version %s", spec.label, count, spec.version)
    if progress:
        progress(len(runs), len(jobs))
    for run in perform_jobs(
        _sort_longest_first([job for job in jobs if job.task not in runs], specs)
    ):
        runs[run.task] = run
        if journal:
            journal.add(run)
        if progress:
            progress(len(runs), len(jobs))
    return [runs[job.task] for job in jobs]


def _sort_longest_first(
    jobs: Sequence[PlannerJob], specs: Sequence[PlannerSpec]
) -> list[PlannerJob]:
    """Sort jobs by costmap, then long ones first, so that workers finish at similar times."""

    def get_time_limit(job: PlannerJob) -> float:
        spec = specs[job.planner]
        unknown = math.inf if spec.is_user_planner else 0.0
        return unknown if spec.time_limit is None else spec.time_limit

    groups = group_records(jobs, lambda job: (job.costs, job.task.weight))
    return [
        job
        for costmap_jobs in groups.values()
        for job in sorted(costmap_jobs, key=get_time_limit, reverse=True)
    ]


def write_costmap(costs: Costmap, folder: Path) -> None:
    """Write a costmap into a new folder, with a file for each of its arrays."""
    # Measuring paths needs these: computed once, and outside the planners' time.
    _ = costs.grid.clearance, costs.u_of_heading
    buffers: list[pickle.PickleBuffer] = []
    pickled_costmap = pickle.dumps(costs, protocol=5, buffer_callback=buffers.append)
    try:
        folder.mkdir()
        for n, buffer in enumerate(buffers):
            (folder / f"{n}.raw").write_bytes(buffer.raw())
        (folder / "about.pickle").write_bytes(pickled_costmap)
    except OSError as error:
        reason = error.strerror or error
        raise LocplanError(
            f"{folder}: cannot be written ({reason}); set TMPDIR to another folder"
        ) from None


@lru_cache(maxsize=1)
def read_costmap(folder: Path) -> Costmap:
    """Read a costmap with read-only arrays that processes share; the last one is cached."""
    names = (folder / f"{n}.raw" for n in itertools.count())
    files = itertools.takewhile(Path.exists, names)
    buffers = [np.memmap(file, mode="r") for file in files]
    costs: Costmap = pickle.loads((folder / "about.pickle").read_bytes(), buffers=buffers)
    return costs


@lru_cache(maxsize=1)
def read_weighted_costmap(folder: Path, weight: float) -> Costmap:
    """Return the costmap in a folder with a weight; the last one is cached."""
    costs = read_costmap(folder)
    if math.isnan(costs.weight) and weight == 0:
        return costs
    return costs if costs.weight == weight else costs.with_weight(weight)


def perform_job(planner: PlannerSpec, job: PlannerJob, max_bytes: float) -> PlannerRun:
    """Run a job within a memory limit [bytes]; an exception of the planner is a result."""
    began = time.perf_counter()
    try:
        costs = read_weighted_costmap(job.costs, job.task.weight)
        with limit_memory(max_bytes):
            result = planner.plan(costs, job.start, job.goal, job.task.seed)
    except MemoryError as error:
        status, note = "out of memory", str(error) or "the planner ran out of memory"
    except LocplanError as error:
        status, note = "error", str(error)
    except BaseException as error:  # sys.exit in a planner must not end the comparison
        status, note = "error", f"{type(error).__name__}: {error}"
    else:
        run = run_from_plan(job.task, result)
        return dataclasses.replace(run, note=find_driving_fault(costs, result.path) or run.note)
    elapsed = time.perf_counter() - began
    return PlannerRun(job.task, status, elapsed, elapsed, note=(note.splitlines() or [""])[0])


def run_from_plan(task: RunTask, result: Plan) -> PlannerRun:
    """Return a plan as a run; the caller adds the wall time."""
    seconds = float(result.solve_time)
    run = PlannerRun(
        task,
        str(result.status),
        seconds,
        seconds,
        note=str(result.note or ""),
        expanded=None if result.expanded is None else int(result.expanded),
    )
    if result.path is None:
        return run
    names = [name for name in MEASURES if name not in ("seconds", "turning")]
    metric_values = {name: float(getattr(result.metrics, name, math.nan)) for name in names}
    history = ((float(at), float(cost)) for at, cost in result.history)
    return dataclasses.replace(
        run,
        measures=metric_values | {"turning": measure_turning(result.path)},
        history=tuple(point for point in history if math.isfinite(sum(point))),
        xy=tuple(map(tuple, result.path.xy.tolist())),
    )


def find_driving_fault(costs: Costmap, path: Route | None) -> str:
    """Return why a robot with an outline or turning radius cannot drive a path; empty if it can."""
    robot = costs.robot
    if path is None or robot is None or not (robot.outline or robot.kinematics.turning_radius):
        return ""
    faults = find_path_faults(costs.grid, path, robot)
    fault_texts = [f"{fault.kind} near {fault.x:.2f},{fault.y:.2f}" for fault in faults]
    return f"{PlannerRun.undrivable_note}: {fault_texts[0]}" if fault_texts else ""


def measure_turning(path: Route) -> float:
    """Return the sum of all changes of direction along a path [rad].

    >>> round(measure_turning(Route(np.array([(0, 0), (1, 0), (1, 1), (1, 1), (0, 1)]))), 4)
    3.1416
    """
    steps = np.diff(path.xy, axis=0)
    steps = steps[steps.any(axis=1)]
    turns = np.diff(np.arctan2(steps[:, 1], steps[:, 0]))
    return float(np.abs(turns - 2 * np.pi * np.round(turns / (2 * np.pi))).sum())


def forbid_core_files() -> None:
    """Prevent core files of this process, on systems with resource limits."""
    with suppress(ModuleNotFoundError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


@contextmanager
def limit_memory(extra_bytes: float) -> Iterator[None]:
    """Limit the additional memory of this process within a block [bytes], on Linux."""
    used = _measure_data_size()
    try:
        import resource
    except ModuleNotFoundError:
        used = 0  # Windows has no such limits
    if not used or not math.isfinite(extra_bytes):
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_DATA)
    soft, hard = used + int(extra_bytes), before[1]
    soft = soft if hard == resource.RLIM_INFINITY else min(soft, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


def _measure_data_size() -> int:
    """Return the memory that counts towards the limit: private and writable [bytes]."""
    try:
        lines = Path("/proc/self/status").read_text("ascii").splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmData")), 0)
