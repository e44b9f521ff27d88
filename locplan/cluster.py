"""Computing on a cluster of dask.distributed."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from locplan.errors import LocplanError

PATIENCE = "10 s"
"""How long the scheduler may take to answer."""


@contextmanager
def executor_of(scheduler: str) -> Iterator[Executor]:
    """An executor on the cluster of a scheduler, such as ``tcp://192.168.1.2:8786``.

    Tiles of workers that die are computed by others. The workers need locplan.

    Raises
    ------
    LocplanError
        If dask.distributed is not installed, or the scheduler does not answer.
    """
    try:
        from distributed import Client
    except ImportError:
        raise LocplanError("a scheduler needs dask: pip install 'locplan[dask]'") from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # errors are told once, below
    try:
        client = Client(scheduler, timeout=PATIENCE)
    except (OSError, ValueError, TypeError) as error:
        what = " ".join(str(error).split())[:120]
        raise LocplanError(f"the scheduler {scheduler} does not answer ({what})") from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise LocplanError(f"the scheduler {scheduler} has no workers; start some first")
        yield client.get_executor()
