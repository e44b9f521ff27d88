"""The folder of compiled kernels between test runs, in the checkout.

The package keeps each state of all kernels apart in it, so no test runs a kernel of yesterday.
"""

from __future__ import annotations

import os
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / ".kernel_cache"
VARIABLE = "NUMBA_CACHE_DIR"


def keep_kernels() -> None:
    """Name the folder to the package and to numba, unless the user has named another."""
    if not os.environ.get(VARIABLE):
        os.environ[VARIABLE] = str(FOLDER)
