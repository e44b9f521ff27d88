"""Where a recorded robot was: its trajectory by odometry, scans and the map, all at once."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._kernels.arrays import Floats
from locplan._util.checks import instance, shown, whole
from locplan._util.poses import after_way, turning, way_between, wrapped
from locplan._util.progress import ProgressCallback, parts, scaled
from locplan.errors import ConfigError, RecordingError
from locplan.field import position_axes
from locplan.maps import OCCUPIED, OccupancyGrid, check_grid, extent_text, own_axes
from locplan.matching import CLEARANCE, checked_database
from locplan.recordings._chain import Chain
from locplan.recordings._odometry_model import Moves, OdometryModel
from locplan.recordings._passes import Pass, Walls
from locplan.recordings._recording import Recording
from locplan.recordings._trajectory import (
    AMBIGUOUS,
    BAD_FIT,
    JUMPED,
    MAP_MOVED,
    UNCERTAIN,
    Trajectory,
    jump_at,
)
from locplan.robots import Robot

SURE_BEAMS = 30.0
"""Number of independent beams that a scan counts as in the covariance: the map's faults count."""
KEY_WAY, KEY_TURN = 0.3, 0.2
"""Way [m] and turn [rad] from one scan that the filter takes to the next."""
FAR = 0.3
"""Distance from which on two ways are at different places [m]."""


def smooth(
    grid: OccupancyGrid,
    recording: Recording,
    robot: Robot | None = None,
    start: ArrayLike | str | None = None,
    *,
    folder: Path | None = None,
    seed: int = 1,
    progress: ProgressCallback | None = None,
) -> Trajectory:
    """Find where a robot was along a recorded drive, of its scans, its odometry and the map.

    The recorded poses are read only where the drive has no odometry, in its place, and for the
    start if that is "log". A particle filter runs along the drive in both directions, from poses of
    the whole map where it does not know better, and trajectories are drawn of what it held for
    likely. Of these the likeliest way is put together, refined with all scans at once by least
    squares, and with what that tells of odometry refined anew.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    recording : Recording
        The drive.
    robot : Robot, optional
        The robot, of which the errors of odometry are read: it may err by more than is usual.
    start : (x, y, heading) or "log", optional
        Pose of the first scan in the world [m, m, rad], to 0.5 m and 10 deg, or that of the
        recording; by default it is not known.
    folder : path, optional
        Folder for what is done so far, from which the same call goes on that was interrupted.
    seed : int, default 1
        Seed of all random numbers, >= 0.
    progress : callable, optional
        Called with (done, total) in thousandths of the work.

    Returns
    -------
    Trajectory
        The poses at all scans, how sure they are, and which are not to be trusted.

    Raises
    ------
    RecordingError
        If the map has no walls, or the drive has fewer than ten scans.
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> import locplan
    >>> from locplan.recordings import record_drive
    >>> grid = locplan.maps.environments.make("places", resolution=0.1)
    >>> robot = locplan.Robot(locplan.Lidar(range=8.0, beams=180))
    >>> drive = record_drive(grid, locplan.Path([[13.0, 5.5], [20.0, 5.5]]), robot)
    >>> found = smooth(grid, drive)
    >>> bool(found.deviation.max() < 0.1)
    True
    """
    instance("recording", recording, Recording, "read one with locplan.recordings.read_drive")
    check_grid(grid)
    whole("seed", seed, 0)
    if len(recording) < 10:
        raise RecordingError(f"the drive has {len(recording)} scans, too few: 10 are needed")
    if not (grid.cells == OCCUPIED).any():
        raise RecordingError(f"{grid.name or 'the map'} has no walls; take another map")
    robot = recording.robot(robot)
    drive = _Drive(grid, recording)
    first = _first(grid, recording, start)
    database = checked_database(grid, recording.lidar, CLEARANCE, None)
    _ = database.everywhere  # before the work that shows its progress
    chain = Chain(
        drive.walls, drive.ends[drive.keys], drive.key_moves, OdometryModel.first(robot.odometry)
    )
    forth, back = (scaled(each, 500) for each in parts(progress, [500, 500]))
    samples = drive.passed(chain, database, first, seed, folder, forth)
    # What the way forth tells of odometry serves the way back; and where it was taken for much
    # better than it is, the way forth is gone again.
    refined, first_model = chain.of_samples(samples), chain.model
    chain = chain.learning(chain.best_way(refined))
    other = drive.passed(chain, database, None, seed, folder, back, number=1, backwards=True)
    wider = chain.model.deviations(chain.moves) / first_model.deviations(chain.moves)
    if np.median(wider[1:], axis=0).max() > 1.3:
        samples = drive.passed(chain, database, first, seed, folder, back, number=2)
        refined = chain.of_samples(samples)
    return drive.put_together(chain, [samples, other], [refined, chain.of_samples(other)])


def _first(
    grid: OccupancyGrid, recording: Recording, start: ArrayLike | str | None
) -> Floats | None:
    """The pose of the first scan on the map; None if it is not known."""
    if start is None:
        return None
    try:
        log = isinstance(start, str) and start == "log"
        pose = recording.poses[0] if log else np.array(start, np.float64)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise ConfigError(f'start must be x, y, heading [m, m, rad], or "log", not {shown(start)}')
    own = np.asarray(own_axes(grid, pose[None])[0])
    if not grid.contains(*(int(own[axis] // grid.resolution) for axis in (1, 0))):
        raise ConfigError(
            f"start {pose[0]:g},{pose[1]:g} lies outside {grid.name or 'the map'}, which reaches"
            f" from {extent_text(grid)}"
        )
    return own


def key_scans(moves: Moves) -> NDArray[np.int64]:
    """Indices of the scans that a filter takes: the first and the last one, and some between."""
    way, turned, chosen = np.cumsum(moves.lengths), np.cumsum(moves.turned), [0]
    for n in range(1, len(way)):
        far = way[n] - way[chosen[-1]] >= KEY_WAY or turned[n] - turned[chosen[-1]] >= KEY_TURN
        if far or n == len(way) - 1:
            chosen.append(n)
    return np.array(chosen)


class _Drive:
    """A recorded drive on a map, whose poses are in the map's own axes."""

    def __init__(self, grid: OccupancyGrid, recording: Recording) -> None:
        self.grid, self.recording, self.walls = grid, recording, Walls(grid)
        own = recording.odometry
        self.odometry = recording.poses if own is None else own
        self.moves = Moves.of(self.odometry, np.arange(len(recording)))
        self.keys = key_scans(self.moves)
        self.key_moves = Moves.of(self.odometry, self.keys)
        self.ends = self._ends(180)

    def _ends(self, most: int) -> Floats:
        """Ends of up to so many beams on the robot, (n, b, 2) [m]."""
        lidar, ranges = self.recording.lidar, self.recording.ranges
        beams = np.unique(np.linspace(0, lidar.beams - 1, most).astype(np.int64))
        # In blocks of scans, which saves memory.
        blocks = (ranges[n : n + 256] for n in range(0, len(ranges), 256))
        return np.concatenate([lidar.ends_on_robot(each)[:, beams] for each in blocks])

    def passed(
        self,
        chain: Chain,
        database: Any,
        first: Floats | None,
        seed: int,
        folder: Path | None,
        progress: ProgressCallback,
        *,
        number: int = 0,
        backwards: bool = False,
    ) -> Floats:
        """Trajectories (40, k, 3) of a filter's way forth or back along the key scans."""
        ends, ranges = chain.ends[:, ::3], self.recording.ranges[self.keys]
        ways, deviations = chain.model.expected(chain.moves), chain.model.deviations(chain.moves)
        if backwards:
            ends, ranges = ends[::-1], ranges[::-1]
            ways[1:] = way_between(ways[1:], np.zeros_like(ways[1:]))[::-1]
            deviations[1:] = deviations[:0:-1].copy()
        one = Pass(self.walls, database, ranges, ends, ways, deviations, first, seed, number)
        samples = one.trajectories(folder, progress)
        return np.ascontiguousarray(samples[:, ::-1]) if backwards else samples

    def put_together(self, keys: Chain, samples: list[Floats], refined: list[Floats]) -> Trajectory:
        """The trajectory that both ways' samples lead to, of which some are refined."""
        candidates = np.concatenate(refined)
        best, absurd = keys.bridged(keys.best_way(candidates))
        chain = Chain(self.walls, self.ends, self.moves, keys.model)
        poses, near, jumps = self._between(chain, best, keys.jumped(best))
        chain = replace(chain, jumps=jumps)
        poses = chain.refined(poses, 15)
        for _ in range(2):
            chain = chain.learning(poses)
            poses = chain.refined(poses, 20)
        # Other ways that either pass held for likely: refined, they end in another place.
        other = (_distances(candidates, best) > FAR).any(axis=0)
        other |= (_distances(np.concatenate(samples), best) > FAR).mean(axis=0) >= 0.05
        doubts = np.zeros(len(poses), np.int64)
        fits = chain.fits(poses[None])[0]
        own = self._widened(chain.covariances(poses, SURE_BEAMS)[0], fits)
        doubts[chain.displaced(poses)] = MAP_MOVED
        doubts[other[near]] = AMBIGUOUS
        # Log-likelihood a beam below which a scan is unlike the map.
        doubts[(fits < -0.8) | absurd[near]] = BAD_FIT
        sure = (position_axes(own)[0] <= 0.15) & (np.sqrt(own[:, 2, 2]) <= math.radians(4))
        doubts[~sure] = UNCERTAIN
        for n in jumps:
            doubts[max(0, n - 1) : n + 1] = JUMPED
        return self._finished(chain, poses, own, doubts, fits)

    def _between(
        self, chain: Chain, best: Floats, jumps: tuple[int, ...]
    ) -> tuple[Floats, NDArray[np.int64], tuple[int, ...]]:
        """Poses of all scans by those of the key scans, the key of each, and where they jump.

        They follow odometry from the key scan before, but for those after a jump, which lead to the
        next one: the scans fit best so.
        """
        scans = np.arange(len(self.odometry))
        near = np.searchsorted(self.keys, scans, side="right") - 1
        after = np.searchsorted(self.keys, scans)
        forth, back = (
            after_way(best[each], way_between(self.odometry[self.keys[each]], self.odometry))
            for each in (near, after)
        )
        gains, found = np.nan_to_num(chain.fits(np.array([forth, back]))), []
        for jump in jumps:
            begin, end = self.keys[jump - 1] + 1, self.keys[jump]
            sums = [gains[0, begin:n].sum() + gains[1, n:end].sum() for n in range(begin, end + 1)]
            found.append(int(begin + np.argmax(sums)))
            forth[found[-1] : end], near[found[-1] : end] = back[found[-1] : end], jump
        return forth, near, tuple(found)

    def _widened(self, covariances: Floats, fits: Floats) -> Floats:
        """Covariances with what a map's cells and faults add, the more where it fits badly."""
        badly = np.nan_to_num(np.maximum(np.nanmedian(fits) - fits, 0.0))
        least = (0.2 * self.grid.resolution) ** 2 + 0.01**2 + (0.1 * badly) ** 2
        turn = np.full(len(fits), math.radians(0.2) ** 2)
        return covariances + np.stack([least, least, turn], axis=1)[:, :, None] * np.eye(3)

    def _finished(
        self, chain: Chain, poses: Floats, own: Floats, doubts: Any, fits: Floats
    ) -> Trajectory:
        """The trajectory in the world."""
        grid, recording = self.grid, self.recording
        x, y = grid.grid_to_world(poses[:, 1] / grid.resolution, poses[:, 0] / grid.resolution)
        world = np.column_stack([x, y, wrapped(poses[:, 2] + grid.origin[2])])
        turn, errors = turning(grid.origin[2]), chain.errors(poses)
        jumps = tuple(jump_at(n, world[n], errors[n], recording.times) for n in chain.jumps)
        return Trajectory(
            world,
            turn @ own @ turn.T,
            doubts,
            fits,
            jumps,
            None if recording.odometry is None else chain.model,
            recording.poses,
            recording.times,
            recording.source.file,
            grid.name,
            grid,
        )


def _distances(some: Floats, other: Floats) -> Floats:
    """Distances of positions [m]."""
    return np.asarray(np.hypot(*np.moveaxis(some[..., :2] - other[..., :2], -1, 0)))
