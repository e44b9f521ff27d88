"""Paths as callers give them: paths, results that have one, arrays, and several of these."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from locplan._kernels.arrays import Floats, Ints
from locplan.costs._path import Path, numbers_of
from locplan.errors import LocplanError


class HasPath(Protocol):
    """A result with a path, such as a `Plan`."""

    @property
    def path(self) -> Path | None:
        """The path; None if there is none."""


AnyPath = Path | HasPath | ArrayLike
"""A path, a plan that has one, or an (n, 2) or (n, 3) array of positions or poses [m, m, rad]."""


def path_from(given: AnyPath) -> Path:
    """Return the path that a path, a plan or an array is.

    Parameters
    ----------
    given : Path, Plan, or (n, 2) or (n, 3) array
        The path; the third column of an array has headings [rad].

    Raises
    ------
    LocplanError
        If it is none of them, or a plan without a path.
    """
    path = getattr(given, "path", given)
    if isinstance(path, Path):
        return path
    if path is None and given is not None:
        raise LocplanError("the plan has no path; its status and note tell why")
    fault = "a path must be a Path, a plan, or an (n, 2) or (n, 3) array [m, m, rad]"
    poses = numbers_of(path, fault)
    if poses.ndim != 2 or poses.shape[1] not in (2, 3):
        raise LocplanError(f"{fault}, not {poses.shape}")
    return Path(poses[:, :2], poses[:, 2] if poses.shape[1] == 3 else None)


def poses_of_paths(given: AnyPath | Sequence[AnyPath]) -> tuple[Floats, Ints, bool]:
    """Return the poses of one path or several, their numbers, and whether it is a single path.

    Parameters
    ----------
    given : Path, Plan, or (n, 2) or (n, 3) array, or several of them
        One path as of `path_from`; a list of such paths, or an array (m, n, 2) or (m, n, 3).

    Returns
    -------
    poses : (k, 3) array
        Poses of all paths, one path after the other; the heading is NaN if a path has none.
    sizes : (m,) array
        Number of poses of each path, at least 1.
    is_single : bool
        Whether the caller gave one path and not several.
    """
    is_single = not _are_several(given)
    several: Any = [given] if is_single else given
    if isinstance(several, np.ndarray) and several.size:  # checked as one, for speed
        sizes = np.full(len(several), several.shape[1])
        return _poses_of(path_from(several.reshape(-1, several.shape[2]))), sizes, False
    poses = [_poses_of(path_from(path)) for path in several]
    sizes = np.array([len(part) for part in poses], np.int64)
    return np.concatenate([np.empty((0, 3)), *poses]), sizes, is_single


def _poses_of(path: Path) -> Floats:
    return np.column_stack(
        [path.xy, np.nan * path.xy[:, 0] if path.heading is None else path.heading]
    )


def _are_several(given: object) -> bool:
    """True if these are paths, and not the positions of one."""
    if isinstance(given, np.ndarray):
        return given.ndim == 3
    if not isinstance(given, (list, tuple)) or not given:
        return False
    first = given[0]
    if isinstance(first, (list, tuple)):
        return bool(first) and isinstance(first[0], (list, tuple, np.ndarray))
    return isinstance(first, Path) or hasattr(first, "path") or np.ndim(first) == 2
