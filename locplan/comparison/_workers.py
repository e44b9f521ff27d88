"""Worker processes: a planner that crashes, hangs or takes all memory costs one run.

Workers are new interpreters, not forks: they have none of the locks and threads of the caller's
process (OpenCV's, a progress bar's, a notebook's), and a script needs no guard against being
imported again. Functions are sent by value where they cannot be imported.
"""

from __future__ import annotations

import dataclasses
import os
import signal
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path

from locplan._util.machine import usable_memory
from locplan.comparison import _worker as worker_module
from locplan.comparison._runs import Run
from locplan.comparison._specs import PlannerSpec
from locplan.comparison._worker import READY, Order
from locplan.errors import LocplanError

PATIENCE = 300.0
"""Time after which a planner without a time limit counts as hung by default [s]."""
GRACE = 10.0
"""Time that a planner may take beyond twice its time limit [s]."""
STARTING = 600.0
"""Time that a worker may take to start; the very first start compiles [s]."""
ATTEMPTS = 3
"""Number of failed starts in a row after which a comparison ends."""
_LOOK_EVERY = 0.5
"""Interval between looks for workers that ended without closing their socket [s]."""
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")


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
    `locplan.compare`. The folder `scratch` takes the temporary files of planners, which processes
    that are killed leave behind.
    """

    def __init__(
        self,
        planners: Sequence[PlannerSpec],
        count: int,
        *,
        memory: float | None = None,
        patience: float = PATIENCE,
        scratch: Path | None = None,
    ) -> None:
        self._scratch = scratch
        self._planners, self._count, self._patience = planners, count, patience
        if memory is None:  # a fair share, so that the machine has some left
            memory = usable_memory() / count
        self._memory = memory
        self._workers: list[_Worker] = []
        self._failed_starts = 0
        remedy = "put it into a module"
        try:
            from cloudpickle import dumps
        except ModuleNotFoundError:  # then all are locplan's, see PlannerSpec.check_library
            from pickle import dumps

            remedy = "pip install 'locplan[functions]'"
        try:
            self._handed = dumps(list(planners))
        except Exception as error:  # pickling fails in many ways
            raise LocplanError(
                f"a planner cannot be sent to a worker process ({error}); {remedy}"
            ) from None

    def __enter__(self) -> Workers:
        self._start(self._count)  # while they load, the caller makes orders
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        for worker in self._workers:
            worker.end()
        self._workers = []

    def run(self, orders: Sequence[Order]) -> Iterator[Run]:
        """Start the runs in this order as workers become free, and yield each when it is done."""
        waiting, remaining = deque(orders), len(orders)
        while remaining:
            self._start(min(self._count, remaining))
            for worker in self._workers:
                if worker.idle and waiting and worker.take(waiting[0], self._limit(waiting[0])):
                    waiting.popleft()
            self._wait()
            for worker in list(self._workers):
                if run := worker.listen():
                    remaining -= 1
                    yield run
                if worker.gone:
                    self._workers.remove(worker)
                    worker.end()
                    self._note_start(worker)

    def _start(self, wanted: int) -> None:
        for _ in range(wanted - len(self._workers)):
            self._workers.append(_Worker(self._handed, self._memory, self._scratch))

    def _limit(self, order: Order) -> float:
        own = self._planners[order.planner].time_limit
        return self._patience if own is None else 2 * own + GRACE

    def _wait(self) -> None:
        now = time.perf_counter()
        first = min((worker.deadline - now for worker in self._workers), default=0.0)
        wait([worker.connection for worker in self._workers], max(0.0, min(first, _LOOK_EVERY)))

    def _note_start(self, gone: _Worker) -> None:
        self._failed_starts = 0 if gone.started else self._failed_starts + 1
        if gone.refusal:
            raise LocplanError(f"a planner cannot be used in a worker process: {gone.refusal}")
        if self._failed_starts >= ATTEMPTS:
            raise LocplanError(
                "worker processes end before they are ready; the reason is on standard error"
            )


class _Worker:
    """A process and its present order."""

    def __init__(self, handed: bytes, memory: float, scratch: Path | None) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            command = (
                f"import sys; sys.path[:] = {sys.path!r}; from {worker_module.__name__} import main"
                f"; main({theirs.fileno()}, {os.getpid()})"
            )
            # In a session of its own Ctrl-C reaches only the caller, and its children end with it.
            self._process = subprocess.Popen(
                [sys.executable, "-c", command],
                stdin=subprocess.DEVNULL,
                stdout=2,  # the caller's output has nothing that a planner prints
                pass_fds=[theirs.fileno()],
                env={**os.environ, **_ONE_THREAD, **({"TMPDIR": str(scratch)} if scratch else {})},
                start_new_session=True,
            )
        self.connection = Connection(ours.detach())
        self.started = self.gone = False
        self.refusal = ""
        self.deadline = time.perf_counter() + STARTING
        self._order: Order | None = None
        self._handed_at, self._limit = 0.0, STARTING
        with suppress(OSError):  # a process that has ended already is noticed later
            self.connection.send(memory)
            self.connection.send_bytes(handed)

    @property
    def idle(self) -> bool:
        """Whether the process waits for an order."""
        return self.started and self._order is None and not self.gone

    def take(self, order: Order, limit: float) -> bool:
        """Send an order that counts as hung after the limit [s]; return whether it arrived."""
        self._handed_at = time.perf_counter()
        try:
            self.connection.send(order)
        except OSError:
            self.gone = True
            return False
        self._order, self._limit = order, limit
        self.deadline = self._handed_at + limit
        return True

    def listen(self) -> Run | None:
        """The run of the present order, if it is known by now."""
        ended = self._process.poll() is not None
        try:
            if self.connection.poll():
                return self._answered(self.connection.recv())
        except (EOFError, OSError):
            ended = True
        if ended:
            self.gone = True
            return self._failed("crashed", self._exit_reason())
        if time.perf_counter() >= self.deadline:
            self.gone = True
            return self._failed("hung", f"gave no answer within {self._limit:g} s and was ended")
        return None

    def end(self) -> None:
        """Kill the process, with all processes that it has started."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self.connection.close()

    def _answered(self, message: Run | str) -> Run | None:
        self.deadline = float("inf")
        if isinstance(message, str):
            self.started = message == READY
            self.refusal = "" if self.started else message
            self.gone = not self.started
            return None
        self._order = None
        self.gone = message.status == "out of memory"  # nobody knows how much memory it has left
        return self._timed(message)

    def _failed(self, status: str, note: str) -> Run | None:
        if self._order is None:
            return None
        return self._timed(Run(self._order.task, status, 0.0, 0.0, note=note), failed=True)

    def _timed(self, run: Run, *, failed: bool = False) -> Run:
        wall = time.perf_counter() - self._handed_at
        return dataclasses.replace(run, wall_seconds=wall, seconds=wall if failed else run.seconds)

    def _exit_reason(self) -> str:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        code = self._process.returncode
        if code is None:
            return "its process closed the connection"
        if code >= 0:
            return f"its process ended with exit code {code}"
        reason = f"its process was ended by {signal.Signals(-code).name}"
        return reason + (", from outside or for want of memory" if -code == signal.SIGKILL else "")
