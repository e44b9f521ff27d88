"""Computing on a cluster of dask.distributed."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any

from locplan.errors import LocplanError

PATIENCE = 10.0
"""Longest time that the scheduler may take to answer [s]."""
WORKERLESS = 60.0
"""Longest time to wait for workers to come back when all are gone [s]."""


@contextmanager
def executor_of(scheduler: str) -> Iterator[Executor]:
    """Yield an executor on the cluster of a scheduler, such as ``tcp://192.168.1.2:8786``.

    If a worker dies, other workers compute its tiles. The workers need locplan.
    """
    try:
        from distributed import Client
    except ImportError:
        raise LocplanError("a scheduler needs dask: pip install 'locplan[dask]'") from None
    for name in ("distributed", "distributed.client"):  # our own error reports failures once
        logging.getLogger(name).setLevel(logging.CRITICAL)
    client = _connected(Client, scheduler)
    with client:
        if not client.scheduler_info()["workers"]:
            raise LocplanError(f"the scheduler {scheduler} has no workers; start some first")
        executor, over = client.get_executor(), threading.Event()
        threading.Thread(target=_watch, args=(client, executor, over), daemon=True).start()
        try:
            yield executor
        finally:
            over.set()


def _connected(client: Any, scheduler: str) -> Any:
    """Connect in a thread, since a server that is no scheduler may never finish its answer."""
    answer: Future[Any] = Future()

    def connect() -> None:
        try:
            answer.set_result(client(scheduler, timeout=PATIENCE, set_as_default=False))
        except Exception as error:  # a wrong server's answer fails in many ways
            answer.set_exception(error)

    threading.Thread(target=connect, daemon=True).start()
    try:
        return answer.result(timeout=PATIENCE + 2)
    except Exception as error:
        what = " ".join(str(error).split())[:120] or "it may be no dask scheduler"
        raise LocplanError(f"the scheduler {scheduler} does not answer ({what})") from None


def _watch(client: Any, executor: Any, over: threading.Event) -> None:
    """Cancel the tiles when the cluster has had no worker for `WORKERLESS` seconds."""
    seen = time.monotonic()
    while not over.wait(min(2.0, WORKERLESS / 4)):
        if client.scheduler_info()["workers"]:
            seen = time.monotonic()
        elif time.monotonic() - seen > WORKERLESS:
            executor.shutdown(wait=False)
            return
