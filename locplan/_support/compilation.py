"""numba's compiler for the kernels, and the folder of their machine code.

numba compiles a kernel again if its own file has changed, but not if a kernel that it calls has.
So each state of all kernels has its own folder, named by their digest. It lies in the user's cache,
since an installed package often cannot be written.

Compilation takes most of the first run. Loops over numbers compile in a third of the time that
array functions such as `np.full`, `np.argmax` and masks take. Each type of an argument compiles a
kernel again, also the order of an array and the constant 0, whose type differs from that of other
integers.
"""

from __future__ import annotations

import hashlib
import logging
import os
import re
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numba
from numba.core import config, event as events

from locplan import __version__
from locplan._support import progress
from locplan._support.user_cache import find_kernel_root

LOG = logging.getLogger(__name__)
PACKAGE = Path(__file__).resolve().parents[1]
PREFIX = "locplan-"
_NAME = re.compile(re.escape(PREFIX) + "[0-9a-f]{16}")
MAX_UNUSED_DAYS = 7
"""Time after which kernels of other versions are removed [days]."""


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return numba's decorator `njit`, which caches machine code in the folder of this version."""

    def decorate(function: Callable[..., Any]) -> Any:
        folder = find_kernel_folder()
        # Nothing calls a kernel from C, so numba need not compile an entry for that.
        all_options = options | {
            "cache": bool(options.get("cache") and folder),
            "no_cfunc_wrapper": True,
        }
        previous, config.CACHE_DIR = config.CACHE_DIR, str(folder or "")
        try:
            return numba.njit(**all_options)(function)
        finally:
            config.CACHE_DIR = previous

    return decorate


@cache
def find_kernel_folder() -> Path | None:
    """Return the folder of the machine code of these kernels; None if it cannot be written."""
    root = find_kernel_root()
    folder = root / f"{PREFIX}{compute_digest(PACKAGE)}"
    try:
        is_new = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)  # it is in use
        TemporaryFile(dir=folder).close()  # numba fails if it cannot write
    except OSError:
        return None
    if is_new:
        _remove_unused_folders(root)
    return folder


def compute_digest(package: Path) -> str:
    """Return the digest of all files in folders of kernels, and of the versions."""
    digest = hashlib.sha256(f"{__version__} {numba.__version__}".encode())
    for file in sorted(package.glob("**/kernels/**/*.py")):
        source = hashlib.sha256(file.read_bytes()).hexdigest()
        digest.update(f"\n{file.relative_to(package).as_posix()} {source}".encode())
    return digest.hexdigest()[:16]


def _remove_unused_folders(root: Path) -> None:
    """Remove machine code that no process has used for some days."""
    oldest = time.time() - MAX_UNUSED_DAYS * 86400.0
    for folder in root.iterdir():
        if _NAME.fullmatch(folder.name):
            with suppress(OSError):  # another process has removed it
                if folder.stat().st_mtime < oldest:
                    shutil.rmtree(folder, ignore_errors=True)


def is_compiling() -> bool:
    """True if a kernel is being compiled."""
    return _compilations.depth > 0


class CompilationLog(events.Listener):  # type: ignore[misc]
    """Listener that logs once that kernels are compiled, if that takes more than a second."""

    def __init__(self) -> None:
        self.depth, self._seconds, self._began = 0, 0.0, 0.0
        self._is_logged = False

    def on_start(self, event: Any) -> None:
        """Note that a function is being compiled, or one that it calls."""
        if self.depth == 0:
            self._began = time.monotonic()
        self.depth += 1
        self._log_if_long(event)

    def on_end(self, event: Any) -> None:
        """Note that a function is compiled."""
        self._log_if_long(event)
        self.depth -= 1
        if self.depth == 0:
            self._seconds += time.monotonic() - self._began

    def _log_if_long(self, event: Any) -> None:
        seconds = self._seconds + time.monotonic() - self._began
        is_kernel = event.data["dispatcher"].py_func.__module__.startswith("locplan.")
        if self._is_logged or not is_kernel or seconds < progress.DISPLAY_DELAY:
            return
        self._is_logged = True
        if find_kernel_folder():
            LOG.info("compiling kernels for their first use, which takes up to a minute")
        else:
            LOG.info(
                "compiling kernels, which takes up to a minute in each run; to keep them, set"
                " NUMBA_CACHE_DIR to a folder that can be written"
            )


_compilations = CompilationLog()
events.register("numba:compile", _compilations)
