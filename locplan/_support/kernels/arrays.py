"""Types of the kernels' arrays, and the array by which threads stop and follow a kernel."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]
Floats: TypeAlias = NDArray[np.float64]
Singles: TypeAlias = NDArray[np.float32]
Ints: TypeAlias = NDArray[np.int64]
Bools: TypeAlias = NDArray[np.bool_]
Octets: TypeAlias = NDArray[np.uint8]
Shorts: TypeAlias = NDArray[np.uint16]
Words: TypeAlias = NDArray[np.uint64]
Numbers: TypeAlias = tuple[Any, ...]
Random: TypeAlias = np.random.Generator

STOP, N_DONE = 0, 1
"""Indices in the shared array `control`: a flag to stop early, and the number of places done."""
