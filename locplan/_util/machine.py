"""What the machine has, by which counts are bounded before work begins."""

from __future__ import annotations

import os

from locplan._util.checks import whole
from locplan.errors import ConfigError

THREADS_A_CORE = 32
"""Greatest number of threads for each core."""
WORKERS_A_CORE = 4
"""Greatest number of worker processes for each core."""
WORKER_BYTES = 300_000_000
"""Memory that a worker process takes at least, with its libraries [bytes]."""
PARTS = 0.8
"""Share of the memory that a computation may take."""


def usable_cores() -> int:
    """Number of cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def usable_memory() -> int:
    """Memory that a computation may take [bytes]."""
    try:
        every = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # Windows
        every = 8_000_000_000
    return int(PARTS * every)


def check_threads(threads: int | None) -> int:
    """Return a number of threads, that of the cores for None, within what the cores bear."""
    cores = usable_cores()
    if threads is None:
        return cores
    why = f"{THREADS_A_CORE} for each of this machine's {cores} cores"
    return _at_most("threads", threads, THREADS_A_CORE * cores, why)


def check_workers(workers: int | None) -> int:
    """Return a number of worker processes, that of the cores for None, within what there is."""
    cores = usable_cores()
    if workers is None:
        return cores
    most, why = WORKERS_A_CORE * cores, f"{WORKERS_A_CORE} for each of this machine's {cores} cores"
    if usable_memory() // WORKER_BYTES < most:
        most = max(1, usable_memory() // WORKER_BYTES)
        why = f"{_gb(usable_memory())} of this machine's memory, {_gb(WORKER_BYTES)} each"
    return _at_most("workers", workers, most, why)


def _at_most(name: str, value: int, most: int, why: str) -> int:
    if whole(name, value) > most:
        raise ConfigError(f"{name} must be at most {most} ({why}), not {value}")
    return int(value)


def check_memory(what: str, size: float, remedy: str) -> None:
    """Raise a ConfigError if something takes more memory [bytes] than the machine has."""
    if size > usable_memory():
        raise ConfigError(
            f"{what} take {_gb(size)} of memory, and this machine has {_gb(usable_memory())} for"
            f" them; {remedy}"
        )


def _gb(size: float) -> str:
    return f"{size / 1e9:.3g} GB"
