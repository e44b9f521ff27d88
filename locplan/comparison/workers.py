"""Worker processes: a planner that crashes, hangs or takes all memory costs one run.

pebble.ProcessPool 5.2 does not suffice. Its spawned and forkserver workers import a script again,
and fail without ``if __name__ == "__main__"``. Its forks die if numba's OpenMP threads have run in
the caller. Processes that a planner has started survive. A planner that hangs in native code blocks
the pool for three seconds.

Workers are new interpreters. They read jobs from their standard input and write runs to their
original standard output. Functions that cannot be imported are sent by value.
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
from locplan._support.user_cache import find_kernel_root
from locplan.comparison.planners import PlannerSpec
from locplan.comparison.runs import PlannerJob, forbid_core_files, perform_job
from locplan.comparison.statistics import PlannerRun
from locplan.errors import LocplanError

LOADING_LIMIT = 600.0
"""Time limit for a worker to load the planners [s]; the first one compiles kernels."""


class WorkerPool:
    """A pool of processes that run planners; as a context manager it ends them all.

    At most `count` processes run at once. `Execution` describes `memory` [bytes] and `patience`
    [s]. The folder `scratch` is for temporary files of planners, since killed processes leave
    theirs behind.
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
        # By default a fair share, so that some memory remains.
        memory = get_usable_memory() / count if memory is None else memory
        self._setup_message = pickle.dumps((memory, _pickle_planners(planners)))
        self._scratch = scratch
        self._jobs: queue.SimpleQueue[PlannerJob | None] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[PlannerRun | Exception] = queue.SimpleQueue()
        self._processes: dict[int, _WorkerProcess] = {}
        self._threads = [
            threading.Thread(target=self._serve_jobs, args=[place], daemon=True)
            for place in range(count)
        ]
        self._lock, self._is_closed = threading.Lock(), False

    def __enter__(self) -> WorkerPool:
        for thread in self._threads:  # the processes load in the background
            thread.start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        with self._lock:
            self._is_closed = True
        for process in self._processes.values():
            process.end()
        for _ in self._threads:
            self._jobs.put(None)
        for thread in self._threads:
            thread.join(1.0)

    def perform_jobs(self, jobs: Sequence[PlannerJob]) -> Iterator[PlannerRun]:
        """Perform jobs in this order as workers become free, and yield runs as they complete."""
        for job in jobs:
            self._jobs.put(job)
        runs_left = len(jobs)
        while runs_left:
            with suppress(queue.Empty):
                result = self._results.get(timeout=0.2)
                if isinstance(result, Exception):
                    raise result
                runs_left -= 1
                yield result
            for process in list(self._processes.values()):
                process.end_if_due()

    def _serve_jobs(self, worker_number: int) -> None:
        """Pass jobs to a process, and replace the process after it has ended."""
        try:
            process = self._start_worker(worker_number)
            for job in iter(self._jobs.get, None):
                if not process.is_alive:
                    process = self._start_worker(worker_number)
                self._results.put(process.run_job(job, self._limits[job.planner]))
        except Exception as error:
            self._results.put(error)
        finally:
            if worker_number in self._processes:
                self._processes[worker_number].close()

    def _start_worker(self, worker_number: int) -> _WorkerProcess:
        """Return a new process with the planners loaded."""
        for _ in range(3):
            if worker_number in self._processes:
                self._processes[worker_number].close()
            with self._lock:
                if self._is_closed:
                    raise LocplanError("the comparison has ended")
                self._processes[worker_number] = process = _WorkerProcess(self._scratch)
            fault = process.request_answer(self._setup_message, LOADING_LIMIT)
            if fault == "":
                return process
            if fault:
                raise LocplanError(f"a planner cannot be used in a worker process: {fault}")
        raise LocplanError(
            "worker processes end before they are ready; see the reason on standard error"
        )


class _WorkerProcess:
    """A process that loads the planners, and then runs one at a time."""

    def __init__(self, scratch: Path) -> None:
        program = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import run_worker"
        threads = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"
        folders = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(scratch))
        folders["NUMBA_CACHE_DIR"] = str(find_kernel_root())  # it may be a temporary folder
        # A separate session or group, so that Ctrl-C reaches only the caller.
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
        """True if the process has not ended."""
        return self._process.poll() is None

    def request_answer(self, message: bytes, time_limit: float) -> Any:
        """Return the answer to a pickled message; None if the process ends first.

        `end_if_due` ends it after the limit [s].
        """
        jobs, answers = self._pipes
        self._deadline = time.perf_counter() + time_limit
        try:
            jobs.write(message)
            jobs.flush()
            return pickle.load(answers)
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            return None
        finally:
            self._deadline = math.inf

    def run_job(self, job: PlannerJob, time_limit: float) -> PlannerRun:
        """Return the run of a job, which may take up to the limit [s]."""
        began = time.perf_counter()
        run: PlannerRun | None = self.request_answer(pickle.dumps(job), time_limit)
        wall = time.perf_counter() - began
        if run is None:
            status, note = self._describe_failure(time_limit)
            run = PlannerRun(job.task, status, wall, wall, note=note)
        if run.is_aborted:
            self.end()  # after it ran out of memory, the remaining memory is unknown
        return dataclasses.replace(run, wall_seconds=wall)

    def end_if_due(self) -> None:
        """End a process that has exceeded its limit, and the children of an ended process."""
        if self.is_alive and time.perf_counter() > self._deadline:
            self._is_overdue = True
        if self._is_overdue or not self.is_alive:
            self.end()

    def end(self) -> None:
        """Kill the process and all processes that it has started."""
        if not self._has_been_killed:  # afterwards the system may reuse its id
            self._has_been_killed = True
            if sys.platform == "win32":
                tree = ["taskkill", "/F", "/T", "/PID", str(self._process.pid)]
                subprocess.run(tree, capture_output=True)
            else:
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def close(self) -> None:
        """End the process and close its pipes; no thread may be waiting for an answer."""
        self.end()
        for pipe in self._pipes:
            with suppress(OSError):  # closing flushes data that the process did not read
                pipe.close()

    def _describe_failure(self, time_limit: float) -> tuple[str, str]:
        """Return status and note of a run without an answer."""
        if self._is_overdue:
            return "hung", f"was ended without an answer after {time_limit:g} s"
        try:
            code = self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            return "crashed", "its process closed the connection"
        if code >= 0:
            return "crashed", f"its process ended with exit code {code}"
        doubt = ", by another program or for lack of memory" if -code == signal.SIGKILL else ""
        return "crashed", f"its process was ended by {signal.Signals(-code).name}{doubt}"


def _pickle_planners(planners: Sequence[PlannerSpec]) -> bytes:
    """Return the pickled planners for workers."""
    remedy = "put it into a module"
    try:
        from cloudpickle import dumps
    except ModuleNotFoundError:  # then all planners are locplan's, see `make_specs`
        from pickle import dumps

        remedy = "pip install 'locplan[functions]'"
    try:
        return bytes(dumps(list(planners)))
    except Exception as error:  # pickling fails in many ways
        raise LocplanError(
            f"a planner cannot be sent to a worker process ({error}); {remedy}"
        ) from None


def run_worker(parent_pid: int) -> None:
    """Perform the jobs from standard input until it is closed.

    The first message has the memory limit of a run [bytes] and the planners; the answer is empty,
    or the reason why the planners cannot be used. The answer to a job is its run.
    """
    jobs, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    # A planner cannot read standard input, and its prints do not reach the caller's output.
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    import cv2

    cv2.setNumThreads(1)  # a run is timed on one core
    end_with_parent(parent_pid)
    forbid_core_files()
    with suppress(EOFError, OSError):  # the caller has closed the pipe
        memory, pickled = pickle.load(jobs)
        try:
            planners: list[PlannerSpec] = pickle.loads(pickled)
            for spec in planners:
                spec.planner.prepare()
        except Exception as error:
            _send_answer(answers, f"{type(error).__name__}: {error}")
            return
        _send_answer(answers, "")
        while True:
            job = pickle.load(jobs)
            _send_answer(answers, perform_job(planners[job.planner], job, memory))


def _send_answer(stream: Any, answer: Any) -> None:
    pickle.dump(answer, stream)
    stream.flush()
