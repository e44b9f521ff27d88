"""The user's folder for cached results and compiled kernels, and a substitute for it.

The substitute lies in the system's folder for temporary files. It is for containers whose user has
no home, and for homes that cannot be written.
"""

from __future__ import annotations

import logging
import os
import stat
from functools import cache
from pathlib import Path

LOG = logging.getLogger(__name__)


def find_user_cache() -> Path:
    """Return the user's cache folder, or the substitute if only that can be written.

    Logs the substitute once.
    """
    folder, substitute = choose_user_cache()
    if substitute is None:
        return folder
    _log_substitute(folder, substitute)
    return substitute


def find_kernel_root() -> Path:
    """Return the folder of compiled kernels: NUMBA_CACHE_DIR, or one in the user's cache."""
    configured = os.environ.get("NUMBA_CACHE_DIR")
    if configured and can_write(folder := Path(configured).absolute()):
        return folder
    return find_user_cache() / "kernels"


def choose_user_cache() -> tuple[Path, Path | None]:
    """Return the user's cache folder, and the substitute if one is needed and can be made."""
    from platformdirs import user_cache_path

    try:
        folder = user_cache_path("locplan")
    except RuntimeError:  # the system knows no home of this user
        folder = Path("~/.cache/locplan")
    if folder.is_absolute() and can_write(folder):
        return folder, None
    return folder, _make_private_folder()


def can_write(folder: Path) -> bool:
    """True if files can be written to a folder, which need not exist yet."""
    for place in (folder, *folder.parents):
        if os.path.lexists(place):
            return place.is_dir() and os.access(place, os.W_OK | os.X_OK)
    return False


def _make_private_folder() -> Path | None:
    """Return a temporary folder that only this user can write; None if there is none.

    Compiled kernels are code, so a folder that another user made must not be used.
    """
    from tempfile import gettempdir

    try:
        folder = Path(gettempdir(), f"locplan-{os.getuid() if hasattr(os, 'getuid') else 'cache'}")
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return None
    if os.name != "posix":
        return folder  # temporary files of Windows belong to one user
    is_private = stat.S_ISDIR(status.st_mode) and not status.st_mode & 0o022
    return folder if is_private and status.st_uid == os.getuid() else None


@cache
def _log_substitute(folder: Path, substitute: Path) -> None:
    LOG.warning(
        "%s cannot be written, so the cache is in %s; set HOME to a writable folder to keep it",
        folder,
        substitute,
    )
