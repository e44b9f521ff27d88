"""The poses of a whole map that explain a scan best."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from locplan._util.poses import Numbers
from locplan._util.progress import ProgressCallback
from locplan.matching._database import CAP, Database
from locplan.matching._matching import STEP, TURNS

Result = TypeVar("Result")
MIN_RETURNS = 5
"""Number of returns below which a scan says nothing about its pose."""
APART, TURNED = 0.8, 0.5
"""Distance [m] and angle [rad] below which two modes are one."""
THIN, THIN_TURN = 0.6, 0.25
"""Distance [m] and angle [rad] from a better one below which a pair is not refined."""
ENOUGH = 8.0
"""Excess over the best pose up to which all modes are found [nats]."""
SLACK = 8.0
"""By how much the refinement with the widest deviation lowers a start's loss at most [nats]."""
AWAY = 2.0
"""Distance from the true position from which on a match is wrong [m]."""
BARRIER = 1.0
"""Rise of the loss between two modes from which on they are not joined [nats]."""
SLIDE, SLIDE_STEP = 4.0, 0.2
"""Greatest distance of two modes that are joined, and the steps of the way between them [m]."""
BATCH = 16
"""Number of scans that a thread matches at a time, by default."""
NO_HOME = np.full(2, np.nan)


@dataclass(frozen=True, eq=False)
class Modes:
    """The poses that explain a scan best, the best first."""

    poses: Numbers
    """x, y [cells] and heading [rad] of each on the map, (n, 3)."""
    losses: Numbers
    """Loss of each, (n,) [nats]."""
    returns: int
    """Number of the scan's beams that return; below `MIN_RETURNS` there are no modes."""


def find_modes(database: Database, ranges: Numbers, home: Numbers | None = None) -> Modes:
    """Match one scan with the whole map.

    Parameters
    ----------
    database : Database
        The map, from `make_database`.
    ranges : (96,) array
        Ranges of the beams in `Matching.bearings` [m]: infinite without a return, NaN where
        nothing is known. A beam that is neither is compared.
    home : (3,) array, optional
        A pose, x, y [cells] and heading on the map, from which the search begins, too. The best
        mode more than 2 m from it is found whatever its loss.
    """
    return refined(database, ranges, shortlisted(database, ranges), home)


def shortlisted(database: Database, ranges: Numbers) -> Numbers:
    """Poses of the robot whose ranges are nearest to a scan's, x, y [cells], heading, (n, 3).

    Parameters
    ----------
    database : Database
        What the lidar sees on the map.
    ranges : (96,) array
        Ranges of one scan, as `find_modes` takes them [m].
    """
    from locplan._kernels.matches import shortlist
    from locplan._kernels.scan_losses import unlike

    matching, resolution = database.matching, database.grid.resolution
    returns = np.isfinite(ranges)
    if returns.sum() < MIN_RETURNS:
        return np.empty((0, 3))
    compared = _interleaved(returns | np.isposinf(ranges) if matching.count_missing else returns)
    codes = database.codes_of(ranges)[compared]
    places = len(database.positions)
    _, where = shortlist(database.codes, places, compared, codes, CAP, matching.shortlisted)
    place, turn = np.divmod(where, TURNS)
    heading = turn * STEP
    starts = np.column_stack([_robot(database, database.positions[place], heading), heading])
    kept = unlike(starts, np.arange(len(starts)), THIN / resolution, THIN_TURN)
    return np.asarray(starts[kept])


def refined(
    database: Database, ranges: Numbers, starts: Numbers, home: Numbers | None = None
) -> Modes:
    """Modes to which some poses lead.

    Parameters
    ----------
    database : Database
        What the lidar sees on the map.
    ranges : (96,) array
        Ranges of one scan, as `find_modes` takes them [m].
    starts : (n, 3) array
        The poses, as `shortlisted` gives them.
    home : (3,) array, optional
        See `find_modes`.
    """
    from locplan._kernels.scan_losses import modes

    matching, resolution = database.matching, database.grid.resolution
    returns = np.isfinite(ranges)
    count = int(returns.sum())
    if count < MIN_RETURNS:
        return Modes(np.empty((0, 3)), np.empty(0), count)
    if home is not None:
        starts = np.concatenate([home[None], starts])
    poses, losses = modes(
        database.tables,
        ends_of(database, ranges),
        starts,
        turning_lever(database, ranges),
        ENOUGH / _nats(database),
        SLACK / _nats(database),
        NO_HOME if home is None else home[:2],
        AWAY / resolution,
        APART / resolution,
        TURNED,
    )
    losses = losses * _nats(database)
    if matching.count_missing and len(poses):
        losses = losses + _missing(database, ranges, poses)
        order = np.argsort(losses, kind="stable")
        poses, losses = poses[order], losses[order]
    return Modes(poses, losses, count)


def find_all_modes(
    database: Database,
    ranges: Numbers,
    *,
    threads: int = 1,
    progress: ProgressCallback | None = None,
) -> list[Modes]:
    """Match scans with the whole map, each as `find_modes` does.

    Parameters
    ----------
    database : Database
        What the lidar sees on the map.
    ranges : (n, 96) array
        The scans [m].
    threads : int, default 1
        Number of threads.
    progress : callable, optional
        Called with (done, total) scans.
    """

    def match(some: NDArray[np.int64]) -> list[Modes]:
        return [find_modes(database, ranges[n]) for n in some]

    return in_batches(match, len(ranges), threads, progress)


def in_batches(
    work: Callable[[NDArray[np.int64]], Sequence[Result]],
    count: int,
    threads: int,
    progress: ProgressCallback | None = None,
    batch: int = BATCH,
) -> list[Result]:
    """Results of numbers 0 to count - 1, which threads work at in batches.

    Parameters
    ----------
    work : callable
        Gives the results of some of the numbers.
    count : int
        How many there are.
    threads : int
        Number of threads.
    progress : callable, optional
        Called with (done, total) numbers.
    batch : int, default 16
        How many a thread takes at a time.
    """
    found: list[Result] = []
    batches = np.array_split(np.arange(count), max(1, -(-count // batch)))
    with ThreadPoolExecutor(threads) as pool:
        for some in pool.map(work, batches):
            found.extend(some)
            if progress:
                progress(len(found), count)
    return found


def joined_to(database: Database, ranges: Numbers, found: Modes, first: int) -> NDArray[np.bool_]:
    """Mask of the modes that a pose can slide to from the first one without a rise of the loss.

    Only those whose excess over the first is up to 8 nats count.

    Parameters
    ----------
    database : Database
        What the lidar sees on the map.
    ranges : (96,) array
        Ranges of one scan, as `find_modes` takes them [m].
    found : Modes
        All modes of the scan.
    first : int
        Number of the first one.
    """
    from locplan._kernels.scan_losses import joined_modes

    resolution = database.grid.resolution
    low = np.flatnonzero(found.losses <= found.losses[first] + ENOUGH)
    joined = np.zeros(len(found.losses), bool)
    joined[low] = joined_modes(
        database.tables,
        ends_of(database, ranges),
        found.poses[low],
        found.losses[low] / _nats(database),
        int(np.searchsorted(low, first)),
        BARRIER / _nats(database),
        SLIDE / resolution,
        TURNED,
        SLIDE_STEP / resolution,
    )
    return joined


def ends_of(database: Database, ranges: Numbers) -> NDArray[np.float32]:
    """Ends of the beams that return, ahead and to the left of the robot, (2, k) [cells].

    Parameters
    ----------
    database : Database
        What the lidar sees on the map.
    ranges : (96,) array
        Ranges of one scan, as `find_modes` takes them [m].
    """
    returns = np.isfinite(ranges)
    bearing, away = database.matching.bearings[returns], ranges[returns] / database.grid.resolution
    forward, left = database.lever
    ends = np.array([forward + away * np.cos(bearing), left + away * np.sin(bearing)])
    return ends.astype(np.float32)


def turning_lever(database: Database, ranges: Numbers) -> float:
    """Root mean square of the ranges, by which turns are made comparable with moves [cells].

    Parameters
    ----------
    database : Database
        What the lidar sees on the map.
    ranges : (96,) array
        Ranges of one scan, as `find_modes` takes them [m].
    """
    away = ranges[np.isfinite(ranges)] / database.grid.resolution
    return max(1.0, math.sqrt(float((away**2).mean())))


def losses_at(database: Database, ranges: Numbers, poses: Numbers) -> Numbers:
    """Losses of one scan at some poses, (n,) [nats].

    Parameters
    ----------
    database : Database
        What the lidar sees on the map.
    ranges : (96,) array
        Ranges of one scan, as `find_modes` takes them [m].
    poses : (n, 3) array
        x, y and heading on the map [cells, cells, rad].
    """
    from locplan._kernels.scan_losses import loss_at

    ends, last = ends_of(database, ranges), len(database.tables.corners) - 1
    losses = [loss_at(database.tables, last, ends, *pose) for pose in poses.tolist()]
    counted = _missing(database, ranges, poses) if database.matching.count_missing else 0.0
    return np.array(losses) * _nats(database) + counted


def moved_to_least(database: Database, ranges: Numbers, start: Numbers) -> tuple[Numbers, float]:
    """The pose of least loss next to a start, x, y [cells] and heading, and its loss [nats].

    Parameters
    ----------
    database : Database
        What the lidar sees on the map.
    ranges : (96,) array
        Ranges of one scan, as `find_modes` takes them [m].
    start : (3,) array
        x, y and heading on the map [cells, cells, rad].
    """
    from locplan._kernels.scan_losses import polish, refine

    ends, lever, pose = ends_of(database, ranges), turning_lever(database, ranges), start.copy()
    for level in range(len(database.tables.corners)):
        refine(database.tables, level, ends, lever, pose)
    loss = polish(database.tables, ends, lever, pose)
    if not database.fits[int(pose[1]), int(pose[0])]:
        return pose, math.inf
    missing = _missing(database, ranges, pose[None])[0] if database.matching.count_missing else 0.0
    return pose, loss * _nats(database) + missing


def _nats(database: Database) -> float:
    """Nats of one step of a kernel's loss."""
    from locplan._kernels.scan_losses import TOP

    return database.matching.nats_a_loss / TOP


def _interleaved(compared: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Numbers of the beams, every fourth first, so that a part of them covers all directions."""
    order = np.concatenate([np.arange(first, TURNS, 4) for first in (0, 2, 1, 3)])
    chosen: NDArray[np.int64] = order[compared[order]]
    return chosen


def _robot(database: Database, lidars: Numbers, heading: Numbers) -> Numbers:
    """Positions of the robot whose lidar is at x, y [cells], (n, 2)."""
    forward, left = database.lever
    cos, sin = np.cos(heading), np.sin(heading)
    return lidars - np.column_stack([cos * forward - sin * left, sin * forward + cos * left])


def _missing(database: Database, ranges: Numbers, poses: Numbers) -> Numbers:
    """What the beams without a return cost at poses where they would meet a wall, (n,) [nats]."""
    there = np.isfinite(database.scans_at(poses))
    count: Numbers = (there & np.isposinf(ranges)).sum(axis=1).astype(np.float64)
    return count * database.matching.nats_a_loss
