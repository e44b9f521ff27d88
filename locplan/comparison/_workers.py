"""Worker processes: a planner that crashes, hangs or takes all memory costs one run.

The pools of concurrent.futures, joblib and loky break as a whole when a process dies, and end no
single task that hangs. So one loop waits here for the answers of all processes.
Workers are new interpreters, not forks: they have none of the locks and threads of the caller's
process (OpenCV's, a progress bar's, a notebook's), and a script needs no guard against being
imported again. Functions are sent by value where they cannot be imported. Their program is `main`.
"""

from __future__ import annotations

import dataclasses
import math
import os
import pickle
import signal
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import numpy as np

from locplan._util.checks import usable_memory
from locplan._util.supervision import end_with_parent
from locplan.comparison._journal import Order, weighted_costmap
from locplan.comparison._specs import PlannerSpec
from locplan.comparison._statistics import MEASURES, Run, Task
from locplan.costs import Costmap, Path as Route
from locplan.errors import LocplanError
from locplan.planners import Plan, path_faults


def check_platform() -> None:
    """Raise a LocplanError unless the system has the processes that comparisons need."""
    if os.name != "posix":
        raise LocplanError(
            "comparisons are not available on Windows: their worker processes need a POSIX system;"
            " take WSL"
        )


class Workers:
    """Processes that run planners; a context manager that ends them all.

    At most `count` processes run at once; `memory` [bytes] and `patience` [s] are those of
    `Execution`. The folder `scratch` takes the temporary files of planners, which processes that
    are killed leave behind.
    """

    def __init__(
        self,
        planners: Sequence[PlannerSpec],
        count: int,
        *,
        memory: float | None,
        patience: float,
        scratch: Path,
    ) -> None:
        limits = (spec.time_limit for spec in planners)
        self._limits = [patience if own is None else 2 * own + 10.0 for own in limits]
        # A fair share by default, so that the machine has some left.
        memory = usable_memory() / count if memory is None else memory
        self._start = partial(_Worker, _pickled(planners), memory, scratch)
        self._count, self._workers = count, list[_Worker]()

    def __enter__(self) -> Workers:
        for _ in range(self._count):
            self._workers.append(self._start())  # they load meanwhile
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        for worker in self._workers:
            worker.end()

    def run(self, orders: Sequence[Order]) -> Iterator[Run]:
        """Start the runs in this order as workers become free, and yield each when it is done."""
        left = deque(orders)
        while left or any(worker.order for worker in self._workers):
            self._hand_out(left)
            busy = [worker for worker in self._workers if worker.busy]
            wait([worker.connection for worker in busy], min(worker.patience for worker in busy))
            for worker in busy:
                if worker.works():
                    continue
                if run := worker.result():
                    yield run
                elif worker.failed == 3:
                    raise LocplanError(
                        "worker processes end before they are ready; the reason is on standard"
                        " error"
                    )

    def _hand_out(self, left: deque[Order]) -> None:
        """Send the next orders to workers that wait, and replace those that have ended."""
        for n, worker in enumerate(self._workers):
            if left and not worker.busy and worker.alive:
                worker.send(left[0], self._limits[left.popleft().planner])
            elif left and not worker.busy:
                self._workers[n] = self._start(worker.failed)


class _Worker:
    """A process that loads the planners, and then runs one at a time."""

    def __init__(self, handed: bytes, memory: float, scratch: Path, failed: int = 0) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            command = (
                f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import main"
                f"; main({theirs.fileno()}, {os.getpid()})"
            )
            threads = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"
            # In a session of its own Ctrl-C reaches only the caller, and its children end with it.
            self._process = subprocess.Popen(
                [sys.executable, "-c", command],
                stdin=subprocess.DEVNULL,
                stdout=2,  # the caller's output has nothing that a planner prints
                pass_fds=[theirs.fileno()],
                env={**os.environ, **dict.fromkeys(threads, "1"), "TMPDIR": str(scratch)},
                start_new_session=True,
            )
        self.connection = Connection(ours.detach())
        self.failed = failed  # starts in a row that ended while loading, in its place
        self._begin(None, 600.0)  # the very first start compiles
        with suppress(OSError):  # a process that has ended already is noticed later
            self.connection.send(memory)
            self.connection.send_bytes(handed)

    def _begin(self, order: Order | None, limit: float) -> None:
        """Note what it works at from now on, an order or none to load, and its limit [s]."""
        self.order, self.busy = order, True
        self._began, self._limit = time.perf_counter(), limit

    def send(self, order: Order, limit: float) -> None:
        """Send an order, whose run may take up to the limit [s]."""
        self._begin(order, limit)
        with suppress(OSError):  # it ends, as its result will show
            self.connection.send(order)

    @property
    def alive(self) -> bool:
        """Whether the process has not ended."""
        return self._process.poll() is None

    @property
    def patience(self) -> float:
        """Time after which to look again whether it still works [s]."""
        return min(max(self._began + self._limit - time.perf_counter(), 0.0), 0.5)

    def works(self) -> bool:
        """Whether it has neither answered nor ended, and has some time left."""
        # Whether it is alive is asked first: it may send and end meanwhile.
        return self.alive and self.patience > 0 and not self.connection.poll()

    def result(self) -> Run | None:
        """The run of its order; None where it was loading, after which it may have ended.

        A LocplanError says which planner it cannot use.
        """
        wall, answer = time.perf_counter() - self._began, None
        with suppress(EOFError, OSError):
            if self.connection.poll():
                answer = self.connection.recv()
        order, self.order, self.busy = self.order, None, False
        if order is None:
            if answer:
                raise LocplanError(f"a planner cannot be used in a worker process: {answer}")
            self.failed = self.failed + 1 if answer is None else 0
            if self.failed:
                self.end()
            return None
        if answer is None:
            status, note = self._failure(wall)
            answer = Run(order.task, status, wall, wall, note=note)
        run: Run = answer
        if run.ended:
            self.end()  # nobody knows how much memory one has left that ran out of it
        return dataclasses.replace(run, wall_seconds=wall)

    def end(self) -> None:
        """Kill the process, with all processes that it has started."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _failure(self, wall: float) -> tuple[str, str]:
        """Status and note of a run that has no answer after some time [s]."""
        if wall >= self._limit and self.alive:
            return "hung", f"gave no answer within {self._limit:g} s and was ended"
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        code = self._process.returncode
        if code is None:
            return "crashed", "its process closed the connection"
        if code >= 0:
            return "crashed", f"its process ended with exit code {code}"
        doubt = ", from outside or for want of memory" if -code == signal.SIGKILL else ""
        return "crashed", f"its process was ended by {signal.Signals(-code).name}{doubt}"


def _pickled(planners: Sequence[PlannerSpec]) -> bytes:
    """The planners as they are sent to workers."""
    remedy = "put it into a module"
    try:
        from cloudpickle import dumps
    except ModuleNotFoundError:  # then all are locplan's, see `specs_of`
        from pickle import dumps

        remedy = "pip install 'locplan[functions]'"
    try:
        return bytes(dumps(list(planners)))
    except Exception as error:  # pickling fails in many ways
        raise LocplanError(
            f"a planner cannot be sent to a worker process ({error}); {remedy}"
        ) from None


def main(descriptor: int, parent: int) -> None:
    """Carry out the orders that come through a socket, until it is closed.

    The first messages are the memory of a run [bytes] and the planners; the answer is empty, or
    the reason why they cannot be used. Each order that follows is answered by its run.
    """
    os.set_inheritable(descriptor, False)
    import resource

    import cv2

    cv2.setNumThreads(1)  # a run is timed on one core
    end_with_parent(parent)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a planner's crash leaves no files
    connection = Connection(descriptor)
    with suppress(EOFError, OSError):  # the other end is closed
        memory = connection.recv()
        try:
            planners: list[PlannerSpec] = pickle.loads(connection.recv_bytes())
            for each in planners:
                each.planner.prepare()
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
        run = run_of(order.task, result)
        return dataclasses.replace(run, note=undriven(costs, result.path) or run.note)
    elapsed = time.perf_counter() - began
    return Run(order.task, status, elapsed, elapsed, note=(note.splitlines() or [""])[0])


def run_of(task: Task, result: Plan) -> Run:
    """A plan as a run; the caller measures the wall time and adds it."""
    seconds, path = float(result.solve_time), result.path
    found: dict[str, Any] = {}
    if path is not None:
        names = [name for name in MEASURES if name not in ("seconds", "turning")]
        known = {name: float(getattr(result.metrics, name, math.nan)) for name in names}
        history = ((float(at), float(cost)) for at, cost in result.history)
        found["measures"] = known | {"turning": turning(path)}
        found["history"] = tuple(point for point in history if math.isfinite(sum(point)))
        found["xy"] = tuple(map(tuple, path.xy.tolist()))
    expanded = None if result.expanded is None else int(result.expanded)
    about = {"note": str(result.note or ""), "expanded": expanded, **found}
    return Run(task, str(result.status), seconds, seconds, **about)


def undriven(costs: Costmap, path: Route | None) -> str:
    """Why a robot with an outline or a turning radius cannot drive a path; empty where it can."""
    robot = costs.robot
    if path is None or robot is None or not (robot.outline or robot.kinematics.turning_radius):
        return ""
    faults = path_faults(costs.grid, path, robot)
    found = [f"{each.kind} near {each.x:.2f},{each.y:.2f}" for each in faults]
    return f"{Run.undriven}: {found[0]}" if found else ""


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
