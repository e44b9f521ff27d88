"""Worker processes: a planner that crashes, hangs or takes all memory costs one run.

Workers are new interpreters, no forks: locks and threads of the caller's process (OpenCV's, a
progress bar's, a notebook's) are none of theirs, and no script needs a guard for being imported
again. Functions are sent by value where they cannot be imported.
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
from types import TracebackType

from locplan.comparison import _worker as worker_module
from locplan.comparison._runs import Run
from locplan.comparison._specs import PlannerSpec
from locplan.comparison._worker import READY, Order
from locplan.errors import LocplanError

PATIENCE = 300.0
"""After which a planner without a time limit counts as hung, unless told otherwise [s]."""
GRACE = 10.0
"""What a planner may take beyond twice its time limit [s]."""
STARTING = 600.0
"""The very first start compiles [s]."""
ATTEMPTS = 3
"""Starts in a row that may fail."""
_LOOK_EVERY = 0.5
"""How often one looks for workers that ended without closing their socket [s]."""
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")


def check_platform() -> None:
    """Raise a LocplanError unless the system has the processes that comparisons need."""
    if os.name != "posix":
        raise LocplanError(
            "comparisons are not available on Windows: their worker processes need a POSIX system;"
            " take WSL"
        )


def usable_cores() -> int:
    """Cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def fair_memory(workers: int) -> float:
    """What each of them may take, so that the machine has some left [bytes]."""
    return 0.8 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / workers


class Workers:
    """Processes that run planners; a context manager that ends them all.

    Parameters
    ----------
    planners : sequence of PlannerSpec
        All that orders will name.
    count : int
        How many at once, at most.
    memory : float, optional
        What a run may take [bytes], on Linux; by default a fair share of the machine's.
    patience : float
        How long a planner without a time limit may take [s].
    scratch : path, optional
        For the temporary files of planners, which processes that are ended leave behind.

    Raises
    ------
    LocplanError
        If a planner cannot be sent to a process.
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
        self._memory = fair_memory(count) if memory is None else memory
        self._workers: list[_Worker] = []
        self._failed_starts = 0
        remedy = "put it into a module"
        try:
            from cloudpickle import dumps
        except ModuleNotFoundError:  # without it all are locplan's: see PlannerSpec.identity
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for worker in self._workers:
            worker.end()
        self._workers = []

    def run(self, orders: Sequence[Order]) -> Iterator[Run]:
        """Make the runs, in this order as workers get free; each as it is finished.

        Raises
        ------
        LocplanError
            If workers cannot be started.
        """
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
    """One process and what it is at."""

    def __init__(self, handed: bytes, memory: float, scratch: Path | None) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            command = (
                f"import sys; sys.path[:] = {sys.path!r}; from {worker_module.__name__} import main"
                f"; main({theirs.fileno()}, {os.getpid()})"
            )
            # A session of its own: Ctrl-C reaches the caller only, and it ends with its children.
            self._process = subprocess.Popen(
                [sys.executable, "-c", command],
                stdin=subprocess.DEVNULL,
                stdout=2,  # what a planner prints is no part of the caller's output
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
        with suppress(OSError):  # if it has ended already, that is noticed later
            self.connection.send(memory)
            self.connection.send_bytes(handed)

    @property
    def idle(self) -> bool:
        """Whether it waits for an order."""
        return self.started and self._order is None and not self.gone

    def take(self, order: Order, limit: float) -> bool:
        """Hand it an order that counts as hung after the limit [s]; whether it was there."""
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
        """What came of its order, if that is known by now."""
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
        """Kill it, with all processes it has started."""
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
        self.gone = message.status == "out of memory"  # what it has left is uncertain
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
