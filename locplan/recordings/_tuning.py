"""AMCL's settings tuned on stretches of a recorded drive."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import check_threads, instance, whole
from locplan._util.intervals import random_of
from locplan._util.poses import Numbers
from locplan._util.progress import ProgressCallback
from locplan.errors import RecordingError
from locplan.maps import OccupancyGrid, check_grid
from locplan.recordings._recording import Recording
from locplan.recordings._tracks import REPLAY, Tracks, sparse_notes
from locplan.robots import Amcl, Robot
from locplan.simulation import (
    BeamsLeft,
    DisturbanceLevel,
    Tuning,
    TuningBench,
    check_drives,
    check_filter_map,
    search_settings,
)

DRIVES = 8
"""Number of replays of each stretch."""
RECORDED = DisturbanceLevel("recorded", 1.0, 1.0)
"""The only level of a recorded drive."""
MIN_LENGTH = 30.0
"""Length of a drive below which nothing is tuned on it [m]."""
MIN_SCANS = 3
"""Number of scans that a stretch must have."""


class RecordedBench(TuningBench):
    """Replays of settings on some stretches of a recorded drive.

    Parameters
    ----------
    grid : OccupancyGrid
        The map that was driven in.
    tracks : Tracks
        What the filter gets of the drive.
    stretches : sequence of slice
        The scans of each stretch.
    robot : Robot
        Its disturbances are read for the deviation of the filter's first poses.
    drives : int
        Greatest number of replays of each stretch.
    seed, threads : int
        Seed of all random numbers, and number of threads.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        tracks: Tracks,
        stretches: Sequence[slice],
        robot: Robot,
        drives: int,
        *,
        seed: int,
        threads: int,
    ) -> None:
        lines = [tracks.truth[each] for each in stretches]
        own: Any = {"seed": seed, "threads": threads}
        lidar = tracks.recording.lidar
        super().__init__(grid, tracks.grid, lidar, [RECORDED], lines, drives, **own)
        self._tracks, self._stretches, self._robot = tracks, stretches, robot

    def arguments(self, amcl: Amcl) -> list[Any]:
        """The ends of beams that the filter compares, and the kernel's arguments."""
        ends, robot = self._tracks.ends(amcl), dataclasses.replace(self._robot, filter=amcl)
        return [(ends, self._tracks.arguments(robot, self.scores(amcl)))]

    def errors(self, level: int, path: int, drive: int, arguments: Any) -> NDArray[np.float64]:
        """Errors of one replay, in the world."""
        random = random_of(self.seed, REPLAY, path, drive)
        ends, own = arguments
        return self._tracks.track(random, ends, own, self._stretches[path])[0]


def tune_on_drive(
    recording: Recording,
    grid: OccupancyGrid,
    robot: Robot | None = None,
    *,
    drives: int = DRIVES,
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
    ends = tracks.ends(robot.filter)
    left = BeamsLeft(ends.shape[1], float(np.isfinite(ends[..., 0]).sum(axis=1).mean()))

    def bench_of(own_seed: int, judging: bool) -> RecordedBench:
        some = halves[judging][:paths]
        return RecordedBench(grid, tracks, some, robot, drives, seed=own_seed, threads=workers)

    return search_settings(
        bench_of,
        robot,
        paths,
        drives,
        left=left,
        others=others,
        seed=seed,
        progress=progress,
        drive=recording.source.file or "the drive",
        notes=sparse_notes(recording, robot.filter),
    )


def _stretches(recording: Recording) -> list[slice]:
    """The scans of equally long stretches of a drive, one after the other."""
    if recording.length < MIN_LENGTH:
        raise RecordingError(
            f"the drive is {recording.length:.1f} m long, and tuning needs {MIN_LENGTH:g} m at"
            " least; record a longer one"
        )
    way: Numbers = np.concatenate(
        [[0.0], np.cumsum(np.hypot(*np.diff(recording.poses[:, :2], axis=0).T))]
    )
    count = max(2 * TuningBench.fewest_paths, int(np.ceil(way[-1] / TuningBench.longest)))
    edges = np.searchsorted(way, np.linspace(0.0, way[-1], count + 1))
    edges[-1] = len(way)
    if np.diff(edges).min() < MIN_SCANS:
        raise RecordingError(
            f"the drive has {len(recording)} scans, too sparse to tune on: stretches of"
            f" {way[-1] / count:.1f} m have fewer than {MIN_SCANS}; record more scans"
        )
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
