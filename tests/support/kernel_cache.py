"""Where numba keeps the compiled kernels between test runs.

Numba compiles a kernel again when its own file has changed, but not when a kernel that it calls
has. So each state of all kernels has a folder of its own, named by their digest: no test runs a
kernel of yesterday, and what has not changed is not compiled again, in a new environment neither.
"""

from __future__ import annotations

import hashlib
import os
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
KERNELS = ROOT / "locplan"
FOLDER = ROOT / ".kernel_cache"
VARIABLE = "NUMBA_CACHE_DIR"


def digest_of(kernels: Path, numba: str) -> str:
    """Return the digest of all sources in folders of kernels, their names, and numba's version."""
    digest = hashlib.sha256(numba.encode())
    for file in sorted(file for file in kernels.rglob("*.py") if "kernels" in file.parts):
        source = hashlib.sha256(file.read_bytes()).hexdigest()
        digest.update(f"\n{file.relative_to(kernels).as_posix()} {source}".encode())
    return digest.hexdigest()[:16]


def keep_kernels(folder: Path = FOLDER, kernels: Path = KERNELS) -> None:
    """Tell numba the folder, unless the user has, or it cannot be written."""
    if os.environ.get(VARIABLE):
        return
    own = folder / digest_of(kernels, version("numba"))
    try:
        own.mkdir(parents=True, exist_ok=True)
        (own / f".{os.getpid()}").touch()
        (own / f".{os.getpid()}").unlink()
    except OSError:
        return  # numba takes a folder of its own
    os.environ[VARIABLE] = str(own)
