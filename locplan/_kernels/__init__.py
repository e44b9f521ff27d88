"""Kernels by numba: arrays and numbers in, arrays and numbers out; and what numba has compiled."""

from __future__ import annotations

import sys
from typing import Any


def are_cached(*kernels: Any) -> bool:
    """Whether numba's cache holds kernels, for any types; True where that is not known."""
    try:
        return all(kernel._cache._cache_file._load_index() for kernel in kernels)
    except Exception:  # numba does not compile, has changed, or cannot read or write its cache
        return True


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
