"""AMCL on a recorded drive: what it gets of one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan._util.poses import turning, updates_of, way_between, way_length, wrapped
from locplan.errors import RecordingError
from locplan.maps import OccupancyGrid, extent_text, own_axes
from locplan.recordings._recording import Recording
from locplan.robots import Amcl, Robot, compared_ends
from locplan.simulation import DriveArguments, drive_arguments

REPLAY = 14
"""Stream of random numbers of replays."""


def sparse_notes(recording: Recording, amcl: Amcl) -> tuple[str, ...]:
    """A note if the filter updates less often than it would with more scans, and than Nav2's does.

    Else settings that update often would make any log a sparse one.

    Parameters
    ----------
    recording : Recording
        The recording, with odometry.
    amcl : Amcl
        The filter's settings.
    """
    assert recording.odometry is not None
    updates = updates_of(recording.odometry, amcl.update_min_d, amcl.update_min_a)
    at = recording.odometry[updates, :2]
    steps = np.hypot(*np.diff(at, axis=0).T)
    spacing = float(np.median(steps)) if len(steps) else 0.0
    if spacing <= 1.5 * max(amcl.update_min_d, Amcl().update_min_d):
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
                " record it, too, or name its topic with odom_topic="
            )
        moved, reported = recording.length, way_length(recording.odometry)
        if reported < 0.1 * moved:
            raise RecordingError(
                f"the odometry moves by {reported:.1f} m, but the poses by {moved:.1f} m; is it the"
                " right topic, and was it recorded?"
            )
        x, y, _ = recording.poses[0].tolist()
        if not grid.contains(*grid.cell((x, y))):
            raise RecordingError(
                f"the drive begins at {x:.2f},{y:.2f}, off {grid.name or 'the map'}, which reaches"
                f" from {extent_text(grid)}; is it the right one? See"
                " locplan.recordings.fit_to_map"
            )
        self.odometry: Floats = recording.odometry
        self.truth = own_axes(grid, recording.poses)
        self._turn = turning(grid.origin[2])

    def arguments(self, robot: Robot, scores: NDArray[np.float32] | None = None) -> DriveArguments:
        """The arguments of the kernels; of the disturbances those of the start are read."""
        robot = replace(robot, lidar=self.recording.lidar)
        return drive_arguments(self.grid, robot, scores=scores)

    def ends(self, amcl: Amcl) -> Floats:
        """Ends of the beams that AMCL compares, (n, beams, 2) [cells]; NaN without a return."""
        ends = compared_ends(amcl, self.recording.lidar, self.recording.ranges)
        return ends / self.grid.resolution

    def track(
        self,
        random: np.random.Generator,
        ends: Floats,
        arguments: DriveArguments,
    ) -> tuple[Floats, Floats]:
        """Errors (n, 3) and covariances (n, 3, 3) of one run, in the world."""
        from locplan._kernels.drives import replay as kernel

        truth = self.truth
        poses, covariances = np.empty_like(truth), np.empty((len(truth), 3, 3))
        drive = truth[0].copy(), np.ascontiguousarray(self.odometry), ends
        settings = arguments.scores, arguments.start, arguments.filter
        kernel(random, *drive, *settings, poses, covariances)
        errors = poses - truth
        errors[:, 2] = wrapped(errors[:, 2])
        return errors @ self._turn.T, self._turn @ covariances @ self._turn.T


def without_jumps(
    poses: Floats, odometry: Floats, faulty: NDArray[np.bool_] | None = None
) -> tuple[Floats, Floats, int]:
    """Poses and odometry that both stand still where they jump apart, and the number of jumps.

    One jump would count for more than all the noise of a drive. They stand still at faulty steps,
    too.

    Parameters
    ----------
    poses, odometry : (n, 3) arrays
        Recorded poses and those by odometry [m, m, rad], each in a frame of its own.
    faulty : (n - 1,) array of bool, optional
        Mask of the steps of odometry that are wrong.

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
    left_out = far if faulty is None else far | faulty
    if not left_out.any():
        return poses, odometry, 0
    joined = _joined(poses[0], true, left_out), _joined(odometry[0], reported, left_out)
    return *joined, int(far.sum())


def _joined(first: Floats, ways: Floats, left_out: NDArray[np.bool_]) -> Floats:
    """The poses to which ways lead from the first one, but for those that are left out."""
    ahead, left, turn = np.where(left_out[:, None], 0.0, ways).T
    heading = first[2] + np.append(0.0, np.cumsum(turn))
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    x = first[0] + np.append(0.0, np.cumsum(cos * ahead - sin * left))
    y = first[1] + np.append(0.0, np.cumsum(sin * ahead + cos * left))
    return np.column_stack([x, y, wrapped(heading)])
