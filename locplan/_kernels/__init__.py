"""Kernels by numba: arrays and numbers in, arrays and numbers out; whether numba compiles."""

from __future__ import annotations

import sys


def is_compiling() -> bool:
    """Whether another thread compiles a kernel just now; False where that is not known."""
    try:
        lock = sys.modules["numba.core.compiler_lock"].global_compiler_lock._lock
    except (KeyError, AttributeError):  # nothing has imported numba yet
        return False
    free = lock.acquire(blocking=False)
    if free:
        lock.release()
    return not free
