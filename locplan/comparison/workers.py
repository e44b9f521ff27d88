"""Worker processes: a planner that crashes, hangs or takes all memory costs one run.

Why not pebble.ProcessPool, tried in version 5.2: spawned and forkserver workers import a script
again, and fail if it has no ``if __name__ == "__main__"``. Forks die if numba's OpenMP threads have
run in the caller. Processes that a planner has started outlive it. A planner that hangs in native
code holds up the pool for three seconds.

Workers are new interpreters that read orders from their standard input and write runs to what was
their standard output, on any system. Functions that cannot be imported are sent by value.
"""

from __future__ import annotations

import dataclasses
import math
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from locplan._support.checks import get_usable_memory
from locplan._support.supervision import end_with_parent
from locplan.comparison.planners import PlannerSpec
from locplan.comparison.runs import Job, forbid_core_files, perform_job
from locplan.comparison.statistics import Run
from locplan.errors import LocplanError

LOADING_LIMIT = 600.0
"""Time that a worker has to load the planners [s]; the very first one compiles kernels."""


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
        self._limits = [patience if limit is None else 2 * limit + 10.0 for limit in limits]
        # A fair share by default, so that the machine has some left.
        memory = get_usable_memory() / count if memory is None else memory
        self._greeting = pickle.dumps((memory, _pickle_planners(planners)))
        self._scratch = scratch
        self._orders: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[Run | Exception] = queue.SimpleQueue()
        self._processes: dict[int, _Process] = {}
        self._threads = [
            threading.Thread(target=self._serve, args=[place], daemon=True)
            for place in range(count)
        ]
        self._lock, self._is_closed = threading.Lock(), False

    def __enter__(self) -> Workers:
        for thread in self._threads:  # the processes load meanwhile
            thread.start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        with self._lock:
            self._is_closed = True
        for process in self._processes.values():
            process.end()
        for _ in self._threads:
            self._orders.put(None)
        for thread in self._threads:
            thread.join(1.0)

    def run(self, orders: Sequence[Job]) -> Iterator[Run]:
        """Start the runs in this order as workers become free, and yield each when it is done."""
        for order in orders:
            self._orders.put(order)
        runs_left = len(orders)
        while runs_left:
            with suppress(queue.Empty):
                result = self._results.get(timeout=0.2)
                if isinstance(result, Exception):
                    raise result
                runs_left -= 1
                yield result
            for process in list(self._processes.values()):
                process.end_if_due()

    def _serve(self, place: int) -> None:
        """Pass orders to a process, and replace it when it has ended."""
        try:
            process = self._start(place)
            for order in iter(self._orders.get, None):
                if not process.is_alive:
                    process = self._start(place)
                self._results.put(process.perform(order, self._limits[order.planner]))
        except Exception as error:
            self._results.put(error)
        finally:
            if place in self._processes:
                self._processes[place].close()

    def _start(self, place: int) -> _Process:
        """Return a new process that has loaded the planners."""
        for _ in range(3):
            if place in self._processes:
                self._processes[place].close()
            with self._lock:
                if self._is_closed:
                    raise LocplanError("the comparison has ended")
                self._processes[place] = process = _Process(self._scratch)
            fault = process.ask(self._greeting, LOADING_LIMIT)
            if fault == "":
                return process
            if fault:
                raise LocplanError(f"a planner cannot be used in a worker process: {fault}")
        raise LocplanError(
            "worker processes end before they are ready; the reason is on standard error"
        )


class _Process:
    """A process that loads the planners, and then runs one at a time."""

    def __init__(self, scratch: Path) -> None:
        program = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import run_worker"
        threads = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"
        folders = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(scratch))
        # In a session or group of its own Ctrl-C reaches only the caller.
        self._process = subprocess.Popen(
            [sys.executable, "-c", f"{program}; run_worker({os.getpid()})"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **dict.fromkeys(threads, "1"), **folders},
            start_new_session=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
        self._deadline, self._is_overdue, self._has_been_killed = math.inf, False, False

    @property
    def _pipes(self) -> tuple[IO[bytes], IO[bytes]]:
        """The process's standard input and output."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        return self._process.stdin, self._process.stdout

    @property
    def is_alive(self) -> bool:
        """Whether the process has not ended."""
        return self._process.poll() is None

    def ask(self, message: bytes, limit: float) -> Any:
        """Return the answer to a pickled message; None if the process ends before.

        `end_if_due` ends it after the limit [s].
        """
        orders, answers = self._pipes
        self._deadline = time.perf_counter() + limit
        try:
            orders.write(message)
            orders.flush()
            return pickle.load(answers)
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            return None
        finally:
            self._deadline = math.inf

    def perform(self, order: Job, limit: float) -> Run:
        """Return the run of an order, which may take up to the limit [s]."""
        began = time.perf_counter()
        run: Run | None = self.ask(pickle.dumps(order), limit)
        wall = time.perf_counter() - began
        if run is None:
            status, note = self._failure(limit)
            run = Run(order.task, status, wall, wall, note=note)
        if run.is_aborted:
            self.end()  # nobody knows how much memory one has left that ran out of it
        return dataclasses.replace(run, wall_seconds=wall)

    def end_if_due(self) -> None:
        """End a process that is beyond its limit, and what is left of one that has ended."""
        if self.is_alive and time.perf_counter() > self._deadline:
            self._is_overdue = True
        if self._is_overdue or not self.is_alive:
            self.end()

    def end(self) -> None:
        """Kill the process, with all processes that it has started."""
        if not self._has_been_killed:  # its number may be another's afterwards
            self._has_been_killed = True
            if sys.platform == "win32":
                tree = ["taskkill", "/F", "/T", "/PID", str(self._process.pid)]
                subprocess.run(tree, capture_output=True)
            else:
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def close(self) -> None:
        """End the process, and close the pipes; nobody may wait for an answer."""
        self.end()
        for pipe in self._pipes:
            with suppress(OSError):  # it holds what the process did not read
                pipe.close()

    def _failure(self, limit: float) -> tuple[str, str]:
        """Return status and note of a run that has no answer."""
        if self._is_overdue:
            return "hung", f"gave no answer within {limit:g} s and was ended"
        try:
            code = self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            return "crashed", "its process closed the connection"
        if code >= 0:
            return "crashed", f"its process ended with exit code {code}"
        doubt = ", from outside or for want of memory" if -code == signal.SIGKILL else ""
        return "crashed", f"its process was ended by {signal.Signals(-code).name}{doubt}"


def _pickle_planners(planners: Sequence[PlannerSpec]) -> bytes:
    """Return the planners as they are sent to workers."""
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


def run_worker(parent: int) -> None:
    """Carry out the orders that come from standard input, until it is closed.

    The first message is the memory of a run [bytes] and the planners; the answer is empty, or the
    reason why they cannot be used. The answer to an order is its run.
    """
    orders, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    # A planner reads nothing, and the caller's output has nothing that a planner prints.
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    import cv2

    cv2.setNumThreads(1)  # a run is timed on one core
    end_with_parent(parent)
    forbid_core_files()
    with suppress(EOFError, OSError):  # the caller has closed its end
        memory, pickled = pickle.load(orders)
        try:
            planners: list[PlannerSpec] = pickle.loads(pickled)
            for spec in planners:
                spec.planner.prepare()
        except Exception as error:
            _answer(answers, f"{type(error).__name__}: {error}")
            return
        _answer(answers, "")
        while True:
            order = pickle.load(orders)
            _answer(answers, perform_job(planners[order.planner], order, memory))


def _answer(stream: Any, answer: Any) -> None:
    pickle.dump(answer, stream)
    stream.flush()
