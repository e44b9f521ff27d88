"""Properties of the machine: data next to the project, rights, and how long to wait."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

TIMEOUT = 600.0
"""Time after which an answer does not come any more, however busy the machine is [s]."""


SHARED_DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


respects_permissions = pytest.mark.skipif(
    sys.platform == "win32" or getattr(os, "geteuid", int)() == 0,
    reason="no permission stops root, nor are folders read-only on Windows",
)
