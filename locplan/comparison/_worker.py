"""What a worker process does: it waits for orders, plans, and answers."""

from __future__ import annotations

import math
import os
import pickle
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from locplan.comparison import _shared_costmaps as shared_costmaps
from locplan.comparison._runs import MEASURES, Run, Task
from locplan.comparison._specs import PlannerSpec
from locplan.costs import Path as Route
from locplan.errors import LocplanError
from locplan.planners import Plan, Position

READY = "ready"
_DIE_WITH_PARENT = 1  # Linux's PR_SET_PDEATHSIG


@dataclass(frozen=True)
class Order:
    """A task with all that a worker needs for it."""

    task: Task
    costs: Path
    """Where its costmap is shared."""
    start: Position
    goal: Position
    planner: int
    """Which of the planners that the worker was given."""
    digest: str
    """Of all that decides the result."""


def main(descriptor: int, parent: int) -> None:
    """Serve whoever is at the other end of a socket, until it is closed.

    First come the memory that a run may take [bytes] and the planners; the answer is `READY`, or
    why they cannot be used. Then comes one order after the other, and a run for each.
    """
    os.set_inheritable(descriptor, False)
    import resource

    _end_with(parent)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a planner's crash leaves no files
    connection = Connection(descriptor)
    with suppress(EOFError, OSError):  # nobody is there any more
        memory = connection.recv()
        try:
            planners = _received(connection.recv_bytes())
        except Exception as error:
            connection.send(f"{type(error).__name__}: {error}")
            return
        connection.send(READY)
        while True:
            order = connection.recv()
            connection.send(perform(planners[order.planner], order, memory))


def perform(planner: PlannerSpec, order: Order, memory: float) -> Run:
    """Make one run in so much memory [bytes]; whatever a planner raises is a result."""
    costs = shared_costmaps.weighted(order.costs, order.task.weight)
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
    """A plan as a record; its time with the worker is added by who measures it."""
    seconds, path, note = float(result.solve_time), result.path, str(result.note or "")
    status = str(result.status)
    if path is None:
        return Run(task, status, seconds, seconds, note=note)
    measures = {
        name: getattr(result.metrics, name, math.nan) for name in MEASURES if name != "seconds"
    }
    return Run(
        task,
        status,
        seconds,
        seconds,
        {name: float(value) for name, value in measures.items()} | {"turning": turning(path)},
        tuple((float(at), float(cost)) for at, cost in result.history if math.isfinite(at + cost)),
        tuple((x, y) for x, y in path.xy.tolist()),
        note,
    )


def turning(path: Route) -> float:
    """By how much the direction of travel changes along a path, all in all [rad].

    Examples
    --------
    >>> round(turning(Route(np.array([(0, 0), (1, 0), (1, 1), (1, 1), (0, 1)]))), 4)
    3.1416
    """
    steps = np.diff(path.xy, axis=0)
    steps = steps[steps.any(axis=1)]
    turns = np.diff(np.arctan2(steps[:, 1], steps[:, 0]))
    return float(np.abs(turns - 2 * np.pi * np.round(turns / (2 * np.pi))).sum())


@contextmanager
def limited_memory(extra: float) -> Iterator[None]:
    """Allow this process so much more memory than it has [bytes], where the system can (Linux)."""
    import resource

    used = _data_size()
    before = resource.getrlimit(resource.RLIMIT_DATA)
    if used and math.isfinite(extra):
        _, hard = before
        most = used + int(extra)
        soft = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


def _data_size() -> int:
    """What counts against the limit: private memory that can be written, touched or not."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmData")), 0)


def _received(handed: bytes) -> list[PlannerSpec]:
    """The planners, with all compiled that they need."""
    import cv2

    cv2.setNumThreads(1)  # a run is timed on one core
    planners: list[PlannerSpec] = pickle.loads(handed)
    for planner in planners:
        planner.planner.prepare()
    return planners


def _end_with(parent: int) -> None:
    """Have the system end this process with its parent, even while a planner hangs (Linux)."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
        if os.getppid() != parent:
            sys.exit()
