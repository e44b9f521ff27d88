"""Computing the covariance field of a map, here or on a cluster of dask.distributed."""

from __future__ import annotations

import logging
import re
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any

from locplan._kernels.arrays import Bools
from locplan._util.checks import shown
from locplan._util.progress import ProgressCallback
from locplan._util.public import needed
from locplan.errors import LocplanError
from locplan.field import _tiles as tiles
from locplan.field._config import FieldConfig, config_of
from locplan.field._estimator import Estimator
from locplan.field._field import CovarianceField
from locplan.maps import OccupancyGrid, check_grid


def covariance_field(
    grid: OccupancyGrid,
    config: FieldConfig | Estimator | None = None,
    *,
    points: Bools | None = None,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: ProgressCallback | None = None,
) -> CovarianceField:
    """Compute the covariance of a pose match over the free cells of a map.

    It is evaluated on every lattice point (`config.stride` apart) in a free cell. A free cell
    without such a point around it adds its nearest lattice point.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    config : FieldConfig or Estimator, optional
        Estimator and lattice; `Sad()` by default.
    points : (h, w) array of bool, optional
        Lattice points to evaluate, by default all: point (i, j) is cell (i, j) times the stride.
        The others are read from those around them. A few points take a fraction of the time.
    threads : int, optional
        Number of threads, >= 1; all cores by default. The result does not depend on it.
    executor : concurrent.futures.Executor, optional
        Executor that runs the tiles instead of threads: a process pool, or a cluster by
        dask.distributed's ``client.get_executor()``. Its workers need locplan.
    progress : callable, optional
        Function that is called with (done, total) cells from time to time.

    Raises
    ------
    ConfigError
        If the config does not fit the map's resolution, `points` is no mask of the lattice, or
        `threads` is below 1.
    FieldError
        If the executor fails, or the estimator's values are no covariances or change with the map
        beyond its halo, see `locplan.field.Estimator.covariances`.

    Examples
    --------
    >>> import numpy as np
    >>> from locplan.field import Sad
    >>> from locplan.maps import FREE
    >>> grid = OccupancyGrid(np.full((30, 30), FREE), resolution=0.1)
    >>> field = covariance_field(grid, Sad(range=0.5))
    >>> field.covariance.shape
    (15, 15, 3, 3)
    """
    check_grid(grid)
    config = config_of(config)
    values = tiles.nothing_known(grid, config)
    needed = tiles.needed_points(grid, config, points)
    for _ in tiles.finished_chunks(values, grid, config, threads, executor, progress, needed):
        pass
    return CovarianceField.of(values, grid, config)


PATIENCE = 10.0
"""Longest time that the scheduler may take to answer [s]."""


WORKERLESS = 60.0
"""Longest time to wait for workers to come back when all are gone [s]."""


@contextmanager
def executor_of(scheduler: str) -> Iterator[Executor]:
    """Yield an executor on the cluster of a dask scheduler.

    If a worker dies, other workers compute its tiles. The workers need locplan.

    Parameters
    ----------
    scheduler : str
        Address of the scheduler, such as ``tcp://192.168.1.2:8786``.

    Raises
    ------
    LocplanError
        If it is no address, does not answer, or has no workers.
    """
    check_scheduler(scheduler)
    from distributed import Client

    # A client that never connected cannot be closed: only the block below closes one.
    unclosed: Any = type("UnclosedClient", (Client,), {"__del__": lambda _: None})
    for name in ("distributed", "distributed.client"):  # our own error reports failures once
        logging.getLogger(name).setLevel(logging.CRITICAL)
    client = _connected(unclosed, scheduler)
    with client:
        if not client.scheduler_info()["workers"]:
            raise LocplanError(f"the scheduler {scheduler} has no workers; start some first")
        executor, over = client.get_executor(), threading.Event()
        threading.Thread(target=_watch, args=(client, executor, over), daemon=True).start()
        try:
            yield executor
        finally:
            over.set()


def check_scheduler(scheduler: str) -> None:
    """Check the address of a scheduler without connecting to it.

    Parameters
    ----------
    scheduler : str
        See `executor_of`.

    Raises
    ------
    LocplanError
        If it is no address, or dask is not installed.
    """
    host = r"[^\s/:\[\]]+|\[[\da-fA-F:.]+\]"
    found = re.fullmatch(rf"((tcp|tls|ws|wss)://)?({host}):(?P<port>[0-9]{{1,5}})", scheduler)
    if not found or not 0 < int(found["port"]) < 2**16:
        raise LocplanError(
            f"the scheduler must be an address such as tcp://192.168.1.2:8786, not"
            f" {shown(scheduler)}"
        )
    needed("distributed", "dask", "a scheduler")


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
        what = " ".join(str(error).split()).rstrip(".")[:120] or "it may be no dask scheduler"
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
