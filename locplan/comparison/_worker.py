"""The program of a worker process: it waits for orders, plans, and answers.

Its costmaps are shared by all processes: one file for each array, mapped into memory.
"""

from __future__ import annotations

import dataclasses
import math
import mmap
import os
import pickle
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from locplan._util.supervision import end_with_parent
from locplan.comparison._specs import PlannerSpec
from locplan.comparison._statistics import MEASURES, Run, Task
from locplan.costs import Costmap, Path as Route
from locplan.errors import LocplanError
from locplan.planners import Plan, Position


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
    digest: str
    """Digest of everything that decides the result."""


def main(descriptor: int, parent: int) -> None:
    """Carry out the orders that come through a socket, until it is closed.

    The first messages are the memory of a run [bytes] and the planners; the answer is empty, or
    the reason why they cannot be used. Each order that follows is answered by its run.
    """
    os.set_inheritable(descriptor, False)
    import resource

    end_with_parent(parent)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a planner's crash leaves no files
    connection = Connection(descriptor)
    with suppress(EOFError, OSError):  # the other end is closed
        memory = connection.recv()
        try:
            planners = _received(connection.recv_bytes())
        except Exception as error:
            connection.send(f"{type(error).__name__}: {error}")
            return
        connection.send("")
        while True:
            order = connection.recv()
            connection.send(perform(planners[order.planner], order, memory))


def perform(planner: PlannerSpec, order: Order, memory: float) -> Run:
    """Make one run within a limit of memory [bytes]; an exception of the planner is a result."""
    costs = weighted_costmap(order.costs, order.task.weight)
    began = time.perf_counter()
    try:
        with limited_memory(memory):
            result = planner.plan(costs, order.start, order.goal, order.task.seed)
    except MemoryError as error:
        status, note = "out of memory", str(error) or "the planner ran out of memory"
    except LocplanError as error:
        status, note = "error", str(error)
    except BaseException as error:  # sys.exit in a planner shall not end the comparison
        status, note = "error", f"{type(error).__name__}: {error}"
    else:
        return run_of(order.task, result)
    elapsed = time.perf_counter() - began
    return Run(order.task, status, elapsed, elapsed, note=(note.splitlines() or [""])[0])


def run_of(task: Task, result: Plan) -> Run:
    """A plan as a run; the caller measures the wall time and adds it."""
    seconds, path = float(result.solve_time), result.path
    run = Run(
        *(task, str(result.status), seconds, seconds),
        note=str(result.note or ""),
        expanded=None if result.expanded is None else int(result.expanded),
    )
    if path is None:
        return run
    names = [name for name in MEASURES if name not in ("seconds", "turning")]
    known = {name: float(getattr(result.metrics, name, math.nan)) for name in names}
    history = ((float(at), float(cost)) for at, cost in result.history)
    return dataclasses.replace(
        run,
        measures=known | {"turning": turning(path)},
        history=tuple(point for point in history if math.isfinite(sum(point))),
        xy=tuple((x, y) for x, y in path.xy.tolist()),
    )


def turning(path: Route) -> float:
    """The sum of all changes of direction along a path [rad].

    >>> round(turning(Route(np.array([(0, 0), (1, 0), (1, 1), (1, 1), (0, 1)]))), 4)
    3.1416
    """
    steps = np.diff(path.xy, axis=0)
    steps = steps[steps.any(axis=1)]
    turns = np.diff(np.arctan2(steps[:, 1], steps[:, 0]))
    return float(np.abs(turns - 2 * np.pi * np.round(turns / (2 * np.pi))).sum())


@contextmanager
def limited_memory(extra: float) -> Iterator[None]:
    """Limit the memory that this process may take in addition [bytes], on Linux."""
    import resource

    used = _data_size()
    before = resource.getrlimit(resource.RLIMIT_DATA)
    if used and math.isfinite(extra):
        soft, hard = used + int(extra), before[1]
        soft = soft if hard == resource.RLIM_INFINITY else min(soft, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


def _data_size() -> int:
    """The memory that counts against the limit: private and writable, touched or not [bytes]."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmData")), 0)


def _received(handed: bytes) -> list[PlannerSpec]:
    """The planners from their pickle, prepared to solve."""
    import cv2

    cv2.setNumThreads(1)  # a run is timed on one core
    planners: list[PlannerSpec] = pickle.loads(handed)
    for planner in planners:
        planner.planner.prepare()
    return planners


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
    buffers = []
    for n in range(len(list(folder.glob("*.raw")))):
        with (folder / f"{n}.raw").open("rb") as file:
            buffers.append(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    costs: Costmap = pickle.loads((folder / "about.pickle").read_bytes(), buffers=buffers)
    return costs


@lru_cache(maxsize=1)
def weighted_costmap(folder: Path, weight: float) -> Costmap:
    """The costmap with a weight, which is 0 for one without a field; the last one is kept."""
    costs = read_costmap(folder)
    if math.isnan(costs.weight) and weight == 0:
        return costs
    return costs if costs.weight == weight else costs.with_weight(weight)
