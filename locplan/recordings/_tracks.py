"""AMCL on a recorded drive: what it gets of one, and its settings tuned on stretches of it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import check_threads, instance, whole
from locplan._util.intervals import random_of
from locplan._util.poses import (
    Numbers,
    turning,
    updates_of,
    way_along,
    way_between,
    way_length,
    wrapped,
)
from locplan._util.progress import ProgressCallback
from locplan.errors import RecordingError
from locplan.maps import OccupancyGrid, check_grid, own_axes
from locplan.recordings._recording import Recording
from locplan.robots import Amcl, Robot, compared_ends
from locplan.simulation import (
    BeamsLeft,
    DisturbanceLevel,
    DriveArguments,
    Tuning,
    TuningBench,
    check_drives,
    check_filter_map,
    drive_arguments,
    search_settings,
)

REPLAY = 14
"""Stream of random numbers of replays."""


def sparse_notes(recording: Recording, amcl: Amcl) -> tuple[str, ...]:
    """A note if the filter updates less often than it would with more scans."""
    assert recording.odometry is not None
    updates = updates_of(recording.odometry, amcl.update_min_d, amcl.update_min_a)
    at = recording.odometry[updates, :2]
    steps = np.hypot(*np.diff(at, axis=0).T)
    spacing = float(np.median(steps)) if len(steps) else 0.0
    if spacing <= 1.5 * amcl.update_min_d:
        return ()
    return (
        f"the filter updated every {spacing:.2g} m for lack of scans, in place of every"
        f" {amcl.update_min_d:g} m: with all scans of the robot it errs less",
    )


class Tracks:
    """What the filter gets of a recorded drive, in a map's own axes.

    Raises
    ------
    RecordingError
        If the drive has no odometry, or its first pose is not on the map.
    """

    def __init__(self, recording: Recording, grid: OccupancyGrid) -> None:
        self.recording, self.grid = recording, grid
        if recording.odometry is None:
            raise RecordingError(
                f"{recording.source.file or 'the recording'} has no odometry, which a replay needs;"
                " record it, too, or name its topic (--odom-topic, odom_topic=)"
            )
        moved, reported = recording.length, way_length(recording.odometry)
        if reported < 0.1 * moved:
            raise RecordingError(
                f"the odometry moves by {reported:.1f} m, but the poses by {moved:.1f} m; is it the"
                " right topic, and was it recorded?"
            )
        x, y, _ = recording.poses[0].tolist()
        if not grid.contains(*grid.world_to_cell(x, y)):
            raise RecordingError(
                f"the drive begins at {x:.2f},{y:.2f}, off {grid.name or 'the map'}; is it the"
                " right one? See locplan.recordings.fit_to_map"
            )
        self.odometry: Numbers = recording.odometry
        self.truth = own_axes(grid, recording.poses)
        self._turn = turning(grid.origin[2])

    def arguments(self, robot: Robot, scores: NDArray[np.float32] | None = None) -> DriveArguments:
        """The arguments of the kernels; of the disturbances those of the start are read."""
        robot = replace(robot, lidar=self.recording.lidar)
        return drive_arguments(self.grid, robot, scores=scores)

    def ends(self, amcl: Amcl) -> Numbers:
        """Ends of the beams that AMCL compares, (n, beams, 2) [cells]; NaN without a return."""
        ends = compared_ends(amcl, self.recording.lidar, self.recording.ranges)
        return ends / self.grid.resolution

    def track(
        self,
        random: np.random.Generator,
        ends: Numbers,
        arguments: DriveArguments,
        part: slice = slice(None),
    ) -> tuple[Numbers, Numbers]:
        """Errors (n, 3) and covariances (n, 3, 3) of one run on a part of the drive, in the world.

        `ends` are those of the whole drive.
        """
        from locplan._kernels.drives import replay as kernel

        truth, odometry = self.truth[part], self.odometry[part]
        poses, covariances = np.empty_like(truth), np.empty((len(truth), 3, 3))
        drive = truth[0].copy(), np.ascontiguousarray(odometry), ends[part]
        settings = arguments.scores, arguments.start, arguments.filter
        kernel(random, *drive, *settings, poses, covariances)
        errors = poses - truth
        errors[:, 2] = wrapped(errors[:, 2])
        return errors @ self._turn.T, self._turn @ covariances @ self._turn.T


def without_jumps(poses: Numbers, odometry: Numbers) -> tuple[Numbers, Numbers, int]:
    """Poses and odometry that both stand still where they jump apart, and the number of jumps.

    One jump would count for more than all the noise of a drive.

    Parameters
    ----------
    poses, odometry : (n, 3) arrays
        Recorded poses and those by odometry [m, m, rad], each in a frame of its own.

    Examples
    --------
    >>> poses = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    >>> still, odometry, jumps = without_jumps(poses, poses + [[5.0, 0, 0], [5.0, 0, 0], [0, 0, 0]])
    >>> still[:, 0].tolist(), odometry[:, 0].tolist(), jumps
    ([0.0, 1.0, 1.0], [5.0, 6.0, 6.0], 1)
    """
    true, reported = (way_between(each[:-1], each[1:]) for each in (poses, odometry))
    off = reported - true
    apart, true_way, way = (np.hypot(each[:, 0], each[:, 1]) for each in (off, true, reported))
    # Half a metre or half a radian, and three tenths of the step, are no jump yet.
    far = apart > 0.5 + 0.3 * np.minimum(true_way, way)
    far |= np.abs(wrapped(off[:, 2])) > 0.5 + 0.3 * np.abs(wrapped(true[:, 2]))
    if not far.any():
        return poses, odometry, 0
    joined = _joined(poses[0], true, far), _joined(odometry[0], reported, far)
    return *joined, int(far.sum())


def _joined(first: Numbers, ways: Numbers, left_out: NDArray[np.bool_]) -> Numbers:
    """The poses to which ways lead from the first one, but for those that are left out."""
    ahead, left, turn = np.where(left_out[:, None], 0.0, ways).T
    heading = first[2] + np.append(0.0, np.cumsum(turn))
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    x = first[0] + np.append(0.0, np.cumsum(cos * ahead - sin * left))
    y = first[1] + np.append(0.0, np.cumsum(sin * ahead + cos * left))
    return np.column_stack([x, y, wrapped(heading)])


@dataclass(eq=False, repr=False)
class RecordedBench(TuningBench):
    """Replays of settings on some stretches of a recorded drive."""

    tracks: Tracks
    """What the filter gets of the drive."""
    stretches: Sequence[slice]
    """The scans of each stretch."""
    robot: Robot
    """Its disturbances are read for the deviation of the filter's first poses."""

    def arguments(self, amcl: Amcl) -> list[Any]:
        """The ends of beams that the filter compares, and the kernel's arguments."""
        ends, robot = self.tracks.ends(amcl), replace(self.robot, filter=amcl)
        return [(ends, self.tracks.arguments(robot, self.scores(amcl)))]

    def errors(self, level: int, path: int, drive: int, arguments: Any) -> NDArray[np.float64]:
        """Errors of one replay, in the world."""
        random = random_of(self.seed, REPLAY, path, drive)
        ends, own = arguments
        return self.tracks.track(random, ends, own, self.stretches[path])[0]


def tune_on_drive(
    recording: Recording,
    grid: OccupancyGrid,
    robot: Robot | None = None,
    *,
    drives: int = 8,
    filter_map: OccupancyGrid | None = None,
    others: Mapping[str, object] | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Tuning:
    """Find settings of AMCL that localize a robot better on its recorded drive than its own ones.

    The drive is cut into stretches of up to 16 m. Settings are searched on every other one as
    `locplan.simulation.tune` does on simulated paths, and what was found is judged against the
    user's own on the others. There is but one level of disturbance, that of the recording; and the
    recorded poses are the reference, so that they should not be those of the filter to be tuned.

    Parameters
    ----------
    recording : Recording
        The drive, with odometry.
    grid : OccupancyGrid
        The map; the poses are in its world frame.
    robot : Robot, optional
        The robot, from whose filter the search begins, with the deviation of the filter's first
        pose on a stretch; Nav2's defaults without it.
    drives : int, default 8
        Number of replays of each stretch, 2 to 100,000.
    filter_map : OccupancyGrid, optional
        The filter's map in the same frame, where it differs from `grid`.
    others : mapping of str to object, optional
        Further parameters in the user's file, such as `z_short`, for the warnings.
    seed : int, default 1
        Seed of all random numbers, >= 0.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) in thousandths of the work.

    Returns
    -------
    Tuning
        The settings to use, and the evidence for them.

    Raises
    ------
    RecordingError
        If the drive has no odometry, is shorter than 30 m, or has too few scans.
    ConfigError
        If a number is out of its range.

    Examples
    --------
    >>> import locplan
    >>> from locplan.recordings import record_drive
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> path = locplan.plan(locplan.Costmap.blank(grid), (2.0, 3.0), (36.0, 3.0)).path
    >>> robot = locplan.Robot(locplan.Lidar(range=6.0, beams=60))
    >>> drive = record_drive(grid, path, robot)
    >>> own = robot.changed({"min_particles": 20, "max_particles": 20})
    >>> tune_on_drive(drive, grid, own, drives=2).winner.max_particles
    20
    """
    instance("recording", recording, Recording, "read one with locplan.recordings.read_drive")
    check_grid(grid)
    check_drives(drives)
    whole("seed", seed, 0)
    workers = check_threads(threads)
    robot = recording.robot(robot)
    tracks = Tracks(recording, check_filter_map(filter_map, grid))
    stretches = _stretches(recording)
    halves = stretches[::2], stretches[1::2]
    paths = len(halves[1])  # never more than those of the search
    ends = tracks.ends(robot.amcl)
    left = BeamsLeft(ends.shape[1], float(np.isfinite(ends[..., 0]).sum(axis=1).mean()))

    def bench_of(own_seed: int, judging: bool) -> RecordedBench:
        some = halves[judging][:paths]
        lines, level = [tracks.truth[each] for each in some], DisturbanceLevel("recorded", 1.0, 1.0)
        common = grid, tracks.grid, recording.lidar, [level], lines, drives, own_seed, workers
        return RecordedBench(*common, tracks, some, robot)

    name, notes = recording.source.file or "the drive", sparse_notes(recording, robot.amcl)
    own: Any = {"left": left, "others": others, "seed": seed, "progress": progress}
    return search_settings(bench_of, robot, paths, drives, drive=name, notes=notes, **own)


def _stretches(recording: Recording) -> list[slice]:
    """The scans of equally long stretches of a drive, one after the other."""
    way = way_along(recording.poses)
    if way[-1] < 30:
        raise RecordingError(
            f"the drive is {way[-1]:.1f} m long, and tuning needs 30 m at least; record a longer"
            " one"
        )
    count = max(2 * TuningBench.fewest_paths, int(np.ceil(way[-1] / TuningBench.longest)))
    edges = np.searchsorted(way, np.linspace(0.0, way[-1], count + 1))
    edges[-1] = len(way)
    if np.diff(edges).min() < 3:
        raise RecordingError(
            f"the drive has {len(recording)} scans, too sparse to tune on: stretches of"
            f" {way[-1] / count:.1f} m have fewer than 3; record more scans"
        )
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
