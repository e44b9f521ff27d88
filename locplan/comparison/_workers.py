"""Worker processes: a planner that crashes, hangs or takes all memory costs one run.

The pools of concurrent.futures, joblib and loky break as a whole when a process dies, and end no
single task that hangs. So each thread of a ThreadPoolExecutor waits here for a process of its own.
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
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from locplan._util.checks import usable_memory
from locplan._util.supervision import end_with_parent
from locplan.comparison._journal import Order, weighted_costmap
from locplan.comparison._specs import PlannerSpec
from locplan.comparison._statistics import MEASURES, Run, Task
from locplan.costs import Path as Route
from locplan.errors import LocplanError
from locplan.planners import Plan


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
        self._planners, self._patience = planners, patience
        # A fair share by default, so that the machine has some left.
        self._memory = usable_memory() / count if memory is None else memory
        self._handed, self._scratch = _pickled(planners), scratch
        self._count, self._threads = count, ThreadPoolExecutor(count)
        self._lock, self._closed = threading.Lock(), False
        self._started: list[_Worker] = []
        self._idle: list[_Worker] = []

    def __enter__(self) -> Workers:
        self._idle = [self._start() for _ in range(self._count)]  # they load meanwhile
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        with self._lock:  # from now on no thread starts another one
            self._closed = True
        for worker in self._started:
            worker.end()
        self._threads.shutdown(cancel_futures=True)

    def run(self, orders: Sequence[Order]) -> Iterator[Run]:
        """Start the runs in this order as workers become free, and yield each when it is done."""
        for made in as_completed([self._threads.submit(self._made, order) for order in orders]):
            yield made.result()

    def _made(self, order: Order) -> Run:
        worker = self._ready()
        own = self._planners[order.planner].time_limit
        run = worker.run(order, self._patience if own is None else 2 * own + 10.0)
        if worker.alive:
            self._idle.append(worker)
        return run

    def _ready(self) -> _Worker:
        """A worker that waits for an order."""
        for _ in range(3):  # failed starts in a row
            try:
                worker = self._idle.pop()
            except IndexError:
                worker = self._start()
            if worker.is_ready():
                return worker
        raise LocplanError(
            "worker processes end before they are ready; the reason is on standard error"
        )

    def _start(self) -> _Worker:
        with self._lock:
            if self._closed:
                raise LocplanError("the comparison has ended")
            worker = _Worker(self._handed, self._memory, self._scratch)
            self._started.append(worker)
        return worker


class _Worker:
    """A process that runs one planner at a time."""

    def __init__(self, handed: bytes, memory: float, scratch: Path) -> None:
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
        self._connection, self._greeted = Connection(ours.detach()), False
        with suppress(OSError):  # a process that has ended already is noticed later
            self._connection.send(memory)
            self._connection.send_bytes(handed)

    @property
    def alive(self) -> bool:
        """Whether the process has not ended."""
        return self._process.poll() is None

    def is_ready(self) -> bool:
        """Wait until the process takes orders; False if it ends instead.

        A LocplanError says which planner it cannot use.
        """
        if not self._greeted:
            said = self._answer(600.0)  # the very first start compiles
            if said is None:
                self.end()
            elif said:
                raise LocplanError(f"a planner cannot be used in a worker process: {said}")
            self._greeted = True
        return self.alive

    def run(self, order: Order, limit: float) -> Run:
        """Send an order, and wait for its run, up to the limit [s]."""
        began = time.perf_counter()
        with suppress(OSError):  # it ends, as its answer will show
            self._connection.send(order)
        run: Run | None = self._answer(limit)
        wall = time.perf_counter() - began
        if run is None:
            status, note = self._failure(wall, limit)
            run = Run(order.task, status, wall, wall, note=note)
        if run.ended:
            self.end()  # nobody knows how much memory one has left that ran out of it
        return dataclasses.replace(run, wall_seconds=wall)

    def end(self) -> None:
        """Kill the process, with all processes that it has started."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _answer(self, limit: float) -> Any:
        """The next message; None if the process ends, or sends none within the limit [s]."""
        deadline = time.perf_counter() + limit
        with suppress(EOFError, OSError):
            while (left := deadline - time.perf_counter()) > 0:
                alive = self.alive  # asked first: it may send and end meanwhile
                if self._connection.poll(min(left, 0.5) if alive else 0):
                    return self._connection.recv()
                if not alive:
                    break
        return None

    def _failure(self, wall: float, limit: float) -> tuple[str, str]:
        """Status and note of a run that has no answer after some time [s]."""
        if wall >= limit and self.alive:
            return "hung", f"gave no answer within {limit:g} s and was ended"
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
