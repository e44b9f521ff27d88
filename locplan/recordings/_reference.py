"""The poses of a recorded drive that count as true: the log's own, or smoothed ones, kept."""

from __future__ import annotations

import hashlib
import os
from dataclasses import replace
from pathlib import Path

from numpy.typing import ArrayLike

from locplan._util.checks import instance, one_of
from locplan._util.progress import ProgressCallback
from locplan.field import load_or_compute_result
from locplan.maps import OccupancyGrid, check_grid
from locplan.recordings._recording import Recording
from locplan.recordings._smoothing import smooth
from locplan.recordings._trajectory import SMOOTHED, Trajectory
from locplan.robots import Robot

VERSION = 4
"""Version of what `smooth` finds, which rises when it finds something else."""


def trajectory_of(
    recording: Recording,
    grid: OccupancyGrid,
    robot: Robot | None = None,
    *,
    start: ArrayLike | str | None = None,
    seed: int = 1,
    cache_dir: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | None = None,
) -> Trajectory:
    """Return the trajectory that `smooth` finds, from the cache if it was found before.

    An interrupted call resumes.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map.
    robot, start, seed, progress
        See `smooth`.
    cache_dir : path, optional
        Cache folder; by default LOCPLAN_CACHE of the environment, or else the user's.

    Raises
    ------
    LocplanError
        As for `smooth`.
    """
    instance("recording", recording, Recording, "read one with locplan.recordings.read_recording")
    check_grid(grid)

    def compute(parts: Path | None) -> Trajectory:
        return smooth(grid, recording, robot, start, folder=parts, seed=seed, progress=progress)

    def save(file: Path, trajectory: Trajectory) -> None:
        trajectory.write(file)

    key = _digest(recording, grid, robot, start, seed)
    trajectory = load_or_compute_result(key, Trajectory.load, compute, save, cache_dir=cache_dir)
    # The names are not in the digest.
    return replace(trajectory, grid=grid, map=grid.name, drive=recording.source.file)


def referenced(
    recording: Recording,
    grid: OccupancyGrid,
    reference: str | None = None,
    robot: Robot | None = None,
    *,
    cache_dir: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | None = None,
) -> Recording:
    """The recording with the poses that count as true.

    Smoothed poses that are not to be trusted are left out, with their scans.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map.
    reference : {"log", "smoothed"}, optional
        The log's own poses, or those of `smooth`; by default these of a bag, which does not tell
        whether its poses are a filter's, and the log's own of other files.
    robot, cache_dir, progress
        See `trajectory_of`.

    Raises
    ------
    LocplanError
        As for `trajectory_of`.
    """
    if reference is not None:
        one_of("reference", reference, ("log", SMOOTHED))
    of_bag = bool(recording.source.lidar_frame)  # other files name none
    if recording.source.poses == SMOOTHED or (reference or ("log", SMOOTHED)[of_bag]) == "log":
        return recording
    found = trajectory_of(recording, grid, robot, cache_dir=cache_dir, progress=progress)
    return found.of(recording)


def _digest(
    recording: Recording,
    grid: OccupancyGrid,
    robot: Robot | None,
    start: ArrayLike | str | None,
    seed: int,
) -> str:
    """What a trajectory is found by: all that it depends on."""
    odometry = recording.robot(robot).odometry
    about = VERSION, grid.digest, repr(recording.lidar), repr(odometry), repr(start), seed
    digest = hashlib.sha256(repr(about).encode())
    for array in (recording.ranges, recording.poses, recording.times, recording.odometry):
        digest.update(b"-" if array is None else array.tobytes())
    return digest.hexdigest()[:32]
