"""Kernels by numba: arrays and numbers in, arrays and numbers out.

Here are the types of their arrays, how another thread follows and stops one that runs, and what
numba has compiled. numpy and numba are not imported by this: whoever shows progress asks it.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Array: TypeAlias = "NDArray[Any]"
Floats: TypeAlias = "NDArray[np.float64]"
Singles: TypeAlias = "NDArray[np.float32]"
Ints: TypeAlias = "NDArray[np.int64]"
Bools: TypeAlias = "NDArray[np.bool_]"
Octets: TypeAlias = "NDArray[np.uint8]"
Shorts: TypeAlias = "NDArray[np.uint16]"
Words: TypeAlias = "NDArray[np.uint64]"
Numbers: TypeAlias = "tuple[Any, ...]"
Random: TypeAlias = "np.random.Generator"

STOP, DONE = 0, 1
"""Places in the array `control` that threads share: set to stop early, and the places done."""


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
