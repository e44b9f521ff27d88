"""Where a recorded robot was: its trajectory by odometry, scans and the map, all at once."""

from __future__ import annotations

import itertools
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._util.checks import check_threads, instance, shown, whole
from locplan._util.poses import Numbers, after_way, turning, way_between, wrapped
from locplan._util.progress import ProgressCallback, parts, scaled
from locplan.errors import ConfigError, RecordingError
from locplan.maps import OCCUPIED, OccupancyGrid, check_grid, own_axes
from locplan.matching import CLEARANCE, checked_database
from locplan.recordings._odometry_model import Moves, OdometryModel, ways_of
from locplan.recordings._passes import BEAMS, UNEXPLAINED, Pass, Walls, scoring
from locplan.recordings._recording import Recording
from locplan.recordings._trajectory import (
    AMBIGUOUS,
    BAD_FIT,
    DISAGREE,
    JUMPED,
    UNCERTAIN,
    Jump,
    Trajectory,
)
from locplan.robots import Robot

KEY_WAY, KEY_TURN = 0.3, 0.2
"""Way [m] and turn [rad] from one scan that the filter takes to the next."""
REFINED = 16
"""Number of a pass's trajectories that are refined."""
FINE, FINE_BEAMS, SURE_BEAMS = 0.1, 150.0, 30.0
"""Deviation of beams' ends in least squares [m], and the number of independent beams that a scan
counts as there, and in the covariance, where the map's faults count, too."""
APART = 0.5
"""Way from which on scans are independent of each other [m]."""


def smooth(
    grid: OccupancyGrid,
    recording: Recording,
    robot: Robot | None = None,
    start: ArrayLike | str | None = None,
    *,
    folder: Path | None = None,
    seed: int = 1,
    threads: int | None = None,
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
    threads : int, optional
        Number of threads, at least 1, of which two are used; the result does not depend on it.
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
    workers = min(2, check_threads(threads))
    if len(recording) < 10:
        raise RecordingError(f"the drive has {len(recording)} scans, too few: 10 are needed")
    if not (grid.cells == OCCUPIED).any():
        raise RecordingError(f"{grid.name or 'the map'} has no walls; take another map")
    robot = recording.robot(robot)
    drive = _Drive(grid, recording)
    first = _first(recording, start)
    first = None if first is None else own_axes(grid, first[None])[0]
    model = OdometryModel.first(robot.odometry)
    filtering, last = (scaled(each, n) for each, n in zip(parts(progress, [900, 100]), (900, 100), strict=False))
    database = checked_database(grid, recording.lidar, CLEARANCE, None)
    database.prepare()
    passes = drive.passes(model, database, first, seed)
    samples = _run(passes, folder, workers, filtering)
    found = drive.put_together(samples, model)
    last(1, 1)
    return found


def _first(recording: Recording, start: ArrayLike | str | None) -> Numbers | None:
    """The pose of the first scan in the world; None if it is not known."""
    if start is None:
        return None
    if isinstance(start, str):
        if start != "log":
            raise ConfigError(f'start must be a pose, "log" or None, not {shown(start)}')
        return recording.poses[0]
    try:
        pose = np.array(start, np.float64)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise ConfigError(f"start must be x, y, heading [m, m, rad], not {shown(start)}")
    return pose


def _run(
    passes: list[Pass], folder: Path | None, workers: int, progress: ProgressCallback
) -> list[Numbers]:
    """Trajectories of both passes, at once if there are two threads."""
    steps = [0, 0]

    def told(n: int) -> ProgressCallback:
        def update(done: int, total: int) -> None:
            steps[n] = done
            progress(sum(steps), 2 * total)

        return update

    with ThreadPoolExecutor(workers) as pool:
        running = [pool.submit(each.trajectories, folder, told(n)) for n, each in enumerate(passes)]
        forth, back = (each.result() for each in running)
    return [forth, np.ascontiguousarray(back[:, ::-1])]


def key_scans(moves: Moves) -> NDArray[np.int64]:
    """Indices of the scans that a filter takes: the first and the last one, and some between."""
    way, turned, chosen = np.cumsum(moves.lengths), np.cumsum(moves.turned), [0]
    for n in range(1, len(way)):
        far = way[n] - way[chosen[-1]] >= KEY_WAY or turned[n] - turned[chosen[-1]] >= KEY_TURN
        if far or n == len(way) - 1:
            chosen.append(n)
    return np.array(chosen)


@dataclass(frozen=True, eq=False)
class _Chain:
    """Some scans of a drive one after the other, and the least squares of their poses."""

    walls: Walls
    ends: Numbers
    moves: Moves
    model: OdometryModel
    jumps: tuple[int, ...] = ()
    """Scans that odometry does not lead to."""

    def _odometry(self) -> tuple[Numbers, Numbers]:
        """The ways by odometry, and the scales of their errors: infinite at jumps."""
        deviations = self.model.deviations(self.moves)
        deviations[list(self.jumps)] = np.inf
        return self.model.expected(self.moves), deviations

    @property
    def _shares(self) -> Numbers:
        """The share of each scan that is independent of the one before."""
        shares = np.minimum(1.0, self.moves.lengths / APART)
        shares[0] = 1.0
        return np.asarray(shares)

    def refined(self, poses: Numbers, rounds: int) -> Numbers:
        """Poses of less loss."""
        from locplan._kernels.trajectory import refine_poses

        poses = np.array(poses)
        beams = scoring(FINE, FINE_BEAMS)
        distances = self.walls.distances
        refine_poses(distances, beams, self.ends, self._shares, poses, *self._odometry(), rounds)
        return poses

    def fits(self, candidates: Numbers) -> Numbers:
        """Log-likelihoods a beam of the scans at poses (c, n, 3), (c, n); NaN without returns."""
        from locplan._kernels.trajectory import fits_along

        fits = np.empty(candidates.shape[:2])
        fits_along(self.walls.distances, scoring(0.15, BEAMS), self.ends, candidates, fits)
        return fits

    def best_way(self, candidates: Numbers) -> Numbers:
        """The likeliest way over the poses of some candidates (c, n, 3), (n, 3)."""
        from locplan._kernels.trajectory import best_way

        gains = BEAMS * np.maximum(np.nan_to_num(self.fits(candidates)), UNEXPLAINED)
        way = best_way(candidates, gains, *self._odometry(), self.walls.kidnapped)
        return np.asarray(candidates[way, np.arange(len(way))])

    def covariances(self, poses: Numbers, beams: float) -> tuple[Numbers, Numbers]:
        """Covariance of each pose, and with the one before, of so many independent beams."""
        from locplan._kernels.trajectory import covariances_of, normal_equations

        blocks = [np.empty((len(poses), 3, 3)) for _ in range(4)]
        normal_equations(
            self.walls.distances,
            scoring(FINE, beams),
            self.ends,
            self._shares,
            poses,
            *self._odometry(),
            *blocks[:2],
            np.empty((len(poses), 3)),
        )
        covariances_of(*blocks)
        return blocks[2], blocks[3]

    def errors(self, poses: Numbers) -> Numbers:
        """How odometry errs from one pose to the next, (n, 3) [m, m, rad]."""
        errors = np.zeros((len(poses), 3))
        errors[1:] = way_between(poses[:-1], poses[1:]) - self.model.expected(self.moves)[1:]
        errors[:, 2] = wrapped(errors[:, 2])
        return errors

    def jumped(self, poses: Numbers) -> tuple[int, ...]:
        """The scans to which odometry does not lead: far off, and far beyond its errors."""
        errors = self.errors(poses)
        square = ((errors / self.model.deviations(self.moves)) ** 2).sum(axis=1)
        far = (np.hypot(errors[:, 0], errors[:, 1]) > 0.5) | (np.abs(errors[:, 2]) > 0.5)
        return tuple(map(int, np.flatnonzero(far & (square > 40.0))))

    def bridged(self, poses: Numbers) -> Numbers | None:
        """Poses that follow odometry between each two jumps; None if there are no two."""
        jumps = self.jumped(poses)
        if len(jumps) < 2:
            return None
        found, ways = poses.copy(), self.model.expected(self.moves)
        for begin, end in itertools.pairwise(jumps):
            for n in range(begin, end):
                found[n] = after_way(found[n - 1], ways[n])
            closing = found[end] - after_way(found[end - 1], ways[end])
            closing[2] = wrapped(closing[2])
            share = np.arange(1, end - begin + 1) / (end - begin + 1)
            found[begin:end] += share[:, None] * closing
        return found

    def learning(self, poses: Numbers) -> _Chain:
        """The same scans with what poses tell of odometry."""
        own, across = self.covariances(poses, FINE_BEAMS)
        used = np.ones(len(poses))
        used[[0, *self.jumps]] = 0.0
        model = self.model.learned(self.moves, *ways_of(poses, own, across), used)
        return _Chain(self.walls, self.ends, self.moves, model, self.jumps)


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

    def _ends(self, most: int) -> Numbers:
        """Ends of up to so many beams on the robot, (n, b, 2) [m]."""
        lidar = self.recording.lidar
        beams = np.unique(np.linspace(0, lidar.beams - 1, most).astype(np.int64))
        ends = [
            self.recording[n : n + 1].ends_on_robot()[:, beams]
            if np.isfinite(self.recording.ranges[n]).any()
            else np.full((1, len(beams), 2), np.nan)
            for n in range(len(self.recording))
        ]
        return np.concatenate(ends)

    def passes(
        self, model: OdometryModel, database: Any, first: Numbers | None, seed: int
    ) -> list[Pass]:
        """The filter's way forth, and back."""
        ends, ranges = self.ends[self.keys, ::3], self.recording.ranges[self.keys]
        ways, deviations = model.expected(self.key_moves), model.deviations(self.key_moves)
        back = np.zeros_like(ways)
        back[1:] = way_between(ways[1:], np.zeros_like(ways[1:]))[::-1]
        back_deviations = np.concatenate([deviations[:1], deviations[:0:-1]])
        return [
            Pass(self.walls, database, ranges, ends, ways, deviations, first, seed, 0),
            Pass(
                *(self.walls, database, ranges[::-1], ends[::-1], back, back_deviations),
                *(None, seed, 1),
            ),
        ]

    def put_together(self, samples: list[Numbers], model: OdometryModel) -> Trajectory:
        """The trajectory that both passes' samples lead to."""
        keys = _Chain(self.walls, self.ends[self.keys], self.key_moves, model)
        refined = [np.array([keys.refined(each, 3) for each in some[:REFINED]]) for some in samples]
        apart = _distance(*(keys.best_way(each) for each in refined))
        candidates = np.concatenate(refined)
        best = keys.best_way(candidates)
        if (bridged := keys.bridged(best)) is not None:
            best = keys.best_way(np.concatenate([candidates, bridged[None]]))
        near = np.searchsorted(self.keys, np.arange(len(self.moves.lengths)), side="right") - 1
        way = way_between(self.odometry[self.keys[near]], self.odometry)
        jumps = tuple(int(n) for n in self.keys[list(keys.jumped(best))])
        chain = _Chain(self.walls, self.ends, self.moves, model, jumps)
        poses = chain.refined(after_way(best[near], way), 15)
        for _ in range(2):
            chain = chain.learning(poses)
            poses = chain.refined(poses, 20)
        far = [(_distances(each, best) > 0.5).mean(axis=0) > 0.05 for each in samples]
        doubts = np.zeros(len(poses), np.int64)
        fits = chain.fits(poses[None])[0]
        own = self._widened(chain.covariances(poses, SURE_BEAMS)[0])
        doubts[(apart > 0.3)[near]] = DISAGREE
        doubts[(far[0] & far[1])[near]] = AMBIGUOUS
        doubts[fits < np.nanmedian(fits) - 0.25] = BAD_FIT
        doubts[~(_deviations(own) <= (0.15, math.radians(4))).all(axis=1)] = UNCERTAIN
        for n in jumps:
            doubts[max(0, n - 1) : n + 1] = JUMPED
        return self._finished(chain, poses, own, doubts, fits)

    def _widened(self, covariances: Numbers) -> Numbers:
        """Covariances with what a map's cells and faults add."""
        least = (0.2 * self.grid.resolution) ** 2 + 0.01**2
        return covariances + np.diag([least, least, math.radians(0.2) ** 2])

    def _finished(
        self, chain: _Chain, poses: Numbers, own: Numbers, doubts: Any, fits: Numbers
    ) -> Trajectory:
        """The trajectory in the world."""
        grid, recording = self.grid, self.recording
        x, y = grid.grid_to_world(poses[:, 1] / grid.resolution, poses[:, 0] / grid.resolution)
        world = np.column_stack([x, y, wrapped(poses[:, 2] + grid.origin[2])])
        turn, errors = turning(grid.origin[2]), chain.errors(poses)
        jumps = tuple(Jump.of(n, world[n], errors[n], recording.times) for n in chain.jumps)
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


def _distances(some: Numbers, other: Numbers) -> Numbers:
    """Distances of positions [m]."""
    return np.asarray(np.hypot(*np.moveaxis(some[..., :2] - other[..., :2], -1, 0)))


def _distance(some: Numbers, other: Numbers) -> Numbers:
    return _distances(some, other)


def _deviations(covariances: Numbers) -> Numbers:
    """Largest deviations of the position, and those of the heading, (n, 2) [m, rad]."""
    from locplan.field import position_axes

    return np.column_stack([position_axes(covariances)[0], np.sqrt(covariances[:, 2, 2])])
